"""The only file of the snapshots that imports inner modules: whoever moves a package adapts this one."""

import asyncio
import urllib.request
from collections.abc import Callable, Coroutine, Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine import Style, load_profile
from fapengine.engine.engine import Engine
from fapengine.host.hub import Hub
from fapengine.server.cluster.workers import Workers
from fapengine.server.config import BusChoice, CallChoice, Listen, ServerConfig
from fapengine.server.intake.rates import Turns
from fapengine.server.server import Server
from fapengine.server.web.connection import Connection, WebCounts
from fapengine.server.web.session_view import SessionView, open_session_view
from fapengine.voices.choice import VoiceChoice
from fapengine.wire.speech_osc.peers import WordsRequest
from fapengine.wire.speech_osc.receiver import OscReceiver
from tests.serve_example import EXAMPLE

WALL_S = 1_790_000_000.0
"""Time of the wall clock when the engine's is 0."""


def config_example() -> str:
    """Every key of ``serve.toml``, as the documentation shows it."""
    return EXAMPLE


def metric_names() -> str:
    """Names, labels and help of all metrics: of a server with a page, calls and a sink, and of a parent of workers."""
    listen = Listen(port=0, web_port=0, metrics_port=0)
    server = Server(ServerConfig(listen=listen, calls=CallChoice(on=True), sinks=("osc://127.0.0.1:9",)))
    config = ServerConfig(listen=Listen(port=0, web_port=None, workers=2), bus=BusChoice(url="nats://127.0.0.1:9"))
    text = asyncio.run(_metrics(server)) + "# of a parent of workers\n" + asyncio.run(_parent_metrics(config))
    shown = [line if line.startswith("#") else line.rpartition(" ")[0] for line in text.splitlines()]
    kept = [line for line in shown if "_created" not in line and "_bucket" not in line]
    return "\n".join(in_order(kept)) + "\n"


def in_order(lines: Sequence[str]) -> list[str]:
    """Sort the families, each of which begins with ``# HELP`` or a remark: their order means nothing."""
    starts = [n for n, line in enumerate(lines) if line.startswith(("# HELP", "# of"))]
    blocks = [lines[start:stop] for start, stop in zip(starts, [*starts[1:], len(lines)], strict=True)]
    parent = blocks.index([line for line in lines if line.startswith("# of")])
    return [line for part in (blocks[:parent], blocks[parent:]) for block in sorted(part) for line in block]


async def _parent_metrics(config: ServerConfig) -> str:
    return (await Workers(config).metrics()).decode()


async def _metrics(server: Server) -> str:
    await server.start()
    running = asyncio.create_task(server.run())
    try:
        host, port = server.sites[-1]
        with await asyncio.to_thread(urllib.request.urlopen, f"http://{host}:{port}/metrics", timeout=300) as answer:
            text: str = answer.read().decode()
        return text
    finally:
        server.stop(is_quiet=True)
        await running


class LiveServer:
    """A server without sockets, on a clock that the caller turns. Stateful.

    Parameters
    ----------
    clock : callable
        Seconds; the engine's time.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1), style=Style())
        self._clock = clock
        self._hub = Hub(engine, clock=clock, idle_close_s=10.0)
        self._receiver = OscReceiver(self._hub.engine, instance=11)
        self._views: dict[str, SessionView] = {}
        self._texts: set[asyncio.Task[object]] = set()

    def datagram(self, data: bytes, peer: str) -> list[tuple[Hashable, bytes]]:
        """Take a datagram of a peer; give what is answered, and to whom."""
        return self._receiver.receive(data, peer, self._clock(), WALL_S + self._clock())

    async def page(self, socket: object, session: str) -> None:
        """Serve a page until its socket ends: ``async for`` gives its messages, and it is written to."""
        view = open_session_view(self._hub, session, self._views)
        await Connection(self._hub, view, socket, WebCounts(), VoiceChoice(), Turns(lambda: 0.0)).run("hello")  # type: ignore[arg-type]

    def tick(self) -> tuple[dict[str, NDArray[np.int32]], list[tuple[Hashable, bytes]]]:
        """Make the next frame of every session, and give what peers are told unasked."""
        now_s = self._clock()
        frames = self._hub.tick(now_s)
        replies = self._receiver.tick(now_s)
        for text in self._receiver.texts():
            self._run(self._hub.speak(text.session, text.text, voice=text.voice or "en-us"))
        for words in self._receiver.words():
            self._run(self._say_words(words))
        return dict(zip(frames.sessions, frames.faps, strict=True)), replies

    async def _say_words(self, words: WordsRequest) -> None:
        await self._hub.say_words(
            words.session, words.words, voice=words.voice or "en-us", utterance=words.utterance,
            is_last=words.is_last, duration_s=words.duration_s,
        )  # fmt: skip

    def _run(self, speaking: Coroutine[object, object, object]) -> None:
        task = asyncio.ensure_future(speaking)
        self._texts.add(task)
        task.add_done_callback(self._texts.discard)
