"""``Score``: all measures of one recording.

With a reference recording: distances of opening, width and lip points, frame by frame (:class:`Likeness`). With phones:
contacts and timing. Always: motion of the head and blinks (:class:`Behaviour`). With sound: whether lips open more with
loudness (:class:`Intensity`).
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError, UsageError
from fapengine.scoring.mouth import (
    CLOSED_MM,
    LIP_POINTS,
    Contacts,
    Mouth,
    closures_of_phones,
    closures_of_truth,
    runs,
    teeth_of_phones,
)
from fapengine.scoring.timing import GRID_HZ, Timing, grid, timing_of_phones, timing_of_truth
from fapengine.scoring.vertices import vertex_errors
from fapengine.speech.phone_track import PhoneTrack

MIN_MM = 1e-6
"""Range below which a length does not move, and correlates with nothing."""


@dataclass(frozen=True, slots=True)
class Likeness:
    """Similarity, over the reference's frames that both recordings have. None where one of them does not move."""

    opening_r: float | None
    """Pearson correlation of the openings."""
    opening_slope: float | None
    """Slope of the regression of the opening on the reference's: 0.5 opens half as far."""
    opening_mm: float
    """Mean distance of the openings (mouth opening distance, MOD)."""
    width_r: float | None
    """Pearson correlation of the widths."""
    width_slope: float | None
    """Slope of the width."""
    lips_mm: float
    """Mean distance of the 16 lip points."""
    lve_mm2: float
    """Lip vertex error: mean over frames of the largest squared distance of a lip point, mm²."""
    lve_root_mm: float
    """The same without the square, as some papers print it: mean of the largest distance, mm."""


def likeness_of(mouth: Mouth, truth: Mouth) -> Likeness:
    """Compare a mouth with a reference.

    Raises DataError if the reference has no frame while the mouth is recorded.

    Notes
    -----
    LVE is that of :mod:`fapengine.scoring.vertices`, with the lip points of MPEG-4 as vertices. Sets of vertices differ
    between papers, and so their figures cannot be compared with each other or with these.
    """
    times_s = truth.times_s[(truth.times_s >= mouth.start_s - 1e-9) & (truth.times_s <= mouth.end_s + 1e-9)]
    if not len(times_s):
        span = f"{mouth.start_s:.3f} to {mouth.end_s:.3f} s"
        raise DataError(f"reference: has no frame from {span}, the time of the lip sync")
    true, made = truth.at(times_s), mouth.at(times_s)
    apart = vertex_errors(made.lips_mm, true.lips_mm, lips=range(len(LIP_POINTS)))
    assert apart.lve is not None
    assert apart.lve_squared is not None
    return Likeness(
        opening_r=correlation(made.opening_mm, true.opening_mm),
        opening_slope=slope(made.opening_mm, true.opening_mm),
        opening_mm=float(np.abs(made.opening_mm - true.opening_mm).mean()),
        width_r=correlation(made.width_mm, true.width_mm),
        width_slope=slope(made.width_mm, true.width_mm),
        lips_mm=apart.mve,
        lve_mm2=apart.lve_squared,
        lve_root_mm=apart.lve,
    )


def correlation(one: Array, other: Array) -> float | None:
    """Pearson's r of two (T,) arrays; None if one of them does not vary."""
    if len(one) < 2 or np.ptp(one) < MIN_MM or np.ptp(other) < MIN_MM:
        return None
    return float(np.corrcoef(one, other)[0, 1])


def slope(made: Array, true: Array) -> float | None:
    """Slope of the regression of ``made`` on ``true``, both (T,); None if ``true`` does not vary."""
    if len(true) < 2 or np.ptp(true) < MIN_MM:
        return None
    centred = true - true.mean()
    return float(centred @ made / (centred @ centred))


BLINK_SHUT, BLINK_OPEN, MAX_BLINK_S = 0.5, 0.3, 0.6
"""An eye counts as shut below half its opening, and until it is seven tenths open again: detectors waver in between.
Longer closures are not blinks (blinks last 0.1 to 0.4 s; Schiffman, "Sensation and Perception", 2001, cited from
memory)."""
WINDOW_S, HOP_S, MIN_WINDOWS = 1.0, 0.5, 6
"""Windows in which loudness and motion are compared, and the smallest number of them that gives a result."""
LEVEL_FLOOR_DB = -50.0
"""Audio level, relative to the loudest moment, below which there is a pause."""


@dataclass(frozen=True, slots=True)
class Behaviour:
    """Head and eyes of one recording."""

    head_deg: tuple[float, float, float]
    """Standard deviations of pitch, yaw and roll."""
    head_deg_s: float
    """Mean speed of its turning."""
    blinks: int
    """Number of times that both eyes shut and opened again within 0.6 s."""
    blinks_per_minute: float
    blink_ms: float | None
    """Mean time for which eyes are more than half shut; None without a blink."""


@dataclass(frozen=True, slots=True)
class Intensity:
    """Lips and loudness."""

    slcc: float | None
    """Speech-lip intensity correlation; None for a recording too short or without change."""
    windows: int
    """Number of windows."""
    opening_r: float | None
    """Correlation of the level in dB with the opening, moment by moment, pauses left out."""


def behaviour_of(mouth: Mouth) -> Behaviour:
    """Measure head and eyes."""
    first_s, last_s = mouth.start_s, mouth.end_s
    length_s = last_s - first_s
    shut = _shut_spans(mouth.shut.min(axis=1), mouth.times_s)
    blinks = [(start, end) for start, end in shut if end - start <= MAX_BLINK_S and start > first_s and end < last_s]
    frame_s = length_s / (len(mouth.times_s) - 1)
    turned = np.linalg.norm(np.diff(mouth.head_rad, axis=0), axis=1).sum()
    pitch, yaw, roll = np.rad2deg(mouth.head_rad.std(axis=0)).tolist()
    return Behaviour(
        head_deg=(pitch, yaw, roll),
        head_deg_s=float(np.rad2deg(turned) / length_s),
        blinks=len(blinks),
        blinks_per_minute=60 * len(blinks) / length_s,
        blink_ms=float(1000 * np.mean([end - start + frame_s for start, end in blinks])) if blinks else None,
    )


def _shut_spans(shut: Array, times_s: Array) -> list[tuple[float, float]]:
    """First and last time of each closure, of how far the eyes are shut (0 to 1)."""
    spans = []
    for start_s, end_s in runs(shut > BLINK_OPEN, times_s):
        within = times_s[(times_s >= start_s) & (times_s <= end_s) & (shut > BLINK_SHUT)]
        if len(within):
            spans.append((float(within[0]), float(within[-1])))
    return spans


def intensity_of(mouth: Mouth, power: Array) -> Intensity:
    """Compare lips and loudness.

    Parameters
    ----------
    power : (N,) float64
        Mean square of the audio in each 10 ms, of any scale.

    Notes
    -----
    SLCC (Chae-Yeon et al., arXiv:2503.20308) is Pearson's r, over the clips of a corpus, of the sound's root mean
    square and the lips' (root mean square over frames of the mean motion of the lip points). Here windows of one second
    of one recording replace the clips.
    """
    times_s = grid(min(mouth.end_s, (len(power) - 1) / GRID_HZ), mouth.start_s)
    seen, power = mouth.at(times_s), power[np.round(times_s * GRID_HZ).astype(int)]
    motion = np.linalg.norm(np.diff(seen.lips_mm, axis=0, prepend=seen.lips_mm[:1]), axis=-1).mean(axis=1)
    width, hop = int(WINDOW_S * GRID_HZ), int(HOP_S * GRID_HZ)
    starts = range(0, len(times_s) - width + 1, hop)
    loud = np.array([np.sqrt(power[start : start + width].mean()) for start in starts])
    lips = np.array([np.sqrt((motion[start : start + width] ** 2).mean()) for start in starts])
    enough = len(starts) >= MIN_WINDOWS
    peak = power.max() if len(power) else 0.0
    level = 10 * np.log10(np.maximum(power, 1e-12 * max(peak, 1e-30)) / max(peak, 1e-30))
    spoken = level > LEVEL_FLOOR_DB
    return Intensity(
        slcc=correlation(loud / max(loud.max(), 1e-30), lips) if enough else None,
        windows=len(starts),
        opening_r=correlation(level[spoken], seen.opening_mm[spoken]),
    )


DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class AgainstPhones:
    """Measures against phones."""

    closures: Contacts
    teeth: Contacts
    timing: Timing


@dataclass(frozen=True, slots=True, kw_only=True)
class AgainstTruth:
    """Measures against another recording."""

    closures: Contacts
    timing: Timing
    likeness: Likeness
    behaviour: Behaviour
    """Head and eyes of the reference."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Every figure of a recording."""

    duration_s: float
    frames: int
    closed_mm: float
    """Opening under which lips counted as closed."""
    opens_mm: float | None
    """How far the mouth opens where phones are spoken, or in the whole recording if they are unknown: the 95th less the
    5th percentile of the opening. None if nothing is spoken."""
    behaviour: Behaviour
    is_heard: bool = False
    """Whether the phones were recognized, so that some are wrong."""
    phones: AgainstPhones | None = None
    truth: AgainstTruth | None = None
    intensity: Intensity | None = None

    @property
    def judged(self) -> AgainstPhones | AgainstTruth | None:
        """What closures and timing are judged by: the phones if they are known, else the reference."""
        return self.phones or self.truth

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, rounded, for JSON."""
        return {name: _rounded(value) for name, value in asdict(self).items()}


def score_mouth(
    mouth: Mouth,
    *,
    truth: Mouth | None = None,
    phones: PhoneTrack | None = None,
    power: Array | None = None,
    closed_mm: float = CLOSED_MM,
    is_heard: bool = False,
) -> Score:
    """Score a mouth, of a track or of a video.

    Parameters
    ----------
    mouth : Mouth
        The lip sync to score.
    truth : Mouth, optional
        Reference: another recording of the same speech.
    phones : PhoneTrack, optional
        Phones of the speech, in IPA.
    power : (N,) float64, optional
        Mean square of the audio in each 10 ms.
    closed_mm : float
        Opening below which lips count as closed.
    is_heard : bool
        Whether the phones were recognized.
    """
    if not closed_mm > 0:
        raise UsageError(f"closed_mm: must be above 0, got {closed_mm}")
    if phones is not None and phones.spelled:
        raise UsageError("phones: got spelled words, expected phones; pronounce them first")
    return Score(
        duration_s=mouth.end_s - mouth.start_s,
        frames=len(mouth.times_s),
        closed_mm=closed_mm,
        opens_mm=opens_mm(mouth, phones),
        behaviour=behaviour_of(mouth),
        is_heard=is_heard,
        phones=None if phones is None else AgainstPhones(
            closures=closures_of_phones(mouth, phones, closed_mm=closed_mm), teeth=teeth_of_phones(mouth, phones),
            timing=timing_of_phones(mouth, phones),
        ),
        truth=None if truth is None else AgainstTruth(
            closures=closures_of_truth(mouth, truth, closed_mm=closed_mm), timing=timing_of_truth(mouth, truth),
            likeness=likeness_of(mouth, truth), behaviour=behaviour_of(truth),
        ),
        intensity=None if power is None else intensity_of(mouth, power),
    )  # fmt: skip


def opens_mm(mouth: Mouth, phones: PhoneTrack | None) -> float | None:
    """How far a mouth opens in speech, mm; None if nothing is spoken while it is recorded. See :class:`Score`."""
    spoken = np.full(len(mouth.times_s), phones is None)
    for phone in phones.phones if phones is not None else ():
        if not phone.is_silence:
            spoken |= (mouth.times_s >= phone.start_s) & (mouth.times_s <= phone.end_s)
    if not spoken.any():
        return None
    low, high = np.percentile(mouth.opening_mm[spoken], (5, 95))
    return float(high - low)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, DIGITS) if isinstance(value, float) else value
