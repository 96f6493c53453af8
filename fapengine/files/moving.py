"""Pictures that move, into whatever a name asks for: a video, an animation, or numbered files."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._late import require
from fapengine.errors import UsageError
from fapengine.files.animation import ENCODERS, GIF_MAX_HZ, is_sequence, write_animation, write_sequence
from fapengine.files.paths import refuse_standard_output
from fapengine.files.video import ALPHA_KINDS, CODECS, write_video

Picture = NDArray[np.uint8]

FOLDER_PATTERN = "frame_%04d.png"
KINDS = f"{', '.join((*CODECS, *ENCODERS))}, a pattern as frame_%04d.png, or a folder's"
"""Endings that a name may have, in words."""


def is_folder(path: Path) -> bool:
    """Tell whether a name is that of a folder of numbered pictures: it has no suffix."""
    return not path.suffix and not is_sequence(path)


def is_moving(path: Path) -> bool:
    """Tell whether a name is one that :func:`write_moving` takes."""
    return path.suffix in CODECS or path.suffix in ENCODERS or is_sequence(path) or is_folder(path)


def check_moving(path: Path, *, rate_hz: float, size: tuple[int, int], alpha: bool) -> None:
    """Refuse what a format cannot hold, before anything is drawn.

    Raises
    ------
    UsageError
        For an unknown suffix, a rate that GIF cannot keep, odd sides of a video, or alpha where there is none.
    ResourceError
        If a library that writes it is not installed.
    """
    refuse_standard_output(path)
    if not is_moving(path):
        raise UsageError(f"path: got {path}, expected a name that ends with {KINDS}")
    if path.suffix == ".gif" and rate_hz > GIF_MAX_HZ:
        raise UsageError(f"GIF: got {rate_hz:g} Hz, expected at most {GIF_MAX_HZ:g}; .webp has no such limit")
    if path.suffix in CODECS and any(side % 2 for side in size):
        raise UsageError(f"size: got {size[0]}x{size[1]}, expected even sides for video")
    if alpha and (path.suffix == ".gif" or (path.suffix in CODECS and path.suffix not in ALPHA_KINDS)):
        raise UsageError(f"background: got none, but {path.suffix} has no alpha; expected .webm, .mov, .webp or .png")
    require("films and pictures", av="av", PIL="pillow")


def write_moving(
    path: Path,
    frames: Iterable[Picture],
    *,
    rate_hz: float,
    sound: tuple[NDArray[np.int16], int] | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> int:
    """Write frames into what the name asks for: a video, an animation, or numbered files.

    Parameters
    ----------
    path : Path
        A folder gets ``frame_0000.png`` and on. Sound goes into videos alone.
    frames, rate_hz, sound, on_frame
        Pictures (height, width, 3 or 4) uint8 and the rest as :func:`fapengine.files.video.write_video` takes them.

    Returns
    -------
    int
        How many frames were written.
    """
    if path.suffix in CODECS:
        return write_video(path, frames, rate_hz=rate_hz, sound=sound, on_frame=on_frame)
    if path.suffix in ENCODERS:
        return write_animation(path, frames, rate_hz=rate_hz, on_frame=on_frame)
    pattern = path if is_sequence(path) else path / FOLDER_PATTERN
    return write_sequence(pattern, frames, on_frame=on_frame)


def moving_files(path: Path) -> list[Path]:
    """Names that :func:`write_moving` writes; a pattern stands for all files of a sequence."""
    return [path / FOLDER_PATTERN if is_folder(path) else path]


def beside(path: Path, suffix: str) -> Path:
    """Name of a file that belongs to a moving picture: ``talk.mp4`` has ``talk.wav``, so has the folder ``talk``.

    Numbered files have it beside the folder that they are in.
    """
    owner = path.parent if is_sequence(path) and path.parent.name else path
    return path.with_name("frames" + suffix) if is_sequence(owner) else owner.with_name(owner.stem + suffix)
