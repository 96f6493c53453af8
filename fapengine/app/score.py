"""Scores of lip syncs, from files of motion, timings and sound."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.app.manner import Manner
from fapengine.app.performance import perform, read_timings
from fapengine.errors import DataError, UsageError
from fapengine.files.landmarks import landmarks_of
from fapengine.files.motion import load_motion
from fapengine.files.paths import write_bytes
from fapengine.files.sound import inspect_sound, load_sound
from fapengine.files.video import FILMS
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ADULT
from fapengine.scoring.mouth import CLOSED_MM, Mouth, mouth_of, mouth_of_landmarks
from fapengine.scoring.score import Score, score_mouth
from fapengine.scoring.timing import GRID_HZ
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.style import Style

MIN_SEEN = 16
"""Least number of images of a video."""
STILL = Style(blinks=False, gaze=False, idle=False, emphasis=False, head_motion=False)
"""Nothing but the mouth moves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreJob:
    """Input, reference and options of a score."""

    made: Path
    """Lip sync: anything that :func:`fapengine.load` reads, or a video of a talking head."""
    against: Path | None = None
    """Reference recording of the same speech."""
    phones: Path | None = None
    """Timings of phones or words."""
    plan: bool = False
    """True to use the plan of the phones as the reference."""
    audio: Path | None = None
    """Sound of the speech."""
    offset_s: float = 0.0
    """Start of the lip sync within the other files."""
    closed_mm: float = CLOSED_MM
    """Lip opening below which lips count as closed."""
    voice: str | None = None
    """Voice that pronounces timings which have words only; by default that of the file's language."""
    how: Mapping[str, str | None] = field(default_factory=dict)
    """Options of :func:`fapengine.files.timings.load_timings`."""
    output: Path | None = None
    """File for the report, HTML; None for none."""


def run_score(job: ScoreJob, *, on_frame: Callable[[], None] = lambda: None) -> Score:
    """Score a lip sync, and write the report if ``output`` is set.

    Parameters
    ----------
    on_frame : callable
        Called after each frame of a video that the face detector has processed.
    """
    if job.plan and (job.phones is None or job.against is not None):
        raise UsageError("plan: requires phones, and cannot be combined with another reference")
    if job.output is not None and job.output.suffix not in (".html", ".htm"):
        raise UsageError(f"output: got {job.output}, expected a name that ends with .html")
    made = _mouth(job.made, job.offset_s, on_frame)
    phones = read_timings(job.phones, job.voice, **job.how) if job.phones is not None else None
    truth = _mouth(job.against, 0.0, on_frame) if job.against is not None else None
    if job.plan and phones is not None:
        truth = mouth_of(plan_of(phones, (len(made.times_s) - 1) / (made.end_s - float(made.times_s[0]))))
    sound = job.audio or (job.made if is_film(job.made) and not job.offset_s and _has_sound(job.made) else None)
    power = power_of(*load_sound(sound)) if sound is not None else None
    score = score_mouth(made, truth=truth, phones=phones, power=power, closed_mm=job.closed_mm)
    if job.output is not None:
        from fapengine.files.report.score_page import write_score_report

        report = write_score_report(
            score,
            made,
            title=job.made.name,
            notes=notes_of(job, score),
            truth=truth,
            phones=phones,
        )
        write_bytes(job.output, report)
    return score


def is_film(path: Path) -> bool:
    """Whether a name is that of a video."""
    return path.suffix.lower() in FILMS


def _mouth(path: Path, offset_s: float, on_frame: Callable[[], None]) -> Mouth:
    if not is_film(path):
        return mouth_of(load_motion(path), offset_s=offset_s)
    times_s, landmarks = landmarks_of(path, on_frame=on_frame)
    times_s, kept = times_s + offset_s, times_s + offset_s >= -1e-9
    if kept.sum() < MIN_SEEN:
        raise DataError(f"{path}: got {int(kept.sum())} images from 0 s on, expected {MIN_SEEN} or more")
    try:
        return mouth_of_landmarks(times_s[kept], landmarks[kept])
    except DataError as error:
        raise DataError(f"{path}: {error.message}") from error


def _has_sound(path: Path) -> bool:
    try:
        inspect_sound(path)
    except DataError:
        return False
    return True


def plan_of(phones: PhoneTrack, rate_hz: float) -> FapTrack:
    """Plan phones with the built-in profile."""
    return perform(phones, None, Manner(profile=DEFAULT_PROFILE, style=STILL, rate_hz=min(max(rate_hz, 25), 240))).track


def power_of(samples: NDArray[np.int16], rate_hz: int) -> NDArray[np.float64]:
    """Mean square of each 10 ms of a sound, (N,) float64, full scale 1."""
    edges = np.round(np.arange(int(len(samples) / rate_hz * GRID_HZ) + 1) * rate_hz / GRID_HZ).astype(np.int64)
    if len(edges) < 2:
        return np.zeros(0)
    total = np.concatenate([[0.0], np.cumsum((samples.astype(np.float64) / 2**15) ** 2)])
    power: NDArray[np.float64] = np.diff(total[edges]) / np.diff(edges)
    return power


def notes_of(job: ScoreJob, score: Score) -> list[str]:
    """Return sentences about what was compared, and how."""
    notes = [f"{score.frames} frames in {score.duration_s:.2f} s; lips count as closed below {job.closed_mm:g} mm."]
    if job.against is not None:
        notes.append(f"Compared with {job.against.name}.")
    if is_film(job.made):
        notes.append(
            "Measured by a face detector, which estimates depth; millimetres assume an adult's pupil distance of"
            f" {ADULT.es0_mm:g} mm."
        )
    if job.plan:
        notes.append("Compared with fapengine's own plan of the phones, not with a person.")
    if job.phones is not None:
        notes.append(f"Phones of {job.phones.name}.")
    if score.phones is None and score.truth is None:
        notes.append("No reference: give another recording or phones to judge the lips.")
    return notes
