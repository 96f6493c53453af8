"""Garbage is collected little at a time, whoever makes it."""

import gc
import weakref
from typing import Any

from fapengine.server.intake.rates import PIECES, collecting_in_pieces

CYCLES = 50_000


class Part:
    """Stateful: half of a cycle."""

    other: "Part"


def cycle() -> Part:
    one, two = Part(), Part()
    one.other, two.other = two, one
    return one


def test_the_remains_of_many_connections_are_collected_in_pieces() -> None:
    before, generations, seen = gc.get_threshold(), [], []

    def note(phase: str, told: dict[str, Any]) -> None:
        if phase == "stop":
            generations.append(told["generation"])
            seen.append(told["collected"])

    with collecting_in_pieces():
        gc.callbacks.append(note)
        try:
            left = [weakref.ref(cycle()) for _ in range(CYCLES)]
        finally:
            gc.callbacks.remove(note)
        assert sum(one() is not None for one in left) < PIECES[0]
    assert len(generations) >= CYCLES // PIECES[0]
    assert set(generations) <= {0, 1}
    assert max(seen) <= 2 * PIECES[0]
    assert gc.get_threshold() == before
