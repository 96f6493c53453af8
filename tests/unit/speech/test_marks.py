"""Marks of language models, emoji and SSML: what is left to say, what a face does, and when."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.expressions import Expression
from fapengine.speech.marks import (
    _EMOJI,
    Act,
    Feel,
    Gesture,
    Loudness,
    Mark,
    MarkedText,
    read_marks,
    timed_marks,
    with_loudness,
    words_of,
)
from fapengine.speech.phone_track import Phone

JOY, SADNESS, SURPRISE = Expression.JOY, Expression.SADNESS, Expression.SURPRISE

PLAIN: list[tuple[str, str, list[tuple[int, Act]]]] = [
    ("No mark.", "No mark.", []),
    ("a < b, [sic], [3] and 2 > 1", "a < b, [sic], [3] and 2 > 1", []),
    ("The [long remark that is sad] stays.", "The [long remark that is sad] stays.", []),
    ('<expr type="expression" label="happy"/> Hi.', "Hi.", [(0, Feel(JOY, 0.7))]),
    ('<expr type="expression" label="a little sheepish, apologetic"/> Ah.', "Ah.", [(0, Feel(SADNESS, 0.24))]),
    ("<expr type='expression' label='really bright > sad'/> Ah.", "Ah.", [(0, Feel(SADNESS, 0.84))]),
    ('Well <expr type="sound" label="laugh"/> yes.', "Well yes.", [(5, Feel(JOY, 1.0, is_brief=True))]),
    ('Are you <expr type="prosody" label="emphasis">sure</expr>?', "Are you sure?", [(8, Gesture("nod"))]),
    ('A <expr type="prosody" label="whisper">se</expr>cret', "A secret",
     [(2, Loudness(-9.0)), (4, Loudness(0.0))]),
    ('Code <expr type="spell">A7</expr>.', "Code A7.", []),
    ("[laughs] No [sigh].", "No .", [(0, Feel(JOY, 1.0, is_brief=True)), (3, Feel(SADNESS, 0.35, is_brief=True))]),
    ("[whispering] So.", "So.", [(0, Loudness(-9.0))]),
    ("Yes [nod] and no [shakes head].", "Yes and no .", [(4, Gesture("nod")), (11, Gesture("shake"))]),
    ("Hi 😀 there ☹\ufe0f", "Hi there", [(3, Feel(JOY, 0.7, is_brief=True)), (8, Feel(SADNESS, 0.6, is_brief=True))]),
    ("A train 🚂 stays.", "A train 🚂 stays.", []),
    ('Look <mark name="look:left"/>here.', "Look here.", [(5, Gesture("left"))]),
    ('<mark name="surprise:0.5"/>Oh.', "Oh.", [(0, Feel(SURPRISE, 0.5))]),
    ("😀", "", [(0, Feel(JOY, 0.7, is_brief=True))]),
    ("one too many </expr> here", "one too many here", []),
    ('<break time="1s"/> stays', '<break time="1s"/> stays', []),
]  # fmt: skip


@pytest.mark.parametrize(("text", "left", "marks"), PLAIN, ids=[text[:24] for text, _, _ in PLAIN])
def test_of_a_plain_text(text: str, left: str, marks: list[tuple[int, Act]]) -> None:
    marked = read_marks(text)
    assert marked.text == left
    assert [(mark.at, mark.act) for mark in marked.marks] == marks


def test_a_pause_and_emphasis_are_for_the_voice_too() -> None:
    marked = read_marks('Wait <expr type="break" label="300ms"/> <expr type="prosody" label="emphasis">now</expr> & go')
    assert marked.ssml == 'Wait <break time="300ms"/> <emphasis level="strong">now</emphasis> &amp; go'
    assert read_marks("[laughs] Hi").ssml is None


def test_of_ssml() -> None:
    marked = read_marks(
        '<speak>Tom &amp; <emphasis>Ann</emphasis> <mark name="joy"/>say <prosody volume="loud">hi</prosody>'
        " <s>[laughs] there</s></speak>",
        ssml=True,
    )  # fmt: skip
    assert marked.text == "Tom & Ann say hi there"
    assert [(mark.at, mark.act) for mark in marked.marks] == [
        (6, Gesture("nod")), (10, Feel(JOY, 1.0)), (14, Loudness(5.0)), (16, Loudness(0.0)),
        (17, Feel(JOY, 1.0, is_brief=True)),
    ]  # fmt: skip
    assert marked.ssml == (
        '<speak>Tom &amp; <emphasis>Ann</emphasis> say <prosody volume="loud">hi</prosody> <s> there</s></speak>'
    )


def test_what_says_nothing_is_told() -> None:
    assert read_marks('<expr type="expression" label="purple"/> Hi <mark name="chapter"/>.').unknown == (
        "purple",
        "chapter",
    )


def test_times_are_those_of_the_words() -> None:
    marked = read_marks('[nod] Well, well <expr label="sad"/>it rains 😢')
    words = [("Well", 0.3, 0.5), ("um", 0.5, 0.6), ("well", 0.7, 0.9), ("it", 1.0, 1.1), ("rains", 1.1, 1.6)]
    assert [(mark.at_s, mark.until_s) for mark in timed_marks(marked, words, 2.0)] == [
        (0.3, pytest.approx(1.9)), (1.0, 2.0), (1.6, pytest.approx(3.2)),
    ]  # fmt: skip


def test_a_delivery_lasts_until_the_next() -> None:
    marked = read_marks('<expr label="happy"/> Yes. <expr label="sad"/> No. <expr label="calm"/> So.')
    words = [("Yes", 0.0, 0.4), ("No", 1.0, 1.3), ("So", 2.0, 2.5)]
    assert [(mark.at_s, mark.until_s) for mark in timed_marks(marked, words, 3.0)] == [
        (0.0, 1.0),
        (1.0, 2.0),
        (2.0, 3.0),
    ]


def test_loudness_ends_with_its_stretch() -> None:
    marked = MarkedText("ab", (Mark(0, Loudness(5.0)), Mark(1, Loudness(0.0))))
    times = timed_marks(marked, [("a", 0.0, 0.5), ("b", 0.5, 1.0)], 1.0)
    phones = [Phone("a", 0.0, 0.5, loudness_db=6.0), Phone("b", 0.5, 1.0)]
    assert [phone.loudness_db for phone in with_loudness(phones, times)] == [8.0, 0.0]


PIECES = st.sampled_from(
    ["[", "]", "<", ">", "/", "expr", "mark", " ", '"', "'", "=", "type", "label", "sad", "😀", "nod", "&amp;",
     "prosody", "</expr>", '<expr type="prosody" label="loud">', "<expr/>", "<mark name='nod'/>", "emphasis", "\n", "ё"]
)  # fmt: skip


@given(st.one_of(st.text(), st.lists(PIECES).map("".join)), st.booleans())
def test_any_text_can_be_read(text: str, ssml: bool) -> None:
    marked = read_marks(text, ssml=ssml)
    assert all(0 <= mark.at <= len(marked.text) for mark in marked.marks)
    assert [mark.at for mark in marked.marks] == sorted(mark.at for mark in marked.marks)
    if not marked.marks and not ssml and marked.ssml is None:
        assert marked.text == text or "<" in text


STEMS = (
    "sarcas disgust contempt apolog sheepish regret empath sympath concern sorry sad cry sob disappoint melanchol "
    "sigh worr nervous anxious scared afraid terrif fear panic angry anger furious annoy frustrat irritat stern "
    "determin shout surpris gasp shock amaz astonish curious inquisit confus laugh chuckl giggl excit delight "
    "happ joy cheer playful mischiev smil smirk grin warm welcom friendl amiabl bright hopeful proud enthusias "
    "amus reassur gentl calm neutral serious chill casual easygoing whisper x-soft soft quiet x-loud loud silent"
)


def test_strengths_change_only_on_purpose() -> None:
    """Chosen values: a digest, because no law connects them."""
    shown = [repr(mark.act) for stem in STEMS.split() for mark in read_marks(f"[{stem}] x").marks]
    shown += [repr(mark.act) for face in sorted(_EMOJI) for mark in read_marks(f"{face} x").marks]
    assert len(shown) >= 130
    assert hashlib.sha256("\n".join(shown).encode()).hexdigest()[:16] == "dfb140b1b960f35b"


def test_a_word_lasts_from_its_first_phone_to_its_last() -> None:
    phones = [
        Phone(label, 0.1 * n, 0.1 * n + 0.1, word=word)
        for n, (label, word) in enumerate(zip("mæpa", ("map",) * 3 + ("a",), strict=True))
    ]
    assert words_of(phones) == [("map", 0.0, pytest.approx(0.3)), ("a", pytest.approx(0.3), 0.4)]
