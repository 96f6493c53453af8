"""Capture sessions from folders: recordings, their phone timings, and ``session.toml``.

A session is a folder. Every recording in it is a take; a timing file of the same name contains its phones. Everything
else is in ``session.toml``, whose keys are all optional::

    subject = "S03"
    language = "en-GB"                     # BCP 47
    licence = "CC-BY-4.0"
    attribution = "recorded by ..."
    units = "mm"                           # of recordings that do not state it
    up = "+y"
    rate_hz = 120.0                        # of recordings that do not state it, such as mesh sequences
    head = ["LFHD", "RFHD", "LBHD", "RBHD"]  # markers that follow the skull alone
    neutral = { take = "rest", start_s = 0.0, end_s = 1.0 }
    fapu_mm = { es0 = 62.0, ens0 = 47.0, irisd0 = 11.0 }

    [landmarks]                            # of tracks of a video tracker, in fractions of the image
    width_px = 1280.0
    height_px = 720.0
    eye_corners_mm = 89.0                  # between the outer eye corners

    [points]                               # marker label = feature point of the standard
    LLIP = "8.2"

    [[pose]]                               # an expression or phone that the subject held
    expression = "joy"
    take = "faces"
    start_s = 1.2
    end_s = 1.6

    [[scan]]                               # a dense face
    file = "scans/a.ply"                   # in a folder of its own, mm
    reference = true                       # the others get its vertices; lips apart; otherwise the first scan
    landmarks = { "8.1" = [0.1, -20.4, 92.0], "8.2" = [0.0, -31.5, 90.3], "2.1" = [0.2, -70.1, 80.0] }
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from glob import escape
from pathlib import Path

import numpy as np

from fapengine._strict_toml import MAX_BYTES, checked, parse_toml, spell_path
from fapengine.capture.conventions import check_conventions
from fapengine.capture.landmarks import Picture
from fapengine.capture.marker_track import Interval, Session, Take
from fapengine.errors import DataError, UsageError, as_data_error
from fapengine.expressions import STANDARD_EXPRESSIONS, Expression
from fapengine.files.paths import locating, read_bytes
from fapengine.files.recordings import RECORDINGS, load_markers, load_painted, mesh_files
from fapengine.files.timings import load_timings
from fapengine.laboratory.setup import HeldPhone, Moment, Pose, Scan, Setup
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.speech import ipa
from fapengine.speech.phone_track import PhoneTrack

SETUP_NAME = "session.toml"
TIMINGS = (".textgrid", ".lab", ".pho", ".align", ".json", ".csv")
"""Endings of timing files; the first that exists for a recording is read."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedSession:
    """A session read from its folder."""

    session: Session
    setup: Setup = Setup()  # noqa: RUF009  frozen
    warnings: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file that was read, by its path within the folder."""

    @property
    def takes(self) -> tuple[Take, ...]:
        """Its recordings."""
        return self.session.takes


@checked
def read(path: str | Path, *, rate_hz: float | None = None) -> LoadedSession:
    """Read a session, or one recording as a session of one take.

    Parameters
    ----------
    path : str or Path
        A folder of recordings with phone timings and ``session.toml``; a recording (.c3d, .trc, .csv, .tsv, .npz); via
        points of ``fapengine reduce`` (.npz), as the motion through them; or a folder of meshes.
    rate_hz : float, optional
        Frame rate of a folder of meshes, or of the motion through via points.

    Returns
    -------
    LoadedSession
        ``takes[0].markers`` has ``positions_mm`` (T, M, 3) float64 in mm, +y up, NaN where a marker was not seen,
        ``labels`` (M,) and ``rate_hz``; ``takes[0].phones`` are the phones, with times in s.

    Raises
    ------
    UsageError
        If there is no such file or folder, or it contains no recording.
    DataError
        If a file is wrong; ``where`` says which.
    """
    path = Path(path)
    if path.is_dir() and not mesh_files(path):
        return load_session(path)
    recording = load_markers(path, rate_hz=rate_hz)
    warnings: list[str] = list(recording.warnings)
    phones = _phones(path, recording.markers.duration_s, None, warnings)
    return LoadedSession(Session(path.stem, (Take(path.stem, recording.markers, phones),)), warnings=tuple(warnings))


def load_session(
    folder: Path,
    *,
    units: str | None = None,
    up: str | None = None,
    on_take: Callable[[str, int], None] = lambda name, count: None,
    pronounce: Callable[[PhoneTrack], PhoneTrack] | None = None,
) -> LoadedSession:
    """Read a session's folder.

    Parameters
    ----------
    folder : Path
    units, up : str, optional
        Override those of ``session.toml``.
    on_take : callable
        Called with the name of each take, and the number of takes, before it is read.
    pronounce : callable, optional
        Converts timings of words to phones; without it they are left out.

    Raises
    ------
    UsageError
        If the folder does not exist, or contains no recording.
    DataError
        If a recording, timing file or ``session.toml`` is wrong; ``where`` says which.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: not a folder; expected one with recordings ({', '.join(RECORDINGS)})")
    path = folder / SETUP_NAME
    document = parse_toml(read_bytes(path, MAX_BYTES) if path.is_file() else b"", _Document, str(path))
    picture = _picture(document, str(path))
    with as_data_error(where=str(path)):
        check_conventions(document.units, document.up)
    setup, units, up = _setup(document, folder), units or document.units, up or document.up
    used = {SETUP_NAME: path} if path.is_file() else {}
    used |= {scan.file: folder / scan.file for scan in document.scan}
    paths = _recordings(folder, {(folder / scan.name).parent for scan in setup.scans})
    if not paths:
        raise UsageError(f"{folder}: contains none of {', '.join(RECORDINGS)}")
    takes, warnings = [], []
    for path in paths:
        on_take(path.stem, len(paths))
        recording = load_markers(path, units=units, up=up, rate_hz=document.rate_hz, picture=picture)
        warnings += [f"take {path.stem}: {text}" for text in recording.warnings]
        phones = _phones(path, recording.markers.duration_s, pronounce, warnings)
        takes.append(Take(path.stem, recording.markers, phones))
        files = (*(mesh_files(path) if path.is_dir() else [path]), _timing_of(path))
        used |= {file.relative_to(folder).as_posix(): file for file in files if file is not None}
    inputs = {name: _digest(used[name]) for name in sorted(used)}
    with locating(folder):
        session = Session(document.subject or folder.resolve().name, tuple(takes))
    return LoadedSession(session, setup, tuple(warnings), inputs)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _recordings(folder: Path, scans: set[Path]) -> list[Path]:
    """List recordings and folders of meshes, sorted by name."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in RECORDINGS and not _is_timing(path))
    folders = (path for path in folder.iterdir() if path.is_dir() and path not in scans and mesh_files(path))
    return sorted([*files, *folders])


def _picture(document: "_Document", name: str) -> Picture | None:
    if document.landmarks is None:
        return None
    if document.rate_hz is None:
        raise DataError(
            "got no rate_hz, expected the video's frame rate above [landmarks]", where=spell_path(name, "landmarks")
        )
    with as_data_error(where=spell_path(name, "landmarks")):
        return Picture(rate_hz=document.rate_hz, **asdict(document.landmarks))


def _is_timing(path: Path) -> bool:
    """Whether a table accompanies a recording of another kind, and so contains its phones."""
    return path.suffix.lower() in TIMINGS and any(
        path.with_suffix(ending).is_file() for ending in RECORDINGS if ending not in TIMINGS
    )


def _timing_of(path: Path) -> Path | None:
    beside = {other.suffix.lower(): other for other in path.parent.glob(f"{escape(path.stem)}.*") if other != path}
    return next((beside[ending] for ending in TIMINGS if ending in beside), None)


def _phones(
    path: Path, duration_s: float, pronounce: Callable[[PhoneTrack], PhoneTrack] | None, warnings: list[str]
) -> tuple[Interval, ...]:
    timing = _timing_of(path)
    if timing is None:
        return ()
    track = load_timings(timing)
    if track.spelled:
        use = "left out" if pronounce is None else "pronounced, so phones within a word are not where they were said"
        warnings.append(f"take {path.stem}: {timing.name} times words, not phones: {use}")
        if pronounce is None:
            return ()
        track = pronounce(track)
    phones = track.phones
    late = [phone for phone in phones if phone.end_s > duration_s + 0.1 and not phone.is_silence]
    if late:
        warnings.append(f"take {path.stem}: {len(late)} phones end after the recording's {duration_s:.2f} s: left out")
    return tuple(Interval(p.label, p.start_s, p.end_s, p.word) for p in phones if p.end_s <= duration_s + 0.1)


@dataclass(frozen=True, slots=True)
class _Landmarks:
    width_px: float
    height_px: float
    eye_corners_mm: float


@dataclass(frozen=True, slots=True)
class _Pose:
    take: str
    start_s: float
    end_s: float
    expression: str | None = None
    phone: str | None = None


@dataclass(frozen=True, slots=True)
class _Scan:
    file: str
    landmarks: dict[str, tuple[float, float, float]]
    reference: bool = False


@dataclass(frozen=True, slots=True)
class _Document:
    """``session.toml``, key by key."""

    subject: str | None = None
    language: str = "und"
    licence: str = "not stated"
    attribution: str = ""
    units: str | None = None
    up: str | None = None
    rate_hz: float | None = None
    head: tuple[str, ...] = ()
    neutral: Moment | None = None
    fapu_mm: dict[str, float] = field(default_factory=dict)
    landmarks: _Landmarks | None = None
    points: dict[str, str] = field(default_factory=dict)
    pose: tuple[_Pose, ...] = ()
    scan: tuple[_Scan, ...] = ()


def _setup(document: _Document, folder: Path) -> Setup:
    def wrong(message: str, *keys: str | int) -> DataError:
        return DataError(message, where=spell_path(str(folder / SETUP_NAME), *keys))

    for name, point in document.points.items():
        if point not in FEATURE_POINT_NAMES:
            raise wrong(f"got {point!r}, expected a feature point such as 8.2", "points", name)
    poses = []
    held_phones = []
    for index, pose in enumerate(document.pose):
        moment = Moment(pose.take, pose.start_s, pose.end_s)
        if (pose.expression is None) == (pose.phone is None):
            raise wrong("got both or neither, expected an expression or a phone", "pose", index)
        if pose.phone is not None:
            symbols = "".join(ipa.letters(pose.phone))
            if not symbols:
                raise wrong(f"got {pose.phone!r}, expected a phone in IPA", "pose", index, "phone")
            held_phones.append(HeldPhone(symbols, moment))
            continue
        assert pose.expression is not None
        if pose.expression not in [one.label for one in STANDARD_EXPRESSIONS]:
            raise wrong(f"got {pose.expression!r}, expected one of the six expressions", "pose", index, "expression")
        poses.append(Pose(Expression[pose.expression.upper()], moment))
    for index, scan in enumerate(document.scan):
        for name, place_mm in scan.landmarks.items():
            if not np.isfinite(place_mm).all():
                raise wrong(f"got {place_mm}, expected finite numbers", "scan", index, "landmarks", name)
    if sum(scan.reference for scan in document.scan) > 1:
        raise wrong("got reference = true more than once, expected one reference", "scan")
    scans = []
    for scan in sorted(document.scan, key=lambda scan: not scan.reference):
        surface, paint = load_painted(folder / scan.file)
        scans.append(Scan(scan.file, surface, scan.landmarks, paint))
    return Setup(
        points=document.points, head=document.head, neutral=document.neutral, fapu_mm=document.fapu_mm,
        poses=tuple(poses), held_phones=tuple(held_phones), scans=tuple(scans),
        language=document.language, licence=document.licence, attribution=document.attribution,
        tracked=document.landmarks is not None,
    )  # fmt: skip
