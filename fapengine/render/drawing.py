"""Options for drawing a face, as one value: image size, camera, background, antialiasing, light; and parsers for text.

No OpenGL is imported here: describing an image does not need it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine._strict_toml import check_value, checked
from fapengine.errors import UsageError
from fapengine.render.camera import PRESETS, Camera, preset

Picture = NDArray[np.uint8]
Background = Literal["studio", "transparent"] | tuple[int, int, int] | Picture
"""Background behind the head: a lit wall; transparent, so that images have alpha; one colour, sRGB 0..255; or a (H, W,
3) uint8 image, cropped to the middle in the shape needed.
"""
Pixels = Literal["rgb", "i420"]
"""How an image is stored: ``rgb``, (H, W, 3) sRGB, top row first, or with a transparent background (H, W, 4) with
premultiplied alpha; ``i420``, (H * 3 // 2, W), as video encoders take it: luma, then Cb and Cr at half the width and
height, Rec. 601 of limited range.
"""
Shading = Literal["auto", "pixels", "vertices"]
"""Where light is computed. ``auto``: at vertices while they are close together in the image."""

SHADINGS: tuple[Shading, ...] = ("auto", "pixels", "vertices")
RENDERERS = ("auto", "native", "gl")
MIN_SIDE_PX, MAX_SIDE_PX = 16, 4096
MIN_SCALE, MAX_SCALE = 0.1, 1.0
SAMPLES = (0, 1, 2, 4, 8)
EDGES: Mapping[str, int] = MappingProxyType({"fine": 4, "soft": 0, "none": 1})
"""Name of an antialiasing method to :attr:`RenderOptions.samples`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RenderOptions:
    """Options for drawing one face. Change them with ``dataclasses.replace(drawing, wire=True)``.

    Raises
    ------
    UsageError
        If a value is out of range.

    Examples
    --------
    >>> RenderOptions(size=(256, 320), background=(240, 232, 216)).aspect
    0.8
    """

    size: tuple[int, int] = (512, 512)
    """Width and height in pixels, 16 to 4096. For a window: in points."""
    camera: Camera = PRESETS["front"]
    background: Background = "studio"
    samples: int = 0
    """Samples per pixel: 0 smooths edges after drawing; 2, 4 or 8 are multisampled, in twice the time; 1 is no
    antialiasing.
    """
    shading: Shading = "auto"
    wire: bool = False
    """Whether to draw the edges of the triangles over the face."""
    scale: float = 1.0
    """Fraction of each side that is rendered, 0.1 to 1; the result is enlarged to full size."""
    rest: float = 1.0
    """Strength of the expression at rest, 0 to 1 (:mod:`fapengine.mesh.deform`); 0 is the standard's neutral face."""
    renderer: str = "auto"
    """``native`` draws on the processor, without OpenGL (package fapengine-native); ``gl`` by OpenGL; ``auto`` natively
    where that is installed and there is no GPU.
    """

    def __post_init__(self) -> None:
        check_value("size", self.size, tuple[int, ...])
        for name, kind in (("samples", int), ("shading", str), ("wire", bool), ("scale", float), ("rest", float)):
            check_value(name, getattr(self, name), kind)
        if len(self.size) != 2 or not all(MIN_SIDE_PX <= side <= MAX_SIDE_PX for side in self.size):
            shown = "x".join(map(str, self.size))
            raise UsageError(
                f"size: got {shown}, expected a width and a height of {MIN_SIDE_PX} to {MAX_SIDE_PX} pixels"
            )
        if not isinstance(self.camera, Camera):
            raise UsageError(f"camera: got {self.camera!r}, expected a Camera; RenderOptions.parse() takes its name")
        if self.samples not in SAMPLES:
            raise UsageError(f"samples: got {self.samples}, expected one of {', '.join(map(str, SAMPLES))}")
        if self.shading not in SHADINGS:
            raise UsageError(f"shading: got {self.shading!r}, expected one of {', '.join(SHADINGS)}")
        if not MIN_SCALE <= self.scale <= MAX_SCALE:
            raise UsageError(f"scale: got {self.scale:g}, expected {MIN_SCALE:g} to {MAX_SCALE:g}")
        check_renderer(self.renderer)
        if not 0 <= self.rest <= 1:
            raise UsageError(f"rest: got {self.rest:g}, expected 0 to 1")
        object.__setattr__(self, "background", _checked_background(self.background))

    @classmethod
    @checked
    def parse(
        cls,
        *,
        size: str = "512x512",
        camera: str = "front",
        background: str | Background = "studio",
        edges: str = "soft",
        wire: bool = False,
        rest: float = 1.0,
        renderer: str = "auto",
    ) -> "RenderOptions":
        """Make options from text: see :func:`parse_size`, :func:`parse_background`, :func:`parse_edges`.

        Parameters
        ----------
        size, camera, edges : str
            For example ``"512x512"``, ``"three-quarter"`` or ``"20,-5"``, ``"soft"``.
        background : str or Background
            For example ``"#f0e8d8"``; other values are used unchanged.
        wire : bool
        rest : float
        renderer : str
            As :attr:`renderer`.

        Raises
        ------
        UsageError
            If a text cannot be parsed or a value is out of range.
        """
        return cls(
            size=parse_size(size),
            camera=preset(camera),
            background=parse_background(background) if isinstance(background, str) else background,
            samples=parse_edges(edges),
            wire=wire,
            rest=rest,
            renderer=renderer,
        )

    @property
    def aspect(self) -> float:
        """Ratio of width to height."""
        return self.size[0] / self.size[1]

    @property
    def components(self) -> int:
        """Values per pixel: 3, or 4 with alpha."""
        return 4 if isinstance(self.background, str) and self.background == "transparent" else 3

    @property
    def drawn_size(self) -> tuple[int, int]:
        """Width and height that are rendered, in pixels."""
        return max(1, round(self.size[0] * self.scale)), max(1, round(self.size[1] * self.scale))

    @property
    def takes_i420(self) -> bool:
        """Whether images can be I420: even sides, no alpha, and drawn at their size."""
        return self.components == 3 and self.drawn_size == self.size and not any(side % 2 for side in self.size)

    def check_pixels(self, pixels: Pixels) -> None:
        """Raise ``UsageError`` if images cannot be stored so."""
        if pixels == "i420" and not self.takes_i420:
            shown = "x".join(map(str, self.size))
            raise UsageError(f"i420: got {shown} pixels, expected even sides, a background without alpha, and scale 1")


def parse_size(text: str) -> tuple[int, int]:
    """Parse ``"640x480"``, or ``"512"`` for a square, into width and height.

    Raises
    ------
    UsageError
        If it is neither.

    Examples
    --------
    >>> parse_size("640x480"), parse_size("512")
    ((640, 480), (512, 512))
    """
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height or width)
    except ValueError as error:
        raise UsageError(f"size: got {text!r}, expected WIDTHxHEIGHT such as 512x512") from error


def parse_background(text: str) -> Background:
    """Parse ``"studio"``, ``"transparent"`` (or ``"none"``), ``"#rrggbb"`` or ``"#rgb"`` into a background.

    Raises
    ------
    UsageError
        If it is not one of these.

    Examples
    --------
    >>> parse_background("#f0e8d8"), parse_background("none")
    ((240, 232, 216), 'transparent')
    """
    if text in ("studio", "transparent", "none"):
        return "studio" if text == "studio" else "transparent"
    if not text.startswith("#"):
        raise UsageError(f"background: got {text!r}, expected studio, none, a colour such as #f0e8d8, or an image")
    digits = text[1:] if len(text) == 7 else "".join(2 * digit for digit in text[1:])
    try:
        red, green, blue = bytes.fromhex(digits)
    except ValueError:
        raise UsageError(f"background: got {text!r}, expected a colour such as #f0e8d8") from None
    return red, green, blue


def parse_edges(text: str) -> int:
    """Convert ``"fine"``, ``"soft"`` or ``"none"`` to :attr:`RenderOptions.samples`.

    Raises
    ------
    UsageError
        If it is not one of these.
    """
    if text not in EDGES:
        raise UsageError(f"edges: got {text!r}, expected one of {', '.join(EDGES)}")
    return EDGES[text]


def check_renderer(name: str, source: str = "renderer") -> None:
    """Raise UsageError for a name from an option or variable that is not in :data:`RENDERERS`."""
    if name not in RENDERERS:
        raise UsageError(f"{source}: got {name!r}, expected one of {', '.join(RENDERERS)}")


def _checked_background(background: Any) -> Background:
    """Return it, an image read-only."""
    if isinstance(background, np.ndarray):
        shape, dtype = background.shape, background.dtype
        if len(shape) != 3 or shape[2] != 3 or dtype != np.uint8 or not background.size:
            raise UsageError(f"background: got {dtype} of shape {shape}, expected (H, W, 3) uint8")
        return frozen(background, "background", ("H", "W", 3), np.uint8) if background.flags.writeable else background
    if isinstance(background, str) and background in ("studio", "transparent"):
        return cast(Background, background)
    if isinstance(background, tuple) and len(background) == 3:
        red, green, blue = background
        if all(isinstance(part, int | np.integer) and 0 <= part <= 255 for part in background):
            return int(red), int(green), int(blue)
    raise UsageError(
        f"background: got {background!r}, expected 'studio', 'transparent', three integers from 0 to 255, or an image"
    )


DEFAULT_RENDER_OPTIONS = RenderOptions()
