"""For all bytes: a value or an error of ours, from everything that reads; a short run of ``make fuzz``."""

import contextlib
import random
from collections.abc import Iterator

import pytest

from fapengine.errors import DataError, FapEngineError
from tests.fuzz.mutated import BYTE_S, LEAST_S, Tally, attempt, mutated, table
from tests.fuzz.readers import NUMBER, Reader, clean, readers

INPUTS = 12
DAMAGED = ("FBA", "timings, any")
"""Readers among whose examples is one that is damaged, or that no content tells."""


@pytest.fixture(scope="module", autouse=True)
def tidied() -> Iterator[None]:
    yield
    clean()


def test_good_files_are_read() -> None:
    assert len(readers()) >= 120
    for reader in readers():
        assert reader.good, reader.name
        for good in reader.good:
            with contextlib.suppress(*(FapEngineError,) if reader.name in DAMAGED else ()):
                reader.read(good)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_spoiled_files_are_read_or_refused() -> None:
    chance, tally = random.Random(3), Tally()
    for reader in readers():
        for _ in range(INPUTS):
            data = mutated(chance, reader.good)
            assert attempt(reader, data, tally) is None, f"{reader.name}: {data!r:.500}"
    assert tally.inputs == INPUTS * len(readers())
    assert 0.05 < tally.taken / tally.inputs < 0.9


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_a_search_has_found() -> None:
    known = {reader.name: reader for reader in readers()}
    far = NUMBER.sub(b"1e301", known["landmarks"].good[0], count=1)
    no_points = bytes.fromhex("445241434f020201000204010001020000000080")
    for name, data in (
        ("timings, ctm", b"#"),
        ("timings, ctm", b"talk 1 0.0 0.1 \x0c"),
        ("landmarks", far),
        ("Draco", no_points),
    ):
        with pytest.raises(DataError):
            known[name].read(data)


def test_what_breaks_the_law_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(data: bytes) -> None:
        raise DataError("no")

    tally = Tally()
    assert attempt(Reader("fails", lambda data: 1 // 0, (b"x",)), b"x", tally) == (
        "ZeroDivisionError: integer division or modulo by zero"
    )
    assert attempt(Reader("refuses", refuse, (b"x",)), b"x", tally) is None
    times = iter([0.0, LEAST_S + BYTE_S + 0.1])
    monkeypatch.setattr("tests.fuzz.mutated.time.process_time", lambda: next(times))
    assert attempt(Reader("slow", len, (b"x",)), b"x", tally) == "1.1 s for 1 bytes"
    tally.broken.append("slow")
    assert (tally.inputs, tally.taken) == (3, 1)
    assert "| slow | 3 | 1 | 1.10 | 1 |" in table({"slow": tally})
