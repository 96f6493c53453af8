"""Metrics for Prometheus: all counters (:mod:`fapengine._counters`) as text.

A server with workers has one page: the workers' samples with a label ``worker``, and the parent's own metrics.
"""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

from aiohttp import web
from prometheus_client import CollectorRegistry, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from fapengine._counters import Counts, Family, joined
from fapengine.host.hub import Hub
from fapengine.server.config import Listen
from fapengine.server.intake.doors import Door
from fapengine.server.sinks.kinds import Sink, SinkCounts
from fapengine.server.web.access import Access
from fapengine.server.web.site import Site, harden, open_site

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
BUCKETS_S = (0.001, 0.002, 0.004, 0.006, 0.008, 0.010, 0.012, 0.014, 0.016, 0.020, 0.030, 0.050, 0.100)
STATES = ("idle", "waiting", "speaking", "paused")
Source = Callable[[], Iterable[Family]]


@dataclass(slots=True)
class TextCounts(Counts):
    """Counts of texts that senders wanted spoken. Stateful."""

    METRIC = "texts", "Texts that senders wanted spoken, by what became of them."

    spoken: int = 0
    refused: int = 0
    """Texts that came too fast, or that no installed voice can speak."""


class ServerMetrics(Collector):
    """Metrics of one server, gathered on request. Stateful."""

    def __init__(self) -> None:
        self.sources: list[Source] = []
        """Functions that return metrics, such as :meth:`fapengine._counters.Counts.families`."""
        self._registry = CollectorRegistry()
        self._registry.register(self)
        self.tick_s = Histogram(
            "fapengine_tick_seconds", "What a frame of all sessions takes, sending included.",
            buckets=BUCKETS_S, registry=self._registry,
        )  # fmt: skip
        self.late_s = Histogram(
            "fapengine_late_seconds", "How much later than due a frame began.",
            buckets=BUCKETS_S, registry=self._registry,
        )  # fmt: skip

    def text(self) -> bytes:
        """Return the page that Prometheus reads."""
        return generate_latest(self._registry)

    def collect(self) -> Iterator[Metric]:
        """Gather the metrics; called by the registry."""
        return map(_metric, joined(chain.from_iterable(source() for source in self.sources)))


async def open_metrics(text: Callable[[], Awaitable[bytes]], listen: Listen, door: Door, access: Access) -> Site | None:
    """Serve metrics on their own port, if one is configured. Raises ResourceError if the port is in use."""
    if listen.metrics_port is None:
        return None

    async def answer(request: web.Request) -> web.Response:
        access.admit(request)
        return web.Response(body=await text(), headers={"Content-Type": CONTENT_TYPE})

    app = web.Application()
    harden(app)
    app.router.add_get("/metrics", answer)
    return await open_site(app, listen.host, listen.metrics_port, door)


def of_sessions(hub: Hub) -> Iterator[Family]:
    """Return metrics of a hub's sessions."""
    states: list[str] = [hub.engine.state(session) for session in hub.engine.sessions]
    samples = tuple(((("state", state),), states.count(state)) for state in STATES)
    yield Family("sessions", "Open sessions, by what they do.", samples, is_gauge=True)
    yield Family.of("sessions_refused", "Sessions that were refused for want of time.", hub.engine.refused)
    yield from hub.counts.families()
    yield from hub.engine.totals().families()


def of_sinks(sinks: Iterable[Sink]) -> Iterator[Family]:
    """Return metrics of sinks; without sinks, their names."""
    yield from (replace(family, samples=()) for family in SinkCounts().families())
    for sink in sinks:
        yield from sink.counts.families(("sink", str(sink.address)))


def _metric(family: Family) -> Metric:
    kind = GaugeMetricFamily if family.is_gauge else CounterMetricFamily
    names = [name for name, _ in family.samples[0][0]] if family.samples else ()
    metric = kind(f"fapengine_{family.name}", family.help, labels=names)
    for labels, value in family.samples:
        metric.add_metric([text for _, text in labels], value)
    return metric


class _Page(Collector):
    def __init__(self, metrics: Iterable[Metric]) -> None:
        self._metrics = metrics

    def collect(self) -> Iterable[Metric]:
        return self._metrics


def page_of_workers(families: Iterable[Family], texts: Mapping[int, bytes]) -> bytes:
    r"""Return the page of a parent: its own metrics, and the workers' pages joined.

    Examples
    --------
    >>> texts = {0: b"# TYPE faces gauge\nfaces 2.0\n", 1: b"# TYPE faces gauge\nfaces 3.0\n"}
    >>> print(page_of_workers([], texts).decode().splitlines()[2:])
    ['faces{worker="0"} 2.0', 'faces{worker="1"} 3.0']
    """
    joined_pages: dict[str, Metric] = {}
    for worker, text in texts.items():
        for family in text_string_to_metric_families(text.decode()):
            whole = joined_pages.setdefault(family.name, Metric(family.name, family.documentation, family.type))
            for sample in family.samples:
                whole.add_sample(sample.name, {"worker": str(worker), **sample.labels}, sample.value)
    return generate_latest(_Page([*map(_metric, families), *joined_pages.values()]))
