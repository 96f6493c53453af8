"""``Reading``: how the labels of a file were understood, so that no guess is silent."""

from dataclasses import dataclass

STAND_IN = "ə"
"""Shown for a label that has no IPA letter at all: the neutral vowel."""


@dataclass(frozen=True, slots=True)
class UnknownPhone:
    """A label that its alphabet does not explain, and what stands in for it."""

    label: str
    count: int
    first_s: float
    """Start of its first occurrence."""
    stand_in: str = STAND_IN

    def __str__(self) -> str:
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{self.label!r} {times}, first at {self.first_s:.3f} s; /{self.stand_in}/ stands in"


@dataclass(frozen=True, slots=True)
class Reading:
    """What the labels of a track were taken for."""

    alphabet: str
    """One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`."""
    guessed: bool = False
    """True where neither the format nor the caller named the alphabet."""
    others: tuple[str, ...] = ()
    """Alphabets that explain as many of the labels, and mean something else by some."""
    doubtful: tuple[UnknownPhone, ...] = ()
    """Labels that the alphabet does not have; their letters are read one by one."""

    def __str__(self) -> str:
        how = " (guessed)" if self.guessed else ""
        also = f"; {' and '.join(self.others)} would fit as well; alphabet=NAME says which" if self.others else ""
        return f"labels read as {self.alphabet}{how}{also}"
