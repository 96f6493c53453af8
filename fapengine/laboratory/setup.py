"""Facts about a session that the recordings do not contain."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, freeze
from fapengine.expressions import Expression
from fapengine.geometry.surface import Surface


@dataclass(frozen=True, slots=True)
class Moment:
    """A stretch of one take."""

    take: str
    start_s: float
    end_s: float

    def frames(self, values: NDArray[Any], rate_hz: float) -> NDArray[Any]:
        """Rows of its take's values, (T, ...), within it: (N, ...), one at least."""
        first = round(self.start_s * rate_hz)
        return values[first : max(round(self.end_s * rate_hz), first + 1)]


@dataclass(frozen=True, slots=True)
class Pose:
    """An expression that the subject held."""

    expression: Expression
    moment: Moment


@dataclass(frozen=True, slots=True)
class HeldPhone:
    """A phone whose mouth shape the subject held."""

    ipa: str
    moment: Moment


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Paint:
    """Colours of a scan: an image and each vertex's position in it, or a colour for each vertex."""

    uv: Array | None = None
    """(V, 2): position in ``texture``, (0, 0) is its top left corner."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 4), sRGB and straight alpha."""
    albedo: Array | None = None
    """(V, 3), linear RGB, 0..1."""

    def __post_init__(self) -> None:
        given = {"uv": ("V", 2), "albedo": ("V", 3)}
        freeze(self, **{name: shape for name, shape in given.items() if getattr(self, name) is not None})
        if self.texture is not None:
            freeze(self, np.uint8, texture=("H", "W", 4))


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A dense face in one held posture."""

    name: str
    surface: Surface
    landmarks: Mapping[str, tuple[float, float, float]]
    """Positions of markers (by label or feature point) on it, mm, in the scan's own space."""
    paint: Paint | None = None
    """Its colours, where the file has any; only the reference's are kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Facts about a session, from ``session.toml``."""

    points: Mapping[str, str] = field(default_factory=dict)
    """Marker label to feature point; markers that bear a feature point's name need no entry."""
    tracked: bool = False
    """True if the markers are landmarks of a video tracker."""
    head: tuple[str, ...] = ()
    """Markers that only follow the skull (head band, forehead, nose bridge); empty: head motion is already removed."""
    neutral: Moment | None = None
    """Moment at which the face is neutral; None: the median of all silences."""
    fapu_mm: Mapping[str, float] = field(default_factory=dict)
    """Distances of the neutral face that the markers do not show: ``es0``, ``ens0`` ..."""
    poses: tuple[Pose, ...] = ()
    held_phones: tuple[HeldPhone, ...] = ()
    """Used for phones with too few tokens for a median."""
    scans: tuple[Scan, ...] = ()
    """The first is the reference, whose vertices all others get; best with lips apart, as the paper's /a/."""
    language: str = "und"
    licence: str = ""
    attribution: str = ""
