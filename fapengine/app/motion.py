"""Face motion in files and pictures: load, save, draw."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine.app.drawing import resized
from fapengine.app.heads import load_head
from fapengine.app.mouth_cues import check_cues, is_cues, save_cues_of_motion
from fapengine.app.scene_choice import Into, check_scene, is_scene
from fapengine.errors import UsageError
from fapengine.files.motion import BLEND_ENDINGS, RECORDED_ENDINGS, load_motion, save_fap
from fapengine.files.moving import KINDS, check_moving, is_moving, is_sequence, write_moving
from fapengine.files.paths import write_bytes
from fapengine.files.pictures import save_png, straight
from fapengine.files.sound import save_wav
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import Drawing, Picture
from fapengine.render.renderer import FaceRenderer

if TYPE_CHECKING:
    from fapengine.codec.encoder import EncoderOptions

Sound = tuple[NDArray[np.int16], int]
"""(N,) int16 mono samples, and how many of them a second."""
LOADED = (".fap", ".fba", *BLEND_ENDINGS, *RECORDED_ENDINGS)
"""Suffixes of face motion that can be loaded."""
SAVED = f".fap, .fba, .csv, .wav, .png, .glb, .vrma, .usda, .usdc, {KINDS}"
"""Endings of a name to save to, in words."""


def load(path: str | Path) -> FapTrack:
    """Load face motion.

    Parameters
    ----------
    path : str or Path
        FAPs (``.fap``), an MPEG-4 stream (``.fba``), or a table of ARKit, Oculus or VRM shapes (``.csv``; Azure's
        frames ``.json``, ``.jsonl``), or a VMC stream that ``oscdump`` recorded (``.osc``).

    Raises
    ------
    UsageError
        If the name's ending is none of these, or the file cannot be read.
    DataError
        If its content is wrong.
    """
    path = Path(path)
    if path.suffix.lower() not in LOADED:
        raise UsageError(f"path: got {path}, expected a name that ends with {', '.join(LOADED)}")
    return load_motion(path)


def save(
    track: FapTrack,
    path: str | Path,
    *,
    sound: Sound | None = None,
    head: str | Path | FaceMesh = "default",
    drawing: Drawing | None = None,
    size: tuple[int, int] | None = None,
    at_s: float = 0.0,
    shapes: str | None = None,
    kbit_s: float | None = None,
    encoding: EncoderOptions | None = None,
    into: str | Path | Into | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> Path:
    """Save face motion as what the name asks for; folders are made.

    Parameters
    ----------
    track : FapTrack
    path : str or Path
        ``.fap`` text; ``.fba`` stream; ``.csv`` table of shapes; ``.mp4``, ``.webm``, ``.mkv``, ``.mov`` video;
        ``.gif``, ``.webp`` animation; ``frame_%04d.png`` or a folder's name: numbered pictures; ``.png`` one picture;
        ``.wav`` the sound alone; ``.glb``, ``.vrm`` the avatar ``into`` with the motion inside, ``.usda``, ``.usdc`` a
        head of ours; ``.vrma`` a VRM animation.
    sound : ((N,) int16, int), optional
        Mono samples and their rate in Hz: goes into a video, from its start, and into ``.wav``.
    head : str, Path or Head
        Whose face, for pictures: see :func:`fapengine.load_head`.
    drawing : Drawing, optional
        How it is drawn.
    size : (int, int), optional
        Width and height in pixels; goes before those of ``drawing``.
    at_s : float
        Time of the frame that ``.png`` shows.
    shapes : str, optional
        Columns of ``.csv``: ``"arkit"`` (52, the default), ``"oculus"`` (15 visemes), ``"vrm0"`` or ``"vrm1"``.
        ``"rhubarb"``: nine mouth shapes with their times, in Rhubarb's files ``.json``, ``.tsv``, ``.xml`` or ``.dat``.
        Expressions of ``.vrma``: ``"vrm1"``, the presets, by default, or ``"arkit"``.
    kbit_s : float, optional
        Bit rate of ``.fba``; by default as ``encoding`` says.
    encoding : EncoderOptions, optional
        All choices for ``.fba``.
    into : str, Path or Into, optional
        Somebody's avatar (.glb, .vrm, .gltf) that is written with the motion as an animation, and how.
    on_frame : callable
        Called after each frame that is drawn.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    UsageError
        If the name's ending is unknown, or the file cannot hold what was asked for.
    ResourceError
        If the file cannot be written, or there is no OpenGL.
    """
    path = Path(path)
    avatar = Into(Path(into)) if isinstance(into, str | Path) else into
    check_cues(path, shapes)
    check_scene(path, avatar)
    if is_scene(path):
        from fapengine.app.scene_files import save_scene  # other programs' files, which a film does without

        save_scene(path, track, avatar, shapes=shapes, name=path.stem)
    elif is_cues(path):
        save_cues_of_motion(path, track)
    elif path.suffix == ".fap":
        save_fap(path, track)
    elif path.suffix == ".fba":
        if kbit_s is not None and encoding is not None:
            raise UsageError("kbit_s and encoding: got both, expected one; EncoderOptions has a kbit_s of its own")
        from fapengine.codec.encoder import EncoderOptions, encode  # with Numba, whose import takes 0.2 s

        write_bytes(path, encode(track, encoding or EncoderOptions(kbit_s=kbit_s)))
    elif path.suffix == ".csv":
        from fapengine.retarget.blend_tracks import format_blend_csv

        write_bytes(path, format_blend_csv(track, shapes or "arkit"))
    elif path.suffix == ".wav":
        if sound is None:
            raise UsageError(f"sound: got none, expected samples and their rate for {path}")
        save_wav(path, *sound)
    elif path.suffix == ".png" and not is_sequence(path):
        save_png(path, next(_drawn(track.values[_row_at(track, at_s)][None], head, resized(drawing, size))))
    elif is_moving(path):
        chosen = resized(drawing, size)
        check_moving(path, rate_hz=track.rate_hz, size=chosen.size, alpha=chosen.components == 4)
        pictures = _drawn(track.even_values(), head, chosen)
        write_moving(path, pictures, rate_hz=track.rate_hz, sound=sound, on_frame=on_frame)
    else:
        raise UsageError(f"path: got {path}, expected a name that ends with {SAVED}")
    return path


def frames(
    track: FapTrack,
    *,
    head: str | Path | FaceMesh = "default",
    drawing: Drawing | None = None,
    size: tuple[int, int] | None = None,
) -> Iterator[Picture]:
    """Draw a track, a picture a frame; frames that the track skips show the one before.

    Parameters
    ----------
    track : FapTrack
    head : str, Path or Head
        Whose face: see :func:`fapengine.load_head`.
    drawing : Drawing, optional
        How it is drawn.
    size : (int, int), optional
        Width and height in pixels; goes before those of ``drawing``.

    Yields
    ------
    (height, width, 3) uint8
        sRGB, top row first; a fourth component is alpha, with colours not multiplied with it.

    Raises
    ------
    UsageError
        If the head or a size cannot be.
    ResourceError
        If there is no OpenGL.
    """
    return _drawn(track.even_values(), head, resized(drawing, size))


def _drawn(rows: NDArray[np.int32], head: str | Path | FaceMesh, drawing: Drawing) -> Iterator[Picture]:
    with FaceRenderer(head if isinstance(head, FaceMesh) else load_head(head), drawing) as renderer:
        yield from map(straight, renderer.frames(rows))


def _row_at(track: FapTrack, at_s: float) -> int:
    """Index of the frame that is shown at a time from the track's first frame on."""
    times_s = track.times_s - (track.times_s[0] if len(track) else 0.0)
    if not len(track) or not 0 <= at_s <= times_s[-1]:
        length_s = times_s[-1] if len(track) else 0.0
        raise UsageError(f"at_s: got {at_s} s, the track lasts {length_s:.2f} s")
    return int(np.searchsorted(times_s, at_s + 1e-9, side="right")) - 1
