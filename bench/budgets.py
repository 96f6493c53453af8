"""Time and memory against the length of the input, for every reader and every command that reads.

    python -m bench.budgets [--rows 2000] [--seconds 30] [--only readers commands] [--command NAME ...]
        [--table FILE.md]

Each reader of :mod:`tests.fuzz.readers` gets an input of ROWS frames, phones, vertices or words, and one four times as
long (:mod:`bench.growth`); each command timings of SECONDS, and four times as long, or what it makes of them. A reader
whose longer input no file of ours holds gets a good file again and again; "refused" stands beside what it does not
take.

*CPU*: CPU time; of a command that of its process. *Memory*: what Python allocates at most; of a command the peak of its
process. From both of a command goes what it takes for :data:`LEAST_S` seconds, the least of :data:`LEAST_RUNS`
processes: start and libraries, told in a column of their own. *Times*: the longer over the shorter one. Exits 1 where
one takes more than :data:`MOST_TIMES` the time or memory of its quarter, beyond :data:`NOTHING_S` or
:data:`NOTHING_MB`, of a command :data:`START_S` and :data:`START_MB`.
"""

import argparse
import subprocess
import sys
import tempfile
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.growth import grown, markers
from bench.hour import write_inputs
from fapengine.errors import FapEngineError
from fapengine.files.recordings import save_markers
from tests.fuzz.readers import Reader, clean, readers

MOST_TIMES = 5.0
"""Work and memory that are linear take four times as much; the rest is what else the machine does."""
NOTHING_S, NOTHING_MB = 0.05, 2.0
START_S, START_MB = 0.5, 20.0
"""Difference of a process and its libraries from the same once more, on a busy machine."""
LEAST_S, LEAST_RUNS = 1.0, 2


@dataclass(frozen=True)
class Row:
    """Time and memory of an input, and of one four times as long."""

    name: str
    size: tuple[int, int]
    """Bytes."""
    cpu_s: tuple[float, float]
    mb: tuple[float, float]
    is_read: bool = True
    start: tuple[float, float] | None = None
    """Seconds and MB of a command's least input, taken off the others; None of a reader."""

    @property
    def is_linear(self) -> bool:
        """Whether the longer input took no more than it may."""
        (less_s, more_s), (less_mb, more_mb) = self.cpu_s, self.mb
        least_s, least_mb = (NOTHING_S, NOTHING_MB) if self.start is None else (START_S, START_MB)
        return more_s <= MOST_TIMES * less_s + least_s and more_mb <= MOST_TIMES * less_mb + least_mb

    def __str__(self) -> str:
        name = self.name if self.is_read else f"{self.name} (refused)"
        digits, least_s = (3, 1e-9) if self.start is None else (2, 0.1)
        cpu, mb = (f"{less:.{digits}f} | {more:.{digits}f}" for less, more in (self.cpu_s, self.mb))
        mb = mb if self.start is None else f"{self.mb[0]:.0f} | {self.mb[1]:.0f}"
        times = f"{self.cpu_s[1] / self.cpu_s[0]:.1f}" if self.cpu_s[0] >= least_s else "-"
        start = "" if self.start is None else f" {self.start[0]:.2f} | {self.start[1]:.0f} |"
        return f"| {name} | {self.size[0] / 1000:.1f} | {self.size[1] / 1000:.1f} | {cpu} | {times} | {mb} |{start}"


def read(reader: Reader, data: bytes) -> bool:
    """Read; False where the input was refused."""
    try:
        reader.read(data)
    except FapEngineError:
        return False
    return True


def of_reader(reader: Reader, rows: int, repeats: int = 3) -> Row:
    """Measure a reader."""
    inputs = grown(reader, rows), grown(reader, 4 * rows)
    read(reader, reader.good[0])
    cpu_s, mb, is_read = [], [], True
    for data in inputs:
        spent = []
        for _ in range(repeats):
            begun_s = time.process_time()
            is_read = read(reader, data)
            spent.append(time.process_time() - begun_s)
        tracemalloc.start()
        read(reader, data)
        mb.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
        cpu_s.append(min(spent))
    sizes = len(inputs[0]), len(inputs[1])
    return Row(reader.name, sizes, (cpu_s[0], cpu_s[1]), (mb[0], mb[1]), is_read)


COMMANDS = {
    "animate": ("talk.csv", "animate talk.csv --alphabet ipa -o talk.fap"),
    "animate --audio": ("talk.wav", "animate talk.csv --alphabet ipa --audio talk.wav -o x.fap"),
    "animate, film": (
        "talk.csv",
        "animate talk.csv --alphabet ipa --fps 5 --size 32 --head default:level=coarse -o x.mp4",
    ),
    "encode": ("talk.fap", "encode talk.fap -o talk.fba"),
    "decode": ("talk.fba", "decode talk.fba -o x.fap"),
    "convert": ("talk.fap", "convert talk.fap -o shapes.csv"),
    "convert, back": ("shapes.csv", "convert shapes.csv -o x.fap"),
    "convert --into": ("talk.fap", "convert talk.fap --into default:level=coarse -o x.glb"),
    "capture, scores": ("shapes.csv", "capture shapes.csv -o x.fap"),
    "render": ("talk.fap", "render talk.fap --size 32 --head default:level=coarse -o x.webm"),
    "inspect, phones": ("talk.csv", "inspect talk.csv --alphabet ipa"),
    "inspect, FAPs": ("talk.fap", "inspect talk.fap"),
    "inspect, stream": ("talk.fba", "inspect talk.fba"),
    "inspect, sound": ("talk.wav", "inspect talk.wav"),
    "score": ("talk.fap", "score talk.fap --phones talk.csv -o x.html"),
    "reduce": ("take.trc", "reduce take.trc --max-error 0.5mm -o x.npz"),
    "batch": ("rows.csv", "batch rows.csv -o rows --to fap --workers 0"),
    "say": ("said.txt", "say - -o x.fap"),
}
"""Input whose size is told, and the words; each may use what those before it wrote."""
MEASURE = """
import os, sys
quiet = [(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_WRONLY, 0) for number in (1, 2)]
_, status, usage = os.wait4(os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet), 0)
sys.stderr.write(f"{usage.ru_utime + usage.ru_stime} {usage.ru_maxrss / 1000}")
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""Run and measure words. A process's peak begins as that of the one that starts it, so this one is small."""
SENTENCE = "Many people may bring big blue bowls. "


def write_folder(folder: Path, seconds: float) -> None:
    """Write what the commands read."""
    write_inputs(folder, seconds)
    save_markers(folder / "take.trc", markers(round(100 * seconds)))
    text = SENTENCE * max(1, round(seconds / 3))
    (folder / "said.txt").write_text(text)
    (folder / "row.pho").write_text("_ 50\nm 100\na 200\n_ 50\n")
    (folder / "rows.csv").write_text("id,timings\n" + "".join(f"{n},row.pho\n" for n in range(round(seconds))))


def of_command(command: str, least: Path, folders: tuple[Path, Path]) -> Row:
    """Measure a command, each length in a process of its own, without what the least one takes."""
    name, words = COMMANDS[command]
    run = [sys.executable, "-m", "fapengine", *words.split()]

    def took(folder: Path) -> tuple[float, float]:
        with (folder / "said.txt").open("rb") as said:
            told = subprocess.run(
                [sys.executable, "-S", "-c", MEASURE, *run], cwd=folder, stdin=said, check=True, capture_output=True
            )
        cpu_s, mb = map(float, told.stderr.split()[-2:])
        return cpu_s, mb

    starts = [took(least) for _ in range(LEAST_RUNS)]
    start_s, start_mb = (min(column) for column in zip(*starts, strict=True))
    (less_s, less_mb), (more_s, more_mb) = (took(folder) for folder in folders)
    sizes = [(folder / name).stat().st_size for folder in folders]
    return Row(
        command, (sizes[0], sizes[1]),
        (max(less_s - start_s, 0.0), max(more_s - start_s, 0.0)),
        (max(less_mb - start_mb, 0.0), max(more_mb - start_mb, 0.0)),
        start=(start_s, start_mb),
    )  # fmt: skip


def main() -> int:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--only", nargs="+", choices=("readers", "commands"), default=("readers", "commands"))
    parser.add_argument(
        "--command", nargs="+", choices=COMMANDS, default=tuple(COMMANDS), help="with those that it needs first"
    )
    parser.add_argument("--table", type=Path)
    wanted = parser.parse_args()
    lines, bent = [], []

    def tell(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    def head(what: str, *more: str) -> None:
        columns = (what, "input, kB", "4 times", "CPU, s", "4 times", "times", "memory, MB", "4 times", *more)
        tell(f"\n| {' | '.join(columns)} |")
        tell("|---" * len(columns) + "|")

    if "readers" in wanted.only:
        head("reader")
        for reader in readers():
            row = of_reader(reader, wanted.rows)
            tell(str(row))
            bent += [] if row.is_linear else [row.name]
        clean()
    if "commands" in wanted.only:
        head("command", "start, s", "start, MB")
        with tempfile.TemporaryDirectory() as place:
            least, *folders = (Path(place) / name for name in ("least", "less", "more"))
            for folder, seconds in zip((least, *folders), (LEAST_S, wanted.seconds, 4 * wanted.seconds), strict=True):
                folder.mkdir()
                write_folder(folder, seconds)
            for command in wanted.command:
                row = of_command(command, least, (folders[0], folders[1]))
                tell(str(row))
                bent += [] if row.is_linear else [row.name]
    tell(f"\nmore than {MOST_TIMES:g} times a quarter: {', '.join(bent) or 'none'}")
    if wanted.table:
        wanted.table.write_text("\n".join(lines) + "\n")
    return bool(bent)


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main())
