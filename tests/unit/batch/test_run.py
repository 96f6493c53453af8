"""Runs: what is done once stays done, whoever is killed and whenever."""

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fapengine
from fapengine._child import Child
from fapengine.batch import journal as journals
from fapengine.batch import run as runs
from fapengine.batch.journal import Done, Journal, load_journals, parse_journal
from fapengine.batch.rows import Options, Row
from fapengine.batch.run import format_index, format_page, on_this_machine, plan_run, run, serially
from fapengine.batch.work import Job
from fapengine.errors import ResourceError
from tests.unit.batch.deadly import FATAL, do_or_die

COUNT = 24


@pytest.fixture
def rows(tmp_path: Path) -> tuple[Row, ...]:
    """24 short rows of timings, of which the sixth is damaged."""
    made = []
    for number in range(COUNT):
        path = tmp_path / f"{number}.pho"
        path.write_text("_ 50\nb 60\na 90\n_ 50\n" if number != 5 else "_ fifty\n")
        made.append(Row(id=f"{number % 3}/{number}", timings=path, options=Options(seed=number)))
    return tuple(made)


def go(rows: tuple[Row, ...], folder: Path, engine: runs.Engine = serially, **options: bool) -> dict[str, Done]:
    return run(plan_run(rows, Job(folder, "fap"), **options), engine, 2, folder / "journal.jsonl")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.fap")}


def hidden(folder: Path) -> list[Path]:
    return list(folder.rglob(".*"))


def test_a_row_is_what_animate_does(rows: tuple[Row, ...], tmp_path: Path) -> None:
    done = go(rows[:1], tmp_path / "out")
    fapengine.animate(rows[0].timings, seed=0).save(tmp_path / "alone.fap")
    assert (tmp_path / "out" / "0" / "0.fap").read_bytes() == (tmp_path / "alone.fap").read_bytes()
    assert done["0/0"].phones == 2
    assert done["0/0"].duration_s == pytest.approx(0.25)


def test_a_bad_row_is_a_line_and_the_others_go_on(rows: tuple[Row, ...], tmp_path: Path) -> None:
    done = go(rows, tmp_path / "out")
    assert [row for row, entry in done.items() if entry.error] == ["2/5"]
    assert "5.pho" in done["2/5"].error
    assert len(contents(tmp_path / "out")) == COUNT - 1
    assert not plan_run(rows, Job(tmp_path / "out", "fap")).left
    assert len(plan_run(rows, Job(tmp_path / "out", "fap"), retry_failed=True).left) == 1
    assert format_index(rows, done).decode().splitlines()[6].startswith("2/5,failed,")
    assert "2/5" in format_page(rows, done).decode()


def test_only_what_changed_is_done_again(rows: tuple[Row, ...], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    go(rows, folder)
    (folder / "0/0.fap").write_bytes(b"damaged")
    (folder / "1/1.fap").unlink()
    rows[2].timings.write_text("_ 50\nm 60\na 90\n_ 50\n")
    rows[5].timings.write_text("_ 50\nm 60\na 90\n_ 50\n")  # mended
    other = (*rows[:3], Row(id=rows[3].id, timings=rows[3].timings, options=Options(seed=99)), *rows[4:])
    assert plan_run(other, Job(folder, "fap")).left == (0, 1, 2, 3, 5)


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    with Journal(path) as journal:
        journal.add([Done(id=f"ü{n}", key="k", outputs={f"{n}.fap": (n, 2)}, error="x" * (n == 2)) for n in range(3)])
    return path.read_bytes()


def test_a_journal_cut_at_every_byte_loses_its_last_line_alone(lines: bytes, tmp_path: Path) -> None:
    whole = lines.splitlines(keepends=True)
    for cut in range(len(lines) + 1):
        kept = sum(len(b"".join(whole[:n])) <= cut for n in range(1, 4))
        assert list(parse_journal(lines[:cut])) == [f"ü{n}" for n in range(kept)]
    path = tmp_path / "journal.jsonl"
    for cut in range(len(lines) + 1):
        path.write_bytes(lines[:cut])
        with Journal(path) as journal:
            journal.add([Done(id="new", key="k")])
        assert list(load_journals(tmp_path))[-1] == "new"
        assert path.read_bytes().count(b"\n") == len(load_journals(tmp_path))


@settings(max_examples=60)
@given(st.binary(max_size=80), st.integers(0, 300), st.integers(0, 255))
def test_any_bytes_are_a_journal(lines: bytes, tail: bytes, at: int, byte: int) -> None:
    damaged = bytearray(lines)
    damaged[at % len(damaged)] = byte
    parse_journal(bytes(damaged) + tail)


def test_a_full_disk_leaves_whole_lines(lines: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(lines)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with Journal(path) as journal:
        monkeypatch.setattr(journals.os, "fsync", full)
        with pytest.raises(ResourceError, match="No space left"):
            journal.add([Done(id="new", key="k")])
    assert path.read_bytes() == lines


def test_a_run_that_stops_goes_on_with_the_same_bytes(rows: tuple[Row, ...], tmp_path: Path) -> None:
    go(rows, tmp_path / "whole")

    class StoppedError(Exception):
        pass

    def stopping(shards: list[runs.Shard], job: Job):
        for number, some in enumerate(serially(shards, job)):
            if number == 3:
                raise StoppedError  # after the work, before the line
            yield some

    with pytest.raises(StoppedError):
        go(rows, tmp_path / "out", stopping)
    before = len(load_journals(tmp_path / "out"))
    assert 0 < before < COUNT
    go(rows, tmp_path / "out")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert (tmp_path / "out" / "journal.jsonl").read_bytes().count(b"\n") == COUNT  # none twice


def test_a_worker_is_killed_and_nothing_is_lost(
    rows: tuple[Row, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Child] = []
    start = runs._worker

    def keep() -> Child:
        started.append(start())
        return started[-1]

    monkeypatch.setattr(runs, "_worker", keep)
    go(rows, tmp_path / "whole")
    killed: list[int] = []

    def kill(_: int) -> None:
        if not killed:
            killed.append(started[0].process.pid)
            started[0].kill()

    folder = tmp_path / "out"
    done = run(plan_run(rows, Job(folder, "fap")), on_this_machine(2), 2, folder / "journal.jsonl", kill)
    assert killed
    assert len(started) == 3
    assert [row for row, entry in done.items() if entry.error] == ["2/5"]
    assert contents(folder) == contents(tmp_path / "whole")
    assert not hidden(folder)


def test_a_row_that_ends_its_worker_is_named(
    rows: tuple[Row, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "do_rows", do_or_die)
    fatal = (*rows[:3], Row(id=FATAL, timings=rows[0].timings))
    done = go(fatal, tmp_path / "out", on_this_machine(1))
    assert "its worker ended" in done[FATAL].error
    assert sum(not entry.error for entry in done.values()) == 3


def test_shards_of_a_job_array_are_one_run(rows: tuple[Row, ...], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    for number in range(3):
        mine = rows[number::3]
        run(plan_run(mine, Job(folder, "fap")), serially, 1, folder / f"journal.{number + 1}-of-3.jsonl")
    assert len(load_journals(folder)) == COUNT
    assert not plan_run(rows, Job(folder, "fap")).left
