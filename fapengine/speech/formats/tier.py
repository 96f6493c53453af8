"""``Tier``: the intervals of one tier of a TextGrid."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Tier:
    """One interval tier."""

    name: str
    intervals: tuple[tuple[float, float, str], ...]
    """(start_s, end_s, label), as written."""
