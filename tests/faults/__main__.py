"""Kill things at random moments, and tell what that did: ``python -m tests.faults --moments 200 --seed 1``."""

import argparse
import random
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Row:
    """What came of one target.

    Stateful.
    """

    moments: int = 0
    wrong: list[str] = field(default_factory=list)


def inject(
    moments: int, seed: int, *, only: str = "", minutes: float = 60.0, tell: Callable[[str], None] = print
) -> dict[str, Row]:
    """Kill at random moments: commands that write, parts of running servers, and parts of an agent, side by side.

    Parameters
    ----------
    moments, seed : int
    only : str
        Beginning of the targets' names; the others are left out.
    minutes : float
        Time after which no further moment is begun.
    tell : callable
        Told each moment that went wrong.
    """
    from tests.faults import agents
    from tests.faults.servers import PARTS, World
    from tests.faults.writers import JOBS, Writers

    until_s = time.monotonic() + 60 * minutes
    sides = [
        (kind, names)
        for kind, those in (("command", JOBS), ("server:", PARTS), ("agent:", agents.PARTS))
        if (names := [name for name in those if f"{kind} {name}".startswith(only)])
    ]

    def run(kind: str, names: list[str], count: int) -> dict[str, Row]:
        rows, rng = defaultdict[str, Row](Row), random.Random(f"{seed} {kind}")
        with ExitStack() as all_:
            folder = Path(all_.enter_context(tempfile.TemporaryDirectory()))
            if kind == "command":
                once = Writers(folder, rng).once
            else:
                once = all_.enter_context(World(folder, rng) if kind == "server:" else agents.Agent(rng)).once
            for number in range(count):
                if time.monotonic() > until_s:
                    break
                row = rows[f"{kind} {names[number % len(names)]}"]
                try:
                    wrong = once(names[number % len(names)])
                except Exception as error:  # noqa: BLE001  a fault of ours: counted, and the others go on
                    wrong = f"{type(error).__name__}: {error}"
                row.moments += 1
                if wrong:
                    row.wrong.append(wrong)
                    tell(f"moment {number}, {kind} {names[number % len(names)]}: {wrong}")
        return dict(rows)

    counts = [moments // len(sides) + (place < moments % len(sides)) for place in range(len(sides))]
    with ThreadPoolExecutor(len(sides)) as threads:  # each lives to the end: what it starts ends with it
        begun = [threads.submit(run, kind, names, count) for (kind, names), count in zip(sides, counts, strict=True)]
        return {name: row for one in begun for name, row in one.result().items()}


def main() -> int:
    """Inject faults and print a table; 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="beginning of a target's name: command, server, 'command say'")
    parser.add_argument("--minutes", type=float, default=60.0, help="then no further moment is begun, and that fails")
    options = parser.parse_args()
    begun_s = time.monotonic()
    rows = inject(
        options.moments, options.seed, only=options.only, minutes=options.minutes,
        tell=lambda text: print(text, flush=True),
    )  # fmt: skip
    print(f"\n{'killed':<24}{'moments':>8}{'wrong':>7}")
    for name, row in sorted(rows.items()):
        print(f"{name:<24}{row.moments:>8}{len(row.wrong):>7}")
    wrong = sum(len(row.wrong) for row in rows.values())
    done, took_s = sum(row.moments for row in rows.values()), time.monotonic() - begun_s
    print(f"{'all':<24}{done:>8}{wrong:>7}   seed {options.seed}, {took_s:.0f} s")
    return wrong > 0 or done < options.moments


if __name__ == "__main__":
    sys.exit(main())
