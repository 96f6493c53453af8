"""The 84 FDP feature points: ISO/IEC 14496-2, Annex C, figure of the feature points."""

from dataclasses import dataclass
from enum import StrEnum


class Side(StrEnum):
    """Side of the subject's face."""

    LEFT = "left"
    RIGHT = "right"
    MIDDLE = "middle"


@dataclass(frozen=True, slots=True)
class FeaturePoint:
    """One numbered point on the face."""

    name: str
    """``"group.index"`` as the standard numbers it."""
    place: str
    """Place on the face; left and right are the subject's."""
    side: Side


# fmt: off
FEATURE_POINTS: tuple[FeaturePoint, ...] = (
    FeaturePoint(name="2.1",   place="chin bottom",              side=Side.MIDDLE),
    FeaturePoint(name="2.2",   place="upper inner lip middle",   side=Side.MIDDLE),
    FeaturePoint(name="2.3",   place="lower inner lip middle",   side=Side.MIDDLE),
    FeaturePoint(name="2.4",   place="inner lip corner left",    side=Side.LEFT),
    FeaturePoint(name="2.5",   place="inner lip corner right",   side=Side.RIGHT),
    FeaturePoint(name="2.6",   place="upper inner lip left",     side=Side.LEFT),
    FeaturePoint(name="2.7",   place="upper inner lip right",    side=Side.RIGHT),
    FeaturePoint(name="2.8",   place="lower inner lip left",     side=Side.LEFT),
    FeaturePoint(name="2.9",   place="lower inner lip right",    side=Side.RIGHT),
    FeaturePoint(name="2.10",  place="chin boss",                side=Side.MIDDLE),
    FeaturePoint(name="2.11",  place="chin contour left",        side=Side.LEFT),
    FeaturePoint(name="2.12",  place="chin contour right",       side=Side.RIGHT),
    FeaturePoint(name="2.13",  place="jaw corner left",          side=Side.LEFT),
    FeaturePoint(name="2.14",  place="jaw corner right",         side=Side.RIGHT),
    FeaturePoint(name="3.1",   place="upper lid left",           side=Side.LEFT),
    FeaturePoint(name="3.2",   place="upper lid right",          side=Side.RIGHT),
    FeaturePoint(name="3.3",   place="lower lid left",           side=Side.LEFT),
    FeaturePoint(name="3.4",   place="lower lid right",          side=Side.RIGHT),
    FeaturePoint(name="3.5",   place="pupil left",               side=Side.LEFT),
    FeaturePoint(name="3.6",   place="pupil right",              side=Side.RIGHT),
    FeaturePoint(name="3.7",   place="outer eye corner left",    side=Side.LEFT),
    FeaturePoint(name="3.8",   place="inner eye corner right",   side=Side.RIGHT),
    FeaturePoint(name="3.9",   place="lower socket left",        side=Side.LEFT),
    FeaturePoint(name="3.10",  place="lower socket right",       side=Side.RIGHT),
    FeaturePoint(name="3.11",  place="inner eye corner left",    side=Side.LEFT),
    FeaturePoint(name="3.12",  place="outer eye corner right",   side=Side.RIGHT),
    FeaturePoint(name="3.13",  place="upper socket left",        side=Side.LEFT),
    FeaturePoint(name="3.14",  place="upper socket right",       side=Side.RIGHT),
    FeaturePoint(name="4.1",   place="inner brow left",          side=Side.LEFT),
    FeaturePoint(name="4.2",   place="inner brow right",         side=Side.RIGHT),
    FeaturePoint(name="4.3",   place="middle brow left",         side=Side.LEFT),
    FeaturePoint(name="4.4",   place="middle brow right",        side=Side.RIGHT),
    FeaturePoint(name="4.5",   place="outer brow left",          side=Side.LEFT),
    FeaturePoint(name="4.6",   place="outer brow right",         side=Side.RIGHT),
    FeaturePoint(name="5.1",   place="cheek left",               side=Side.LEFT),
    FeaturePoint(name="5.2",   place="cheek right",              side=Side.RIGHT),
    FeaturePoint(name="5.3",   place="cheekbone left",           side=Side.LEFT),
    FeaturePoint(name="5.4",   place="cheekbone right",          side=Side.RIGHT),
    FeaturePoint(name="6.1",   place="tongue tip",               side=Side.MIDDLE),
    FeaturePoint(name="6.2",   place="tongue middle",            side=Side.MIDDLE),
    FeaturePoint(name="6.3",   place="tongue edge left",         side=Side.LEFT),
    FeaturePoint(name="6.4",   place="tongue edge right",        side=Side.RIGHT),
    FeaturePoint(name="7.1",   place="head pivot",               side=Side.MIDDLE),
    FeaturePoint(name="8.1",   place="upper outer lip middle",   side=Side.MIDDLE),
    FeaturePoint(name="8.2",   place="lower outer lip middle",   side=Side.MIDDLE),
    FeaturePoint(name="8.3",   place="outer lip corner left",    side=Side.LEFT),
    FeaturePoint(name="8.4",   place="outer lip corner right",   side=Side.RIGHT),
    FeaturePoint(name="8.5",   place="upper outer lip left",     side=Side.LEFT),
    FeaturePoint(name="8.6",   place="upper outer lip right",    side=Side.RIGHT),
    FeaturePoint(name="8.7",   place="lower outer lip left",     side=Side.LEFT),
    FeaturePoint(name="8.8",   place="lower outer lip right",    side=Side.RIGHT),
    FeaturePoint(name="8.9",   place="cupid's bow right",        side=Side.RIGHT),
    FeaturePoint(name="8.10",  place="cupid's bow left",         side=Side.LEFT),
    FeaturePoint(name="9.1",   place="nostril border left",      side=Side.LEFT),
    FeaturePoint(name="9.2",   place="nostril border right",     side=Side.RIGHT),
    FeaturePoint(name="9.3",   place="nose tip",                 side=Side.MIDDLE),
    FeaturePoint(name="9.4",   place="nose base right",          side=Side.RIGHT),
    FeaturePoint(name="9.5",   place="nose base left",           side=Side.LEFT),
    FeaturePoint(name="9.6",   place="nose root right",          side=Side.RIGHT),
    FeaturePoint(name="9.7",   place="nose root left",           side=Side.LEFT),
    FeaturePoint(name="9.8",   place="upper teeth top",          side=Side.MIDDLE),
    FeaturePoint(name="9.9",   place="lower teeth bottom",       side=Side.MIDDLE),
    FeaturePoint(name="9.10",  place="upper teeth edge",         side=Side.MIDDLE),
    FeaturePoint(name="9.11",  place="lower teeth edge",         side=Side.MIDDLE),
    FeaturePoint(name="9.12",  place="nose bridge",              side=Side.MIDDLE),
    FeaturePoint(name="9.13",  place="nose bone left",           side=Side.LEFT),
    FeaturePoint(name="9.14",  place="nose bone right",          side=Side.RIGHT),
    FeaturePoint(name="9.15",  place="nose base middle",         side=Side.MIDDLE),
    FeaturePoint(name="10.1",  place="ear top left",             side=Side.LEFT),
    FeaturePoint(name="10.2",  place="ear top right",            side=Side.RIGHT),
    FeaturePoint(name="10.3",  place="ear back left",            side=Side.LEFT),
    FeaturePoint(name="10.4",  place="ear back right",           side=Side.RIGHT),
    FeaturePoint(name="10.5",  place="ear lobe left",            side=Side.LEFT),
    FeaturePoint(name="10.6",  place="ear lobe right",           side=Side.RIGHT),
    FeaturePoint(name="10.7",  place="lower ear root left",      side=Side.LEFT),
    FeaturePoint(name="10.8",  place="lower ear root right",     side=Side.RIGHT),
    FeaturePoint(name="10.9",  place="upper ear root left",      side=Side.LEFT),
    FeaturePoint(name="10.10", place="upper ear root right",     side=Side.RIGHT),
    FeaturePoint(name="11.1",  place="hairline middle",          side=Side.MIDDLE),
    FeaturePoint(name="11.2",  place="hairline right",           side=Side.RIGHT),
    FeaturePoint(name="11.3",  place="hairline left",            side=Side.LEFT),
    FeaturePoint(name="11.4",  place="skull top",                side=Side.MIDDLE),
    FeaturePoint(name="11.5",  place="hair top",                 side=Side.MIDDLE),
    FeaturePoint(name="11.6",  place="skull back",               side=Side.MIDDLE),
)
# fmt: on

FEATURE_POINT_NAMES: tuple[str, ...] = tuple(point.name for point in FEATURE_POINTS)
