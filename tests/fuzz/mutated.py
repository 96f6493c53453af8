"""Mutated files, in number: every reader of :mod:`.readers` returns a value or raises an error of ours, in time.

    python -m tests.fuzz.mutated [--inputs 10000000] [--seconds 600] [--seed 1] [--table FILE.md]
    python -m tests.fuzz.mutated --each 200

Readers take turns and get equal time; with --each, as many inputs each, the same in every run. An input is a good
example with a few bytes flipped, cut, doubled, swapped, or exchanged for what nobody meant. What breaks the law is left
in out/fuzz, and the exit code is 1: any other exception, a warning of NumPy, a crash of the process, more time than
:data:`LEAST_S` and :data:`BYTE_S` a byte, more memory than :data:`MOST_MB`.
"""

import argparse
import json
import os
import random
import resource
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fapengine.errors import FapEngineError
from tests.fuzz.readers import NUMBER, ODD, Reader, clean, readers

LEAST_S, BYTE_S = 1.0, 20e-6
"""CPU time that any input may take, and more for each byte: at least ten times what good files need."""
MOST_MB = 700
"""Peak of the whole process."""
TURN_S = 0.2


@dataclass
class Tally:
    """What a reader met with."""

    inputs: int = 0
    taken: int = 0
    """Inputs that were read; the others were refused."""
    worst_s: float = 0.0
    broken: list[str] = field(default_factory=list)


def mutated(chance: random.Random, good: Sequence[bytes]) -> bytes:
    """Spoil a good file."""
    data = bytearray(chance.choice(good))
    for _ in range(chance.choice((1, 1, 2, 3, 6))):
        at = chance.randrange(len(data) + 1)
        kind = chance.randrange(8)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << chance.randrange(8)
        elif kind == 1 and at < len(data):
            data[at] = chance.randrange(256)
        elif kind == 2:
            del data[at : at + chance.choice((1, 2, 4, 30, 200))]
        elif kind == 3:
            data[at:at] = data[at : at + chance.choice((1, 4, 30, 200))] * chance.choice((1, 2, 9))
        elif kind == 4:
            data[at : at + chance.choice((0, 1, 4))] = chance.choice(ODD)
        elif kind == 5:
            other = chance.choice(good)
            start = chance.randrange(len(other) + 1)
            data[at : at + 20] = other[start : start + chance.choice((4, 20, 100))]
        elif kind == 6:
            found = NUMBER.search(data, at)
            if found:
                data[found.start() : found.end()] = chance.choice(ODD)
        elif kind == 7 and chance.random() < 0.3:
            del data[at:]
    return bytes(data)


def attempt(reader: Reader, data: bytes, tally: Tally) -> str | None:
    """Give bytes to a reader; says what is wrong with its answer."""
    start_s = time.process_time()
    wrong = None
    try:
        reader.read(data)
        tally.taken += 1
    except FapEngineError:
        pass
    except Exception as error:  # noqa: BLE001  that is what is looked for
        wrong = f"{type(error).__name__}: {error!s:.200}"
    took_s = time.process_time() - start_s
    tally.inputs += 1
    tally.worst_s = max(tally.worst_s, took_s)
    if took_s > LEAST_S + BYTE_S * len(data):
        wrong = f"{took_s:.1f} s for {len(data)} bytes"
    return wrong


def search(
    inputs: int,
    seconds: float,
    seed: int,
    *,
    folder: Path | None = None,
    only: str = "",
    turn_s: float = TURN_S,
    each: int | None = None,
) -> dict[str, Tally]:
    """Try up to ``inputs`` inputs in up to ``seconds``, or ``each`` of every reader; keep what breaks the law."""
    chance = random.Random(seed)
    chosen = [reader for reader in readers() if only in reader.name]
    for reader in chosen:  # what is compiled or imported once is no cost of an input
        reader.read(reader.good[0])
    tallies = {reader.name: Tally() for reader in chosen}
    turn_s, until_s = min(turn_s, seconds / max(len(chosen), 1)), time.monotonic() + seconds
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    last = 0
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        last = os.open(folder / "last", os.O_RDWR | os.O_CREAT)
    turns = 0
    while time.monotonic() < until_s and sum(tally.inputs for tally in tallies.values()) < inputs:
        if each and turns:
            break
        turns += 1
        for reader in chosen:
            tally, turn_until_s = tallies[reader.name], time.monotonic() + turn_s
            while True:
                data = mutated(chance, reader.good)
                if last:
                    os.pwrite(last, f"{len(data):9} {reader.name:60}".encode() + data, 0)  # what a crash leaves
                if (wrong := attempt(reader, data, tally)) is not None:
                    tally.broken.append(wrong)
                    if folder and len(tally.broken) <= 20:
                        name = f"{reader.name.replace('/', ' ')}-{len(tally.broken)}"
                        (folder / name).write_bytes(data)
                        (folder / f"{name}.why").write_text(wrong)
                if tally.inputs == each or (each is None and time.monotonic() > turn_until_s):
                    break
    if last:
        os.close(last)
    return tallies


def peak_mb() -> float:
    """Peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def table(tallies: dict[str, Tally]) -> str:
    """Write the figures as a table."""
    groups: dict[str, list[Tally]] = {}
    for name, tally in tallies.items():
        groups.setdefault(name.split(",")[0] if name.startswith(("timings", "option")) else name, []).append(tally)
    lines = ["| reader | inputs | read all the same | slowest, s | not as promised |", "|---|---|---|---|---|"]
    for name, some in groups.items():
        total, taken = (sum(getattr(tally, what) for tally in some) for what in ("inputs", "taken"))
        worst, broken = max(tally.worst_s for tally in some), sum(len(tally.broken) for tally in some)
        lines.append(f"| {name} | {total:,} | {taken:,} | {worst:.2f} | {broken} |")
    total = sum(tally.inputs for tally in tallies.values())
    lines.append(f"| all | {total:,} | | peak memory {peak_mb():.0f} MB | |")
    return "\n".join(lines)


def main() -> int:
    """Search, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, help="inputs for each reader, however long they take")
    parser.add_argument("--only", default="", help="readers with this in their names")
    parser.add_argument("--table", type=Path)
    chosen = parser.parse_args()
    only, each, folder = chosen.only, chosen.each, Path("out/fuzz")
    tallies = search(chosen.inputs, chosen.seconds, chosen.seed, folder=folder, only=only, each=each)
    written = table(tallies)
    print(written)
    if chosen.table:
        chosen.table.write_text(written + "\n")
    found = {name: tally.broken[:3] for name, tally in tallies.items() if tally.broken}
    if found:
        print(json.dumps(found, indent=2, ensure_ascii=False))
    clean()
    return bool(found) or peak_mb() > MOST_MB


if __name__ == "__main__":
    sys.exit(main())
