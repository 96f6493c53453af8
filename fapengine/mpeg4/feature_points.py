"""The 84 FDP feature points: ISO/IEC 14496-2, Annex C, figure of the feature points."""

from dataclasses import dataclass

from fapengine.mpeg4.fap import read_rows


@dataclass(frozen=True, slots=True)
class FeaturePoint:
    """One numbered point on the face."""

    name: str
    """``"group.index"`` as the standard numbers it."""
    place: str
    """Place on the face, with its side at the end, if it is not in the middle: the subject's left or right."""


FEATURE_POINTS = tuple(FeaturePoint(**row) for row in read_rows("feature_points.csv"))
FEATURE_POINT_NAMES: tuple[str, ...] = tuple(point.name for point in FEATURE_POINTS)
