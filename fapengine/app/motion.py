"""Face motion in files and images: load, save, draw."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import SoundLike
from fapengine._late import needed
from fapengine._strict_toml import checked
from fapengine.app.drawing import resized
from fapengine.app.outputs import OTHER_NAMES, SaveOptions, draw_frames, write_output
from fapengine.errors import UsageError
from fapengine.files.motion import ANIMATED_ENDINGS, BLEND_ENDINGS, RECORDED_ENDINGS, load_motion, shown
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.render.drawing import Picture, RenderOptions
from fapengine.retarget.blend import ARKIT_NAMES

if TYPE_CHECKING:
    from fapengine.app.scene_files import Into
    from fapengine.codec.encoder import EncoderOptions

LOADED = (".fap", ".fba", *BLEND_ENDINGS, *RECORDED_ENDINGS, *ANIMATED_ENDINGS)
"""Endings of files of face motion that can be loaded."""


@checked
def load(path: str | Path, *, strict: bool = False) -> FapTrack:
    """Load face motion.

    Parameters
    ----------
    path : str or Path
        FAPs (``.fap``), an MPEG-4 stream (``.fba``), a table of ARKit, Oculus or VRM weights (``.csv``; Azure's frames
        ``.json``, ``.jsonl``), a VMC stream that ``oscdump`` recorded (``.osc``), or an animated avatar or VRM
        animation (``.glb``, ``.vrm``, ``.vrma``).
    strict : bool
        True to refuse motion with a remark.

    Returns
    -------
    FapTrack
        Its ``remarks`` say what looks wrong, such as lips that never meet, and what was assumed.

    Raises
    ------
    UsageError
        If the ending is unknown, or the file cannot be read.
    DataError
        If its content is wrong, or ``strict`` finds a remark.
    """
    path = Path(path)
    if path.suffix.lower() not in LOADED:
        raise UsageError(f"path: got {path}, expected a name that ends with {', '.join(LOADED)}")
    return load_motion(path, strict=strict)


@checked
def save(
    track: FapTrack,
    path: str | Path,
    *,
    sound: SoundLike | None = None,
    head: str | Path | FaceMesh = "default",
    drawing: RenderOptions | None = None,
    size: tuple[int, int] | None = None,
    at_s: float | None = None,
    shapes: str | None = None,
    kbit_s: float | None = None,
    encoding: EncoderOptions | None = None,
    into: str | Path | Into | None = None,
    provenance: bool = True,
    on_frame: Callable[[], None] = lambda: None,
) -> Path:
    """Save face motion in the format that the file name asks for; missing folders are made.

    Parameters
    ----------
    track : FapTrack
    path : str or Path
        ``.fap`` text; ``.fba`` stream; ``.csv`` table of weights; ``.mp4``, ``.webm``, ``.mkv``, ``.mov`` video;
        ``.gif``, ``.webp`` animation; ``frame_%04d.png`` or the name of a folder: numbered images; ``.png`` one image;
        ``.wav`` the sound alone; ``.glb``, ``.vrm`` the avatar ``into`` with the motion inside, ``.usda``, ``.usdc`` a
        built-in head; ``.vrma`` a VRM animation; ``.json``, ``.tsv``, ``.xml``, ``.dat`` visemes.
    sound : (array_like, int), optional
        Samples and their rate in Hz, for a video, from its start, and for ``.wav``: (N,) mono or (N, channels), which
        are averaged; float in -1..1, int16, int32 or uint8, as librosa and soundfile give them.
    head : str, Path or Head
        The head that is drawn: see :func:`fapengine.load_head`.
    drawing : RenderOptions, optional
        How it is drawn.
    size : (int, int), optional
        Width and height in pixels; overrides those of ``drawing``.
    at_s : float, optional
        Time of the frame that ``.png`` shows; by default that with the widest open jaw.
    shapes : str, optional
        Columns of ``.csv``: ``"arkit"`` (52, the default), ``"oculus"`` (15 visemes), ``"vrm0"`` or ``"vrm1"``.
        Visemes with times (:func:`fapengine.visemes`), in ``.json``, ``.tsv`` and ``.csv``: ``"mpeg4"``, ``"azure"``,
        ``"rhubarb"`` (also ``.xml``, ``.dat``) and ``"oculus"`` (not ``.csv``).
        Expressions of ``.vrma``: ``"vrm1"``, the presets, by default, or ``"arkit"``.
    kbit_s : float, optional
        Bit rate of ``.fba``; by default as ``encoding`` says.
    encoding : EncoderOptions, optional
        All options of ``.fba``.
    into : str, Path or Into, optional
        Avatar (.glb, .vrm, .gltf) that gets the motion as an animation, and how it is written.
    provenance : bool
        Whether images, films, avatars and VRM animations say, to programs, that they are synthetic (the IPTC's
        ``digitalSourceType``).
    on_frame : callable
        Called after each frame that is drawn.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    UsageError
        If the ending is unknown, or the file cannot hold what was asked for.
    ResourceError
        If the file cannot be written, or there is no OpenGL.
    """
    options = SaveOptions.of(
        sound=sound, head=head, drawing=drawing, size=size, at_s=at_s, shapes=shapes, kbit_s=kbit_s, encoding=encoding,
        into=into, provenance=provenance, on_frame=on_frame,
    )  # fmt: skip
    write_output(track, Path(path), options)
    return Path(path)


class Weights(NamedTuple):
    """Weights of blendshapes over time."""

    values: NDArray[np.float64]
    """(T, B) float64, 0..1."""
    names: tuple[str, ...]
    """(B,) names of the blendshapes, as their programs write them."""
    times_s: NDArray[np.float64]
    """(T,) float64, s."""

    def to_frame(self) -> Any:
        """Return a pandas DataFrame: a column a blendshape, indexed by time in s.

        Raises
        ------
        ResourceError
            If pandas is not installed.
        """
        pandas = needed("pandas", "pandas", "to_frame")
        return pandas.DataFrame(self.values, pandas.Index(self.times_s, name="time_s"), list(self.names))


@checked
def weights(track: FapTrack, shapes: str = "arkit") -> Weights:
    """Convert face motion to weights of blendshapes, those that :func:`save` writes as ``.csv``.

    Parameters
    ----------
    track : FapTrack
    shapes : str
        ``"arkit"`` (52, named as Apple names them: ``jawOpen``), ``"oculus"`` (15 visemes), ``"vrm0"``, or ``"vrm1"``,
        which ``"vrm"`` means too.

    Raises
    ------
    UsageError
        If the set is unknown.

    Examples
    --------
    >>> weights(FapTrack.pose(open_jaw=300)).values.shape
    (1, 52)
    """
    from fapengine.retarget.blend_tracks import shape_set

    shapes = OTHER_NAMES.get(shapes, shapes)
    chosen = shape_set(shapes)
    names = ARKIT_NAMES if shapes == "arkit" else chosen.names
    faps = shown(track).values.astype(np.float64)
    return Weights(chosen.from_faps(faps, track.rate_hz), names, track.times_s)


@checked
def frames(
    track: FapTrack,
    *,
    head: str | Path | FaceMesh = "default",
    drawing: RenderOptions | None = None,
    size: tuple[int, int] | None = None,
) -> Iterator[Picture]:
    """Draw a track, one image per frame; frames that the track skips show the one before.

    Parameters
    ----------
    track : FapTrack
    head : str, Path or Head
        The head that is drawn: see :func:`fapengine.load_head`.
    drawing : RenderOptions, optional
        How it is drawn.
    size : (int, int), optional
        Width and height in pixels; overrides those of ``drawing``.

    Yields
    ------
    (height, width, 3) uint8
        sRGB, top row first; the fourth component, if any, is straight alpha.

    Raises
    ------
    UsageError
        If the head or the size is invalid.
    ResourceError
        If there is no OpenGL.
    """
    return draw_frames(shown(track).filled_values(), SaveOptions(head=head, drawing=resized(drawing, size)))
