"""Mutated files, in number: every reader of :mod:`.readers` returns a value or raises an error of its own, in time.

    python -m tests.fuzz.mutated [--inputs 10000000] [--seconds 600] [--seed 1] [--table FILE.md]
    python -m tests.fuzz.mutated --each 200

Readers take turns of :data:`TURN_S` of processor time. Each gets :data:`AT_LEAST` of all inputs or more; the rest
goes to those that take :data:`CHEAP_S` or less for one. With --each, all get as many. The same seed gives a reader the
same inputs in every run. An input is a good example with a few bytes flipped, cut, doubled, swapped, or exchanged for
what nobody meant.

Each turn is a child process, so that a crash, a loop without end or a deadlock costs one input and is reported with it.
What breaks the law is left in out/fuzz, and the exit code is 1: an exception that the reader may not raise, a warning
of NumPy, a crash, more processor time than :data:`LEAST_S` and :data:`BYTE_S` a byte, more memory than
:data:`MOST_MB`. No limit is one of wall-clock time.
"""

import argparse
import json
import mmap
import os
import random
import resource
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from math import inf
from pathlib import Path

from tests.fuzz.readers import NUMBER, ODD, Reader, clean, readers

LEAST_S, BYTE_S = 1.0, 20e-6
"""CPU time that any input may take, and more for each byte: at least ten times what good files need."""
ENDLESS_S = 60.0
"""CPU time after which an input is given up, and its process killed."""
MOST_MB = 700
"""Peak of a process."""
MOST_ADDRESSES = 8 << 30
"""Address space of a process in bytes: what asks for more gets a MemoryError."""
TURN_S = 0.5
BLOCK = 100
"""Inputs that one seed makes."""
AT_LEAST = 1 / 500
"""Share of all inputs that every reader gets at least."""
CHEAP_S = 0.0005
ASLEEP = 6000
"""Looks, 10 ms apart or more, at a process that sleeps on one input: then it waits for what never comes."""


@dataclass
class Tally:
    """What a reader met with."""

    inputs: int = 0
    taken: int = 0
    """Inputs that were read; the others were refused."""
    worst_s: float = 0.0
    cpu_s: float = 0.0
    broken: list[str] = field(default_factory=list)

    def add(self, turn: "Tally") -> None:
        """Add what came of a turn."""
        self.inputs += turn.inputs
        self.taken += turn.taken
        self.worst_s = max(self.worst_s, turn.worst_s)
        self.cpu_s += turn.cpu_s
        self.broken += turn.broken


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
    except reader.refuses:
        pass
    except Exception as error:  # noqa: BLE001  that is what is looked for
        wrong = f"{type(error).__name__}: {error!s:.200}"
    took_s = time.process_time() - start_s
    tally.inputs += 1
    tally.worst_s = max(tally.worst_s, took_s)
    tally.cpu_s += took_s
    if took_s > LEAST_S + BYTE_S * len(data):
        wrong = f"{took_s:.1f} s for {len(data)} bytes"
    return wrong


class Board:
    """Memory shared with the children: which input they are at, and its bytes.

    Stateful.
    """

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, 8 << 20)

    def note(self, number: int, data: bytes) -> None:
        self._memory[: 16 + len(data)] = number.to_bytes(8, "little") + len(data).to_bytes(8, "little") + data

    @property
    def number(self) -> int:
        return int.from_bytes(self._memory[:8], "little")

    @property
    def data(self) -> bytes:
        return self._memory[16 : 16 + int.from_bytes(self._memory[8:16], "little")]


def search(
    inputs: int,
    seconds: float,
    seed: int,
    *,
    folder: Path,
    only: str = "",
    each: int | None = None,
    tell: Callable[[dict[str, Tally]], None] = lambda _: None,
) -> dict[str, Tally]:
    """Try up to ``inputs`` inputs in up to ``seconds``, or ``each`` of every reader; keep what breaks the law.

    ``tell`` is called after each round of turns.
    """
    chosen = [reader for reader in readers() if only in reader.name]
    for reader in chosen:
        warm(reader)
    tallies = {reader.name: Tally() for reader in chosen}
    folder.mkdir(parents=True, exist_ok=True)
    board, until_s = Board(), time.monotonic() + seconds
    quotas = dict.fromkeys(tallies, each or max(round(inputs * AT_LEAST), 1))
    shared_out = each is not None
    while time.monotonic() < until_s and (
        left := [one for one in chosen if tallies[one.name].inputs < quotas[one.name]]
    ):
        for reader in left:
            tally = tallies[reader.name]
            tally.add(turn(reader, range(tally.inputs, quotas[reader.name]), seed, board, folder, each is None))
        if not shared_out and (shared_out := len(left) == len(chosen)):
            quotas = shares(inputs, tallies)
        tell(tallies)
    return tallies


def warm(reader: Reader) -> None:
    """Read a good file: what is compiled or imported once is no cost of an input."""
    reader.read(reader.good[0])


def shares(inputs: int, tallies: dict[str, Tally]) -> dict[str, int]:
    """How many of so many inputs each reader gets, by what it has taken for one until now."""
    least = max(round(inputs * AT_LEAST), 1)
    cheap = [name for name, tally in tallies.items() if tally.cpu_s <= CHEAP_S * tally.inputs] or [*tallies]
    more = -(-max(inputs - least * len(tallies), 0) // len(cheap))
    return {name: least + more * (name in cheap) for name in tallies}


def turn(reader: Reader, numbers: range, seed: int, board: Board, folder: Path, is_timed: bool) -> Tally:
    """Try inputs of a reader in a child, all of them or, where timed, as many as a turn has time for."""
    board.note(numbers.start, b"")
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        try:
            told = _tried(reader, numbers, seed, board, folder, TURN_S if is_timed else inf)
            os.write(writes, json.dumps(asdict(told)).encode())
            code = 0
        finally:
            os._exit(code)
    os.close(writes)
    status, used = _ended(child, board)
    with os.fdopen(reads, "rb") as pipe:
        told = pipe.read()
    tally = Tally(**json.loads(told)) if told else Tally(inputs=board.number - numbers.start + 1, cpu_s=used.ru_utime)
    if not told:
        how = signal.Signals(-status).name if status < 0 else f"exit code {status}"
        keep(reader, board.number, board.data, f"the process ended with {how}", tally, folder)
    if used.ru_maxrss / 1024 > MOST_MB:
        keep(reader, board.number, board.data, f"{used.ru_maxrss / 1024:.0f} MB at this input or before", tally, folder)
    return tally


def _tried(reader: Reader, numbers: range, seed: int, board: Board, folder: Path, longest_s: float) -> Tally:
    """Try inputs, in a process of their own."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES, MOST_ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    tally, until_s, chance = Tally(), time.process_time() + longest_s, random.Random()
    for number in numbers:
        if number % BLOCK == 0 or number == numbers.start:
            if time.process_time() > until_s:
                break
            chance.seed(f"{seed} {reader.name} {number // BLOCK}")
            for _ in range(number % BLOCK):
                mutated(chance, reader.good)
        data = mutated(chance, reader.good)
        board.note(number, data)
        signal.setitimer(signal.ITIMER_PROF, ENDLESS_S)
        if (wrong := attempt(reader, data, tally)) is not None:
            keep(reader, number, data, wrong, tally, folder)
            if len(tally.broken) >= 20:
                break
    return tally


def _ended(child: int, board: Board) -> tuple[int, resource.struct_rusage]:
    """Wait for the end of a child; one that sleeps and sleeps on the same input is killed."""
    asleep, last = 0, -1
    while True:
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), used
        states = set()
        for thread in Path(f"/proc/{child}/task").glob("*/stat"):
            with suppress(OSError):  # it has just ended
                states.add(thread.read_text().rpartition(") ")[2][:1])
        asleep, last = (asleep + 1 if board.number == last and states == {"S"} else 0), board.number
        if asleep > ASLEEP:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.01)


def keep(reader: Reader, number: int, data: bytes, wrong: str, tally: Tally, folder: Path) -> None:
    """Note and keep what broke the law."""
    tally.broken.append(wrong)
    name = f"{reader.name.replace('/', ' ')}-{number}"
    (folder / name).write_bytes(data)
    (folder / f"{name}.why").write_text(wrong)


def peak_mb() -> float:
    """Peak memory of this process and its children."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024


def table(tallies: dict[str, Tally]) -> str:
    """Write the figures as a table."""
    groups: dict[str, list[Tally]] = {}
    for name, tally in tallies.items():
        groups.setdefault(name.split(",")[0] if name.startswith(("timings", "option")) else name, []).append(tally)
    lines = [
        "| reader | inputs | read all the same | slowest, s of CPU | not as promised | inputs a second of CPU |",
        "|---|---|---|---|---|---|",
    ]
    for name, some in groups.items():
        total, taken = (sum(getattr(tally, what) for tally in some) for what in ("inputs", "taken"))
        worst, broken = max(tally.worst_s for tally in some), sum(len(tally.broken) for tally in some)
        speed = total / max(sum(tally.cpu_s for tally in some), 1e-9)
        lines.append(f"| {name} | {total:,} | {taken:,} | {worst:.2f} | {broken} | {speed:,.0f} |")
    total, cpu_s = (sum(getattr(tally, what) for tally in tallies.values()) for what in ("inputs", "cpu_s"))
    fewest = min((tally.inputs for tally in tallies.values()), default=0)
    broken = sum(len(tally.broken) for tally in tallies.values())
    lines.append(
        f"| all {len(tallies)}, each at least {fewest:,} | {total:,} | | peak memory {peak_mb():.0f} MB | {broken} "
        f"| {total / max(cpu_s, 1e-9):,.0f} |"
    )
    return "\n".join(lines)


def main() -> int:
    """Search, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, help="inputs for each reader, however long they take")
    parser.add_argument("--only", default="", help="readers with this in their names")
    parser.add_argument("--table", type=Path, help="written after each round of turns")
    chosen = parser.parse_args()

    def tell(tallies: dict[str, Tally]) -> None:
        total, broken = sum(one.inputs for one in tallies.values()), sum(len(one.broken) for one in tallies.values())
        print(f"{total:,} inputs, {broken} not as promised", file=sys.stderr, flush=True)
        if chosen.table:
            chosen.table.write_text(table(tallies) + "\n")

    tallies = search(
        chosen.inputs,
        chosen.seconds,
        chosen.seed,
        folder=Path("out/fuzz"),
        only=chosen.only,
        each=chosen.each,
        tell=tell,
    )
    print(table(tallies))
    found = {name: tally.broken[:3] for name, tally in tallies.items() if tally.broken}
    if found:
        print(json.dumps(found, indent=2, ensure_ascii=False))
    clean()
    return bool(found) or peak_mb() > MOST_MB


if __name__ == "__main__":
    sys.exit(main())
