"""What a track says that no phone set explains: said once a label, with its place."""

from dataclasses import dataclass

from fapengine.speech import ipa
from fapengine.speech.phone_track import PhoneTrack

STAND_IN = "ə"
"""Shown for a label that has no IPA letter at all: the neutral vowel."""


@dataclass(frozen=True, slots=True)
class UnknownPhone:
    """A label that is no IPA, and what stands in for it."""

    label: str
    count: int
    first_s: float
    """Start of its first occurrence."""
    stand_in: str = STAND_IN

    def __str__(self) -> str:
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{self.label!r} {times}, first at {self.first_s:.3f} s; /{self.stand_in}/ stands in"


def find_unknown(track: PhoneTrack) -> tuple[UnknownPhone, ...]:
    """Find the labels that are no IPA, in the order in which they first come.

    Examples
    --------
    >>> from fapengine.speech.phone_track import Phone
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
    return tuple(unknown.values())
