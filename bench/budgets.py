"""Time and memory against the length of the input, for every reader and every verb that reads.

    python -m bench.budgets [--rows 2000] [--seconds 30] [--only readers verbs] [--table FILE.md]

Each reader of :mod:`tests.fuzz.readers` gets an input of ROWS frames, phones, vertices or words, and one four times as
long (:mod:`bench.growth`); each verb timings of SECONDS, and four times as long, or what it makes of them. A reader
whose longer input no file of ours holds gets a good file again and again; "refused" stands beside what it does not
take.

*CPU*: processor time; of a verb that of its process, start and libraries included. *Memory*: what Python allocates at
most; of a verb the process's peak. *Times*: the longer over the shorter one. Exits 1 where one takes more than
:data:`MOST_TIMES` the time or memory of its quarter, beyond :data:`NOTHING_S` or :data:`NOTHING_MB`.
"""

import argparse
import sys
import tempfile
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.growth import grown, markers
from bench.hour import measured, write_inputs
from fapengine.errors import FapEngineError
from fapengine.files.recordings import save_markers
from tests.fuzz.readers import Reader, clean, readers

MOST_TIMES = 5.0
"""Work and memory that are linear take four times as much; the rest is what else the machine does."""
NOTHING_S, NOTHING_MB = 0.05, 2.0


@dataclass(frozen=True)
class Row:
    """What an input, and one four times as long, took."""

    name: str
    size: tuple[int, int]
    """Bytes."""
    cpu_s: tuple[float, float]
    mb: tuple[float, float]
    is_read: bool = True

    @property
    def is_linear(self) -> bool:
        """Whether the longer input took no more than it may."""
        (less_s, more_s), (less_mb, more_mb) = self.cpu_s, self.mb
        return more_s <= MOST_TIMES * less_s + NOTHING_S and more_mb <= MOST_TIMES * less_mb + NOTHING_MB

    def __str__(self) -> str:
        name = self.name if self.is_read else f"{self.name} (refused)"
        cpu, mb = (f"{less:.3f} | {more:.3f}" for less, more in (self.cpu_s, self.mb))
        times = f"{self.cpu_s[1] / max(self.cpu_s[0], 1e-9):.1f}"
        return f"| {name} | {self.size[0] / 1000:.1f} | {self.size[1] / 1000:.1f} | {cpu} | {times} | {mb} |"


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


VERBS = {
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
    "reduce": ("take.trc", "reduce take.trc --bound 0.5mm -o x.npz"),
    "batch": ("rows.csv", "batch rows.csv -o rows --to fap --workers 0"),
    "align": ("said.wav", "align said.wav --text said.txt -o x.TextGrid"),
    "say": ("said.txt", "say - -o x.fap"),
}
"""Input whose size is told, and the words; each may use what those before it wrote."""
SENTENCE = "Many people may bring big blue bowls. "


def write_folder(folder: Path, seconds: float) -> None:
    """Write what the verbs read."""
    from fapengine.files.sound import save_wav
    from fapengine.voices.espeak import EspeakVoice

    write_inputs(folder, seconds)
    save_markers(folder / "take.trc", markers(round(100 * seconds)))
    text = SENTENCE * max(1, round(seconds / 3))
    (folder / "said.txt").write_text(text)
    speech = EspeakVoice().speak(text)
    save_wav(folder / "said.wav", speech.samples, speech.sample_rate_hz)
    (folder / "row.pho").write_text("_ 50\nm 100\na 200\n_ 50\n")
    (folder / "rows.csv").write_text("id,timings\n" + "".join(f"{n},row.pho\n" for n in range(round(seconds))))


def of_verb(verb: str, folders: tuple[Path, Path]) -> Row:
    """Measure a verb."""
    name, words = VERBS[verb]
    run = [sys.executable, "-m", "fapengine", *words.split()]
    found = [
        measured(["sh", "-c", 'cd "$0" && exec "$@" < said.txt 2> /dev/null', str(folder), *run]) for folder in folders
    ]
    sizes = [(folder / name).stat().st_size for folder in folders]
    (less_s, less_mb), (more_s, more_mb) = found
    return Row(verb, (sizes[0], sizes[1]), (less_s, more_s), (less_mb, more_mb))


def main() -> int:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--only", nargs="+", choices=("readers", "verbs"), default=("readers", "verbs"))
    parser.add_argument("--table", type=Path)
    wanted = parser.parse_args()
    lines, bent = [], []

    def tell(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    def head(what: str) -> None:
        tell(f"\n| {what} | input, kB | 4 times | CPU, s | 4 times | times | memory, MB | 4 times |")
        tell("|---|---|---|---|---|---|---|---|")

    if "readers" in wanted.only:
        head("reader")
        for reader in readers():
            row = of_reader(reader, wanted.rows)
            tell(str(row))
            bent += [] if row.is_linear else [row.name]
        clean()
    if "verbs" in wanted.only:
        head("verb")
        with tempfile.TemporaryDirectory() as less, tempfile.TemporaryDirectory() as more:
            folders = Path(less), Path(more)
            for folder, seconds in zip(folders, (wanted.seconds, 4 * wanted.seconds), strict=True):
                write_folder(folder, seconds)
            for verb in VERBS:
                row = of_verb(verb, folders)
                tell(str(row))
                bent += [] if row.is_linear else [row.name]
    tell(f"\nmore than {MOST_TIMES:g} times a quarter: {', '.join(bent) or 'none'}")
    if wanted.table:
        wanted.table.write_text("\n".join(lines) + "\n")
    return bool(bent)


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main())
