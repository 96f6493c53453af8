"""Words of a text, and marks of a voice made whole."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.speech.text.words import (
    attribute,
    is_spelled,
    may_be_spelled,
    pieces_of,
    unread_remarks,
    without_tags,
    words_of,
)

WORDS = [
    ("", []),
    ("  \n ", []),
    ("— … -- - !", []),
    ("We'll go; don’t!", ["We'll", "go", "don’t"]),
    ("‘quoted’ 'tis rock 'n' roll", ["quoted", "tis", "rock", "n", "roll"]),
    ("word—word yes--no one,two (s)he 12:30", ["word", "word", "yes", "no", "one", "two", "s", "he", "12:30"]),
    (
        "1,234.50 $5 50% C++ #tag @me and/or a.m. U.S.",
        ["1,234.50", "$5", "50%", "C++", "#tag", "@me", "and/or", "a.m.", "U.S."],
    ),
    ("yes--no là-bas--so-so", ["yes", "no", "là-bas", "so-so"]),
    ("The end. e.g. this", ["The", "end", "e.g.", "this"]),
    ("iPhoneを2026年に买了", ["iPhone", "を", "2026", "年に买了"]),
    ("ภาษาไทยABC ລາວ", ["ภาษาไทย", "ABC", "ລາວ"]),
    ("नमस्ते, दुनिया।", ["नमस्ते", "दुनिया"]),
    ("«là-bas» می‌رویم،", ["là-bas", "می‌رویم"]),
    ("😀👍🏽 ok", ["😀👍🏽", "ok"]),
]


@pytest.mark.parametrize(("text", "words"), WORDS)
def test_words(text: str, words: list[str]) -> None:
    assert [text[word.start : word.stop] for word in words_of(text)] == words


SPACED = st.text("ab1 -—'’.,/$é", max_size=12)


@given(SPACED, SPACED)
def test_a_space_parts_words_whatever_stands_before_and_behind_it(before: str, behind: str) -> None:
    text = f"{before} {behind}"
    parts = [part[word.start : word.stop] for part in (before, behind) for word in words_of(part)]
    assert [text[word.start : word.stop] for word in words_of(text)] == parts


@pytest.mark.parametrize("outer", ["({})", "«{}»", "{}!", "“{}”,", "¿{}?!", "[({})]…", "{}"])
@pytest.mark.parametrize("word", ["a.m.", "U.S.", "e.g.", "go", "là-bas", "1,234.50"])
def test_punctuation_around_a_word_is_no_part_of_it(word: str, outer: str) -> None:
    text = f"so {outer.format(word)} it"
    assert [text[found.start : found.stop] for found in words_of(text)] == ["so", word, "it"]


@pytest.mark.parametrize("letters", [7, 12, 30, 400])
@given(st.text("ab .,!?éß", max_size=60))
def test_pieces_are_the_text_and_none_is_longer_and_a_short_text_is_one(letters: int, text: str) -> None:
    pieces = pieces_of(text, letters)
    assert "".join(pieces) == text
    assert all(0 < len(piece) <= letters for piece in pieces)
    assert len(pieces) <= 1 or len(text) > letters


def test_a_voice_tells_the_first_word_that_it_does_not_read_with_its_place() -> None:
    (cyrillic, greek) = unread_remarks([("word", 0), ("мир", 5), ("λόγος", 9), ("два", 15), ("три", 19)], "en")
    assert "does not read Cyrillic: 'мир' (letter 6) and 2 more cannot be" in cyrillic
    assert "does not read Greek: 'λόγος' (letter 10) cannot be" in greek


def told(text: str, marks: list[tuple[int, int]]) -> list[list[tuple[str, int]]]:
    return [[(text[word.start : word.stop], phones) for word, phones in words] for words in attribute(text, marks)]


def test_marks_inside_a_word() -> None:
    assert told("in 1984, ok", [(0, 2), (3, 11), (4, 4), (4, 3), (9, 4)]) == [
        [("in", 2)], [("1984", 11)], [("1984", 4)], [("1984", 3)], [("ok", 4)],
    ]  # fmt: skip


def test_a_mark_between_words() -> None:
    assert told("etc. at 9", [(0, 7), (4, 2), (8, 4)]) == [[("etc", 7)], [("at", 2)], [("9", 4)]]
    assert told("😀 ok", [(0, 6), (1, 3), (2, 4)]) == [[("😀", 6)], [("😀", 3)], [("ok", 4)]]
    assert told("😀", [(0, 6), (1, 3)]) == [[("😀", 6)], [("😀", 3)]]


def test_words_without_a_mark_share() -> None:
    assert told("on the year", [(0, 4), (7, 3)]) == [[("on", 2), ("the", 2)], [("year", 3)]]
    assert told("a in of", [(0, 2)]) == [[("a", 1), ("in", 1)]]
    assert told("on. the", [(0, 4)]) == [[("on", 4)]]  # they are not joined across a stop


def test_characters_of_chinese() -> None:
    assert told("你好世界,苹果", [(0, 5), (2, 2), (3, 2), (5, 6)]) == [
        [("你好", 5)], [("世", 2)], [("界", 2)], [("苹果", 6)],
    ]  # fmt: skip


def test_a_text_without_a_word() -> None:
    assert told("...", [(1, 0)]) == [[("...", 0)]]
    assert attribute("", []) == []


@given(st.text(max_size=30), st.lists(st.tuples(st.integers(-1, 40), st.integers(0, 20)), max_size=8))
def test_no_phone_is_lost(text: str, marks: list[tuple[int, int]]) -> None:
    attributed = attribute(text, marks)
    assert [sum(phones for _, phones in words) for words in attributed] == [phones for _, phones in marks]
    for words in attributed:
        for word, _ in words:
            assert 0 <= word.start <= word.stop <= len(text)


@given(st.text(max_size=30))
def test_words_lie_in_order_without_spaces(text: str) -> None:
    words = words_of(text)
    assert words == sorted(words)
    assert all(not any(char.isspace() for char in text[word.start : word.stop]) for word in words)


def test_tags_are_blanked() -> None:
    assert without_tags("a <b/>c") == "a     c"


@pytest.mark.parametrize(
    ("word", "is_one"),
    [("km", True), ("Hptm", True), ("TV", False), ("by", False), ("k", False), ("p.m.", False), ("мм", True)],
)
def test_a_word_without_a_vowel_may_be_spelled_but_not_an_acronym(word: str, is_one: bool) -> None:
    assert may_be_spelled(word) is is_one


@pytest.mark.parametrize(
    ("transcription", "spells"),
    [("(en)eɪtʃ tiː ɛm ɛl", True), ("(en)eɪtʃ tiː ɛm", False), ("(en)hətməl", False), ("hətməl", True)],
)
def test_a_voice_spells_where_it_names_every_letter(transcription: str, spells: bool) -> None:
    assert is_spelled("html", transcription) is spells
