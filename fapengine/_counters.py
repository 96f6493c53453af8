"""Counters: dataclasses of numbers, and their conversion to metrics with samples.

A class of counters is one metric, with its fields as values of the label ``kind``; a field made by :func:`metric` is a
metric of its own. What serves metrics (:mod:`fapengine.server.metrics`) asks each of them for :meth:`Counts.families`.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Self

Labels = tuple[tuple[str, str], ...]
"""Names and values."""


@dataclass(frozen=True, slots=True)
class Family:
    """One metric with its samples."""

    name: str
    help: str
    samples: tuple[tuple[Labels, float], ...]
    is_gauge: bool = False
    """False: a counter, which only grows."""

    @classmethod
    def of(cls, name: str, help_text: str, value: float, *, is_gauge: bool = False) -> "Family":
        """Make a metric without labels."""
        return cls(name, help_text, (((), value),), is_gauge)


@dataclass(slots=True)
class Counts:
    """Base of all counters.

    Examples
    --------
    >>> @dataclass(slots=True)
    ... class Calls(Counts):
    ...     METRIC = "call", "What became of calls."
    ...     open: int = metric("calls", "Open calls.", is_gauge=True)
    ...     begun: int = 0
    ...     lost: int = 0
    >>> [(family.name, family.samples) for family in Calls(2, 9, 1).families()]
    [('calls', (((), 2),)), ('call', (((('kind', 'begun'),), 9), ((('kind', 'lost'),), 1)))]
    >>> Calls(2, 9, 1).plus(Calls(1, 1, 1))
    Calls(open=3, begun=10, lost=2)
    """

    METRIC: ClassVar[tuple[str, str]] = "", ""
    """Name and help of the metric; its fields are values of the label ``kind``."""

    def families(self, *labels: tuple[str, str]) -> Iterator[Family]:
        """Return metrics with these numbers; ``labels`` are added to each sample."""
        kinds: dict[tuple[str, str, bool], list[tuple[Labels, float]]] = {}
        for one in fields(self):
            own = one.metadata.get("metric")
            kind = () if own is not None and not own[3] else (("kind", one.name),)
            key = own[:3] if own is not None else (*self.METRIC, False)
            kinds.setdefault(key, []).append(((*labels, *kind), getattr(self, one.name)))
        for (name, help_text, is_gauge), samples in kinds.items():
            yield Family(name, help_text, tuple(samples), is_gauge)

    def plus(self, *others: Self) -> Self:
        """Sum counters of one class, field by field."""
        return type(self)(*(sum(getattr(one, f.name) for one in (self, *others)) for f in fields(self)))


def metric(name: str, help_text: str, *, is_gauge: bool = False, has_kind: bool = False) -> Any:
    """Make a field, initially 0, that is a metric of its own, or with ``has_kind`` one of its kinds."""
    return field(default=0, metadata={"metric": (name, help_text, is_gauge, has_kind)})


def joined(families: Iterable[Family]) -> list[Family]:
    """Join the samples of metrics with one name, in the order of their first."""
    found: dict[str, Family] = {}
    for family in families:
        before = found.get(family.name)
        samples = (*before.samples, *family.samples) if before is not None else family.samples
        found[family.name] = Family(family.name, family.help, samples, family.is_gauge)
    return list(found.values())
