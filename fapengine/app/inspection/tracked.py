"""Recordings of markers, and what face trackers write: landmarks of a face mesh, or OpenFace's table."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from fapengine.app.inspection.report import FileKind, Report, Source, Table
from fapengine.capture.landmarks import COUNTS, Picture, is_openface, parse_landmarks, parse_openface
from fapengine.capture.marker_track import MarkerTrack, Synchrony, synchrony
from fapengine.errors import DataError
from fapengine.files.heads.built import load_built
from fapengine.files.recordings import RECORDINGS, is_table, load_markers, load_recorded_sound, mesh_files
from fapengine.files.sessions import load_session
from fapengine.laboratory.look import Look, look_over, session_lines
from fapengine.mesh.default_head.style import MEASURED

MARKERS_SHOWN = 12
MARKER_ENDINGS = (".c3d", ".trc", ".npz", ".pos", ".mat", ".bvh")
LANDMARK_ENDINGS = (".json", ".jsonl", ".csv")


def _markers(source: Source) -> Report:
    """Describe a recording, with a ``session.toml`` to start from."""
    is_mesh = source.path.is_dir()
    recording = load_markers(source.path, rate_hz=60.0 if is_mesh else None)
    track, look = recording.markers, look_over(recording.markers)
    lines = session_lines(look, track, source.path.stem, mesh=is_mesh)
    markers = {
        name: {"seen": round(float(seen), 4), "gaps": int(gaps), "longest_s": round(float(longest), 3)}
        for name, seen, gaps, longest in zip(track.labels, look.seen, look.gaps, look.longest_s, strict=True)
    }
    facts = {
        "format": "markers", "frames": track.frame_count, "rate_hz": track.rate_hz, "seconds": track.duration_s,
        "size_mm": [round(float(side), 1) for side in look.size_mm], "markers": markers, "named": look.named,
        "head": look.head, "quiet_s": look.quiet_s, "warnings": recording.warnings, "session": "\n".join(lines),
    }  # fmt: skip
    rows = []
    for index in np.argsort(look.seen, kind="stable"):
        longest = f", the longest {look.longest_s[index]:.2f} s" if look.gaps[index] else ""
        seen = f"seen in {100 * look.seen[index]:.1f} %, {look.gaps[index]} gaps"
        rows.append(f"  {track.labels[index]:<16} {seen}{longest}")
    wide, high, deep = look.size_mm
    sound, in_time = _sound(source.path, track)
    via = [f"via points: {recording.via_points}, with minimum-jerk motion between them"] if recording.via_points else []
    text: list[str | Table] = [
        *via,
        *([sound] if sound else []),
        f"recording: {len(track.labels)} markers, {track.frame_count} frames at {track.rate_hz:g} Hz,"
        f" {track.duration_s:.2f} s; {wide:.0f} x {high:.0f} x {deep:.0f} mm, +y up",
        Table(rows=rows, shown=MARKERS_SHOWN, more="  ... and {} that are seen no less (--all)"),
        f"feature points among the labels: {', '.join(look.named) or 'none'}",
        "\n# session.toml to start from\n" + "\n".join(lines),
    ]

    if in_time is not None:
        facts["sound"] = {"delay_s": round(in_time.delay_s, 3), "r": round(in_time.r, 3)}
    doubts = (
        ("sound and motion do not belong together as they were recorded",) if in_time and in_time.is_doubtful else ()
    )
    warnings = (*recording.warnings, *doubts)
    return Report(facts=facts, text=text, plot=lambda: _plot(source.path, track, look), warnings=warnings)


def _sound(path: Path, track: MarkerTrack) -> tuple[str, Synchrony | None]:
    """Describe the sound of a recording, and how it fits the motion."""
    sound = None if path.is_dir() else load_recorded_sound(path)
    if sound is None:
        return "", None
    found = synchrony(sound, track)
    fit = (
        f"; by loudness and motion it is {1000 * abs(found.delay_s):.0f} ms {'early' if found.delay_s < 0 else 'late'}"
        f" (r {found.r:.2f}; {found.r_as_recorded:.2f} as recorded)"
        if found
        else ""
    )
    return f"sound: {sound.label}, {len(sound.samples) / sound.rate_hz:.2f} s at {sound.rate_hz} Hz{fit}", found


def _plot(path: Path, track: MarkerTrack, look: Look) -> "np.ndarray":
    """Draw the markers from the front at the quietest moment, and when each is seen."""
    from fapengine.files.report.figures import recording  # matplotlib
    from fapengine.laboratory.few_markers import facing  # much of scipy

    first, last = (round(time_s * track.rate_hz) for time_s in look.quiet_s)
    shown = np.flatnonzero(track.valid.any(axis=0))
    quiet = track.positions_mm[first : max(last, first + 1), shown]
    places = np.where(np.isnan(quiet).all(axis=0), np.nanmedian(track.positions_mm[:, shown], axis=0), quiet[0])
    places = np.where(np.isnan(places), np.nanmedian(track.positions_mm[:, shown], axis=0), places)
    head = load_built(MEASURED)
    face_mm = {name: head.point_mm(name).astype(np.float64) for name in head.feature_points}
    labels = [track.labels[index] for index in shown]
    axes = facing(places, labels, face_mm)
    return recording(path.name, track.select(labels), places @ axes.T, look)


def _session(source: Source) -> Report:
    """Describe the takes of a session."""
    loaded = load_session(source.path)
    takes = {
        take.name: {
            "seconds": round(take.markers.duration_s, 3), "phones": len(take.phones),
            "seen": round(float(take.markers.valid.mean()), 4),
        }
        for take in loaded.takes
    }  # fmt: skip
    rows = [
        f"  {name:<16} {take['seconds']:.2f} s, {take['phones']} phones, {100 * take['seen']:.1f} % seen"
        for name, take in takes.items()
    ]
    session = loaded.session
    told = f"session {session.subject}: {len(takes)} takes of {len(session.labels)} markers at {session.rate_hz:g} Hz"
    facts = {
        "format": "session", "subject": session.subject, "rate_hz": session.rate_hz, "labels": session.labels,
        "takes": takes, "warnings": loaded.warnings,
    }  # fmt: skip
    text: list[str | Table] = [told, Table(rows=rows, shown=MARKERS_SHOWN, more="  ... and {} more takes (--all)")]
    return Report(facts=facts, text=text, plot="--plot draws one recording of a session", warnings=loaded.warnings)


def _is_tracked(source: Source) -> bool:
    if source.ending not in LANDMARK_ENDINGS or source.format or not source.path.is_file():
        return False
    return is_openface(source.data) or _landmarks(source.data, source.ending) is not None


def _tracked(source: Source) -> Report:
    """Describe what a tracker saw, and how it becomes FAPs."""
    facts = _openface(source.data) if is_openface(source.data) else _landmarks(source.data, source.ending)
    assert facts is not None
    rate = f" at {facts['rate_hz']:g} Hz" if facts["rate_hz"] else ""
    asked = "" if facts["rate_hz"] else " --size WIDTHxHEIGHT --fps N"
    text = [
        f"{facts['format']}: {facts['points']} points a frame, {facts['frames']} frames{rate}",
        f"a face in {100 * facts['seen']:.1f} % of them; the longest time without: {facts['longest']}",
        facts["has"],
        f"FAPs of it: fapengine capture {source.path}{asked} -o {source.path.stem}.fap",
    ]
    return Report(facts=facts, text=text, plot="holds what a tracker saw; --plot draws its FAPs, see fapengine capture")


def _openface(data: bytes) -> dict[str, Any]:
    table = parse_openface(data)
    units = sorted(table.action_units)
    gaze = "gaze" if table.gaze_rad is not None else "no gaze"
    has = f"{gaze}; {len(units)} action units{': ' if units else ''}{', '.join(units)}"
    return _seen("OpenFace's table", table.points_mm, table.rate_hz, has) | {"action_units": units}


@lru_cache(maxsize=1)
def _landmarks(data: bytes, ending: str) -> dict[str, Any] | None:
    """Make the values of landmarks; None if these are none."""
    if ending == ".csv" and data.split(b"\n", 1)[0].count(b",") < 3 * COUNTS[0] - 1:
        return None
    try:
        track = parse_landmarks(data, Picture(1.0, 1.0, 90.0, 30.0))
    except DataError:
        return None
    irises = "with irises: gaze can be read" if track.positions.shape[1] > COUNTS[0] else "without irises: no gaze"
    return _seen("landmarks of a face mesh", track.positions, None, f"shares of a picture; {irises}")


def _seen(name: str, points: np.ndarray, rate_hz: float | None, has: str) -> dict[str, Any]:
    lost = np.isnan(points).any(axis=(1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    longest = int((edges[1::2] - edges[::2]).max(initial=0))
    return {
        "format": name, "points": points.shape[1], "frames": len(points), "rate_hz": rate_hz,
        "seen": round(1 - float(lost.mean()), 4), "longest": f"{longest} frames", "has": has,
    }  # fmt: skip


MARKERS = FileKind(
    name="a marker recording",
    endings=(*MARKER_ENDINGS, ".csv"),
    fits=lambda source: (
        source.ending in MARKER_ENDINGS
        or (source.path.is_dir() and bool(mesh_files(source.path)))
        or (not source.format and is_table(source.path))
    ),
    describe=_markers,
)
SESSION = FileKind(
    name="a session",
    fits=lambda source: (
        source.path.is_dir() and any(path.suffix.lower() in RECORDINGS for path in source.path.iterdir())
    ),
    describe=_session,
)
TRACKED = FileKind(
    name="face landmarks or an OpenFace table", endings=LANDMARK_ENDINGS, fits=_is_tracked, describe=_tracked
)
