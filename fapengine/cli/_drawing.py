"""What a command line says of how a face is drawn."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.files.pictures import Picture, load_picture, straight
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.render.camera import preset, turned
from fapengine.render.canvas import Background
from fapengine.render.crowd import CrowdRenderer

EDGES = {"fine": 4, "soft": 0}
"""Samples a pixel; 0 softens edges after drawing."""


def parse_background(text: str) -> Background:
    """Turn ``studio``, ``none``, ``#rrggbb`` or a file's name into a background.

    Raises
    ------
    UsageError
        If it is none of these.
    DataError
        If the file is no picture.
    """
    if text == "studio":
        return "studio"
    if text == "none":
        return None
    if text.startswith("#"):
        digits = text[1:] if len(text) == 7 else "".join(2 * digit for digit in text[1:])
        try:
            red, green, blue = bytes.fromhex(digits)
        except ValueError:
            raise UsageError(f"--background: got {text!r}, expected a colour such as #f0e8d8") from None
        return red, green, blue
    if not Path(text).is_file():
        raise UsageError(f"--background: got {text!r}, expected studio, none, a colour such as #f0e8d8, or a picture")
    return load_picture(Path(text))


def parse_edges(text: str) -> int:
    """Turn ``fine`` or ``soft`` into samples a pixel.

    Raises
    ------
    UsageError
        If it is neither.
    """
    if text not in EDGES:
        raise UsageError(f"--edges: got {text!r}, expected one of {', '.join(EDGES)}")
    return EDGES[text]


def side_by_side(tracks: Sequence[FapTrack]) -> tuple[float, NDArray[np.int32]]:
    """Rate in Hz and (T, tracks, 68) FAPs, from each track's start: at the highest rate, until the longest ends.

    Between its frames, where frames are skipped, and after its end a track stays as it was.
    """
    rate_hz = max(track.rate_hz for track in tracks)
    lengths = [(track.frame_numbers[-1] - track.frame_numbers[0] + 1) / track.rate_hz for track in tracks]
    times_s = np.arange(max(1, round(max(lengths) * rate_hz))) / rate_hz
    rows = []
    for track in tracks:
        shown = np.floor(times_s * track.rate_hz + 1e-6) + track.frame_numbers[0]
        rows.append(track.values[np.searchsorted(track.frame_numbers, shown, side="right") - 1])
    return rate_hz, np.stack(rows, axis=1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Drawing:
    """How faces are drawn side by side."""

    size: tuple[int, int]
    """Of one face, in pixels."""
    camera: str = "front"
    background: Background = "studio"
    samples: int = 4
    wire: bool = False
    turn_s: float = 0.0
    """Seconds in which the camera goes once round the head; 0: it stands still."""

    def picture_size(self, faces: int) -> tuple[int, int]:
        """Width and height of the picture of so many faces."""
        columns = self.columns(faces)
        return columns * self.size[0], -(-faces // columns) * self.size[1]

    def columns(self, faces: int) -> int:
        """How many faces stand side by side: up to four in one row."""
        return faces if faces <= 4 else -(-faces // round(faces**0.5))

    def open(self, meshes: Sequence[FaceMesh]) -> CrowdRenderer:
        """Make the renderer."""
        return CrowdRenderer(
            meshes,
            tile=self.size,
            columns=self.columns(len(meshes)),
            cameras=preset(self.camera),
            background=self.background,
            samples=self.samples,
            wire=self.wire,
        )

    def frames(self, crowd: CrowdRenderer, rows: NDArray[np.int32], rate_hz: float) -> Iterator[Picture]:
        """Draw (T, faces, 68) FAPs; colours are as files want them, not multiplied with alpha."""
        standing = crowd.cameras

        def walking() -> Iterator[ArrayLike]:
            for number, row in enumerate(rows):
                if self.turn_s:
                    turns = number / rate_hz / self.turn_s
                    crowd.cameras = [turned(camera, turns) for camera in standing]
                yield row

        return map(straight, crowd.frames(walking()))
