"""Metrics keep their names: dashboards of others are made of them."""

from dataclasses import replace

from fapengine.server.calls.calls import CallCounts
from fapengine.server.config import ServerConfig
from fapengine.server.film.film import FilmCounts
from fapengine.server.metrics import ServerMetrics
from fapengine.server.server import Server
from fapengine.server.sinks.kinds import SinkCounts
from fapengine.server.web.connection import WebCounts

NAMES = """\
call kind begun dropped lost refused unheard
calls kind speaking watching
connections door metrics osc page
connections_lost door,kind metrics,refused metrics,timed_out osc,refused osc,timed_out page,refused page,timed_out
recognizers
faulted
frames
idle_closed
intake kind crowded datagrams faults flooded replies stream_packets streams_broken streams_refused unsent
late_seconds
listeners_dropped
misdirected
packets_waiting
page kind bad_messages connected frames_dropped lost messages refused too_fast unheard
pages
pictures kind drawn faults left_out restarts
sent sink osc://[::1]:9
sessions state idle paused speaking waiting
sessions_refused
skipped
sound kind ended heard_s phones reduced_s refused_s skipped_s
speech kind cancelled concealed dropped finished ignored jumps late lost refused revised underruns unended unknown \
utterances
streams
texts kind refused spoken
tick_seconds
tokens kind delayed wrong
unheard
unsent sink osc://[::1]:9
wire kind bytes checksums clamped clock_steps lost malformed messages moved odd_times packets refused repeated resets \
sound_lost surplus unknown unproved
"""
"""Name without ``fapengine_``, its labels, and their values."""


def names_of(metrics: ServerMetrics) -> list[str]:
    rows = []
    for family in metrics._registry.collect():
        samples = [sample.labels for sample in family.samples if "le" not in sample.labels]
        values = sorted({",".join(labels.values()) for labels in samples})
        rows.append(" ".join([family.name.removeprefix("fapengine_"), ",".join(samples[0]), *values]).rstrip())
    return sorted(rows)


def test_names_and_labels_stay() -> None:
    config = ServerConfig()
    metrics = Server(replace(config, listen=replace(config.listen, web_port=None))).metrics
    assert "sent" in names_of_families(metrics)  # also where there is no sink
    for counts in (WebCounts(), CallCounts(), FilmCounts()):
        metrics.sources.append(counts.families)
    metrics.sources.append(lambda: SinkCounts(3, 4).families(("sink", "osc://[::1]:9")))
    assert names_of(metrics) == sorted(NAMES.splitlines())
    text = metrics.text().decode()
    assert 'fapengine_sent_total{sink="osc://[::1]:9"} 3.0' in text
    assert 'fapengine_unsent_total{sink="osc://[::1]:9"} 4.0' in text
    assert "# TYPE fapengine_streams gauge" in text


def names_of_families(metrics: ServerMetrics) -> list[str]:
    return [family.name.removeprefix("fapengine_") for family in metrics._registry.collect()]
