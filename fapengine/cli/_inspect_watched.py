"""Report of ``fapengine inspect`` on what a face tracker wrote: landmarks of a face mesh, or OpenFace's table."""

import json
from pathlib import Path

import numpy as np
import typer


def inspect_watched(path: Path, *, as_json: bool) -> bool:
    """Print what a tracker saw, and how it becomes FAPs; False if the file is of no tracker."""
    from fapengine.files.paths import read_bytes

    data = read_bytes(path)
    facts = _openface(data) or _landmarks(data, path.suffix.lower())
    if facts is None:
        return False
    if as_json:
        typer.echo(json.dumps(facts))
        return True
    rate = f" at {facts['rate_hz']:g} Hz" if facts["rate_hz"] else ""
    typer.echo(f"{facts['format']}: {facts['points']} points a frame, {facts['frames']} frames{rate}")
    typer.echo(
        f"a face in {100 * float(str(facts['seen'])):.1f} % of them; the longest time without: {facts['longest']}"
    )
    typer.echo(f"{facts['has']}")
    asked = "" if facts["rate_hz"] else " --size WIDTHxHEIGHT --fps N"
    typer.echo(f"FAPs of it: fapengine capture {path}{asked} -o {path.stem}.fap")
    return True


def _openface(data: bytes) -> dict[str, object] | None:
    from fapengine.capture.openface import is_openface, parse_openface

    if not is_openface(data):
        return None
    table = parse_openface(data)
    units = sorted(table.action_units)
    gaze = "gaze" if table.gaze_rad is not None else "no gaze"
    has = f"{gaze}; {len(units)} action units{': ' if units else ''}{', '.join(units)}"
    return _facts("OpenFace's table", table.points_mm, table.rate_hz, has) | {"action_units": units}


def _landmarks(data: bytes, ending: str) -> dict[str, object] | None:
    from fapengine.capture.landmarks import COUNTS, Picture, parse_landmarks
    from fapengine.errors import DataError

    if ending == ".csv" and data.split(b"\n", 1)[0].count(b",") < 3 * COUNTS[0] - 1:
        return None
    try:
        track = parse_landmarks(data, Picture(1.0, 1.0, 90.0, 30.0))
    except DataError:
        return None
    irises = "with irises: gaze can be read" if track.positions.shape[1] > COUNTS[0] else "without irises: no gaze"
    return _facts("landmarks of a face mesh", track.positions, None, f"shares of a picture; {irises}")


def _facts(name: str, points: np.ndarray, rate_hz: float | None, has: str) -> dict[str, object]:
    lost = np.isnan(points).any(axis=(1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    longest = int((edges[1::2] - edges[::2]).max(initial=0))
    return {
        "format": name, "points": points.shape[1], "frames": len(points), "rate_hz": rate_hz,
        "seen": round(1 - float(lost.mean()), 4), "longest": f"{longest} frames", "has": has,
    }  # fmt: skip
