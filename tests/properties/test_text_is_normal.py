"""Laws of text in normal form: total for every str, the same when done twice, and every position maps back."""

import unicodedata

from hypothesis import example, given
from hypothesis import strategies as st

from fapengine.speech.text.normal_form import speakable

ANY = st.text(st.characters(codec=None, categories=None), max_size=40) | st.text(
    # Where the rules meet: marks, joiners, jamo, surrogates, forms, terminal codes.
    st.sampled_from(
        "aeé\u0301\u0323\u0327\u093c\u0e32\u0e48\u0e33\u09c7\u09be\u1100\u1161\u11a8\uac00かカｶﾞﾟ\u3099Ａ１＜＆①Ⅷ𝐇ℎ№℃½ﷺﻻﹰ\u0627\u0653"
        "\u200b\u200c\u200d\u00ad\ufeff\u202e\x00\x07\x1b[31m\x9b\n\r\t\x85\u2028 \ud83d\ude00\ud800\udc00"
        "😀👩\ufe0fक\u094dก"
    ),
    max_size=12,
)


@given(ANY)
@example("\ufb50\u0301\u0323")
@example("\x1b\x00[31m")
def test_twice_is_once(text: str) -> None:
    once = speakable(text)
    assert speakable(once.text).text == once.text
    assert speakable(once.text).replaced == 0


@given(ANY)
def test_it_is_composed_and_encodable(text: str) -> None:
    formed = speakable(text).text
    assert unicodedata.is_normalized("NFC", formed)
    formed.encode()
    assert not any(unicodedata.category(char) in ("Cc", "Cs") for char in formed if char not in "\t\n\r")


@given(ANY)
def test_every_position_maps_back(text: str) -> None:
    formed = speakable(text)
    assert len(formed.starts) == len(formed.stops) == len(formed.text)
    assert list(formed.starts) == sorted(formed.starts)
    assert list(formed.stops) == sorted(formed.stops)
    for char, start, stop in zip(formed.text, formed.starts, formed.stops, strict=True):
        assert 0 <= start < stop <= len(text)
        stretch = speakable(text[start:stop]).text
        assert char in stretch or char in "\u200c\u200d \ufffd\uff9e\uff9f"  # which depend on what stands before


@given(
    st.text(
        st.characters(codec="ascii", exclude_categories=["Cc"]) | st.sampled_from("éßøčğñő中日あア한안\n"), max_size=40
    )
)
def test_plain_text_stays(text: str) -> None:
    formed = speakable(text)
    assert formed.text == text
    assert formed.starts == tuple(range(len(text)))


@given(st.lists(st.text(st.characters(codec="utf-8", categories=["L", "N", "M", "P"]), max_size=6), max_size=5))
def test_words_apart_are_formed_apart(words: list[str]) -> None:
    assert speakable(" ".join(words)).text.split(" ") == " ".join(
        speakable(f" {word}").text[1:] for word in words
    ).split(" ")
