"""The verdict on a lip sync: every figure as a row of a table, its threshold, and what fails.

A threshold is either the least or the largest value that passes. Rows come in the order in which faults are reported:
a mouth that does not open first, then lips that are late, as every other figure of such a recording means little.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from fapengine.errors import UsageError
from fapengine.scoring.score import AgainstPhones, AgainstTruth, Score
from fapengine.scoring.vertices import VertexErrors

S = TypeVar("S", Score, VertexErrors)
R = TypeVar("R")
LEAST, MOST = "at least", "at most"
"""Sides of a threshold."""
CLOSURES_HEARD, MIN_CLOSURES_HEARD = 60.0, 3
"""Threshold of closures, in %, and least number of them, where phones were recognized: of the p b m that the recognizer
reports 4 % were not spoken (docs/measurements.md), which a right lip sync does not close."""


@dataclass(frozen=True, slots=True)
class Measure(Generic[S]):
    """One figure of a score."""

    name: str
    unit: str
    side: str
    """Whether a threshold is the least or the largest value that passes."""
    help: str
    value: Callable[[S], float | None]
    weight: Callable[[S], float] = lambda _: 1.0
    """Weight of an utterance in the mean of a set."""
    limit: float | None = None
    """Threshold by default; None if it is not checked unless it is named."""
    missed: Callable[[S], tuple[float, ...]] = lambda _: ()
    """Times of single faults, s."""

    def passes(self, value: float, limit: float) -> bool:
        """Whether a value satisfies a threshold."""
        return value >= limit if self.side == LEAST else value <= limit

    def spell(self, value: float) -> str:
        """Format a value with its unit."""
        return f"{value + 0.0:.3g} {self.unit}".strip()  # no -0


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _closed(score: Score) -> float | None:
    found = score.judged
    if found is None or (score.is_heard and found.closures.wanted < MIN_CLOSURES_HEARD):
        return None
    return _percent(found.closures.recall)


def _judged(of: Callable[[AgainstPhones | AgainstTruth], R], absent: R) -> Callable[[Score], R]:
    return lambda score: absent if score.judged is None else of(score.judged)


def _phones(of: Callable[[AgainstPhones], R], absent: R) -> Callable[[Score], R]:
    return lambda score: absent if score.phones is None else of(score.phones)


def _truth(of: Callable[[AgainstTruth], float | None]) -> Callable[[Score], float | None]:
    return lambda score: None if score.truth is None else of(score.truth)


MEASURES: tuple[Measure[Score], ...] = (
    Measure("opens", "mm", LEAST, "how far the mouth opens in speech", lambda s: s.opens_mm, limit=2.0),
    Measure("lag", "ms", MOST, "how late the lips are", _judged(lambda j: j.timing.lag_ms, None), limit=90.0),
    Measure(
        "lead", "ms", MOST, "how early the lips are", limit=185.0,
        value=_judged(lambda j: None if j.timing.lag_ms is None else -j.timing.lag_ms, None),
    ),
    Measure(
        "closures", "%", LEAST, "p b m that close", _closed, _judged(lambda j: j.closures.wanted, 0.0), limit=90.0,
        missed=_judged(lambda j: j.closures.missed_s, ()),
    ),
    Measure(
        "teeth", "%", LEAST, "f v that meet the teeth", _phones(lambda p: _percent(p.teeth.recall), None),
        _phones(lambda p: p.teeth.wanted, 0.0), missed=_phones(lambda p: p.teeth.missed_s, ()),
    ),
    Measure(
        "explained", "%", LEAST, "closed time near a p b m f v", _judged(lambda j: _percent(j.closures.precision), None)
    ),
    Measure("r", "", LEAST, "correlation of the opening", _truth(lambda t: t.likeness.opening_r)),
    Measure("slope", "", LEAST, "opening relative to the reference's", _truth(lambda t: t.likeness.opening_slope)),
    Measure("mtm", "ms", MOST, "mean temporal misalignment", _truth(lambda t: t.timing.mtm_ms)),
    Measure("mod", "mm", MOST, "mean distance of the opening", _truth(lambda t: t.likeness.opening_mm)),
    Measure("lve", "mm2", MOST, "lip vertex error, squared", _truth(lambda t: t.likeness.lve_mm2), lambda s: s.frames),
    Measure(
        "slcc", "", LEAST, "lips move more where speech is louder", lambda s: s.intensity.slcc if s.intensity else None
    ),
)  # fmt: skip
"""Figures of a mouth. Limits of lag and lead: ITU-R BT.1359-1, what viewers still accept."""

VERTEX_MEASURES: tuple[Measure[VertexErrors], ...] = (
    Measure("lve", "unit2", MOST, "lip vertex error, squared", lambda e: e.lve_squared, lambda e: e.frames),
    Measure("lve_root", "unit", MOST, "lip vertex error", lambda e: e.lve, lambda e: e.frames),
    Measure("mve", "unit", MOST, "mean vertex error", lambda e: e.mve),
    Measure("fdd", "unit2", MOST, "upper-face dynamics deviation, squared", lambda e: e.fdd_squared),
    Measure("fdd_root", "unit", MOST, "upper-face dynamics deviation", lambda e: e.fdd),
)
"""Figures of a mesh. Means of a set are those of the papers' programs: LVE over frames, the others over sequences."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A figure that does not pass."""

    check: str
    """Name of the measure, or ``file`` if the recording cannot be scored."""
    message: str
    times_s: tuple[float, ...] = ()
    """Where it happens, s; empty if it concerns the whole recording."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one recording."""

    faults: tuple[Fault, ...]
    checked: tuple[str, ...]
    """Names of the measures that were compared with their thresholds, faults included."""
    said: str
    """The figures that pass, in words."""
    unchecked: tuple[str, ...] = ()
    """Names of the measures that have a threshold and no value."""

    @property
    def passes(self) -> bool:
        """Whether nothing fails."""
        return not self.faults

    def __str__(self) -> str:
        if self.faults:
            return f"fails: {'; '.join(fault.message for fault in self.faults)}"
        absent = f"; not checked: {', '.join(self.unchecked)}" if self.unchecked else ""
        return f"passes: {self.said or 'nothing could be checked'}{absent}"


def parse_thresholds(text: str, measures: Iterable[Measure[S]]) -> dict[str, float]:
    """Read thresholds such as ``closures=95,lag=80ms``.

    Raises
    ------
    UsageError
        For an unknown name, another unit, or something that is not a number; the message lists names and units.

    Examples
    --------
    >>> parse_thresholds("closures=95,lag=80ms", MEASURES)
    {'closures': 95.0, 'lag': 80.0}
    """
    known = {measure.name: measure for measure in measures}
    limits: dict[str, float] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\w+)\s*=\s*(-?\d+(?:\.\d+)?)\s*(\S*)\s*", part)
        if not found or found[1] not in known or found[3] not in ("", known[found[1]].unit):
            listed = ", ".join(f"{each.name}={each.unit or 'number'}" for each in known.values())
            raise UsageError(f"fail_under: got {part.strip()!r}, expected NAME=VALUE, separated by commas, of {listed}")
        limits[found[1]] = float(found[2])
    return limits


def judge(score: S, measures: Iterable[Measure[S]], thresholds: Mapping[str, float] | None = None) -> Verdict:
    """Compare a score with thresholds.

    Parameters
    ----------
    score : Score or VertexErrors
    measures : iterable of Measure
        :data:`MEASURES` or :data:`VERTEX_MEASURES`.
    thresholds : mapping of str to float, optional
        Thresholds by name, which replace those of the measures.
    """
    faults, passed, unchecked, checked = [], [], [], []
    for measure in measures:
        limit = (thresholds or {}).get(measure.name, _limit(measure, score))
        if limit is None:
            continue
        value = measure.value(score)
        if value is None:
            unchecked.append(measure.name)
            continue
        checked.append(measure.name)
        if measure.passes(value, limit):
            passed.append(f"{measure.name} {measure.spell(value)}")
        else:
            told = f"{measure.name} {measure.spell(value)} ({measure.help}; {measure.side} {measure.spell(limit)})"
            faults.append(Fault(measure.name, told, measure.missed(score)))
    return Verdict(tuple(faults), tuple(checked), ", ".join(passed), tuple(unchecked))


def _limit(measure: Measure[S], score: S) -> float | None:
    heard = isinstance(score, Score) and score.is_heard
    return CLOSURES_HEARD if measure.name == "closures" and heard else measure.limit
