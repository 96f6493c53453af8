"""Text in normal form: what is dropped, composed and made plain. The laws are in tests/properties."""

import pytest

from fapengine.speech.text.normal_form import decoded, same_word, speakable

CASES = [
    ("plain text, 1,234.50!", "plain text, 1,234.50!"),
    ("cafe\u0301 \u1112\u1161\u11ab", "café 한"),
    ("a\0b\x07c\x7f", "abc"),
    ("a\x0bb\x85c\u2028d\re\r\nf\tg", "a\nb\nc\nd\re\r\nf\tg"),
    ("\x1b[1;31mred\x1b[0m \x1b]0;title\x07x \x9b2Jy", "red x y"),
    ("wor\u00adld \ufeffHe\u200bllo\u2060 \u202eabc\u202c \u200fא", "world Hello abc א"),
    ("می\u200cرویم a\u200cb a\u200db क\u094d\u200dष", "می\u200cرویم ab ab क\u094d\u200dष"),
    ("👩\u200d👧 ❤\ufe0f\u200d🔥", "👩\u200d👧 ❤\ufe0f\u200d🔥"),
    ("สวัสดี\u200bครับ", "สวัสดี ครับ"),
    ("\u0600١", "\u0600١"),
    ("Ｈｅｌｌｏ１ ＡＢ，１：ｱｶﾞ ｡", "Hello1 AB，1：アガ 。"),
    ("＜ｂ＞ ＆", "＜b＞ ＆"),
    ("𝐇𝓮𝕝𝟙 ℋℎℂ", "Hel1 HhC"),
    ("① ⑽ Ⓐ Ⅷ ⅳ", "1 (10) A VIII iv"),
    ("½ ² ﬁ № ™ ª", "½ ² ﬁ № ™ ª"),
    ("℃", "°C"),
    ("＆ﾞ ＜ﾞ", "＆ﾞ ＜ﾞ"),
    ("\ufefb \ufee1", "لا م"),
    ("\ud83d\ude00 \ud800 \udc00", "😀 \ufffd \ufffd"),
]


@pytest.mark.parametrize(("text", "form"), CASES)
def test_form(text: str, form: str) -> None:
    assert speakable(text).text == form


def test_stretches_of_the_original() -> None:
    formed = speakable("\x1b[1ma\u0323\u0302 wor\u00adld ℃!")
    assert formed.text == "ậ world °C!"
    assert formed.starts == (4, 7, 8, 9, 10, 12, 13, 14, 15, 15, 16)
    assert formed.stops == (7, 8, 9, 10, 11, 13, 14, 15, 16, 16, 17)  # without the soft hyphen at 11


def test_halves_are_counted() -> None:
    assert speakable("\ud83d\ude00").replaced == 0
    assert speakable("a\udcff\udcfe").replaced == 2


def test_two_spellings_of_a_word() -> None:
    assert same_word("CAFE\u0301") == same_word("café")
    assert same_word("Don’t ") == same_word("don't")
    assert same_word("Ｈｅｌｌｏ") == same_word("hello")


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", ""), ("né".encode(), "né"), (b"\xef\xbb\xbfBOM", "\ufeffBOM"), (b"it \xff now", "it \udcff now"),
        ("né".encode("utf-16"), "né"), (b"\xfe\xff\x00a\x00", "a\ufffd"),
    ],
)  # fmt: skip
def test_bytes(data: bytes, text: str) -> None:
    assert decoded(data) == text
