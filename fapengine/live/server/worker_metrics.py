"""Metrics of workers as one page: every sample with a label ``worker``, and what the parent counts itself."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from fapengine.live.server.front import FrontCounts


@dataclass(frozen=True, slots=True)
class BusFigures:
    """What the parent knows of other machines."""

    machines: int
    """Machines that live, this one included."""
    owned: int
    """Partitions that are this machine's."""
    fences: int
    """Times that its lease had run out."""


@dataclass(frozen=True, slots=True)
class ParentFigures:
    """What the parent knows."""

    alive: int
    restarts: int
    placed: int
    front: FrontCounts
    bus: BusFigures | None = None
    """None: this machine is alone."""


class _Page(Collector):
    """All of it, once."""

    def __init__(self, figures: ParentFigures, texts: Mapping[int, bytes]) -> None:
        self._figures, self._texts = figures, texts

    def collect(self) -> Iterator[Metric]:
        figures = self._figures
        yield GaugeMetricFamily("fapengine_workers", "Workers that live.", value=figures.alive)
        yield CounterMetricFamily("fapengine_worker_restarts", "Workers that had ended.", value=figures.restarts)
        yield GaugeMetricFamily("fapengine_placed", "Sessions that have a worker.", value=figures.placed)
        front = CounterMetricFamily("fapengine_front", "What came at the known ports, by kind.", labels=["kind"])
        for kind, value in asdict(figures.front).items():
            front.add_metric([kind], value)
        yield front
        if figures.bus is not None:
            bus = figures.bus
            yield GaugeMetricFamily("fapengine_machines", "Machines that share the sessions.", value=bus.machines)
            yield GaugeMetricFamily("fapengine_partitions", "Partitions of this machine.", value=bus.owned)
            yield CounterMetricFamily("fapengine_fences", "Times that its lease had run out.", value=bus.fences)
        yield from labelled(self._texts).values()


def labelled(texts: Mapping[int, bytes]) -> dict[str, Metric]:
    r"""Join the pages of workers: families by name.

    Examples
    --------
    >>> joined = labelled({0: b"# TYPE faces gauge\nfaces 2.0\n", 1: b"# TYPE faces gauge\nfaces 3.0\n"})
    >>> [(sample.labels, sample.value) for sample in joined["faces"].samples]
    [({'worker': '0'}, 2.0), ({'worker': '1'}, 3.0)]
    """
    families: dict[str, Metric] = {}
    for worker, text in texts.items():
        for family in text_string_to_metric_families(text.decode()):
            joined = families.setdefault(family.name, Metric(family.name, family.documentation, family.type))
            for sample in family.samples:
                joined.add_sample(sample.name, {"worker": str(worker), **sample.labels}, sample.value)
    return families


def page(figures: ParentFigures, texts: Mapping[int, bytes]) -> bytes:
    """Write the page that Prometheus reads.

    Parameters
    ----------
    figures : ParentFigures
    texts : mapping of int to bytes
        Pages of those workers that have answered.
    """
    registry = CollectorRegistry()
    registry.register(_Page(figures, texts))
    return generate_latest(registry)
