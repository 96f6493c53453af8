"""Sums of counters: dataclasses whose fields are all whole numbers."""

from dataclasses import fields
from typing import Any, TypeVar

Counts = TypeVar("Counts")


def summed(first: Counts, *others: Counts) -> Counts:
    """Sum counters of one kind, field by field.

    Examples
    --------
    >>> from dataclasses import make_dataclass
    >>> Tries = make_dataclass("Tries", [("won", int), ("lost", int)])
    >>> summed(Tries(1, 2), Tries(3, 4))
    Tries(won=4, lost=6)
    """
    kind: Any = type(first)
    names = [field.name for field in fields(kind)]
    total: Counts = kind(*(sum(getattr(counts, name) for counts in (first, *others)) for name in names))
    return total
