"""The ``.fap`` text format: what we write, what others write, and what is no such file."""

import contextlib
import tracemalloc
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.codec.epf import parse_epf
from fapengine.codec.fapfile import format_fap, parse_fap
from fapengine.errors import DataError, TruncatedError
from fapengine.files.motion import load_fap, save_fap
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from tests.unit.codec.test_bitstream import EXAMPLE_EPF

pytestmark = pytest.mark.conformance

MASK = "0 0 1 1 " + "0 " * 63 + "1"
HEAD = "2.1 talk 25 2\n"
GOOD = f"{HEAD}{MASK}\n0 10 -20 30\n{MASK}\n2 11 -21 31\n"


def sample() -> FapTrack:
    rng = np.random.default_rng(1)
    mask = rng.random((6, 68)) < 0.5
    values = np.where(mask, rng.integers(-1000, 1000, (6, 68)), 0)
    values[:, :2] = 0
    visemes = np.where(mask[:, :1], rng.integers(0, 2, (6, 4)), 0)
    expressions = np.where(mask[:, 1:2], rng.integers(0, 2, (6, 6)), 0)
    return FapTrack(
        values=values, mask=mask, visemes=visemes, expressions=expressions,
        frame_numbers=np.array([0, 1, 2, 5, 6, 9]), rate_hz=30.0, name="two words",
    )  # fmt: skip


def test_there_and_back() -> None:
    text = format_fap(sample())
    assert text.startswith("2.1 two_words 30 6\n")
    assert parse_fap(text.encode()).equals(sample())
    assert not any(line.endswith(" ") for line in text.splitlines())


def test_reads_what_is_written_by_hand() -> None:
    track = parse_fap(GOOD.encode())
    assert track.rate_hz == 25
    assert track.frame_numbers.tolist() == [0, 2]
    assert track.values[:, [fap.column(3), fap.column(4), fap.column(68)]].tolist() == [[10, -20, 30], [11, -21, 31]]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("2.1 talk", "# made by hand\n\n2.0 talk"),
        ("talk", "a name with blanks"),
        ("10 -20 30\n", "10.2 -20.4\n 30e0\n# middle\n"),
        (f"{MASK}\n0", f"{MASK} 0\n0"),
        ("25", "25.0"),
    ],
)
def test_dialects_say_the_same(old: str, new: str) -> None:
    assert parse_fap(GOOD.replace(old, new).encode()).equals(parse_fap(GOOD.encode()))


def test_a_name_may_be_missing_and_no_other_word_of_the_header() -> None:
    track = parse_fap(GOOD.replace(" talk", "").encode())
    assert (track.name, track.rate_hz, len(track)) == ("unnamed", 25, 2)
    with pytest.raises(DataError, match=r"header: got '2\.1 25', expected '2\.1 name rate frames' \(at line 1"):
        parse_fap(GOOD.replace(" talk 25 2", " 25").encode())


def test_visemes_and_expressions_in_both_forms() -> None:
    mask = "1 1 1 " + "0 " * 64 + "0"
    standard = parse_fap(f"2.1 a 25 1\n{mask}\n7 3 4 40 1 1 50 2 20 0 1 99\n".encode())
    assert standard.visemes.tolist() == [[3, 4, 40, 1]]
    assert standard.expressions.tolist() == [[1, 50, 2, 20, 0, 1]]
    single = parse_fap(f"2.1 a 25 1\n{mask}\n7 3 1 99\n".encode())
    assert single.visemes.tolist() == [[3, 0, 63, 0]]
    assert single.expressions.tolist() == [[1, 63, 0, 0, 0, 0]]
    assert single.values[0, 2] == standard.values[0, 2] == 99


def test_the_single_number_form_keeps_the_first_select() -> None:
    mask = "1 1 1 " + "0 " * 64 + "0"
    text = f"2.1 a 25 1\n{mask}\n7 3 4 40 1 1 50 2 20 0 1 99\n"
    single = format_fap(parse_fap(text.encode()), single_numbers=True)
    assert single.splitlines()[2] == "7 3 1 99"


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", TruncatedError, "header is missing"),
        ("# only\n", TruncatedError, "header is missing"),
        ("9.9 a 25 1\n", DataError, "header.*line 1"),
        ("2.1 25\n", DataError, "header"),
        ("2.1 a x 1\n", DataError, "frame rate: got 'x'"),
        ("2.1 9 0 1\n", DataError, "positive number, got 0 "),
        ("2.1 9 nan 1\n", DataError, "positive number, got nan "),
        (HEAD, TruncatedError, "no frame"),
        (GOOD.replace("11 -21 31\n", "11 -21"), TruncatedError, "FAP values: got 2 numbers, expected 3"),
        (GOOD.replace(MASK, "0 0 2" + MASK[5:], 1), DataError, "mask: digit 3 is '2'.*line 2"),
        (GOOD.replace(f"{MASK}\n0", f"{MASK} 1\n0"), DataError, "69th digit"),
        (GOOD.replace("-20", "inf"), DataError, "finite.*line 3"),
        (GOOD.replace("-20", "99999999999"), DataError, "32-bit"),
        (GOOD.replace("-20", "wide"), DataError, "'wide'"),
        (GOOD.replace("\n2 11", "\n0 11"), DataError, "strictly rising"),
    ],
)
def test_refuses(text: str, error: type[DataError], message: str) -> None:
    with pytest.raises(error, match=message):
        parse_fap(text.encode())
    with pytest.raises(DataError, match="is not UTF-8 text"):
        parse_fap(b"\xff\xfe")


@pytest.mark.parametrize(
    ("text", "read", "free"),
    [
        (GOOD, parse_fap, {(1, 1), (1, 3)}),  # the name, and the number of frames, which not every writer knows
        (EXAMPLE_EPF.decode().replace("FQU 1", "FQU 1 TC 1 2 1 3 FIX" + " 1" * 66), parse_epf, set()),
    ],
)
def test_a_wrong_word_is_quoted_in_short_with_its_line(
    text: str, read: Callable[[bytes], object], free: set[tuple[int, int]]
) -> None:
    wrong = "w" * 61
    lines = [line.split() for line in text.splitlines()]
    places = [(number, at) for number, words in enumerate(lines, start=1) for at in range(len(words))]
    for number, at in places:
        if (number, at) in free:
            continue
        words = [[wrong if (row, place) == (number, at) else word for place, word in enumerate(line)]
                 for row, line in enumerate(lines, start=1)]  # fmt: skip
        with pytest.raises(DataError) as told:
            read("\n".join(map(" ".join, words)).encode())
        length = 60 if (number, at) == (1, 0) and free else 20  # of a header, all that has room
        assert f"'{wrong[:length]}'" in str(told.value)
        assert f"line {number}" in str(told.value)


@given(st.binary(max_size=300) | st.text(max_size=300).map(str.encode))
def test_any_bytes_are_a_track_or_a_data_error(data: bytes) -> None:
    with contextlib.suppress(DataError):
        assert isinstance(parse_fap(data), FapTrack)


@given(st.integers(0, len(GOOD) - 1), st.sampled_from(["", "x", "-1", "\n", "1e40", " 1 "]))
def test_a_damaged_file_is_a_track_or_a_data_error(at: int, put: str) -> None:
    with contextlib.suppress(DataError):
        assert isinstance(parse_fap((GOOD[:at] + put + GOOD[at + 1 :]).encode()), FapTrack)


def test_files(tmp_path: Path) -> None:
    save_fap(tmp_path / "new" / "a.fap", sample())
    assert load_fap(tmp_path / "new" / "a.fap").equals(sample())
    (tmp_path / "bad.fap").write_text("2.1 a x 1\n")
    with pytest.raises(DataError, match=r"bad\.fap: frame rate"):
        load_fap(tmp_path / "bad.fap")


def test_every_fap_file_of_the_vectors_is_read_and_written_back(vectors: Mapping[str, bytes]) -> None:
    texts = {name: data for name, data in vectors.items() if name.endswith(".fap")}
    assert len(texts) == 60
    for name, text in texts.items():
        if len(text) < 30_000:
            track = parse_fap(text)
            assert parse_fap(format_fap(track).encode()).equals(track), name


def test_memory_is_that_of_the_text_and_the_track() -> None:
    """A token of each number takes 40 times the text: a gigabyte and a half for an hour."""
    data = format_fap(
        FapTrack.from_values(np.arange(68)[None].repeat(1500, 0) * (np.arange(68) > 1), rate_hz=25.0)
    ).encode()
    tracemalloc.start()
    try:
        parse_fap(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 10 * len(data)


@pytest.mark.parametrize(("first", "second"), [(True, False), (False, True)])
def test_one_single_number_is_read(first: bool, second: bool) -> None:
    mask = f"{int(first)} {int(second)} 1 " + "0 " * 65
    single = parse_fap(f"2.1 a 25 1\n{mask}\n7 3 99\n".encode())
    assert single.visemes.tolist() == [[3 * first, 0, 63 * first, 0]]
    assert single.expressions.tolist() == [[3 * second, 63 * second, 0, 0, 0, 0]]
    assert single.values[0, 2] == 99
