"""Timed labels and phones: ``PhoneTrack``, the type between every timing format and the animation.

``Reading`` reports how the labels of a file were understood, so that no guess is silent. :func:`find_unknown` lists the
labels that no alphabet explains.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import Literal

from fapengine.errors import UsageError
from fapengine.speech import ipa

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


SILENCE = "_"
"""Label of a pause or gap; never an IPA letter."""
LOUDNESS_DB = (-12.0, 8.0)
"""Bounds of a phone's loudness; beyond them a mouth does not do more."""
Level = Literal["phone", "viseme", "word", "character"]
"""Units that a tool gave times for."""


@dataclass(frozen=True, slots=True)
class Phone:
    """One phone: the timed instance of a phoneme."""

    label: str
    """IPA without stress marks, or :data:`SILENCE`."""
    start_s: float
    end_s: float
    stress: int = 0
    """0 none, 1 primary, 2 secondary."""
    word: str = ""
    """The word it belongs to, if known."""
    confidence: float = 1.0
    """Sureness of who heard it, 0..1; 1 too where nobody doubts."""
    loudness_db: float = 0.0
    """Against the speaker's usual loudness, -12..8: whispered, shouted; 0 too where nobody measured it."""

    def __post_init__(self) -> None:
        if not 0 <= self.start_s < self.end_s < inf:  # which no NaN is
            raise UsageError(f"phone {self.label!r}: got {self.start_s} s .. {self.end_s} s, expected 0 <= start < end")
        if not 0 <= self.confidence <= 1:
            raise UsageError(f"confidence of {self.label!r}: must be 0 to 1, got {self.confidence}")
        if not LOUDNESS_DB[0] <= self.loudness_db <= LOUDNESS_DB[1]:
            expected = f"{LOUDNESS_DB[0]:g}..{LOUDNESS_DB[1]:g}"
            raise UsageError(f"loudness_db of {self.label!r}: got {self.loudness_db}, expected {expected}")
        if not self.label:
            raise UsageError(f"phone at {self.start_s} s: got an empty label, expected IPA or {SILENCE!r}")

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return self.end_s - self.start_s

    @property
    def is_silence(self) -> bool:
        """Whether this is a pause."""
        return self.label == SILENCE


@dataclass(frozen=True, slots=True)
class PhoneTrack:
    """Phones in time order without overlap and without holes: silence is a phone too.

    Use :meth:`of` to fill the holes.
    """

    phones: tuple[Phone, ...]
    level: Level = "phone"
    """Unit that the times were given for; of anything but phones, less precise animation comes."""
    spelled: bool = False
    """True where the labels are still spelled words, which must be pronounced before they can be shown."""
    reading: Reading | None = None
    """Alphabet that the labels were read in; None where they were IPA from the start, or are words."""

    def __post_init__(self) -> None:
        for before, after in pairwise(self.phones):
            if after.start_s != before.end_s:
                raise UsageError(
                    f"phones: {before.label!r} ends at {before.end_s} s but {after.label!r} starts at"
                    f" {after.start_s} s, expected no gap and no overlap"
                )

    @classmethod
    def of(
        cls,
        phones: list[Phone],
        *,
        tolerance_s: float = 1e-3,
        level: Level = "phone",
        spelled: bool = False,
        reading: Reading | None = None,
    ) -> "PhoneTrack":
        """Make a track, with silence put into the gaps and neighbouring silences joined.

        Parameters
        ----------
        phones : list of Phone
            In time order.
        tolerance_s : float
            Gaps and overlaps up to this length are rounding of the file; the later start gives way.
        level, spelled, reading : Level, bool, Reading or None
            See :class:`PhoneTrack`.

        Raises
        ------
        UsageError
            If phones overlap by more than the tolerance.
        """
        filled: list[Phone] = []
        now_s = 0.0

        def append(phone: Phone) -> None:
            if phone.is_silence and filled and filled[-1].is_silence:
                filled[-1] = Phone(SILENCE, filled[-1].start_s, phone.end_s)
            else:
                filled.append(phone)

        for phone in phones:
            if phone.start_s < now_s - tolerance_s:
                raise UsageError(
                    f"phone {phone.label!r}: starts at {phone.start_s} s, but the one before ends at {now_s} s"
                )
            if phone.start_s > now_s + tolerance_s:
                append(Phone(SILENCE, now_s, phone.start_s))
                now_s = phone.start_s
            if phone.end_s > now_s:
                follows = phone.start_s == now_s
                append(phone if follows else replace(phone, start_s=now_s))
                now_s = phone.end_s
        return cls(tuple(filled), level, spelled, reading)

    @property
    def duration_s(self) -> float:
        """End of the last phone, in seconds; 0 for an empty track."""
        return self.phones[-1].end_s if self.phones else 0.0


def find_unknown(track: PhoneTrack) -> tuple[UnknownPhone, ...]:
    """Find the labels that are no IPA, and those that only seem to be, in the order in which they first come.

    Examples
    --------
    >>> find_unknown(PhoneTrack((Phone("m", 0, 1), Phone("QQ", 1, 2), Phone("QQ", 2, 3))))[0].count
    2
    """
    unknown: dict[str, UnknownPhone] = {}
    for phone in track.phones:
        if phone.is_silence or ipa.letters(phone.label):
            continue
        before = unknown.get(phone.label)
        first_s = before.first_s if before else phone.start_s
        unknown[phone.label] = UnknownPhone(phone.label, before.count + 1 if before else 1, first_s)
    doubtful = track.reading.doubtful if track.reading else ()
    return tuple(sorted((*unknown.values(), *doubtful), key=lambda each: each.first_s))
