"""The verdict on a lip sync: the value of every figure, and which of them fail."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from fapengine.scoring.score import AgainstPhones, AgainstTruth, Score
from fapengine.scoring.thresholds import LIP_THRESHOLDS, MESH_THRESHOLDS, Threshold
from fapengine.scoring.vertices import VertexErrors

S = TypeVar("S", Score, VertexErrors)
R = TypeVar("R")

CLOSURES_HEARD, MIN_CLOSURES_HEARD = 60.0, 3
"""Threshold of closures, in %, and least number of them, where phones were recognized: of the p b m that the recognizer
reports 4 % were not spoken (docs/measurements.md), which a right lip sync does not close."""
FILE = "file"
"""Check that fails for a recording which cannot be scored."""


@dataclass(frozen=True, slots=True)
class Measure(Generic[S]):
    """How one figure is found in a score."""

    row: Threshold
    value: Callable[[S], float | None]
    weight: Callable[[S], float] = lambda _: 1.0
    """Weight of an utterance in the mean of a set."""
    missed: Callable[[S], tuple[float, ...]] = lambda _: ()
    """Times of single faults, s."""


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


_LIPS = {row.name: row for row in LIP_THRESHOLDS}
MEASURES: tuple[Measure[Score], ...] = (
    Measure(_LIPS["opens"], lambda s: s.opens_mm),
    Measure(_LIPS["lag"], _judged(lambda j: j.timing.lag_ms, None)),
    Measure(_LIPS["lead"], _judged(lambda j: None if j.timing.lag_ms is None else -j.timing.lag_ms, None)),
    Measure(
        _LIPS["closures"], _closed, _judged(lambda j: j.closures.wanted, 0.0),
        _judged(lambda j: j.closures.missed_s, ()),
    ),
    Measure(
        _LIPS["teeth"], _phones(lambda p: _percent(p.teeth.recall), None), _phones(lambda p: p.teeth.wanted, 0.0),
        _phones(lambda p: p.teeth.missed_s, ()),
    ),
    Measure(_LIPS["explained"], _judged(lambda j: _percent(j.closures.precision), None)),
    Measure(_LIPS["r"], _truth(lambda t: t.likeness.opening_r)),
    Measure(_LIPS["slope"], _truth(lambda t: t.likeness.opening_slope)),
    Measure(_LIPS["mtm"], _truth(lambda t: t.timing.mtm_ms)),
    Measure(_LIPS["mod"], _truth(lambda t: t.likeness.opening_mm)),
    Measure(_LIPS["lve"], _truth(lambda t: t.likeness.lve_mm2), lambda s: s.frames),
    Measure(_LIPS["slcc"], lambda s: s.intensity.slcc if s.intensity else None),
)  # fmt: skip
"""Figures of a mouth, in the order of their rows."""
_MESHES = {row.name: row for row in MESH_THRESHOLDS}
VERTEX_MEASURES: tuple[Measure[VertexErrors], ...] = (
    Measure(_MESHES["lve"], lambda e: e.lve_squared, lambda e: e.frames),
    Measure(_MESHES["lve_root"], lambda e: e.lve, lambda e: e.frames),
    Measure(_MESHES["mve"], lambda e: e.mve),
    Measure(_MESHES["fdd"], lambda e: e.fdd_squared),
    Measure(_MESHES["fdd_root"], lambda e: e.fdd),
)
"""Figures of meshes. Means of a set are those of the papers' programs: LVE over frames, the others over sequences."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A figure that does not pass."""

    check: str
    """Name of the figure, or :data:`FILE`."""
    message: str
    times_s: tuple[float, ...] = ()
    """Where it happens, s; empty if it concerns the whole recording."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one recording."""

    faults: tuple[Fault, ...]
    checked: tuple[str, ...]
    """Names of the figures that were compared with their thresholds, faults included."""
    said: str
    """The figures that pass, in words."""
    unchecked: tuple[str, ...] = ()
    """Names of the figures that have a threshold and no value."""

    @property
    def passes(self) -> bool:
        """Whether nothing fails."""
        return not self.faults

    def __str__(self) -> str:
        if self.faults:
            return f"fails: {'; '.join(fault.message for fault in self.faults)}"
        absent = f"; not checked: {', '.join(self.unchecked)}" if self.unchecked else ""
        return f"passes: {self.said or 'nothing could be checked'}{absent}"


def judge(score: S, measures: Iterable[Measure[S]], thresholds: Mapping[str, float] | None = None) -> Verdict:
    """Compare a score with thresholds.

    Parameters
    ----------
    score : Score or VertexErrors
    measures : iterable of Measure
        :data:`MEASURES` or :data:`VERTEX_MEASURES`.
    thresholds : mapping of str to float, optional
        Thresholds by name, which replace those of the rows.
    """
    faults, passed, unchecked, checked = [], [], [], []
    for measure in measures:
        row = measure.row
        limit = (thresholds or {}).get(row.name, _limit(row, score))
        if limit is None:
            continue
        value = measure.value(score)
        if value is None:
            unchecked.append(row.name)
            continue
        checked.append(row.name)
        if row.passes(value, limit):
            if row.name != "lead":  # lag says it
                passed.append(f"{row.name} {row.spell(value)}")
        else:
            message = f"{row.name} {row.spell(value)} ({row.help}; {row.side} {row.spell(limit)})"
            faults.append(Fault(row.name, message, measure.missed(score)))
    return Verdict(tuple(faults), tuple(checked), ", ".join(passed), tuple(unchecked))


def _limit(row: Threshold, score: Score | VertexErrors) -> float | None:
    """Threshold by default. Of closures, it is for phones: people also shut their lips where no phone asks for it."""
    if row.name != "closures" or not isinstance(score, Score):
        return row.limit
    return None if score.phones is None and score.truth is not None else CLOSURES_HEARD if score.is_heard else row.limit
