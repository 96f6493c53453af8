"""Timed labels and phones: ``PhoneTrack``, the type between every timing format and the animation.

``Reading`` reports how the labels of a file were understood, so that no guess is silent. :func:`find_unknown` lists the
labels that no alphabet explains.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from numbers import Real
from typing import Literal, NoReturn, get_args

from fapengine.errors import UsageError
from fapengine.speech import ipa

STAND_IN = "ə"
"""Phone shown for a label without any IPA symbol: the neutral vowel."""


@dataclass(frozen=True, slots=True)
class UnknownPhone:
    """A label outside its alphabet, and the phone shown instead."""

    label: str
    count: int
    first_s: float
    """Start of its first occurrence."""
    stand_in: str = STAND_IN

    def __str__(self) -> str:
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{self.label!r} {times}, first at {self.first_s:.3f} s; /{self.stand_in}/ is used instead"


@dataclass(frozen=True, slots=True)
class Reading:
    """Interpretation of a track's labels."""

    alphabet: str = ""
    """One of :data:`fapengine.speech.alphabets.convert.ALPHABETS`; empty for IPA from the start, and for words."""
    guessed: bool = False
    """True where neither the format nor the caller named the alphabet."""
    others: tuple[str, ...] = ()
    """Alphabets that explain as many of the labels, and read some of them differently."""
    doubtful: tuple[UnknownPhone, ...] = ()
    """Labels outside the alphabet, which are read character by character."""
    language: str = ""
    """Language of the words, as the file spells it: a code or a name; empty if it names none."""
    notes: tuple[str, ...] = ()
    """What is worth knowing and not wrong: the voice of the words, words that are not in the dictionary."""
    remarks: tuple[str, ...] = ()
    """What looks wrong, what was assumed, and how to override it."""

    def __str__(self) -> str:
        how = " (guessed)" if self.guessed else ""
        also = f"; {' and '.join(self.others)} would fit as well; alphabet=NAME says which" if self.others else ""
        return f"labels read as {self.alphabet}{how}{also}"


SILENCE = "_"
"""Label of a pause or gap; never an IPA letter."""
LOUDNESS_DB = (-12.0, 8.0)
"""Limits of a phone's loudness; beyond them a mouth does not change."""
Level = Literal["phone", "viseme", "word", "character"]
"""Units that a file gives times for."""


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
    """Confidence of the recognizer, 0..1; 1 for phones from other sources."""
    loudness_db: float = 0.0
    """Relative to the speaker's usual loudness, -12 (whispered) to 8 (shouted); 0 if it was not measured."""

    def __post_init__(self) -> None:
        try:  # a sum, because phones are made in every frame: whatever is not a number shows in it
            total = self.start_s + self.end_s + self.stress + self.confidence + self.loudness_db
            is_right = (
                isinstance(total, (float, int, Real)) and isinstance(self.label, str) and isinstance(self.word, str)
                and self.label != "" and 0 <= self.start_s < self.end_s < inf  # which no NaN is
                and self.stress in (0, 1, 2) and 0 <= self.confidence <= 1
                and LOUDNESS_DB[0] <= self.loudness_db <= LOUDNESS_DB[1]
            )  # fmt: skip
        except (TypeError, ValueError):
            is_right = False
        if not is_right:
            self._refuse()

    def _refuse(self) -> NoReturn:
        """Say what is wrong."""
        for name in ("label", "word"):
            if not isinstance(getattr(self, name), str):
                raise UsageError(f"{name}: got {getattr(self, name)!r:.40}, expected a text")
        for name in ("start_s", "end_s", "stress", "confidence", "loudness_db"):
            if not isinstance(getattr(self, name), Real):
                raise UsageError(f"{name}: got {getattr(self, name)!r:.40}, expected a number")
        if self.stress not in (0, 1, 2):
            raise UsageError(f"stress of {self.label!r}: got {self.stress}, expected 0, 1 or 2")
        if not 0 <= self.start_s < self.end_s < inf:
            raise UsageError(f"phone {self.label!r}: got {self.start_s} s .. {self.end_s} s, expected 0 <= start < end")
        if not 0 <= self.confidence <= 1:
            raise UsageError(f"confidence of {self.label!r}: must be 0 to 1, got {self.confidence}")
        if not self.label:
            raise UsageError(f"phone at {self.start_s} s: got an empty label, expected IPA or {SILENCE!r}")
        expected = f"{LOUDNESS_DB[0]:g} to {LOUDNESS_DB[1]:g}"
        raise UsageError(f"loudness_db of {self.label!r}: got {self.loudness_db}, expected {expected}")

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return self.end_s - self.start_s

    @property
    def is_silence(self) -> bool:
        """Whether this is a pause."""
        return self.label == SILENCE


def is_bilabial(phone: Phone) -> bool:
    """Return whether both lips touch in a phone."""
    return any(ipa.SOUNDS[letter].lips >= 1.0 for letter in ipa.letters(phone.label))


def is_labiodental(phone: Phone) -> bool:
    """Return whether the lower lip touches the teeth in a phone."""
    return any(ipa.SOUNDS[letter].lips == 0.5 for letter in ipa.letters(phone.label))


@dataclass(frozen=True, slots=True)
class PhoneTrack:
    """Phones in time order without overlaps and gaps: silence is a phone too. :meth:`from_phones` fills gaps."""

    phones: tuple[Phone, ...]
    level: Level = "phone"
    """Unit of the times; anything but phones gives less precise animation."""
    spelled: bool = False
    """True if the labels are written words, which must be pronounced before they can be shown."""
    reading: Reading = Reading()
    """How the labels of a file were understood."""

    def __post_init__(self) -> None:
        _check_phones(self.phones, tuple)
        if not (isinstance(self.level, str) and self.level in get_args(Level)):
            raise UsageError(f"level: got {self.level!r:.40}, expected one of {', '.join(get_args(Level))}")
        if not (isinstance(self.spelled, bool) and isinstance(self.reading, Reading)):
            got = f"{self.spelled!r:.40} and {self.reading!r:.40}"
            raise UsageError(f"spelled, reading: got {got}, expected true or false, and a Reading")
        for before, after in pairwise(self.phones):
            if after.start_s != before.end_s:
                raise UsageError(
                    f"phones: {before.label!r} ends at {before.end_s} s but {after.label!r} starts at"
                    f" {after.start_s} s, expected no gap and no overlap"
                )

    @classmethod
    def from_phones(
        cls,
        phones: list[Phone],
        *,
        tolerance_s: float = 1e-3,
        level: Level = "phone",
        spelled: bool = False,
        reading: Reading = Reading(),
    ) -> "PhoneTrack":
        """Make a track: gaps become silence, and neighbouring silences are joined.

        Parameters
        ----------
        phones : list of Phone
            In time order.
        tolerance_s : float
            Gaps and overlaps up to this length are rounding of the file; the later start is moved.
        level, spelled, reading : Level, bool, Reading
            See :class:`PhoneTrack`.

        Raises
        ------
        UsageError
            If phones overlap by more than the tolerance.
        """
        _check_phones(phones, (list, tuple))
        if not (isinstance(tolerance_s, Real) and tolerance_s >= 0):
            raise UsageError(f"tolerance_s: got {tolerance_s!r:.40}, expected 0 or more seconds")
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
                append(phone if phone.start_s == now_s else replace(phone, start_s=now_s))
                now_s = phone.end_s
        return cls(tuple(filled), level, spelled, reading)

    def __repr__(self) -> str:
        labels = " ".join(phone.label for phone in self.phones[:12]) + (" ..." if len(self.phones) > 12 else "")
        return f"PhoneTrack({len(self.phones)} {self.level}s, {self.duration_s:.2f} s: {labels})"

    @property
    def duration_s(self) -> float:
        """End of the last phone, in seconds; 0 for an empty track."""
        return self.phones[-1].end_s if self.phones else 0.0


def _check_phones(phones: object, kind: type[tuple[Phone, ...]] | tuple[type, ...]) -> None:
    if not (isinstance(phones, kind) and isinstance(phones, Sequence) and all(isinstance(p, Phone) for p in phones)):
        raise UsageError(f"phones: got {phones!r:.60}, expected Phone objects")


def find_unknown(track: PhoneTrack) -> tuple[UnknownPhone, ...]:
    """Find the labels outside IPA, and the doubtful ones, in the order in which they first occur.

    Examples
    --------
    >>> find_unknown(PhoneTrack((Phone("m", 0, 1), Phone("QQ", 1, 2), Phone("QQ", 2, 3))))[0].count
    2
    """
    unknown = [phone for phone in track.phones if not (phone.is_silence or ipa.letters(phone.label))]
    first_s = {phone.label: phone.start_s for phone in reversed(unknown)}
    counts = Counter(phone.label for phone in unknown)
    found = [UnknownPhone(label, count, first_s[label]) for label, count in counts.items()]
    return tuple(sorted((*found, *track.reading.doubtful), key=lambda each: each.first_s))
