"""Closures and the touch of lip and teeth: which of those that speech needs are made, and which need not be there.

What people notice first is a p, b or m with open lips. So the share of them that close (recall) stands beside how much
of the time with shut lips is called for (precision): a mouth that never opens has the first and not the second.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.scoring.mouth import Mouth
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone, PhoneTrack

CLOSED_MM = 1.0
"""Opening against rest under which lips count as closed. Of 49 p b m of 40 filmed sentences, 49 pass below it and 45
below 0.5 mm; video trackers are uncertain by 0.7 mm on the lips."""
TEETH_MM = 2.5
"""Distance under its height at rest, where the teeth's edge is, that the lower lip may keep on f and v. 16 of 19 filmed
ones come that near (13 to 1.5 mm); a vowel's lower lip is 5 mm and more below."""
TOLERANCE_S = 0.02
"""Half a frame at 25 Hz: how far outside its phone a contact may be."""
SLACK_S = 0.05
"""Lips come together before a closure and part behind it; shut time within this of one is called for."""
Span = tuple[float, float]
"""Start and end, s."""
PAUSE_S = 0.3
"""Lips of a truth that are shut for longer are at rest: no closure of speech."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """How many contacts were wanted and made."""

    wanted: int
    """Contacts that speech, or the truth, has."""
    met: int
    """Those of them that were made."""
    recall: float | None
    """``met / wanted``; None if none is wanted."""
    precision: float | None
    """Share of the shut time that is called for; None if the lips never shut, or where it has no meaning."""
    missed_s: tuple[float, ...] = ()
    """Middles of those that were not made, s."""


def is_bilabial(phone: Phone) -> bool:
    """Whether both lips touch in it."""
    return any(ipa.SOUNDS[letter].lips >= 1.0 for letter in ipa.letters(phone.label))


def is_labiodental(phone: Phone) -> bool:
    """Whether the lower lip touches the teeth in it."""
    return any(ipa.SOUNDS[letter].lips == 0.5 for letter in ipa.letters(phone.label))


def closures_of_phones(mouth: Mouth, phones: PhoneTrack, *, closed_mm: float = CLOSED_MM) -> Contacts:
    """Judge closures by the phones that need them: p b m and their kin.

    Precision: of the frames within speech whose lips are shut, the share within :data:`SLACK_S` of a bilabial or a
    labiodental. Pauses, and :data:`SLACK_S` around them, do not count.
    """
    spoken = [phone for phone in phones.phones if not phone.is_silence and phone.start_s <= mouth.end_s]
    needed = [(phone.start_s, phone.end_s) for phone in spoken if is_bilabial(phone)]
    touching = [(phone.start_s, phone.end_s) for phone in spoken if is_bilabial(phone) or is_labiodental(phone)]
    pauses = [(phone.start_s, phone.end_s) for phone in phones.phones if phone.is_silence]
    return _judged(mouth, needed, touching, [*pauses, (phones.duration_s, np.inf)], closed_mm)


def closures_of_truth(mouth: Mouth, truth: Mouth, *, closed_mm: float = CLOSED_MM) -> Contacts:
    """Judge closures by those of a truth: the times at which its lips are shut, for no longer than a pause."""
    shut = [span for span in runs(truth.opening_mm < closed_mm, truth.times_s) if span[0] <= mouth.end_s]
    needed = [span for span in shut if span[1] - span[0] <= PAUSE_S]
    pauses = [span for span in shut if span[1] - span[0] > PAUSE_S]
    return _judged(mouth, needed, needed, pauses, closed_mm)


def teeth_of_phones(mouth: Mouth, phones: PhoneTrack) -> Contacts:
    """Judge f and v: the lower lip comes to the teeth's edge at some time in it."""
    needed = [p for p in phones.phones if is_labiodental(p) and p.start_s <= mouth.end_s]
    met = [bool(_during(mouth, mouth.lower_mm, p.start_s, p.end_s).max() > -TEETH_MM) for p in needed]
    missed = tuple(round((p.start_s + p.end_s) / 2, 3) for p, good in zip(needed, met, strict=True) if not good)
    return Contacts(len(needed), sum(met), sum(met) / len(needed) if needed else None, None, missed)


def runs(flags: NDArray[np.bool_], times_s: NDArray[np.float64]) -> list[Span]:
    """First and last time of each run of true flags; ``flags`` and ``times_s`` are (T,)."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(times_s[start]), float(times_s[stop])) for start, stop in zip(starts, stops, strict=True)]


def _during(mouth: Mouth, values: NDArray[np.float64], start_s: float, end_s: float) -> NDArray[np.float64]:
    """Values of the frames of a contact; where frames are far apart, also between them."""
    first, last = start_s - TOLERANCE_S, min(end_s, mouth.end_s) + TOLERANCE_S
    low, high = np.searchsorted(mouth.times_s, (first, last)).tolist()
    edges = np.interp([first, (first + last) / 2, last], mouth.times_s, values)
    return np.concatenate([values[low:high], edges])


def _judged(mouth: Mouth, needed: list[Span], touching: list[Span], pauses: list[Span], closed_mm: float) -> Contacts:
    met = [bool(_during(mouth, mouth.opening_mm, start, end).min() < closed_mm) for start, end in needed]
    shut_s = mouth.times_s[mouth.opening_mm < closed_mm]
    shut_s = shut_s[~_within(shut_s, pauses)]
    called = _within(shut_s, touching)
    missed = tuple(round((a + b) / 2, 3) for (a, b), good in zip(needed, met, strict=True) if not good)
    return Contacts(
        wanted=len(needed),
        met=sum(met),
        recall=sum(met) / len(needed) if needed else None,
        precision=float(called.mean()) if len(shut_s) else None,
        missed_s=missed,
    )


def _within(times_s: NDArray[np.float64], spans: list[Span]) -> NDArray[np.bool_]:
    """Whether each time is in a span or within :data:`SLACK_S` of it."""
    inside = np.zeros(len(times_s), bool)
    for start, end in spans:
        first, last = np.searchsorted(times_s, (start - SLACK_S, end + SLACK_S + 1e-9)).tolist()
        inside[first:last] = True
    return inside
