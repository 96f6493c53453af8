"""The 84 FDP feature points: ISO/IEC 14496-2, Annex C, figure of the feature points."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FeaturePoint:
    """One numbered point on the face."""

    name: str
    """``"group.index"`` as the standard numbers it."""
    place: str
    """Place on the face, with its side at the end, if it is not in the middle: the subject's left or right."""


# fmt: off
FEATURE_POINTS: tuple[FeaturePoint, ...] = (
    FeaturePoint(name="2.1",   place="chin bottom"),
    FeaturePoint(name="2.2",   place="upper inner lip middle"),
    FeaturePoint(name="2.3",   place="lower inner lip middle"),
    FeaturePoint(name="2.4",   place="inner lip corner left"),
    FeaturePoint(name="2.5",   place="inner lip corner right"),
    FeaturePoint(name="2.6",   place="upper inner lip left"),
    FeaturePoint(name="2.7",   place="upper inner lip right"),
    FeaturePoint(name="2.8",   place="lower inner lip left"),
    FeaturePoint(name="2.9",   place="lower inner lip right"),
    FeaturePoint(name="2.10",  place="chin boss"),
    FeaturePoint(name="2.11",  place="chin contour left"),
    FeaturePoint(name="2.12",  place="chin contour right"),
    FeaturePoint(name="2.13",  place="jaw corner left"),
    FeaturePoint(name="2.14",  place="jaw corner right"),
    FeaturePoint(name="3.1",   place="upper lid left"),
    FeaturePoint(name="3.2",   place="upper lid right"),
    FeaturePoint(name="3.3",   place="lower lid left"),
    FeaturePoint(name="3.4",   place="lower lid right"),
    FeaturePoint(name="3.5",   place="pupil left"),
    FeaturePoint(name="3.6",   place="pupil right"),
    FeaturePoint(name="3.7",   place="outer eye corner left"),
    FeaturePoint(name="3.8",   place="inner eye corner right"),
    FeaturePoint(name="3.9",   place="lower socket left"),
    FeaturePoint(name="3.10",  place="lower socket right"),
    FeaturePoint(name="3.11",  place="inner eye corner left"),
    FeaturePoint(name="3.12",  place="outer eye corner right"),
    FeaturePoint(name="3.13",  place="upper socket left"),
    FeaturePoint(name="3.14",  place="upper socket right"),
    FeaturePoint(name="4.1",   place="inner brow left"),
    FeaturePoint(name="4.2",   place="inner brow right"),
    FeaturePoint(name="4.3",   place="middle brow left"),
    FeaturePoint(name="4.4",   place="middle brow right"),
    FeaturePoint(name="4.5",   place="outer brow left"),
    FeaturePoint(name="4.6",   place="outer brow right"),
    FeaturePoint(name="5.1",   place="cheek left"),
    FeaturePoint(name="5.2",   place="cheek right"),
    FeaturePoint(name="5.3",   place="cheekbone left"),
    FeaturePoint(name="5.4",   place="cheekbone right"),
    FeaturePoint(name="6.1",   place="tongue tip"),
    FeaturePoint(name="6.2",   place="tongue middle"),
    FeaturePoint(name="6.3",   place="tongue edge left"),
    FeaturePoint(name="6.4",   place="tongue edge right"),
    FeaturePoint(name="7.1",   place="head pivot"),
    FeaturePoint(name="8.1",   place="upper outer lip middle"),
    FeaturePoint(name="8.2",   place="lower outer lip middle"),
    FeaturePoint(name="8.3",   place="outer lip corner left"),
    FeaturePoint(name="8.4",   place="outer lip corner right"),
    FeaturePoint(name="8.5",   place="upper outer lip left"),
    FeaturePoint(name="8.6",   place="upper outer lip right"),
    FeaturePoint(name="8.7",   place="lower outer lip left"),
    FeaturePoint(name="8.8",   place="lower outer lip right"),
    FeaturePoint(name="8.9",   place="cupid's bow right"),
    FeaturePoint(name="8.10",  place="cupid's bow left"),
    FeaturePoint(name="9.1",   place="nostril border left"),
    FeaturePoint(name="9.2",   place="nostril border right"),
    FeaturePoint(name="9.3",   place="nose tip"),
    FeaturePoint(name="9.4",   place="nose base right"),
    FeaturePoint(name="9.5",   place="nose base left"),
    FeaturePoint(name="9.6",   place="nose root right"),
    FeaturePoint(name="9.7",   place="nose root left"),
    FeaturePoint(name="9.8",   place="upper teeth top"),
    FeaturePoint(name="9.9",   place="lower teeth bottom"),
    FeaturePoint(name="9.10",  place="upper teeth edge"),
    FeaturePoint(name="9.11",  place="lower teeth edge"),
    FeaturePoint(name="9.12",  place="nose bridge"),
    FeaturePoint(name="9.13",  place="nose bone left"),
    FeaturePoint(name="9.14",  place="nose bone right"),
    FeaturePoint(name="9.15",  place="nose base middle"),
    FeaturePoint(name="10.1",  place="ear top left"),
    FeaturePoint(name="10.2",  place="ear top right"),
    FeaturePoint(name="10.3",  place="ear back left"),
    FeaturePoint(name="10.4",  place="ear back right"),
    FeaturePoint(name="10.5",  place="ear lobe left"),
    FeaturePoint(name="10.6",  place="ear lobe right"),
    FeaturePoint(name="10.7",  place="lower ear root left"),
    FeaturePoint(name="10.8",  place="lower ear root right"),
    FeaturePoint(name="10.9",  place="upper ear root left"),
    FeaturePoint(name="10.10", place="upper ear root right"),
    FeaturePoint(name="11.1",  place="hairline middle"),
    FeaturePoint(name="11.2",  place="hairline right"),
    FeaturePoint(name="11.3",  place="hairline left"),
    FeaturePoint(name="11.4",  place="skull top"),
    FeaturePoint(name="11.5",  place="hair top"),
    FeaturePoint(name="11.6",  place="skull back"),
)
# fmt: on

FEATURE_POINT_NAMES: tuple[str, ...] = tuple(point.name for point in FEATURE_POINTS)
