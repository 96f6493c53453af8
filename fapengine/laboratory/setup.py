"""What a laboratory says about its session beyond the recordings themselves."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fapengine.geometry.surface import Surface
from fapengine.mpeg4.visemes import Expression


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


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A dense face in one held posture."""

    name: str
    surface: Surface
    landmarks: Mapping[str, tuple[float, float, float]]
    """Positions of markers (by label or feature point) on it, mm, in the scan's own space."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """How to understand a session."""

    points: Mapping[str, str] = field(default_factory=dict)
    """Marker label to feature point; markers that bear a feature point's name need no entry."""
    head: tuple[str, ...] = ()
    """Markers that only follow the skull (head band, forehead, nose bridge); none: head motion is already removed."""
    neutral: Moment | None = None
    """Moment at which the face is at rest; none: the median of all silences."""
    fapu_mm: Mapping[str, float] = field(default_factory=dict)
    """Distances of the neutral face that the markers do not show: ``es0``, ``ens0`` ..."""
    poses: tuple[Pose, ...] = ()
    scans: tuple[Scan, ...] = ()
    """The first is the reference whose vertices all others get; best the neutral pose."""
    language: str = "und"
    licence: str = ""
    attribution: str = ""
