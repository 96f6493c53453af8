"""Capture sessions from folders: recordings, the phone timings beside them, and ``session.toml``.

A session is a folder. Every recording in it is a take; a timing file of the same name holds its phones. Whatever cannot
be seen from the files stands in ``session.toml``, every key of which is optional::

    subject = "S03"
    language = "en-GB"                     # BCP 47
    licence = "CC-BY-4.0"
    attribution = "recorded by ..."
    units = "mm"                           # of recordings that do not say
    up = "+y"
    rate_hz = 120.0                        # of recordings that do not say, such as mesh sequences
    head = ["LFHD", "RFHD", "LBHD", "RBHD"]  # markers that follow the skull alone
    neutral = { take = "rest", start_s = 0.0, end_s = 1.0 }
    fapu_mm = { es0 = 62.0, ens0 = 47.0, irisd0 = 11.0 }

    [landmarks]                            # of tracks of a video tracker, in shares of the picture
    width_px = 1280.0
    height_px = 720.0
    eye_corners_mm = 89.0                  # between the outer eye corners

    [points]                               # marker label = feature point of the standard
    LLIP = "8.2"

    [[pose]]                               # an expression that the subject held
    expression = "joy"
    take = "faces"
    start_s = 1.2
    end_s = 1.6

    [[scan]]                               # a dense face; the first one is the neutral
    file = "scans/neutral.ply"             # in a folder of its own, mm
    landmarks = { "8.1" = [0.1, -20.4, 92.0], "8.2" = [0.0, -31.5, 90.3], "2.1" = [0.2, -70.1, 80.0] }
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fapengine._toml import TomlTable, parse_toml
from fapengine.capture.landmarks import Picture
from fapengine.capture.session import Interval, Session, Take
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import read_bytes
from fapengine.files.recordings import RECORDINGS, load_markers, load_surface, mesh_files
from fapengine.files.timings import load_timings
from fapengine.laboratory.setup import Moment, Pose, Scan, Setup
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES
from fapengine.mpeg4.visemes import Expression

SETUP_NAME = "session.toml"
TIMINGS = (".textgrid", ".lab", ".pho", ".align", ".json", ".csv")
"""Endings of timing files, looked for beside a recording in this order."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedSession:
    """A session as its folder has it."""

    session: Session
    setup: Setup
    warnings: tuple[str, ...]


def load_session(
    folder: Path,
    *,
    units: str | None = None,
    up: str | None = None,
    on_take: Callable[[str, int], None] = lambda name, count: None,
) -> LoadedSession:
    """Read a session's folder.

    Parameters
    ----------
    folder : Path
    units, up : str, optional
        Override those of ``session.toml``.
    on_take : callable
        Told each take's name, and how many there are, before it is read.

    Raises
    ------
    UsageError
        If there is no such folder, or no recording in it.
    DataError
        For a recording, timing file or ``session.toml`` that cannot be understood; ``where`` says which.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: got no folder, expected one with recordings ({', '.join(RECORDINGS)})")
    document = folder / SETUP_NAME
    table = parse_toml(read_bytes(document) if document.is_file() else b"", str(document))
    stated_units, stated_up = table.take("units", str, None), table.take("up", str, None)
    rate_hz = table.take("rate_hz", float, None)
    picture = _picture(table.table("landmarks"), rate_hz) if table.has("landmarks") else None
    subject = table.take("subject", str, folder.resolve().name)
    setup = _setup(table, folder)
    paths = _recordings(folder, {(folder / scan.name).parent for scan in setup.scans})
    if not paths:
        raise UsageError(f"{folder}: got no recording, expected some of {', '.join(RECORDINGS)}")
    takes, warnings = [], []
    for path in paths:
        on_take(path.stem, len(paths))
        recording = load_markers(
            path, units=units or stated_units, up=up or stated_up, rate_hz=rate_hz, picture=picture
        )
        warnings += [f"take {path.stem}: {text}" for text in recording.warnings]
        takes.append(Take(path.stem, recording.markers, _phones(path, recording.markers.duration_s, warnings)))
    try:
        return LoadedSession(Session(subject, tuple(takes)), setup, tuple(warnings))
    except DataError as error:
        raise type(error)(error.message, where=f"{folder}, {error.where}") from error


def _recordings(folder: Path, scans: set[Path]) -> list[Path]:
    """Files that are recordings, and folders of meshes, by name."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in RECORDINGS and not _is_timing(path))
    folders = (path for path in folder.iterdir() if path.is_dir() and path not in scans and mesh_files(path))
    return sorted([*files, *folders])


def _picture(table: TomlTable, rate_hz: float | None) -> Picture:
    if rate_hz is None:
        raise table.fail("", "got no rate_hz, expected the video's frames a second above [landmarks]")
    sizes = {key: table.take(key, float) for key in ("width_px", "height_px", "eye_corners_mm")}
    table.finish()
    try:
        return Picture(rate_hz=rate_hz, **sizes)
    except UsageError as error:
        raise table.fail("", str(error)) from error


def _is_timing(path: Path) -> bool:
    """Tell whether a table lies beside a recording of another kind, and so holds its phones."""
    return path.suffix.lower() in TIMINGS and any(
        path.with_suffix(ending).is_file() for ending in RECORDINGS if ending not in TIMINGS
    )


def _phones(path: Path, duration_s: float, warnings: list[str]) -> tuple[Interval, ...]:
    beside = {other.suffix.lower(): other for other in path.parent.glob(f"{path.stem}.*") if other != path}
    timing = next((beside[ending] for ending in TIMINGS if ending in beside), None)
    if timing is None:
        return ()
    track = load_timings(timing)
    if track.spelled:
        warnings.append(f"take {path.stem}: {timing.name} times words, not phones: left out")
        return ()
    phones = track.phones
    late = [phone for phone in phones if phone.end_s > duration_s + 0.1 and not phone.is_silence]
    if late:
        warnings.append(f"take {path.stem}: {len(late)} phones end behind the recording's {duration_s:.2f} s: left out")
    return tuple(Interval(p.label, p.start_s, p.end_s) for p in phones if p.end_s <= duration_s + 0.1)


def _setup(table: TomlTable, folder: Path) -> Setup:
    neutral = _moment(table.table("neutral")) if table.has("neutral") else None
    lengths = table.table("fapu_mm", needed=False)
    points = table.table("points", needed=False)
    setup = Setup(
        points={name: _point(points, name) for name in points},
        head=table.strings("head"),
        neutral=neutral,
        fapu_mm={name: lengths.take(name, float) for name in lengths},
        poses=tuple(_pose(row) for row in table.tables("pose", needed=False)),
        scans=tuple(_scan(row, folder) for row in table.tables("scan", needed=False)),
        language=table.take("language", str, "und"),
        licence=table.take("licence", str, "not stated"),
        attribution=table.take("attribution", str, ""),
    )
    table.finish()
    return setup


def _point(points: TomlTable, name: str) -> str:
    point: str = points.take(name, str)
    if point not in FEATURE_POINT_NAMES:
        raise points.fail(name, f"got {point!r}, expected a feature point such as 8.2")
    return point


def _moment(table: TomlTable) -> Moment:
    moment = Moment(table.take("take", str), table.take("start_s", float), table.take("end_s", float))
    table.finish()
    return moment


def _pose(table: TomlTable) -> Pose:
    name: str = table.take("expression", str)
    if name.upper() not in Expression.__members__ or name == "neutral":
        raise table.fail("expression", f"got {name!r}, expected one of the six expressions")
    return Pose(Expression[name.upper()], _moment(table))


def _scan(table: TomlTable, folder: Path) -> Scan:
    name: str = table.take("file", str)
    marks = table.table("landmarks")
    places = {mark: tuple(marks.numbers(mark, (3,)).tolist()) for mark in marks}
    table.finish()
    return Scan(name, load_surface(folder / name), places)
