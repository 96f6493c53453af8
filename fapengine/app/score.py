"""Score of a lip sync, from files of motion, timings and sound."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import checked
from fapengine.app.hearing import Recognition, hear, read_text
from fapengine.app.manner import Manner
from fapengine.app.performance import perform, pronounced, read_timings
from fapengine.errors import DataError, UsageError
from fapengine.files.landmarks import landmarks_of
from fapengine.files.motion import load_motion
from fapengine.files.paths import naming, write_bytes
from fapengine.files.recordings import is_mesh_sequence, load_indices, load_vertices
from fapengine.files.sound import inspect_sound, load_sound
from fapengine.files.video import FILMS
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend import ADULT
from fapengine.scoring.mouth import CLOSED_MM, Mouth, mouth_of, mouth_of_landmarks
from fapengine.scoring.score import Score, score_mouth
from fapengine.scoring.thresholds import LIP_THRESHOLDS, MESH_THRESHOLDS, Threshold
from fapengine.scoring.timing import GRID_HZ
from fapengine.scoring.verdict import MEASURES, VERTEX_MEASURES, Verdict, judge
from fapengine.scoring.vertices import VertexErrors, vertex_errors
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.style import Style

MIN_SEEN = 16
"""Least number of images of a video."""
STILL = Style().without(["all"])
"""Nothing but the mouth moves."""
RECOGNIZER = "small"
"""Recognizer of sound without a transcript: it knows the voices of speech synthesizers, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreJob:
    """Input, reference and options of a score."""

    made: Path | FapTrack
    """Lip sync: anything that :func:`fapengine.load` reads, a video of a talking head, or a sequence of meshes."""
    against: Path | FapTrack | None = None
    """Reference recording of the same speech."""
    phones: Path | PhoneTrack | None = None
    """Timings of phones or words."""
    plan: bool = False
    """True to use the plan of the phones as the reference."""
    audio: Path | None = None
    """Sound of the speech; without phones and reference, its phones are recognized."""
    text: Path | None = None
    """Transcript of the sound, a file: its phones are aligned."""
    transcript: str | None = None
    """The same as a string."""
    language: str | None = None
    """Language of the transcript, or of timed words."""
    recognizer: Path | None = None
    """Recognizer of sound without a transcript."""
    offset_s: float = 0.0
    """Start of the lip sync within the other files."""
    closed_mm: float = CLOSED_MM
    """Lip opening below which lips count as closed."""
    voice: str | None = None
    """Voice that pronounces timings which have words only; by default that of the file's language."""
    how: Mapping[str, str | None] = field(default_factory=dict)
    """Options of :func:`fapengine.files.timings.load_timings`."""
    lips: Path | None = None
    """Vertices of the lips, for meshes."""
    upper: Path | None = None
    """Vertices of the upper face, for meshes."""
    neutral: Path | None = None
    """The mesh at rest."""
    thresholds: Mapping[str, float] = field(default_factory=dict)
    """Thresholds by name, which replace those of the measures."""
    output: Path | None = None
    """File for the report, HTML; None for none."""
    id: str = ""
    """Name of the utterance in a set."""
    system: str = ""
    """Name of the system that made it."""

    @property
    def name(self) -> str:
        """Name of the lip sync, for people."""
        return self.made.name if isinstance(self.made, Path) else "track"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A recording, its figures and the verdict."""

    job: ScoreJob
    score: Score | VertexErrors | None
    """None if it could not be scored."""
    verdict: Verdict
    remarks: tuple[str, ...] = ()
    """What looks wrong in the recording, and what was assumed."""
    frames: tuple[float, float] = (0.0, 0.0)
    """Time of the first frame, s, and frame rate, Hz, of a table with a line per frame; 0 Hz for others."""

    def as_dict(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        verdict = {
            "passes": self.verdict.passes,
            "faults": [asdict(fault) for fault in self.verdict.faults],
            "checked": list(self.verdict.checked),
            "unchecked": list(self.verdict.unchecked),
        }
        figures = asdict(self.score) if isinstance(self.score, VertexErrors) else self.score and self.score.as_dict()
        return {"verdict": verdict, "remarks": list(self.remarks), **(figures or {})}


@checked
def score(
    made: str | Path | FapTrack,
    *,
    against: str | Path | FapTrack | None = None,
    phones: str | Path | PhoneTrack | None = None,
    audio: str | Path | None = None,
    transcript: str | None = None,
    language: str | None = None,
    offset_s: float = 0.0,
    closed_mm: float = CLOSED_MM,
    thresholds: Mapping[str, float] | None = None,
) -> Scored:
    """Score a lip sync, as ``fapengine score`` does.

    Parameters
    ----------
    made : str, Path or FapTrack
        Motion to score: (T, 68) FAPs, anything that :func:`fapengine.load` reads, or a video of a talking head.
    against : str, Path or FapTrack, optional
        Reference recording of the same speech; gives ``score.truth``: distances in mm, correlations, lags in ms.
    phones : str, Path or PhoneTrack, optional
        Timed phones, or a file of them; give ``score.phones``: contacts and timing.
    audio : str or Path, optional
        Sound of the speech. Without ``phones`` and ``against``, its phones are recognized.
    transcript : str, optional
        What is said in the sound: its phones are aligned.
    language : str, optional
        Language of the transcript, American English by default; or of timed words, by default the one that the file
        names.
    offset_s : float
        Start of the motion within the other recordings.
    closed_mm : float
        Opening below which lips count as closed.
    thresholds : mapping of str to float, optional
        Thresholds of the verdict by name, such as ``{"closures": 95, "lag": 80}``: the names and units of
        :data:`fapengine.scoring.thresholds.LIP_THRESHOLDS`.

    Returns
    -------
    Scored
        ``score``: all figures; ``verdict``: ``passes``, ``faults`` with their times in s, and one line of text.

    Raises
    ------
    UsageError
        If a file cannot be read, or options contradict each other.
    DataError
        If a file's content is wrong.
    ResourceError
        If the recognizer or the face detector is needed and not installed.

    Examples
    --------
    >>> import fapengine
    >>> hello = fapengine.speak("My baby fell off a boat.", rate_hz=50.0)
    >>> fapengine.score(hello.track, phones=hello.phones).verdict.passes
    True
    >>> fapengine.score(hello.track * 0.05, phones=hello.phones).verdict.faults[0].check
    'opens'
    """

    def path(value: object) -> Any:
        return Path(value) if isinstance(value, str) else value

    known = {row.name for row in LIP_THRESHOLDS}
    if unknown := set(thresholds or {}) - known:
        raise UsageError(f"thresholds: got {sorted(unknown)[0]!r}, expected names of {', '.join(sorted(known))}")
    return run_score(
        ScoreJob(
            made=path(made), against=path(against), phones=path(phones), audio=path(audio), transcript=transcript,
            language=language, offset_s=offset_s, closed_mm=closed_mm, thresholds=thresholds or {},
        )
    )  # fmt: skip


def run_score(job: ScoreJob, *, on_frame: Callable[[], None] = lambda: None) -> Scored:
    """Score a lip sync, and write the report if ``output`` is set.

    Parameters
    ----------
    on_frame : callable
        Called after each frame of a video that the face detector has processed.
    """
    if isinstance(job.made, Path) and is_mesh_sequence(job.made):
        return _score_meshes(job)
    if job.lips is not None or job.upper is not None or job.neutral is not None:
        raise UsageError(f"lips, upper, neutral: require meshes (.npy, .npz, a folder of meshes), got {job.name}")
    if job.plan and (job.phones is None or job.against is not None):
        raise UsageError("plan: requires phones, and cannot be combined with another reference")
    if job.output is not None and job.output.suffix not in (".html", ".htm"):
        raise UsageError(f"output: got {job.output}, expected a name that ends with .html")
    sound = job.audio
    if sound is None and is_film(job.made) and not job.offset_s and _has_sound(job.made):
        sound = job.made
    _check_sources(job, sound)
    made, remarks = _mouth(job.made, job.offset_s, on_frame)
    phones, is_heard = _phones(job, sound)
    truth = _mouth(job.against, 0.0, on_frame)[0] if job.against is not None else None
    rate_hz = (len(made.times_s) - 1) / (made.end_s - made.start_s)
    if job.plan and phones is not None:
        truth = mouth_of(plan_of(phones, rate_hz))
    power = power_of(*load_sound(sound)) if sound is not None else None
    found = score_mouth(made, truth=truth, phones=phones, power=power, closed_mm=job.closed_mm, is_heard=is_heard)
    verdict = judge(found, MEASURES, job.thresholds)
    if job.output is not None:
        from fapengine.files.report.score_page import write_score_report

        report = write_score_report(
            found, made, verdict, title=job.name, notes=notes_of(job, found), truth=truth, phones=phones
        )
        write_bytes(job.output, report)
    is_table = isinstance(job.made, Path) and job.made.suffix.lower() == ".csv"
    frames = (job.offset_s, rate_hz) if is_table else (0.0, 0.0)
    return Scored(job=job, score=found, verdict=verdict, remarks=remarks, frames=frames)


def _score_meshes(job: ScoreJob) -> Scored:
    made, against = job.made, job.against
    if not isinstance(made, Path) or not isinstance(against, Path):
        raise UsageError("against: missing; meshes are compared with meshes")
    if any(each is not None for each in (job.phones, job.audio, job.text, job.transcript, job.output)):
        raise UsageError("phones, audio, text, output: cannot be used with meshes, whose lips are not known")
    _check_thresholds(job, MESH_THRESHOLDS, [name for name in ("lips", "upper") if getattr(job, name) is not None])
    indices = {name: load_indices(path) for name in ("lips", "upper") if (path := getattr(job, name)) is not None}
    found = vertex_errors(
        load_vertices(made), load_vertices(against), **indices,
        neutral=None if job.neutral is None else load_vertices(job.neutral),
    )  # fmt: skip
    return Scored(job=job, score=found, verdict=judge(found, VERTEX_MEASURES, job.thresholds))


def _check_sources(job: ScoreJob, sound: Path | None) -> None:
    """Reject options and thresholds that nothing can answer."""
    if sound is None:
        for name in ("text", "transcript", "recognizer"):
            if getattr(job, name) is not None:
                raise UsageError(f"{name}: requires audio, or a film with sound")
    if job.text is not None and job.transcript is not None:
        raise UsageError("text, transcript: use only one")
    if job.phones is not None and any((job.text, job.transcript, job.recognizer)):
        raise UsageError("phones: cannot be combined with text, transcript or recognizer")
    given = {name for name in ("phones", "against") if getattr(job, name) is not None}
    given |= {"audio"} if sound is not None else set()
    given |= {"against"} if job.plan else set()
    _check_thresholds(job, LIP_THRESHOLDS, given)


def _check_thresholds(job: ScoreJob, rows: Iterable[Threshold], given: Collection[str]) -> None:
    for row in rows:
        if row.name in job.thresholds and row.needs and not any(each in given for each in row.needs):
            raise UsageError(f"fail_under: {row.name} requires {' or '.join(row.needs)}")


def _phones(job: ScoreJob, sound: Path | None) -> tuple[PhoneTrack | None, bool]:
    """Phones that were given, aligned or recognized, and whether they were recognized."""
    if isinstance(job.phones, Path):
        return read_timings(job.phones, job.voice, language=job.language, **job.how), False
    if job.phones is not None:
        return pronounced(job.phones, job.voice, language=job.language), False
    transcript = read_text(job.text) if job.text is not None else job.transcript
    if sound is None or (transcript is None and job.against is not None and job.recognizer is None):
        return None, False
    recognizer = None if transcript is not None else job.recognizer or Path(RECOGNIZER)
    found = hear(sound, Recognition(transcript=transcript, language=job.language, recognizer=recognizer))
    return found.phones, transcript is None


def is_film(made: Path | FapTrack) -> TypeGuard[Path]:
    """Whether it is a video, by its name."""
    return isinstance(made, Path) and made.suffix.lower() in FILMS


def _mouth(made: Path | FapTrack, offset_s: float, on_frame: Callable[[], None]) -> tuple[Mouth, tuple[str, ...]]:
    """Measure a mouth; also remarks on what looks wrong in the file."""
    if not is_film(made):
        track = made if isinstance(made, FapTrack) else load_motion(made)
        return mouth_of(track, offset_s=offset_s), track.remarks
    times_s, landmarks = landmarks_of(made, on_frame=on_frame)
    times_s, kept = times_s + offset_s, times_s + offset_s >= -1e-9
    if kept.sum() < MIN_SEEN:
        raise DataError(f"{made}: got {int(kept.sum())} images from 0 s on, expected {MIN_SEEN} or more")
    with naming(made):
        return mouth_of_landmarks(times_s[kept], landmarks[kept]), ()


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
    return np.diff(total[edges]) / np.diff(edges)


def notes_of(job: ScoreJob, score: Score) -> list[str]:
    """Return sentences about what was compared, and how."""
    notes = [f"{score.frames} frames in {score.duration_s:.2f} s; lips count as closed below {job.closed_mm:g} mm."]
    if isinstance(job.against, Path):
        notes.append(f"Compared with {job.against.name}.")
    if is_film(job.made):
        notes.append(
            "Measured by a face detector, which estimates depth; millimetres assume an adult's pupil distance of"
            f" {ADULT.es0_mm:g} mm."
        )
    if job.plan:
        notes.append("Compared with fapengine's own plan of the phones, not with a person.")
    if isinstance(job.phones, Path):
        notes.append(f"Phones of {job.phones.name}.")
    elif score.phones is not None and score.is_heard:
        notes.append("Phones recognized in the sound, some of them wrongly: a transcript or timings are more exact.")
    elif score.phones is not None:
        notes.append("Phones aligned with the transcript.")
    if score.phones is None and score.truth is None:
        notes.append("No reference: give phones, sound or another recording to judge the lips.")
    return notes
