"""For all bytes: a value or an error of ours, from everything that reads; a short run of ``make fuzz``."""

import contextlib
import io
import os
import random
import signal
import zipfile
from collections.abc import Iterator

import pytest

from fapengine.errors import DataError, FapEngineError
from tests.fuzz import mutated as search
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
    cloud = known["Draco"].good[0][:7] + b"\0" + known["Draco"].good[0][8:]
    with pytest.raises(DataError, match="got no mesh, expected triangles"):
        known["Draco"].read(cloud)
    header = b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f8',\n"  # NumPy's own reader of version 1 takes it for a statement
    spoiled = io.BytesIO()
    with zipfile.ZipFile(spoiled, "w") as archive:
        archive.writestr("positions_mm.npy", header)
    with pytest.raises(DataError):
        known["NPZ"].read(spoiled.getvalue())
    flat = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvt 0 1\nvn 0 0 1\nf 1/1/\nvt 4\n"
    with contextlib.suppress(FapEngineError):
        known["mesh, obj"].read(flat)
    endless = known["BVH"].good[0].replace(b"OFFSET 0 -10 0", b"OFFSET 0 -1e999 0")
    assert endless != known["BVH"].good[0]
    for name, data in (
        ("BVH", endless),
        ("timings, ctm", b"#"),
        ("timings, ctm", b"talk 1 0.0 0.1 \x0c"),
        ("landmarks", far),
        ("Draco", no_points),
        ("session.toml", b'up = "0y"\n'),
        ("session.toml", b'units = "ell"\n'),
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


def _kill(data: bytes) -> None:
    os._exit(3)


def _spin(data: bytes) -> None:
    while len(data) > 2:
        pass


def _sleep(data: bytes) -> None:
    while len(data) > 2:
        signal.pause()


@pytest.mark.parametrize(
    ("read", "told"), [(_kill, "ended with exit code 3"), (_spin, "ended with SIGPROF"), (_sleep, "ended with SIGKILL")]
)
def test_what_ends_or_hangs_the_process_costs_one_input(read, told, tmp_path, monkeypatch):
    monkeypatch.setattr(search, "readers", lambda: (Reader("one", read, (b"x", b"yy", b"zzzz")),))
    monkeypatch.setattr(search, "ENDLESS_S", 0.05)
    monkeypatch.setattr(search, "ASLEEP", 20)
    monkeypatch.setattr(search, "MOST_MB", 1e9)
    monkeypatch.setattr(search, "warm", lambda reader: None)
    (tally,) = search.search(100, 1e9, 1, folder=tmp_path, each=9).values()
    assert tally.inputs == 9
    assert tally.broken
    assert all(told in wrong for wrong in tally.broken)
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert kept == sorted(f"{name}{end}" for name in {path.stem for path in tmp_path.iterdir()} for end in ("", ".why"))
    assert len(kept) == 2 * len(tally.broken)


def test_every_reader_gets_its_least_and_cheap_ones_the_rest():
    tallies = {"dear": Tally(inputs=10, cpu_s=1.0), "cheap": Tally(inputs=10, cpu_s=0.001)}
    assert search.shares(10_000, tallies) == {"dear": 20, "cheap": 9980}
