"""The 68 Face Animation Parameters: ISO/IEC 14496-2, Annex C, Table C.1, one row per row.

FAP 1 and 2 are high-level (a viseme and an expression, each several numbers; see :mod:`fapengine.mpeg4.visemes`
and :class:`fapengine.mpeg4.track.FapTrack`). FAP 3 to 68 each move one feature point along one axis.

Deviation: the default symbol ranges of FAP 3, 14 and 47 have both signs, and FAP 47 has +-1080 / +-420, as every
known stream and decoder of the reference family does; the printed table is one-sided and gives +300 / +60.
"""

from dataclasses import dataclass
from enum import StrEnum

from fapengine.errors import UsageError


class FapUnit(StrEnum):
    """Unit of one FAP step; the lengths are a 1024th of a neutral-face distance."""

    IRISD = "IRISD"
    """Iris diameter = neutral lid distance / 1024."""
    ES = "ES"
    """Eye separation / 1024."""
    ENS = "ENS"
    """Eye to nose base / 1024."""
    MNS = "MNS"
    """Mouth to nose base / 1024."""
    MW = "MW"
    """Mouth width / 1024."""
    AU = "AU"
    """Angular unit, 1e-5 rad. Not a FACS action unit."""


class Direction(StrEnum):
    """Positive direction of a FAP, seen from the subject: left is the subject's left."""

    UP = "up"
    DOWN = "down"
    LEFT = "left"
    RIGHT = "right"
    FORWARD = "forward"
    GROWING = "growing"
    CONCAVE_UPWARD = "concave upward"


HEAD_AXES: dict[Direction, tuple[float, float, float]] = {
    Direction.UP: (0.0, 1.0, 0.0),
    Direction.DOWN: (0.0, -1.0, 0.0),
    Direction.LEFT: (1.0, 0.0, 0.0),
    Direction.RIGHT: (-1.0, 0.0, 0.0),
    Direction.FORWARD: (0.0, 0.0, 1.0),
}
"""Unit vectors in head space: +x the subject's left, +y up, +z out of the face."""


@dataclass(frozen=True, slots=True)
class FapSpec:
    """One row of Table C.1 for a low-level FAP."""

    number: int
    """FAP number, 3 to 68. Not a column index: see :func:`column`."""
    name: str
    """Name exactly as the table spells it."""
    unit: FapUnit
    bidirectional: bool
    positive: Direction
    point: str
    """Feature point that moves, ``"group.index"``. Eyeballs and head: the centre of rotation (common reading)."""
    group: int
    """FAP group, 1..10: the unit in which masks are coded."""
    quantiser_step: int
    """QP, in FAPU; the step at ``fap_quant`` 1."""
    intra_limit: int
    """Default symbol range of intra planes: -limit..limit, in quantiser steps at ``fap_quant`` 1."""
    predicted_limit: int
    """Default symbol range of predicted planes, likewise."""


FAP_COUNT = 68
VISEME_FAP = 1
EXPRESSION_FAP = 2

# fmt: off
FAPS: tuple[FapSpec, ...] = (
    FapSpec(number=3,  name="open_jaw",              unit=FapUnit.MNS,   bidirectional=False, positive=Direction.DOWN,           point="2.1",      group=2,  quantiser_step=4,   intra_limit=1080, predicted_limit=360),
    FapSpec(number=4,  name="lower_t_midlip",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="2.2",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=5,  name="raise_b_midlip",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.3",      group=2,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=6,  name="stretch_l_cornerlip",   unit=FapUnit.MW,    bidirectional=True,  positive=Direction.LEFT,           point="2.4",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=7,  name="stretch_r_cornerlip",   unit=FapUnit.MW,    bidirectional=True,  positive=Direction.RIGHT,          point="2.5",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=8,  name="lower_t_lip_lm",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="2.6",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=9,  name="lower_t_lip_rm",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="2.7",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=10, name="raise_b_lip_lm",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.8",      group=2,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=11, name="raise_b_lip_rm",        unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.9",      group=2,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=12, name="raise_l_cornerlip",     unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.4",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=13, name="raise_r_cornerlip",     unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.5",      group=2,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=14, name="thrust_jaw",            unit=FapUnit.MNS,   bidirectional=False, positive=Direction.FORWARD,        point="2.1",      group=2,  quantiser_step=1,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=15, name="shift_jaw",             unit=FapUnit.MW,    bidirectional=True,  positive=Direction.RIGHT,          point="2.1",      group=2,  quantiser_step=1,   intra_limit=1080, predicted_limit=360),
    FapSpec(number=16, name="push_b_lip",            unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.FORWARD,        point="2.3",      group=2,  quantiser_step=1,   intra_limit=1080, predicted_limit=360),
    FapSpec(number=17, name="push_t_lip",            unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.FORWARD,        point="2.2",      group=2,  quantiser_step=1,   intra_limit=1080, predicted_limit=360),
    FapSpec(number=18, name="depress_chin",          unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="2.10",     group=2,  quantiser_step=1,   intra_limit=420,  predicted_limit=180),
    FapSpec(number=19, name="close_t_l_eyelid",      unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.DOWN,           point="3.1",      group=3,  quantiser_step=1,   intra_limit=1080, predicted_limit=600),
    FapSpec(number=20, name="close_t_r_eyelid",      unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.DOWN,           point="3.2",      group=3,  quantiser_step=1,   intra_limit=1080, predicted_limit=600),
    FapSpec(number=21, name="close_b_l_eyelid",      unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.UP,             point="3.3",      group=3,  quantiser_step=1,   intra_limit=600,  predicted_limit=240),
    FapSpec(number=22, name="close_b_r_eyelid",      unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.UP,             point="3.4",      group=3,  quantiser_step=1,   intra_limit=600,  predicted_limit=240),
    FapSpec(number=23, name="yaw_l_eyeball",         unit=FapUnit.AU,    bidirectional=True,  positive=Direction.LEFT,           point="3.5",      group=3,  quantiser_step=128, intra_limit=1200, predicted_limit=420),
    FapSpec(number=24, name="yaw_r_eyeball",         unit=FapUnit.AU,    bidirectional=True,  positive=Direction.LEFT,           point="3.6",      group=3,  quantiser_step=128, intra_limit=1200, predicted_limit=420),
    FapSpec(number=25, name="pitch_l_eyeball",       unit=FapUnit.AU,    bidirectional=True,  positive=Direction.DOWN,           point="3.5",      group=3,  quantiser_step=128, intra_limit=900,  predicted_limit=300),
    FapSpec(number=26, name="pitch_r_eyeball",       unit=FapUnit.AU,    bidirectional=True,  positive=Direction.DOWN,           point="3.6",      group=3,  quantiser_step=128, intra_limit=900,  predicted_limit=300),
    FapSpec(number=27, name="thrust_l_eyeball",      unit=FapUnit.ES,    bidirectional=True,  positive=Direction.FORWARD,        point="3.5",      group=3,  quantiser_step=1,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=28, name="thrust_r_eyeball",      unit=FapUnit.ES,    bidirectional=True,  positive=Direction.FORWARD,        point="3.6",      group=3,  quantiser_step=1,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=29, name="dilate_l_pupil",        unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.GROWING,        point="3.5",      group=3,  quantiser_step=1,   intra_limit=420,  predicted_limit=120),
    FapSpec(number=30, name="dilate_r_pupil",        unit=FapUnit.IRISD, bidirectional=True,  positive=Direction.GROWING,        point="3.6",      group=3,  quantiser_step=1,   intra_limit=420,  predicted_limit=120),
    FapSpec(number=31, name="raise_l_i_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.1",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=32, name="raise_r_i_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.2",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=33, name="raise_l_m_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.3",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=34, name="raise_r_m_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.4",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=35, name="raise_l_o_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.5",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=36, name="raise_r_o_eyebrow",     unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="4.6",      group=4,  quantiser_step=2,   intra_limit=900,  predicted_limit=360),
    FapSpec(number=37, name="squeeze_l_eyebrow",     unit=FapUnit.ES,    bidirectional=True,  positive=Direction.RIGHT,          point="4.1",      group=4,  quantiser_step=1,   intra_limit=900,  predicted_limit=300),
    FapSpec(number=38, name="squeeze_r_eyebrow",     unit=FapUnit.ES,    bidirectional=True,  positive=Direction.LEFT,           point="4.2",      group=4,  quantiser_step=1,   intra_limit=900,  predicted_limit=300),
    FapSpec(number=39, name="puff_l_cheek",          unit=FapUnit.ES,    bidirectional=True,  positive=Direction.LEFT,           point="5.1",      group=5,  quantiser_step=2,   intra_limit=900,  predicted_limit=300),
    FapSpec(number=40, name="puff_r_cheek",          unit=FapUnit.ES,    bidirectional=True,  positive=Direction.RIGHT,          point="5.2",      group=5,  quantiser_step=2,   intra_limit=900,  predicted_limit=300),
    FapSpec(number=41, name="lift_l_cheek",          unit=FapUnit.ENS,   bidirectional=False, positive=Direction.UP,             point="5.3",      group=5,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=42, name="lift_r_cheek",          unit=FapUnit.ENS,   bidirectional=False, positive=Direction.UP,             point="5.4",      group=5,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=43, name="shift_tongue_tip",      unit=FapUnit.MW,    bidirectional=True,  positive=Direction.RIGHT,          point="6.1",      group=6,  quantiser_step=1,   intra_limit=1080, predicted_limit=420),
    FapSpec(number=44, name="raise_tongue_tip",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="6.1",      group=6,  quantiser_step=1,   intra_limit=1080, predicted_limit=420),
    FapSpec(number=45, name="thrust_tongue_tip",     unit=FapUnit.MW,    bidirectional=True,  positive=Direction.FORWARD,        point="6.1",      group=6,  quantiser_step=1,   intra_limit=1080, predicted_limit=420),
    FapSpec(number=46, name="raise_tongue",          unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="6.2",      group=6,  quantiser_step=1,   intra_limit=1080, predicted_limit=420),
    FapSpec(number=47, name="tongue_roll",           unit=FapUnit.AU,    bidirectional=False, positive=Direction.CONCAVE_UPWARD, point="6.3"    ,  group=6,  quantiser_step=512, intra_limit=1080, predicted_limit=420),
    FapSpec(number=48, name="head_pitch",            unit=FapUnit.AU,    bidirectional=True,  positive=Direction.DOWN,           point="7.1",      group=7,  quantiser_step=170, intra_limit=1860, predicted_limit=600),
    FapSpec(number=49, name="head_yaw",              unit=FapUnit.AU,    bidirectional=True,  positive=Direction.LEFT,           point="7.1",      group=7,  quantiser_step=170, intra_limit=1860, predicted_limit=600),
    FapSpec(number=50, name="head_roll",             unit=FapUnit.AU,    bidirectional=True,  positive=Direction.RIGHT,          point="7.1",      group=7,  quantiser_step=170, intra_limit=1860, predicted_limit=600),
    FapSpec(number=51, name="lower_t_midlip_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="8.1",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=52, name="raise_b_midlip_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="8.2",      group=8,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=53, name="stretch_l_cornerlip_o", unit=FapUnit.MW,    bidirectional=True,  positive=Direction.LEFT,           point="8.3",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=54, name="stretch_r_cornerlip_o", unit=FapUnit.MW,    bidirectional=True,  positive=Direction.RIGHT,          point="8.4",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=55, name="lower_t_lip_lm_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="8.5",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=56, name="lower_t_lip_rm_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.DOWN,           point="8.6",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=57, name="raise_b_lip_lm_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="8.7",      group=8,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=58, name="raise_b_lip_rm_o",      unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="8.8",      group=8,  quantiser_step=2,   intra_limit=1860, predicted_limit=600),
    FapSpec(number=59, name="raise_l_cornerlip_o",   unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="8.3",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=60, name="raise_r_cornerlip_o",   unit=FapUnit.MNS,   bidirectional=True,  positive=Direction.UP,             point="8.4",      group=8,  quantiser_step=2,   intra_limit=600,  predicted_limit=180),
    FapSpec(number=61, name="stretch_l_nose",        unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.LEFT,           point="9.1",      group=9,  quantiser_step=1,   intra_limit=540,  predicted_limit=120),
    FapSpec(number=62, name="stretch_r_nose",        unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.RIGHT,          point="9.2",      group=9,  quantiser_step=1,   intra_limit=540,  predicted_limit=120),
    FapSpec(number=63, name="raise_nose",            unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="9.3",      group=9,  quantiser_step=1,   intra_limit=680,  predicted_limit=180),
    FapSpec(number=64, name="bend_nose",             unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.RIGHT,          point="9.3",      group=9,  quantiser_step=1,   intra_limit=900,  predicted_limit=180),
    FapSpec(number=65, name="raise_l_ear",           unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="10.1",     group=10, quantiser_step=1,   intra_limit=900,  predicted_limit=240),
    FapSpec(number=66, name="raise_r_ear",           unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.UP,             point="10.2",     group=10, quantiser_step=1,   intra_limit=900,  predicted_limit=240),
    FapSpec(number=67, name="pull_l_ear",            unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.LEFT,           point="10.3",     group=10, quantiser_step=1,   intra_limit=900,  predicted_limit=300),
    FapSpec(number=68, name="pull_r_ear",            unit=FapUnit.ENS,   bidirectional=True,  positive=Direction.RIGHT,          point="10.4",     group=10, quantiser_step=1,   intra_limit=900,  predicted_limit=300),
)
# fmt: on
"""The 66 low-level FAPs, numbers 3..68 in order."""

_BY_NAME = {spec.name: spec for spec in FAPS}

GROUPS: tuple[tuple[int, ...], ...] = (
    (VISEME_FAP, EXPRESSION_FAP),
    *(tuple(spec.number for spec in FAPS if spec.group == group) for group in range(2, 11)),
)
"""FAP numbers of the ten groups, in order."""


def column(number: int) -> int:
    """Return the array column of a FAP number.

    Raises
    ------
    UsageError
        If the number is outside 1..68.

    Examples
    --------
    >>> column(3)
    2
    """
    if not 1 <= number <= FAP_COUNT:
        raise UsageError(f"FAP number: must be 1 to {FAP_COUNT}, got {number}")
    return number - 1


def spec(number: int) -> FapSpec:
    """Return the row of a low-level FAP.

    Raises
    ------
    UsageError
        If the number is outside 3..68.

    Examples
    --------
    >>> spec(3).name
    'open_jaw'
    """
    if not 3 <= number <= FAP_COUNT:
        raise UsageError(f"low-level FAP number: must be 3 to {FAP_COUNT}, got {number}")
    return FAPS[number - 3]


def by_name(name: str) -> FapSpec:
    """Return the row with this name, as the table spells it.

    Raises
    ------
    UsageError
        If no FAP has the name.

    Examples
    --------
    >>> by_name("open_jaw").number
    3
    """
    if name not in _BY_NAME:
        raise UsageError(f"FAP name: unknown name {name!r}; use a name of Table C.1 such as 'open_jaw'")
    return _BY_NAME[name]


BIFS_NAMES: dict[int, str] = {
    6: "stretch_l_corner",
    7: "stretch_r_corner",
    10: "lower_b_lip_lm",
    11: "lower_b_lip_rm",
    53: "stretch_l_cornerlip",
    54: "stretch_r_cornerlip",
}
"""Fields of the BIFS node ``FAP`` that are spelled unlike Table C.1 (node templates of gpac).

Some are the standard's names of *other* FAPs: BIFS calls FAP 53 as Table C.1 calls FAP 6.
"""


def bifs_name(number: int) -> str:
    """Name of a low-level FAP as a field of the BIFS node.

    Examples
    --------
    >>> bifs_name(3), bifs_name(53)
    ('open_jaw', 'stretch_l_cornerlip')
    """
    return BIFS_NAMES.get(number) or spec(number).name
