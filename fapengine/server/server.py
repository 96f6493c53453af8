"""The whole server: engine, hub, receiver, listeners, sinks, page and metrics, from start to drain.

Theory of operation
-------------------
One loop. Before each frame the sockets are read and packets understood; the frame goes to sinks and pages; then the
receiver answers. Told to stop, the server takes nothing more in, cancels what is being said, shows the faces coming to
rest, closes the sessions (so that every sink's last frame is at rest), sends what it still owes, and ends.
"""

import asyncio
import logging
import os
import socket
import time
from collections.abc import Callable, Coroutine, Hashable
from dataclasses import dataclass, field
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from aiohttp import web

from fapengine.audio.device import open_output
from fapengine.audio.microphone import Microphone
from fapengine.engine.commands import Cancel
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.host.playback import Playback
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.profiles import Profile
from fapengine.server.config import ServeConfig
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.intake.doors import Door, raise_file_limit, shared_out
from fapengine.server.intake.fair_queue import FairQueue
from fapengine.server.intake.ingress import Ingress
from fapengine.server.intake.listeners import Caller, Stream, TcpListener, UdpListener, bound_pair
from fapengine.server.load import Load
from fapengine.server.metrics import ServerMetrics, TextCounts, of_sessions, of_sinks, open_metrics
from fapengine.server.ownership.rule import OwnSessions
from fapengine.server.sinks.address import Sink
from fapengine.server.sinks.kinds import VideoKind, kind_of, open_sink, parse_sink
from fapengine.server.web.site import Site, open_site
from fapengine.voices.espeak import sample_rate_hz
from fapengine.voices.process import VoiceProcess
from fapengine.wire.speech_osc.codec import encode
from fapengine.wire.speech_osc.counts import TextRequest, WordsRequest
from fapengine.wire.speech_osc.peers import Proof
from fapengine.wire.speech_osc.receiver import OscReceiver
from fapengine.wire.speech_osc.schema import Notice

if TYPE_CHECKING:
    from fapengine.server.calls.calls import Calls

DRAIN_FADE_S, DRAIN_S = 0.2, 0.3
"""Fade of the faces to rest when the server stops, and the time after which it ends."""
QUIET_FADE_S = 0.1
"""Fade where another machine goes on with the sessions: lips rest within 0.3 s, however busy this one is."""
TEXTS_AT_ONCE = 64
"""Texts of all OSC senders that wait for the voice; more are refused. One session may have fewer
(:data:`fapengine.host.speaker.MAX_TEXTS`)."""
MAX_REASON = 300
"""Characters of a message to a sender."""
VOICE_SPARE_S = 0.5
"""Part of an utterance that is not left to the voice: silence before and after it."""

log = logging.getLogger("fapengine.server")


@dataclass(slots=True, eq=False)
class _Parts:
    """The parts of a server that are open.

    Stateful.
    """

    datagrams: UdpListener | None = None
    streams: TcpListener | None = None
    sinks: list[Sink] = field(default_factory=list)
    page: Site | None = None
    sites: list[Site] = field(default_factory=list)
    texts: set[asyncio.Task[None]] = field(default_factory=set)
    speaker: Playback | None = None
    microphone: Microphone | None = None
    calls: "Calls | None" = None


class Server:
    """A live server: made, started and run on one event loop; see the theory of operation.

    Stateful.

    Parameters
    ----------
    config : ServeConfig
    profile : Profile, optional
        Whose way of speaking; by default ``config.face.profile`` is loaded.
    head : FaceMesh, optional
        Whose face the page shows; by default ``config.face.head`` is loaded, if there is a page.
    own : OwnSessions, optional
        The only sessions that may be opened here (:mod:`.cluster.worker`); the page then has no port of its own.
        By default all may.
    clock : callable
        The monotonic clock.

    Raises
    ------
    UsageError
        If there is no such profile or head.
    """

    def __init__(
        self,
        config: ServeConfig,
        profile: Profile | None = None,
        head: FaceMesh | None = None,
        own: OwnSessions | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.config, self._own = config, own
        if profile is None:
            profile = load_profile(config.face.profile)
        if head is None and config.listen.web_port is not None:
            head = load_head(config.face.head)
        rng = np.random.default_rng(config.face.seed)
        engine = Engine(profile, rng=rng, limits=config.limits.engine, style=config.style)
        self.voice = VoiceProcess()
        self.hub = Hub(
            engine,
            rate_hz=config.face.rate_hz,
            clock=clock,
            idle_close_s=config.limits.idle_close_s,
            voice=self.voice,
            most_sound_s=max(config.limits.queued_s - VOICE_SPARE_S, VOICE_SPARE_S),
        )
        self.receiver = OscReceiver(
            self.hub.engine,
            token=config.listen.token,
            engine_limits=config.limits.engine,
            instance=int.from_bytes(os.urandom(4)) >> 1 or 1,
            proof=Proof(os.urandom(32), _is_sure, _host_of),
            elsewhere=own.elsewhere if own else lambda session: None,
        )
        if own is not None:
            engine.may_open = own.has
        queue = FairQueue(packets_a_peer=config.limits.packets_a_peer)
        self.ingress = Ingress(self.receiver, clock=self.hub.clock, wall=time.time, queue=queue)
        self.texts = TextCounts()
        self.load = Load(config.face.rate_hz)
        self.doors = _doors_of(config)
        recognizer = Path(config.sound.recognizer) if config.sound.recognizer else None
        self.hearing = Hearing(self.hub, max_ears=config.limits.ears, model=recognizer)
        self.studio = Studio(self.hub, self.hearing)
        self._parts = _Parts()
        self.metrics = ServerMetrics()
        self.metrics.sources += [
            lambda: of_sessions(self.hub), self.receiver.counts.families, self.ingress.families, self.texts.families,
            self.hearing.counts.families, lambda: of_sinks(self._parts.sinks),
            *(partial(door.counts.families, ("door", name)) for name, door in self.doors.items()),
        ]  # fmt: skip
        if config.calls.on or any(isinstance(kind_of(parse_sink(url)), VideoKind) for url in config.sinks):
            self.metrics.sources.append(self.studio.counts.families)
        self._head = head
        self._draining = False
        self._stop = asyncio.Event()
        self.hub.listeners.on_event(None, self._log_event)

    @property
    def osc_address(self) -> tuple[str, int]:
        """Host and port of OSC, UDP and TCP alike.

        Raises
        ------
        UsageError
            If the server was not started.
        """
        if self._parts.datagrams is None:
            raise UsageError("server: got a question for its address, expected start() before it")
        return self._parts.datagrams.address

    @property
    def sites(self) -> list[tuple[str, int]]:
        """Hosts and ports of the page and of the metrics, those that there are."""
        return [site.address for site in self._parts.sites]

    @property
    def sinks(self) -> list[Sink]:
        """Sinks that are open."""
        return self._parts.sinks

    @property
    def sink_names(self) -> list[str]:
        """Where frames go, as URLs."""
        return [str(sink.address) for sink in self._parts.sinks]

    @property
    def microphone(self) -> Microphone | None:
        """What this machine's microphone is, if it moves a face."""
        return self._parts.microphone

    @property
    def speaker(self) -> Playback | None:
        """What plays a session's voice here, if that is wished for."""
        return self._parts.speaker

    async def start(self) -> None:
        """Open everything.

        Raises
        ------
        ResourceError
            If a port is taken, a host unknown, or a sound device that was named not there; then nothing stays open.
        UsageError
            If a sink cannot be understood.
        """
        try:
            await self._open()
        except FapEngineError:
            await self._close()
            raise

    async def run(self) -> None:
        """Show faces until :meth:`stop`; then drain and close."""
        ticking = asyncio.create_task(self._tick_on())
        stopping = asyncio.create_task(self._stop.wait())
        try:
            await asyncio.wait({ticking, stopping}, return_when=asyncio.FIRST_COMPLETED)
            if not ticking.done():
                await self._drain()
        finally:
            stopping.cancel()
            self.hub.stop()
            await asyncio.wait({ticking})
            if ticking.exception() is None:
                self._say_goodbye()
            await self._close()
        ticking.result()

    async def adopt(self, accepted: socket.socket, *, is_page: bool) -> None:
        """Take a connection to the page, or of OSC, that was accepted elsewhere."""
        taker = self._parts.page if is_page else self._parts.streams
        if taker is None or self._draining:
            accepted.close()
        else:
            await taker.adopt(accepted)

    def stop(self, *, is_quiet: bool = False) -> None:
        """Let :meth:`run` end; again changes nothing.

        Parameters
        ----------
        is_quiet : bool
            True if no goodbye is sent, so that senders go on at the server that has their sessions next.
        """
        self.ingress.is_mute |= is_quiet
        self._stop.set()

    async def _open(self) -> None:
        listen, sound, parts = self.config.listen, self.config.sound, self._parts
        streams, datagrams = bound_pair(listen.host, listen.port)
        parts.streams = await TcpListener.open(self.ingress, streams, self.doors["osc"])
        parts.datagrams = UdpListener(self.ingress, datagrams)
        for url in self.config.sinks:
            epochs = self._own.epochs if self._own else None
            parts.sinks.append(await open_sink(self.hub, parse_sink(url), epochs, self.studio, self.config.face.head))
        if sound.session is not None:
            parts.speaker = Playback(
                self.hub, sound.session, opens=lambda rate_hz: open_output(rate_hz, device=sound.device)
            )
            parts.speaker.open(sample_rate_hz())
        if self.hearing.model is not None:
            from fapengine.recognition.choice import check_recognizer

            check_recognizer(self.hearing.model)
        if sound.microphone is not None:
            parts.microphone = Microphone(sound.microphone)
            self.hub.hold(sound.listens)
        if listen.web_port is not None and self._head is not None:
            from fapengine.server.web.app import COUNTS, make_app  # the page's files are read then

            app = make_app(
                self.hub,
                self._head,
                token=listen.token,
                profile=self.config.face.profile,
                heard_here=sound.session,
                voice=self.config.voice,
                hearing=self.hearing,
                origins=listen.origins,
            )
            self.metrics.sources.append(app[COUNTS].families)
            if self.config.calls.on:
                parts.calls = self._open_calls(app)
            web_port = None if self._own else listen.web_port
            parts.page = await open_site(app, listen.host, web_port, self.doors["page"])
            parts.sites.append(parts.page)
        if (site := await open_metrics(self._metrics_text, listen, self.doors["metrics"])) is not None:
            parts.sites.append(site)

    def _open_calls(self, app: web.Application) -> "Calls":
        from fapengine.server.calls.calls import Calls, add_calls

        chosen, face, listen = self.config.calls, self.config.face, self.config.listen
        form = FilmForm(face.head, (chosen.size, chosen.size), min(chosen.rate_hz, face.rate_hz))
        calls = Calls(self.hub, self.studio, self.hearing, form=form, most=chosen.most, host=chosen.host)
        add_calls(app, calls, listen.token, listen.origins)
        self.metrics.sources.append(calls.counts.families)
        return calls

    async def _tick_on(self) -> None:
        before, after, observe = self.ingress.before_frame, self._after, self.metrics.tick_s.observe
        load, engine = self.load, self.hub.engine
        engine.room = load.room
        clock, late = self.hub.clock, self.metrics.late_s.observe
        speaker, begun_s = self._parts.speaker, 0.0

        def begin(now_s: float, due_s: float) -> None:
            nonlocal begun_s
            begun_s = now_s
            late(max(0.0, now_s - due_s))
            before(now_s)
            self._hear(now_s)
            if speaker is not None:
                speaker.follow(clock())

        def end(now_s: float) -> None:
            after(now_s)
            observe(clock() - begun_s)
            was_full = load.is_full
            if load.add(time.thread_time(), now_s):
                engine.room = load.room
            if load.is_full and not was_full:
                log.warning(
                    "no time for more faces: %d take %.0f %% of it", len(engine.sessions), 100 * load.share,
                )  # fmt: skip

        await self.hub.run(begin, end)

    def _after(self, now_s: float) -> None:
        self.ingress.after_frame(now_s)
        for request in self.receiver.texts():
            if self._draining or len(self._parts.texts) >= TEXTS_AT_ONCE:
                self.texts.refused += 1
                log.warning("a text was not spoken: too many wait", extra={"session": request.session})
                self._answer_text(request, "text: too many wait for the voice")
                continue
            self._run(self._speak(request))
        for words in self.receiver.words():
            if not self._draining:
                self._run(self._say_words(words))

    def _run(self, speaking: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(speaking)
        self._parts.texts.add(task)
        task.add_done_callback(self._parts.texts.discard)

    def _hear(self, now_s: float) -> None:
        for request in self.receiver.sounds(now_s):
            try:
                self.hearing.hear(
                    request.session, request.utterance, request.samples, request.rate_hz,
                    first_s=request.first_s, is_placed=request.is_placed, is_last=request.is_last,
                )  # fmt: skip
            except ResourceError as error:
                log.warning("sound is not heard: %s", error, extra={"session": request.session})
                self.receiver.refuse_sound(request, "ears", now_s)
        self._listen()
        self.hearing.tick(now_s)

    def _listen(self) -> None:
        microphone, session = self._parts.microphone, self.config.sound.listens
        if microphone is None or self._draining:
            return
        samples = microphone.take()
        if not len(samples):
            return
        try:
            self.hearing.listen(session, samples, microphone.rate_hz, source=microphone)
        except ResourceError as error:
            log.error("the microphone is not heard any more: %s", error, extra={"session": session})
            microphone.close()
            self._parts.microphone = None

    async def _speak(self, request: TextRequest) -> None:
        voice = self.config.voice
        try:
            said = await self.hub.speak(
                request.session,
                request.text,
                voice=request.voice or voice.name,
                rate_wpm=voice.rate_wpm,
                ssml=voice.ssml,
            )
        except FapEngineError as error:
            self.texts.refused += 1
            log.warning("a text was not spoken: %s", error, extra={"session": request.session})
            self._answer_text(request, str(error))
        else:
            self.texts.spoken += said is not None

    async def _say_words(self, request: WordsRequest) -> None:
        try:
            await self.hub.say_words(
                request.session,
                request.words,
                voice=request.voice or self.config.voice.name,
                utterance=request.utterance,
                is_last=request.is_last,
                duration_s=request.duration_s,
            )
        except FapEngineError as error:
            log.warning("words were not said: %s", error, extra={"session": request.session})
            self._answer_text(request, str(error))

    def _answer_text(self, request: TextRequest | WordsRequest, reason: str) -> None:
        notice = Notice(
            request.session, -1, "error", engine_us=round(self.hub.clock() * 1e6), reason=reason[:MAX_REASON]
        )
        self.ingress.answer(request.peer, encode(notice))

    async def _drain(self) -> None:
        self._draining = True
        self.voice.close()
        self.ingress.close()
        sessions = len(self.hub.engine.sessions)
        log.info("stopping; faces come to rest: %d", sessions, extra={"sessions": sessions})
        fade_s = QUIET_FADE_S if self.ingress.is_mute else DRAIN_FADE_S
        for session in self.hub.engine.sessions:
            self.hub.apply(session, Cancel(fade_s=fade_s))
        await asyncio.sleep(DRAIN_S)

    def _say_goodbye(self) -> None:
        """Close every session; the frame after that tells every sink to rest, and every sender that it is over."""
        now_s = self.hub.clock()
        self.hub.release_all()
        for session in self.hub.engine.sessions:
            self.hub.engine.close(session, now_s)
        self.hub.tick(now_s)
        self.ingress.after_frame(now_s)

    async def _close(self) -> None:
        parts = self._parts
        for task in tuple(parts.texts):
            task.cancel()
        if parts.calls is not None:
            await parts.calls.close()
        self.hearing.close()
        if parts.microphone is not None:
            parts.microphone.close()
            parts.microphone = None
        self.voice.close()
        await self.voice.wait_closed()
        if parts.speaker is not None:
            parts.speaker.close()
        for site in parts.sites:
            await site.close()
        for sink in parts.sinks:
            await sink.close()
        await self.studio.close()
        if parts.datagrams is not None:
            parts.datagrams.close()
        if parts.streams is not None:
            await parts.streams.close()
        self._parts.sites.clear()
        self._parts.sinks.clear()
        parts.datagrams = parts.streams = parts.speaker = parts.page = parts.calls = None

    async def _metrics_text(self) -> bytes:
        return self.metrics.text()

    def _log_event(self, event: Event) -> None:
        level = logging.WARNING if event.kind == "error" else logging.DEBUG
        if log.isEnabledFor(level):
            details: dict[str, Any] = {"session": event.session, "utterance": event.utterance, "kind": event.kind}
            log.log(level, "%s: utterance %d %s", event.session, event.utterance, event.kind, extra=details)


def _is_sure(peer: Hashable) -> bool:
    """Whether a peer is where it says: a connection is, and so is who speaks from this machine."""
    return isinstance(peer, Stream) or (isinstance(peer, Caller) and ip_address(peer.address[0]).is_loopback)


def _host_of(peer: Hashable) -> str:
    return peer.address[0] if isinstance(peer, Caller) else getattr(peer, "host", "")


def _doors_of(config: ServeConfig) -> dict[str, Door]:
    """Give each port its share of what this process may open."""
    limits = config.limits
    most = {"osc": limits.streams, "page": limits.connections, "metrics": limits.connections}
    shares = shared_out(list(most.values()), raise_file_limit())
    return {
        name: Door(share, min(share, limits.connections_an_address)) for name, share in zip(most, shares, strict=True)
    }


def _tell_loop_trouble(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log in a line, which is not repeated each time, that no connection can be taken; all else as ever."""
    if "socket.accept()" in str(context.get("message")):
        log.error("no connection can be taken: %s", context.get("exception"))
    else:
        loop.default_exception_handler(context)


async def serve(server: Server, ready: Callable[[], None] | None = None) -> None:
    """Start, run until stopped, and close.

    Parameters
    ----------
    server : Server
    ready : callable, optional
        Called when everything is open.
    """
    loop = asyncio.get_running_loop()
    if loop.get_exception_handler() is None:
        loop.set_exception_handler(_tell_loop_trouble)
    await server.start()
    if ready is not None:
        ready()
    await server.run()
