"""Four times the input: at most some four times the lines of code that are run, and the memory. No clock is asked."""

from collections.abc import Iterator

import pytest

from bench.budgets import read
from bench.growth import grown
from tests.fuzz.readers import Reader, clean, readers
from tests.work_done import bytes_taken, lines_run

ROWS = 48
TIMES, LINES, BYTES = 4.6, 1500, 150_000
"""Growth that is linear, and what is there however short the input is."""


def is_linear(reader: Reader, short: bytes, long: bytes) -> bool:
    """Whether the longer input takes no more than it may."""
    read(reader, short)
    (few, little), (many, much) = (
        (lines_run(lambda data=data: read(reader, data), __file__), bytes_taken(lambda data=data: read(reader, data)))  # type: ignore[misc]
        for data in (short, long)
    )
    return many <= TIMES * few + LINES and much <= TIMES * little + BYTES


@pytest.fixture
def every_reader() -> Iterator[tuple[Reader, ...]]:
    yield readers()
    clean()


def test_no_reader_takes_more_than_its_input_explains(every_reader: tuple[Reader, ...]) -> None:
    assert len(every_reader) >= 120
    long = [one.name for one in every_reader if not is_linear(one, grown(one, ROWS), grown(one, 4 * ROWS))]
    assert long == []


def test_work_and_memory_that_grow_faster_are_found() -> None:
    def in_turn(data: bytes) -> int:
        count = 0
        for one in data:
            for other in data:
                count += one == other
        return count

    assert not is_linear(Reader("slow", in_turn, (b"a",)), bytes(100), bytes(400))
    assert not is_linear(Reader("large", lambda data: bytes(len(data) ** 2), (b"a",)), bytes(500), bytes(2000))
    assert is_linear(Reader("good", lambda data: [bytes(9) for _ in data], (b"a",)), bytes(500), bytes(2000))
