"""The figures that a verdict may be based on, a row each: names, units, and thresholds by default.

Rows come in the order in which faults are reported: a mouth that does not open first, then lips that are late, as every
other figure of such a recording means little. Their values are in :mod:`fapengine.scoring.verdict`.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from fapengine.errors import UsageError

MINIMUM, MAXIMUM = "at least", "at most"
"""Sides of a threshold."""
SPEECH, TRUTH = ("phones", "audio", "against"), ("against",)
"""What figures are measured against."""


@dataclass(frozen=True, slots=True)
class Threshold:
    """One figure, and which of its values pass."""

    name: str
    unit: str
    side: str
    """Whether the threshold is the least or the largest value that passes."""
    limit: float | None
    """Threshold by default; None if it is not checked unless it is named."""
    needs: tuple[str, ...]
    """What it is measured against, one of these; empty if it needs nothing."""
    help: str

    def passes(self, value: float, limit: float) -> bool:
        """Whether a value satisfies a threshold."""
        return value >= limit if self.side == MINIMUM else value <= limit

    def spell(self, value: float) -> str:
        """Format a value with its unit."""
        return f"{value + 0.0:.3g} {self.unit}".strip()  # no -0

    def __str__(self) -> str:
        default = "" if self.limit is None else f" {self.limit:g}"
        return f"{self.name} ({self.unit or 'number'}, {self.side}{default})"


# fmt: off
LIP_THRESHOLDS = (
    Threshold("opens",     "mm",  MINIMUM, 2.0,   (),                  "how far the mouth opens in speech"),
    Threshold("lag",       "ms",  MAXIMUM, 90.0,  SPEECH,              "how late the lips are"),
    Threshold("lead",      "ms",  MAXIMUM, 185.0, SPEECH,              "how early the lips are"),
    Threshold("closures",  "%",   MINIMUM, 90.0,  SPEECH,              "closures of p b m, or of the reference"),
    Threshold("teeth",     "%",   MINIMUM, None,  ("phones", "audio"), "f v that meet the teeth"),
    Threshold("explained", "%",   MINIMUM, None,  SPEECH,              "closed time near a p b m f v"),
    Threshold("r",         "",    MINIMUM, None,  TRUTH,               "correlation of the opening"),
    Threshold("slope",     "",    MINIMUM, None,  TRUTH,               "opening relative to the reference"),
    Threshold("mtm",       "ms",  MAXIMUM, None,  TRUTH,               "mean temporal misalignment"),
    Threshold("mod",       "mm",  MAXIMUM, None,  TRUTH,               "mean distance of the opening"),
    Threshold("lve",       "mm2", MAXIMUM, None,  TRUTH,               "lip vertex error, squared"),
    Threshold("slcc",      "",    MINIMUM, None,  ("audio",),          "lips move more where speech is louder"),
)
"""Of a mouth. Lag and lead: what viewers still accept, ITU-R BT.1359-1."""
MESH_THRESHOLDS = (
    Threshold("lve",       "unit2", MAXIMUM, None, ("lips",),  "lip vertex error, squared"),
    Threshold("lve_root",  "unit",  MAXIMUM, None, ("lips",),  "lip vertex error"),
    Threshold("mve",       "unit",  MAXIMUM, None, (),         "mean vertex error"),
    Threshold("fdd",       "unit2", MAXIMUM, None, ("upper",), "upper-face dynamics deviation, squared"),
    Threshold("fdd_root",  "unit",  MAXIMUM, None, ("upper",), "upper-face dynamics deviation"),
)
"""Of meshes, in their unit."""
# fmt: on


def parse_thresholds(text: str, rows: Iterable[Threshold]) -> dict[str, float]:
    """Read thresholds such as ``closures=95,lag=80ms``.

    Raises UsageError for an unknown name, another unit, or something that is not a number (the message lists names and
    units).

    Examples
    --------
    >>> parse_thresholds("closures=95,lag=80ms", LIP_THRESHOLDS)
    {'closures': 95.0, 'lag': 80.0}
    """
    known = {row.name: row for row in rows}
    limits: dict[str, float] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\w+)\s*=\s*(-?\d+(?:\.\d+)?)\s*(\S*)\s*", part)
        if not found or found[1] not in known or found[3] not in ("", known[found[1]].unit):
            listed = ", ".join(f"{each.name}={each.unit or 'number'}" for each in known.values())
            raise UsageError(f"fail_under: got {part.strip()!r}, expected NAME=VALUE, separated by commas, of {listed}")
        limits[found[1]] = float(found[2])
    return limits
