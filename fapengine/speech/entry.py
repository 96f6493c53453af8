"""``Entry``: one timed label as a file gives it, before it is understood."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    """One timed label as a file gives it."""

    start_s: float
    end_s: float
    label: str
    where: str
    """Line or key, for messages."""
    word: str = ""
