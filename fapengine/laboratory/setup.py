"""Facts about a session that the recordings do not contain."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.expressions import Expression
from fapengine.geometry.surface import Surface


@dataclass(frozen=True, slots=True)
class Moment:
    """A stretch of one take."""

    take: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Pose:
    """An expression that the subject held."""

    expression: Expression
    moment: Moment


@dataclass(frozen=True, slots=True)
class HeldPhone:
    """The static shape of a phone: the subject held its mouth so."""

    ipa: str
    moment: Moment


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Paint:
    """Colours of a scan: a picture and the vertices' places in it, or a colour for each vertex."""

    uv: NDArray[np.float64] | None = None
    """(V, 2): place in ``texture``, (0, 0) its top left corner."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 4), sRGB and straight alpha."""
    albedo: NDArray[np.float64] | None = None
    """(V, 3), linear RGB, 0..1."""

    def __post_init__(self) -> None:
        shapes = (("uv", ("V", 2), np.float64), ("texture", ("H", "W", 4), np.uint8), ("albedo", ("V", 3), np.float64))
        for name, shape, dtype in shapes:
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen(value, name, shape, dtype))


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A dense face in one held posture."""

    name: str
    surface: Surface
    landmarks: Mapping[str, tuple[float, float, float]]
    """Positions of markers (by label or feature point) on it, mm, in the scan's own space."""
    paint: Paint | None = None
    """Its colours, where the file has any; only the first scan's are kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Facts about a session, from ``session.toml``."""

    points: Mapping[str, str] = field(default_factory=dict)
    """Marker label to feature point; markers that bear a feature point's name need no entry."""
    head: tuple[str, ...] = ()
    """Markers that only follow the skull (head band, forehead, nose bridge); none: head motion is already removed."""
    neutral: Moment | None = None
    """Moment at which the face is at rest; none: the median of all silences."""
    fapu_mm: Mapping[str, float] = field(default_factory=dict)
    """Distances of the neutral face that the markers do not show: ``es0``, ``ens0`` ..."""
    poses: tuple[Pose, ...] = ()
    held_phones: tuple[HeldPhone, ...] = ()
    """Stand for phones that are said too seldom for a median."""
    scans: tuple[Scan, ...] = ()
    """The first is the reference, with the vertices that all others get; best the neutral pose."""
    language: str = "und"
    licence: str = ""
    attribution: str = ""
