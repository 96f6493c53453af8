"""Kill things at random moments, and tell what that did: ``python -m tests.faults --moments 200 --seed 1``."""

import argparse
import random
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Row:
    """What came of one target.

    Stateful.
    """

    moments: int = 0
    wrong: list[str] = field(default_factory=list)


def inject(moments: int, seed: int, *, only: str = "", tell: Callable[[str], None] = print) -> dict[str, Row]:
    """Kill at random moments: half of them verbs that write, half of them parts of a running server.

    Parameters
    ----------
    moments, seed : int
    only : str
        Beginning of the targets' names; the others are left out.
    tell : callable
        Told each moment that went wrong.
    """
    from tests.faults.servers import PARTS, World
    from tests.faults.writers import JOBS, Writers

    rng, rows = random.Random(seed), defaultdict[str, Row](Row)
    names = [
        [name for name in group if name.startswith(only)]
        for group in ([f"verb {name}" for name in JOBS], [f"server: {part}" for part in PARTS])
    ]
    turns = [group for group in names if group]
    with tempfile.TemporaryDirectory() as folder, World(Path(folder), rng) as world:
        writers = Writers(Path(folder), rng) if names[0] else None
        for number in range(moments):
            group = turns[number % len(turns)]
            name = group[number // len(turns) % len(group)]
            kind, _, what = name.partition(" ")
            wrong = writers.once(what) if kind == "verb" and writers else world.once(what)
            rows[name].moments += 1
            if wrong:
                rows[name].wrong.append(wrong)
                tell(f"moment {number}, {name}: {wrong}")
    return dict(rows)


def main() -> int:
    """Inject faults and print a table; 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="beginning of a target's name: verb, server, 'verb say'")
    options = parser.parse_args()
    begun_s = time.monotonic()
    rows = inject(options.moments, options.seed, only=options.only, tell=lambda text: print(text, flush=True))
    print(f"\n{'killed':<24}{'moments':>8}{'wrong':>7}")
    for name, row in sorted(rows.items()):
        print(f"{name:<24}{row.moments:>8}{len(row.wrong):>7}")
    wrong = sum(len(row.wrong) for row in rows.values())
    took_s = time.monotonic() - begun_s
    print(f"{'all':<24}{options.moments:>8}{wrong:>7}   seed {options.seed}, {took_s:.0f} s")
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
