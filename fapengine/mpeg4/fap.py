"""The standard's tables: face animation parameters, feature points, visemes, expressions (ISO/IEC 14496-2, Annex C).

FAP 1 and 2 are high-level: a viseme and an expression (Tables C.4 and C.5), each several numbers
(:class:`fapengine.mpeg4.track.FapTrack`). FAP 3 to 68 (Table C.1) each move one of the 84 feature points along one
axis.

Deviation: the default symbol ranges of FAP 3, 14 and 47 have both signs, and FAP 47 has +-1080 / +-420, as every
known stream and decoder of the reference family does; the printed table is one-sided and gives +300 / +60.
"""

import csv
from dataclasses import dataclass
from enum import StrEnum
from importlib.resources import files

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


def _rows(table: str) -> list[dict[str, str]]:
    """Read one of this package's tables of the standard, ``.csv``: rows by the names in its first line."""
    return list(csv.DictReader((files(__package__) / table).read_text("utf-8").splitlines()))


def _spec(row: dict[str, str]) -> FapSpec:
    numbers = {name: int(row[name]) for name in ("number", "group", "quantiser_step", "intra_limit", "predicted_limit")}
    return FapSpec(
        name=row["name"], unit=FapUnit(row["unit"]), bidirectional=row["bidirectional"] == "yes",
        positive=Direction(row["positive"]), point=row["point"], **numbers,
    )  # fmt: skip


FAPS: tuple[FapSpec, ...] = tuple(map(_spec, _rows("faps.csv")))
"""The 66 low-level FAPs, numbers 3..68 in order."""

_BY_NAME = {spec.name: spec for spec in FAPS}

GROUPS: tuple[tuple[int, ...], ...] = (
    (VISEME_FAP, EXPRESSION_FAP),
    *(tuple(spec.number for spec in FAPS if spec.group == group) for group in range(2, 11)),
)
"""FAP numbers of the ten groups, in order."""


@dataclass(frozen=True, slots=True)
class FeaturePoint:
    """One numbered point on the face."""

    name: str
    """``"group.index"`` as the standard numbers it."""
    place: str
    """Place on the face, with its side at the end, if it is not in the middle: the subject's left or right."""


FEATURE_POINTS = tuple(FeaturePoint(**row) for row in _rows("feature_points.csv"))
FEATURE_POINT_NAMES: tuple[str, ...] = tuple(point.name for point in FEATURE_POINTS)


@dataclass(frozen=True, slots=True)
class Viseme:
    """One row of Table C.4: a value of FAP 1."""

    number: int
    label: str
    """Short label in common use; ``sil`` for 0."""
    phonemes: tuple[str, ...]
    """IPA. The table lists SAMPA; rewritten once here."""
    example: str


VISEMES = tuple(
    Viseme(int(row["number"]), row["label"], tuple(row["phonemes"].split()), row["example"])
    for row in _rows("visemes.csv")
)
FULL_WEIGHT = 63
"""Blend of a viseme, or intensity of an expression, that is shown alone."""
FAP_2_EXPRESSIONS = ("neutral", "joy", "sadness", "anger", "fear", "disgust", "surprise")
"""Expressions of FAP 2 by their numbers; 0 is no expression."""


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


def columns(*numbers: int) -> list[int]:
    """Return the array columns of several FAP numbers: see :func:`column`."""
    return [column(number) for number in numbers]


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
