"""Several faces in one image, and small changes to drawing options."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.files.pictures import straight
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.render.camera import turned
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, Picture, RenderOptions

if TYPE_CHECKING:
    from fapengine.render.native import NativeCrowd
    from fapengine.render.renderer import CrowdRenderer


def resized(drawing: RenderOptions | None, size: tuple[int, int] | None) -> RenderOptions:
    """Return drawing options, by default the standard ones, with another image size if given."""
    drawing = drawing or DEFAULT_RENDER_OPTIONS
    return drawing if size is None else replace(drawing, size=size)


def side_by_side(tracks: Sequence[FapTrack]) -> tuple[float, NDArray[np.int32]]:
    """Put tracks on one time axis: at the highest rate, each from its own start, until the longest ends.

    Between its frames, where frames are skipped, and after its end a track keeps its values.

    Parameters
    ----------
    tracks : sequence of FapTrack
        At least one, each with at least one frame.

    Returns
    -------
    rate_hz : float
    rows : (T, tracks, 68) int32, FAPU
    """
    columns = [track.filled_values() for track in tracks]
    rate_hz, shown = on_one_axis(list(map(len, columns)), [track.rate_hz for track in tracks])
    return rate_hz, np.stack([column[rows] for column, rows in zip(columns, shown, strict=True)], axis=1)


def on_one_axis(counts: Sequence[int], rates_hz: Sequence[float]) -> tuple[float, list[NDArray[np.int64]]]:
    """Return the highest rate, and the (T,) frame numbers of each motion at that rate, until the longest ends."""
    rate_hz = max(rates_hz)
    seconds = max(count / rate for count, rate in zip(counts, rates_hz, strict=True))
    times_s = np.arange(max(1, round(seconds * rate_hz))) / rate_hz
    return rate_hz, [shown_at(times_s, count, rate) for count, rate in zip(counts, rates_hz, strict=True)]


def shown_at(times_s: NDArray[np.float64], count: int, rate_hz: float) -> NDArray[np.int64]:
    """Return the number of the frame at each of (T,) times: the last one that has begun.

    Examples
    --------
    >>> shown_at(np.arange(4) / 25.0, 6, 60.0).tolist()
    [0, 2, 4, 5]
    """
    return np.minimum((times_s * rate_hz + 1e-6).astype(np.int64), count - 1)


def crowd_columns(faces: int) -> int:
    """Return the number of faces per row: up to four in one row."""
    return faces if faces <= 4 else -(-faces // round(faces**0.5))


def crowd_size(drawing: RenderOptions, faces: int) -> tuple[int, int]:
    """Width and height, in pixels, of the image of all faces."""
    columns = crowd_columns(faces)
    return columns * drawing.size[0], -(-faces // columns) * drawing.size[1]


def open_crowd(meshes: Sequence[FaceMesh], drawing: RenderOptions) -> "CrowdRenderer | NativeCrowd":
    """Create the renderer for several faces; the size in ``drawing`` is that of one face.

    Raises UsageError if the image is too large; ResourceError if the renderer is not available.
    """
    from fapengine.render.native import open_crowd_renderer

    return open_crowd_renderer(meshes, drawing, columns=crowd_columns(len(meshes)))


def draw_crowd(
    crowd: "CrowdRenderer | NativeCrowd",
    rows: Iterable[NDArray[np.int32] | Sequence[Pose]],
    rate_hz: float,
    *,
    turn_s: float = 0.0,
) -> Iterator[Picture]:
    """Draw frames one after the other.

    Parameters
    ----------
    crowd : CrowdRenderer or NativeCrowd
    rows : (T, faces, 68) int32, FAPU, or a Pose per frame and face
    rate_hz : float
        Frame rate.
    turn_s : float
        Time of one camera turn around the head; 0 for a fixed camera.

    Yields
    ------
    (height, width, 3 or 4) uint8
        sRGB, with straight alpha.
    """
    cameras = crowd.cameras

    def turning() -> Iterator[ArrayLike | Sequence[Pose]]:
        for number, row in enumerate(rows):
            if turn_s:
                crowd.cameras = [turned(camera, number / rate_hz / turn_s) for camera in cameras]
            yield row

    return map(straight, crowd.frames(turning()))
