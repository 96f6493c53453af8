"""Metrics of a running server for Prometheus: the text of its own registry, read on the loop's thread."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields

from prometheus_client import CollectorRegistry, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from fapengine.live.calls.calls import CallCounts
from fapengine.live.engine.session import Counters
from fapengine.live.film.film import FilmCounts
from fapengine.live.hub.hearing import HearingCounts
from fapengine.live.hub.hub import Hub
from fapengine.live.hub.messages import HubCounts
from fapengine.live.server.doors import Door
from fapengine.live.server.ingress import Ingress
from fapengine.live.server.sink_address import Sink
from fapengine.live.web.connection import WebCounts
from fapengine.live.wire.speech_osc.counts import PeerCounts

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
BUCKETS_S = (0.001, 0.002, 0.004, 0.006, 0.008, 0.010, 0.012, 0.014, 0.016, 0.020, 0.030, 0.050, 0.100)
STATES = ("idle", "waiting", "speaking", "paused")
HUB = {
    "frames": "Ticks of the hub: one frame of every session each.",
    "skipped": "Frames that were due and never shown.",
    "listeners_dropped": "Listeners that failed.",
    "idle_closed": "Sessions closed because nobody talked to them.",
    "faulted": "Sessions ended for a fault of their own; the log has each.",
    "unheard": "Utterances whose player never said where the sound is.",
}


@dataclass(slots=True)
class TextCounts:
    """Counts of texts that senders wanted spoken.

    Stateful.
    """

    spoken: int = 0
    refused: int = 0
    """Texts that came too many at once, or that no installed voice can speak."""


class ServerMetrics(Collector):
    """A collector of a server's counts, gathered when asked for.

    Stateful.

    Parameters
    ----------
    hub, ingress : Hub, Ingress
    peers : PeerCounts
        Of all senders together.
    texts : TextCounts
    hearing : HearingCounts
    sinks : iterable of Sink
    """

    def __init__(
        self,
        hub: Hub,
        ingress: Ingress,
        peers: PeerCounts,
        texts: TextCounts,
        hearing: HearingCounts,
        sinks: Iterable[Sink],
    ) -> None:
        self._hearing = hearing
        self._hub, self._ingress, self._peers, self._texts, self._sinks = hub, ingress, peers, texts, sinks
        self.page: WebCounts | None = None
        """Counts of the page, where there is one."""
        self.calls: CallCounts | None = None
        """Counts of calls, where they are taken."""
        self.films: FilmCounts | None = None
        """Counts of pictures that are drawn here, if any are."""
        self.doors: Mapping[str, Door] = {}
        """Ports by name."""
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
        """Give the page that Prometheus reads."""
        return generate_latest(self._registry)

    def collect(self) -> Iterator[Metric]:
        """Gather; called by the registry."""
        yield from self._sessions()
        hub = self._hub.counts
        for counter in fields(HubCounts):
            yield _counter(counter.name, HUB[counter.name], getattr(hub, counter.name))
        totals = asdict(self._hub.engine.totals())
        yield _labelled("speech", "What sessions have met with, by kind.", {n: totals[n] for n in _names(Counters)})
        wire = asdict(self._peers)
        yield _labelled("wire", "What senders sent, by kind.", {n: wire[n] for n in _names(PeerCounts)})
        ingress, queue = self._ingress.counts, self._ingress.queue
        came = {
            "datagrams": ingress.datagrams, "stream_packets": ingress.stream_packets, "replies": ingress.replies,
            "unsent": ingress.unsent, "faults": ingress.faults, "streams_refused": ingress.streams_refused,
            "streams_broken": ingress.streams_broken, "flooded": queue.flooded, "crowded": queue.crowded,
        }  # fmt: skip
        yield _labelled("intake", "What came in and what was refused, by kind.", came)
        yield _labelled("texts", "Texts that senders wanted spoken, by what became of them.", asdict(self._texts))
        hearing = asdict(self._hearing)
        yield GaugeMetricFamily("fapengine_ears", "Processes that hear sound.", value=hearing.pop("ears"))
        yield _labelled("sound", "Sound that ears were given, s, and its phones, by what became of it.", hearing)
        yield GaugeMetricFamily("fapengine_streams", "Open TCP connections.", value=ingress.streams)
        yield GaugeMetricFamily("fapengine_packets_waiting", "Packets not yet understood.", value=len(queue))
        yield from self._connections()
        if self.page is not None:
            page = asdict(self.page)
            yield GaugeMetricFamily("fapengine_pages", "Pages that are connected.", value=page.pop("pages"))
            yield _labelled("page", "What pages did and met with, by kind.", page)
        if self.calls is not None:
            calls = asdict(self.calls)
            gauge = GaugeMetricFamily("fapengine_calls", "Open calls by WebRTC, by what they do.", labels=["kind"])
            for kind in ("watching", "speaking"):
                gauge.add_metric([kind], calls.pop(kind))
            yield gauge
            yield _labelled("call", "What became of calls, and of what was sent over them, by kind.", calls)
        if self.films is not None:
            yield _labelled("pictures", "Pictures for calls, cameras and streams, by kind.", asdict(self.films))
        yield from self._sent()

    def _sessions(self) -> Iterator[Metric]:
        engine = self._hub.engine
        states: list[str] = [engine.state(session) for session in engine.sessions]
        sessions = GaugeMetricFamily("fapengine_sessions", "Open sessions, by what they do.", labels=["state"])
        for state in STATES:
            sessions.add_metric([state], states.count(state))
        yield sessions
        yield _counter("sessions_refused", "Sessions that were refused for want of time.", engine.refused)

    def _connections(self) -> Iterator[Metric]:
        connections = GaugeMetricFamily("fapengine_connections", "Open connections, by port.", labels=["door"])
        lost = CounterMetricFamily(
            "fapengine_connections_lost", "Those refused or hung up on.", labels=["door", "kind"]
        )
        for name, door in self.doors.items():
            connections.add_metric([name], door.counts.open)
            lost.add_metric([name, "refused"], door.counts.refused)
            lost.add_metric([name, "timed_out"], door.counts.timed_out)
        yield connections
        yield lost

    def _sent(self) -> Iterator[Metric]:
        sent = CounterMetricFamily("fapengine_sent", "Datagrams or planes that sinks sent.", labels=["sink"])
        dropped = CounterMetricFamily("fapengine_unsent", "Those that could not be sent.", labels=["sink"])
        for sink in self._sinks:
            sent.add_metric([str(sink.address)], sink.counts.sent)
            dropped.add_metric([str(sink.address)], sink.counts.dropped)
        yield sent
        yield dropped


def _names(counts: type[Counters] | type[PeerCounts]) -> list[str]:
    return [counter.name for counter in fields(counts)]


def _counter(name: str, help_text: str, value: float) -> Metric:
    return CounterMetricFamily(f"fapengine_{name}", help_text, value=value)


def _labelled(name: str, help_text: str, values: Mapping[str, float]) -> Metric:
    family = CounterMetricFamily(f"fapengine_{name}", help_text, labels=["kind"])
    for kind, value in values.items():
        family.add_metric([kind], value)
    return family
