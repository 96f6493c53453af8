"""``Mouth``: the motion that is measured, in mm and rad, and the contacts that speech needs.

Whatever face a motion was made for, it is measured on one adult face (:data:`fapengine.retarget.blend.ADULT`), so that
millimetres of two recordings mean the same. All lengths count from the face at rest.

People notice first a p, b or m with open lips. So the fraction of them that close (recall) is given with the fraction
of the time with closed lips that speech needs (precision): a mouth that never opens has the first, not the second.

A :class:`Mouth` can come from a video too (:func:`mouth_of_landmarks`). The head is held still
(:mod:`fapengine.capture.held_face`); the distance of the pupils is taken as the adult's. The rest face is what the
video itself shows: lips that touch, at the smallest distance seen (but no more than :data:`TOUCH_MM`, or a mouth that
never closes would count as closed); everything else at its median while the lips are closed.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, Mask, freeze
from fapengine.capture.held_face import hold_face
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ADULT
from fapengine.speech.phone_track import PhoneTrack, is_bilabial, is_labiodental

LIP_POINTS = tuple(
    f"{group}.{number}"
    for group, last in ((2, 9), (8, 8))
    for number in range(1, last + 1)
    if (group, number) != (2, 1)
)
"""Feature points of the lips that FAPs move: 2.2 to 2.9 inside, 8.1 to 8.8 outside."""
LID_FAPS = ((19, 21), (20, 22))
"""Upper and lower lid, left and right; together they close the eye by a lid distance, 1024 steps."""
HEAD_FAPS = (48, 49, 50)
"""Pitch, yaw, roll."""


@dataclass(frozen=True, slots=True, eq=False)
class Mouth:
    """A mouth, two lids and a head over time. Arrays are read-only."""

    times_s: Array
    """(T,) s, rising, 0 or more."""
    lips_mm: Array
    """(T, 16, 3) mm: how far each of :data:`LIP_POINTS` is from its place at rest."""
    opening_mm: Array
    """(T,) mm between the inner lips; negative where they are pressed together."""
    width_mm: Array
    """(T,) mm between the corners."""
    lower_mm: Array
    """(T,) mm: height of the lower lip's inner edge."""
    shut: Array
    """(T, 2): how far the left and the right eye are shut, 0..1."""
    head_rad: Array
    """(T, 3) rad: pitch, yaw, roll."""

    def __post_init__(self) -> None:
        freeze(self, times_s=("T",))
        count = len(self.times_s)
        freeze(self, opening_mm=(count,), width_mm=(count,), lower_mm=(count,), shut=(count, 2), head_rad=(count, 3))
        freeze(self, lips_mm=(count, len(LIP_POINTS), 3))

    @property
    def start_s(self) -> float:
        """Time of the first frame."""
        return float(self.times_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last frame."""
        return float(self.times_s[-1])

    def at(self, times_s: ArrayLike) -> "Mouth":
        """Interpolate linearly at other times, (N,) s; before and after, the first and the last frame hold."""
        wanted = np.asarray(times_s, dtype=np.float64)

        def moved(values: Array) -> Array:
            flat = values.reshape(len(values), -1)
            columns = [np.interp(wanted, self.times_s, column) for column in flat.T]
            return np.stack(columns, axis=1).reshape(len(wanted), *values.shape[1:])

        return Mouth(wanted, *(moved(getattr(self, field.name)) for field in fields(self)[1:]))


def mouth_of(track: FapTrack, *, offset_s: float = 0.0) -> Mouth:
    """Measure the mouth of a track.

    Parameters
    ----------
    track : FapTrack
        Two frames or more.
    offset_s : float
        Time of its first frame; frames before 0 are dropped.
    """
    times_s = track.times_s - (track.times_s[0] if len(track) else 0.0) + offset_s
    kept = times_s >= -1e-9
    if kept.sum() < 2:
        raise UsageError(f"track: got {int(kept.sum())} frames from 0 s on, expected two or more")
    values = track.values[kept].astype(np.float64)
    moved = values * ADULT.steps()

    def column(number: int) -> Array:
        return np.asarray(moved[:, fap.column(number)])

    lips = np.zeros((len(values), len(LIP_POINTS), 3))
    for row in fap.FAPS:
        if row.point in LIP_POINTS:
            lips[:, LIP_POINTS.index(row.point)] += column(row.number)[:, None] * np.array(fap.HEAD_AXES[row.positive])
    closing = [values[:, fap.column(upper)] + values[:, fap.column(lower)] for upper, lower in LID_FAPS]
    return Mouth(
        times_s[kept],
        lips,
        -(column(4) + column(5)),
        column(6) + column(7),
        column(5),
        np.clip(np.stack(closing, axis=1) / 1024, 0.0, 1.0),
        np.stack([column(number) for number in HEAD_FAPS], axis=1),
    )


CLOSED_MM = 1.0
"""Opening, relative to the rest face, below which lips count as closed. Of 49 p b m of 40 filmed sentences, 49 pass
below it and 45 below 0.5 mm; video trackers are uncertain by 0.7 mm on the lips."""
TEETH_MM = 2.5
"""Largest distance of the lower lip below its height at rest, where the teeth's edge is, on f and v. 16 of 19 filmed
ones come that near (13 to 1.5 mm); a vowel's lower lip is 5 mm and more below."""
TOLERANCE_S = 0.02
"""Half a frame at 25 Hz: how far outside its phone a contact may be."""
SLACK_S = 0.05
"""Lips come together before a closure and part after it; closed time within this of one is correct."""
Span = tuple[float, float]
"""Start and end, s."""
PAUSE_S = 0.3
"""Lips of a reference that are shut for longer are at rest, which is not a closure of speech."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """Counts of needed and made contacts."""

    wanted: int
    """Number of contacts in the phones, or in the reference."""
    met: int
    """Number of these that were made."""
    recall: float | None
    """``met / wanted``; None without contacts."""
    precision: float | None
    """Fraction of the shut time that speech needs; None if the lips never shut, and for teeth."""
    missed_s: tuple[float, ...] = ()
    """Middles of those that were not made, s."""


def closures_of_phones(mouth: Mouth, phones: PhoneTrack, *, closed_mm: float = CLOSED_MM) -> Contacts:
    """Count closures of the phones that need them: p, b, m and similar ones.

    Precision: of the frames within speech whose lips are shut, the fraction within :data:`SLACK_S` of a bilabial or a
    labiodental. Pauses, and :data:`SLACK_S` around them, do not count.
    """
    spoken = [phone for phone in phones.phones if not phone.is_silence and _is_seen(mouth, phone.start_s, phone.end_s)]
    needed = [(phone.start_s, phone.end_s) for phone in spoken if is_bilabial(phone)]
    touching = [(phone.start_s, phone.end_s) for phone in spoken if is_bilabial(phone) or is_labiodental(phone)]
    pauses = [(phone.start_s, phone.end_s) for phone in phones.phones if phone.is_silence]
    return _judged(mouth, needed, touching, [*pauses, (phones.duration_s, np.inf)], closed_mm)


def closures_of_truth(mouth: Mouth, truth: Mouth, *, closed_mm: float = CLOSED_MM) -> Contacts:
    """Count closures of a reference: the times at which its lips are shut, for no longer than a pause."""
    shut = [span for span in runs(truth.opening_mm < closed_mm, truth.times_s) if _is_seen(mouth, *span)]
    needed = [span for span in shut if span[1] - span[0] <= PAUSE_S]
    pauses = [span for span in shut if span[1] - span[0] > PAUSE_S]
    return _judged(mouth, needed, needed, pauses, closed_mm)


def teeth_of_phones(mouth: Mouth, phones: PhoneTrack) -> Contacts:
    """Count f and v in which the lower lip comes to the teeth's edge."""
    needed = [(p.start_s, p.end_s) for p in phones.phones if is_labiodental(p) and _is_seen(mouth, p.start_s, p.end_s)]
    met = [bool(_during(mouth, mouth.lower_mm, start, end).max() > -TEETH_MM) for start, end in needed]
    return _counted(needed, met, None)


def _is_seen(mouth: Mouth, start_s: float, end_s: float) -> bool:
    """Whether a contact begins before a mouth ends, and has its middle after the mouth begins."""
    return start_s <= mouth.end_s and (start_s + end_s) / 2 >= mouth.start_s


def _counted(needed: list[Span], met: list[bool], precision: float | None) -> Contacts:
    missed = tuple(round((start + end) / 2, 3) for (start, end), good in zip(needed, met, strict=True) if not good)
    return Contacts(len(needed), sum(met), sum(met) / len(needed) if needed else None, precision, missed)


def runs(flags: Mask, times_s: Array) -> list[Span]:
    """First and last time of each run of true flags; ``flags`` and ``times_s`` are (T,)."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(times_s[start]), float(times_s[stop])) for start, stop in zip(starts, stops, strict=True)]


def _during(mouth: Mouth, values: Array, start_s: float, end_s: float) -> Array:
    """Values of the frames of a contact; where frames are far apart, also between them."""
    first, last = start_s - TOLERANCE_S, min(end_s, mouth.end_s) + TOLERANCE_S
    low, high = np.searchsorted(mouth.times_s, (first, last)).tolist()
    edges = np.interp([first, (first + last) / 2, last], mouth.times_s, values)
    return np.concatenate([values[low:high], edges])


def _judged(mouth: Mouth, needed: list[Span], touching: list[Span], pauses: list[Span], closed_mm: float) -> Contacts:
    met = [bool(_during(mouth, mouth.opening_mm, start, end).min() < closed_mm) for start, end in needed]
    shut_s = mouth.times_s[mouth.opening_mm < closed_mm]
    shut_s = shut_s[~_within(shut_s, pauses)]
    return _counted(needed, met, float(_within(shut_s, touching).mean()) if len(shut_s) else None)


def _within(times_s: Array, spans: list[Span]) -> Mask:
    """For each time, whether it is in a span or within :data:`SLACK_S` of one."""
    inside = np.zeros(len(times_s), bool)
    for start, end in spans:
        first, last = np.searchsorted(times_s, (start - SLACK_S, end + SLACK_S + 1e-9)).tolist()
        inside[first:last] = True
    return inside


LIPS = {
    "2.2": 13, "2.3": 14, "2.4": 308, "2.5": 78, "2.6": 311, "2.7": 81, "2.8": 402, "2.9": 178,
    "8.1": 0, "8.2": 17, "8.3": 291, "8.4": 61, "8.5": 269, "8.6": 39, "8.7": 405, "8.8": 181,
}  # fmt: skip
"""Landmark of each feature point of the lips."""
LIDS = ((386, 374, 263, 362), (159, 145, 33, 133))
"""Upper lid, lower lid and corners of the left and the right eye."""
TOUCH_MM = 1.5
"""Largest distance of inner lips that counts as a touch: a detector seldom reports 0."""
SHUT_MM = 1.0
SHUT_SHARE = 0.25
"""Height of a shut eye, as the detector reports it, over that of the open one."""


def mouth_of_landmarks(times_s: Array, landmarks: Array) -> Mouth:
    """Measure the mouth of a video's landmarks.

    Parameters
    ----------
    times_s : (T,) float64, s
        Rising, from 0.
    landmarks : (T, 478, 3) float64, px
        To the right, down, and away from the camera; NaN where no face was seen.
    """
    held = hold_face(times_s, landmarks, pupils_mm=ADULT.es0_mm)
    still = held.still_mm
    gap = still[:, LIPS["2.2"], 1] - still[:, LIPS["2.3"], 1]
    opening = gap - min(float(np.percentile(gap, 2)), TOUCH_MM)
    shut = opening <= max(SHUT_MM, float(np.percentile(opening, 5)))
    lips = still[:, [LIPS[name] for name in LIP_POINTS]]
    width = np.linalg.norm(still[:, LIPS["8.3"]] - still[:, LIPS["8.4"]], axis=1)
    lower = still[:, LIPS["2.3"], 1]
    return Mouth(
        times_s,
        lips - np.median(lips[shut], axis=0),
        opening,
        width - np.median(width[shut]),
        lower - np.median(lower[shut]),
        np.stack([_closed(still, *lids) for lids in LIDS], axis=1),
        _angles(held.turns),
    )


def _closed(still: Array, upper: int, lower: int, outer: int, inner: int) -> Array:
    """(T,): how far an eye is shut, 0..1."""
    height = np.linalg.norm(still[:, upper] - still[:, lower], axis=1)
    height /= np.linalg.norm(still[:, outer] - still[:, inner], axis=1)
    opened = float(np.percentile(height, 75))
    return np.asarray(np.clip((1.0 - height / max(opened, 1e-9)) / (1.0 - SHUT_SHARE), 0.0, 1.0))


def _angles(turns: Array) -> Array:
    """(T, 3) rad: pitch down, yaw to the subject's left, roll to the right ear, of rotations (T, 3, 3) of the head."""
    forward, left = turns[:, :, 2], turns[:, :, 0]
    pitch = -np.arcsin(np.clip(forward[:, 1], -1, 1))
    yaw = np.arctan2(forward[:, 0], forward[:, 2])
    roll = np.arctan2(left[:, 1], left[:, 0])
    return np.stack([pitch, yaw, roll], axis=1)
