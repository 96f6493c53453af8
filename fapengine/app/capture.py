"""Capture of FAPs from a video, a camera, landmarks, an OpenFace table or blendshape scores."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.app.drawing import resized
from fapengine.app.motion import LOADED, frames, save
from fapengine.capture.held_face import FACE_MESH, FACE_MESH_468, HeldFace, hold_face
from fapengine.capture.landmarks import FEATURE_POINTS, Picture, is_openface, parse_landmarks, parse_openface
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.files.landmarks import landmarks_of, landmarks_of_pictures
from fapengine.files.motion import load_motion
from fapengine.files.moving import is_moving, write_moving
from fapengine.files.paths import naming, read_bytes
from fapengine.files.provenance import COMPOSITE
from fapengine.files.recordings import save_markers
from fapengine.files.sound import load_sound
from fapengine.files.video import FILMS, camera_pictures, stream_pictures
from fapengine.laboratory.watched import openface_faps, watched_faps
from fapengine.mpeg4.track import FapTrack

CAMERA = "webcam"
CAMERA_S = 10.0
"""Default duration of a camera capture."""
PUPILS_MM = 62.0
"""Assumed distance of the pupils, an adult's; sizes in mm depend on it."""
MARKERS = (".npz", ".c3d", ".trc")
"""Outputs that hold feature points in mm, for ``fapengine fit``."""
OVERLAY_PX = 480


@dataclass(frozen=True, slots=True, eq=False)
class Captured:
    """FAPs, and their origin."""

    track: FapTrack
    kind: str
    """Kind of source, in words."""
    seen: float = 1.0
    """Fraction of the frames that show a face."""
    held: HeldFace | None = None


def run_capture(
    source: str,
    output: Path,
    *,
    size: tuple[int, int] | None = None,
    rate_hz: float | None = None,
    seconds: float | None = None,
    overlay: Path | None = None,
    head: str = "default",
    model: Path | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> Captured:
    """Capture, and write the kind of output that its name asks for.

    Parameters
    ----------
    source : str
        A video, landmarks, a table of OpenFace or of scores; ``webcam`` or ``webcam:1``.
    output : Path
    size, rate_hz : (int, int), float, optional
        Of landmarks, whose file contains neither: width and height of their images in pixels, frame rate.
    seconds : float, optional
        Duration of a camera capture, 10 s by default.
    overlay : Path, optional
        Video that shows ``head`` next to the captured face.
    model : Path, optional
        MediaPipe's ``face_landmarker.task``, for wheels without a model.
    on_frame : callable
        Called after each image that the face detector has processed.
    """
    if overlay is not None and not (_is_film(source) and is_moving(overlay)):
        raise UsageError(f"overlay: got {overlay} for {source}, expected a video (.mp4) for a video")
    found = _watch(source, size, rate_hz, CAMERA_S if seconds is None else seconds, model, on_frame)
    if output.suffix.lower() not in MARKERS:
        save(found.track, output)
    elif found.held is None:
        raise UsageError(f"{output}: {found.kind} has no points, expected .fap, .fba or .csv as output")
    else:
        rows = dict(sorted(FEATURE_POINTS.items()))
        still_mm = found.held.still_mm[:, list(rows)]
        save_markers(
            output, MarkerTrack(positions_mm=still_mm, labels=tuple(rows.values()), rate_hz=found.track.rate_hz)
        )
    if overlay is not None:
        _overlay(Path(source), overlay, found.track, head)
    return found


def _watch(
    source: str,
    size: tuple[int, int] | None,
    rate_hz: float | None,
    seconds: float,
    model: Path | None,
    on_frame: Callable[[], None],
) -> Captured:
    path = Path(source)
    if source.partition(":")[0] == CAMERA:
        pictures = camera_pictures(camera_number(source), seconds=seconds)
        times_s, landmarks = landmarks_of_pictures(pictures, model=model, on_frame=on_frame)
        return _seen(times_s, landmarks, "camera")
    if _is_film(source):
        times_s, landmarks = landmarks_of(path, model=model, on_frame=on_frame)
        with naming(path):
            return _seen(times_s, landmarks, "film")
    data = read_bytes(path)
    with naming(path):
        if is_openface(data):
            table = parse_openface(data)
            lost = np.isnan(table.points_mm).any(axis=(1, 2)).mean()
            return Captured(openface_faps(table), "OpenFace's table", seen=1.0 - float(lost))
        if size is not None:
            return _of_landmarks(data, size, rate_hz)
    if path.suffix.lower() not in LOADED:
        raise UsageError(
            f"{path}: got ending {path.suffix!r}, expected a video, {CAMERA}, or one of {', '.join(LOADED)}"
        )
    try:
        return Captured(load_motion(path), "blend shapes")
    except DataError as error:
        hint = "; landmarks (468 or 478 points per frame) need the size of their images"
        raise type(error)(error.message + hint, where=error.where) from error


def camera_number(source: str) -> int:
    """Read a camera's number: ``webcam:1`` is the second one."""
    _, _, number = source.partition(":")
    if number and not (number.isascii() and number.isdigit()):
        raise UsageError(f"source: got {source!r}, expected {CAMERA}, or {CAMERA}:1 for the second one")
    return int(number or 0)


def _is_film(source: str) -> bool:
    return Path(source).suffix.lower() in FILMS


def _seen(times_s: NDArray[np.float64], landmarks: NDArray[np.float64], kind: str) -> Captured:
    """Resample landmarks at even times, and convert them."""
    if len(times_s) < 2:
        raise DataError(f"{kind}: needs at least 2 images, got {len(times_s)}")
    rate_hz = float(f"{(len(times_s) - 1) / (times_s[-1] - times_s[0]):.5g}")
    even = np.arange(round(times_s[-1] * rate_hz) + 1) / rate_hz
    nearest = np.searchsorted((times_s[1:] + times_s[:-1]) / 2, even)
    return _held(landmarks[nearest], rate_hz, kind)


def _held(landmarks: NDArray[np.float64], rate_hz: float, kind: str) -> Captured:
    model = FACE_MESH if landmarks.shape[1] == FACE_MESH.count else FACE_MESH_468
    held = hold_face(np.arange(len(landmarks)) / rate_hz, landmarks, pupils_mm=PUPILS_MM, model=model)
    return Captured(watched_faps(held, rate_hz), kind, seen=float(held.seen.mean()), held=held)


def _of_landmarks(data: bytes, size: tuple[int, int], rate_hz: float | None) -> Captured:
    if rate_hz is None:
        raise UsageError("landmarks: size and rate are required; the file contains neither")
    width, height = size
    raw = parse_landmarks(data, Picture(float(width), float(height), 90.0, rate_hz))
    return _held(raw.positions * (1.0, -1.0, -1.0), rate_hz, "landmarks")


def _overlay(path: Path, overlay: Path, track: FapTrack, head: str) -> None:
    """Write the captured video next to the head."""
    drawing = resized(None, (OVERLAY_PX, OVERLAY_PX))

    def pairs() -> Iterator[NDArray[np.uint8]]:
        drawn = frames(track, head=head, drawing=drawing)
        for (_, picture), ours in zip(stream_pictures(path, max_side=OVERLAY_PX), drawn, strict=False):
            theirs = np.zeros((OVERLAY_PX, 2 * (picture.shape[1] // 2), 3), np.uint8)
            above = (OVERLAY_PX - picture.shape[0]) // 2
            theirs[above : above + picture.shape[0]] = picture[:, : theirs.shape[1]]
            yield np.concatenate([theirs, ours[..., :3]], axis=1)

    try:
        sound = load_sound(path)
    except DataError:  # a video without sound
        sound = None
    write_moving(overlay, pairs(), rate_hz=track.rate_hz, sound=sound, source=COMPOSITE)
