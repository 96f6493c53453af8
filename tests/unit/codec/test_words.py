"""Words of text files: numbered lines without comments, split as they are needed."""

import pytest

from fapengine.codec.fapfile import LINES_KEPT, Words, text_lines
from fapengine.errors import DataError, TruncatedError


def words_of(text: str) -> Words:
    return Words(text_lines(text.encode(), "file"))


def test_comments_and_empty_lines_count_as_lines_only() -> None:
    assert list(text_lines(b"\xef\xbb\xbf# a\n\n1 2\n  # b\n3\n", "file")) == [(3, "1 2"), (5, "3")]
    with pytest.raises(DataError, match=r"file: is not UTF-8 text \(at byte 2"):
        text_lines(b"1 \xff", "file")


def test_words_come_with_their_lines() -> None:
    words = words_of("1 2\n\n3\n")
    assert words.line() == 1
    assert words.take(2, "numbers") == [("1", 1), ("2", 1)]
    assert words.line() == 3
    assert words.per_line == {1: 2, 3: 1}
    assert words.has(1)
    assert not words.has(2)
    with pytest.raises(TruncatedError, match=r"numbers: got 1 numbers, expected 2 \(at line 3, the end"):
        words.take(2, "numbers")
    assert words.take(1, "number") == [("3", 3)]
    assert words.line() == 3
    assert not words.has(1)


def test_counts_of_old_lines_are_forgotten() -> None:
    words = words_of("1\n" * (LINES_KEPT + 50))
    assert words.has(LINES_KEPT + 50)
    assert list(words.per_line) == list(range(51, LINES_KEPT + 51))
