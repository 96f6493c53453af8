"""The whole server: engine, hub, receiver, listeners, sinks, web page and metrics, from start to shutdown.

Theory of operation
-------------------
One event loop. Before each frame the sockets are read and packets decoded; the frame goes to sinks and pages; then the
receiver answers. When stopped, the server accepts nothing more, cancels the current speech, shows the faces returning
to neutral, closes the sessions (so that every sink's last frame is neutral), sends the last acknowledgements, and ends.
"""

import asyncio
import logging
import os
import socket
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from functools import partial
from ipaddress import ip_address
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fapengine._strict_toml import checked
from fapengine.audio.device import Microphone, open_output
from fapengine.engine.commands import Cancel
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.files.heads.load import load_head
from fapengine.files.profiles import load_profile
from fapengine.files.provenance import provenance
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.host.playback import Playback
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.profiles import Profile
from fapengine.server.config import ServerConfig
from fapengine.server.film.film import FilmForm, Studio
from fapengine.server.intake.doors import open_doors, raise_file_limit
from fapengine.server.intake.ingress import FairQueue, Ingress
from fapengine.server.intake.listeners import Stream, TcpListener, UdpListener, bound_pair
from fapengine.server.intake.rates import Load
from fapengine.server.intake.tasks import Tasks
from fapengine.server.metrics import ServerMetrics, TextCounts, of_sessions, of_sinks, open_metrics
from fapengine.server.ownership import OwnSessions
from fapengine.server.sinks.kinds import Sink, kind_of, parse_sink
from fapengine.server.sinks.opening import open_sink
from fapengine.server.web.access import Access
from fapengine.server.web.site import Site, open_site
from fapengine.voices.espeak import sample_rate_hz
from fapengine.voices.process import VoiceProcess
from fapengine.wire.speech_osc.codec import encode
from fapengine.wire.speech_osc.peers import Proof, TextRequest, WordsRequest
from fapengine.wire.speech_osc.receiver import OscReceiver
from fapengine.wire.speech_osc.schema import Notice

if TYPE_CHECKING:
    from fapengine.server.calls.calls import Calls

DRAIN_FADE_S, DRAIN_S = 0.2, 0.3
"""Fade of the faces to neutral when the server stops, and the time after which it ends."""
QUIET_FADE_S = 0.1
"""Fade if another machine takes over the sessions: lips are neutral within 0.3 s, however busy this machine is."""
TEXTS_AT_ONCE = 64
"""Texts of all OSC senders that wait for the voice; further ones are refused. The limit of one session is
:data:`fapengine.host.speaker.MAX_TEXTS`."""
MAX_REASON = 300
"""Characters of a message to a sender."""
VOICE_SPARE_S = 0.5
"""Part of the longest utterance that is reserved for the silence before and after the voice."""

log = logging.getLogger("fapengine.server")


class Server:
    """A live server. Make, start and run it on one event loop. Stateful.

    Parameters
    ----------
    config : ServerConfig
    profile : Profile, optional
        Speaker profile; by default ``config.face.profile`` is loaded.
    head : FaceMesh, optional
        Head on the web page; by default ``config.face.head`` is loaded, if there is a page.
    own : OwnSessions, optional
        The only sessions that may be opened here (:mod:`.cluster.worker`); the page then has no port of its own.
        By default all sessions may be.
    clock : callable
        Monotonic time in s.

    Raises
    ------
    UsageError
        If the profile or the head does not exist.
    """

    @checked
    def __init__(
        self,
        config: ServerConfig,
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
        self._head, limits = head, config.limits
        self._access = Access(config.listen.token, config.listen.origins, clock, config.listen.proxies)
        rng = np.random.default_rng(config.face.seed)
        engine = Engine(profile, rng=rng, limits=limits.engine, style=config.style)
        self.voice = VoiceProcess()
        self.hub = Hub(
            engine, rate_hz=config.face.rate_hz, clock=clock, idle_close_s=limits.idle_close_s, voice=self.voice,
            most_sound_s=max(limits.queued_s - VOICE_SPARE_S, VOICE_SPARE_S),
        )  # fmt: skip
        self.receiver = OscReceiver(
            engine, token=config.listen.token, engine_limits=limits.engine,
            instance=int.from_bytes(os.urandom(4)) >> 1 or 1,
            proof=Proof(os.urandom(32), _is_sure, attrgetter("host")),
            elsewhere=own.elsewhere if own else lambda session: None,
        )  # fmt: skip
        if own is not None:
            engine.may_open = own.has
        queue = FairQueue(packets_a_peer=limits.packets_per_sender)
        self.ingress = Ingress(self.receiver, clock=clock, wall=time.time, queue=queue)
        self.texts = TextCounts()
        self.load = Load(config.face.rate_hz)
        most = {"osc": limits.streams, "page": limits.connections, "metrics": limits.connections}
        self.doors = open_doors(most, limits.connections_per_address, raise_file_limit())
        self.doors["page"].proxies = self.doors["metrics"].proxies = config.listen.proxies
        recognizer = Path(config.sound.recognizer) if config.sound.recognizer else None
        self.hearing = Hearing(self.hub, max_recognizers=limits.recognizers, model=recognizer)
        self.studio = Studio(self.hub, self.hearing)
        self.sinks: list[Sink] = []
        """Open sinks."""
        self.speaker: Playback | None = None
        """Plays a session's voice here, if configured."""
        self.microphone: Microphone | None = None
        """Drives a face, if configured."""
        self.calls: Calls | None = None
        self.metrics = ServerMetrics()
        self.metrics.sources += [
            lambda: of_sessions(self.hub), self.receiver.counts.families, self.ingress.families, self.texts.families,
            self._access.counts.families,
            self.hearing.counts.families, lambda: of_sinks(self.sinks),
            *(partial(door.counts.families, ("door", name)) for name, door in self.doors.items()),
        ]  # fmt: skip
        if config.calls.on or any(kind_of(parse_sink(url)).medium == "video" for url in config.sinks):
            self.metrics.sources.append(self.studio.counts.families)
        self._datagrams: UdpListener | None = None
        self._streams: TcpListener | None = None
        self._page: Site | None = None
        self._sites: list[Site] = []
        self._speaking = Tasks()
        self._opened = AsyncExitStack()
        self._draining = False
        self._stop = asyncio.Event()
        self._frame_begun_s = 0.0
        self.hub.listeners.on_event(None, self._log_event)

    @property
    def osc_address(self) -> tuple[str, int]:
        """Host and port of OSC, UDP and TCP alike.

        Raises
        ------
        UsageError
            If the server was not started.
        """
        if self._datagrams is None:
            raise UsageError("server: got a request for its address, expected start() before it")
        return self._datagrams.address

    @property
    def sites(self) -> list[tuple[str, int]]:
        """Hosts and ports of the web page and of the metrics, as far as they are configured."""
        return [site.address for site in self._sites]

    @property
    def sink_names(self) -> list[str]:
        """URLs of the open sinks."""
        return [str(sink.address) for sink in self.sinks]

    async def start(self) -> None:
        """Open everything.

        Raises
        ------
        ResourceError
            If a port is in use, a host unknown, or a named audio device missing; then nothing stays open.
        UsageError
            If a sink's URL is not valid.
        """
        try:
            with provenance(self.config.listen.provenance):
                await self._open()
        except FapEngineError:
            await self._close()
            raise

    async def run(self) -> None:
        """Show faces until :meth:`stop`; then return them to neutral and close."""
        self.hub.engine.room = self.load.room
        ticking = asyncio.create_task(self.hub.run(self._begin_frame, self._end_frame))
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
                self._close_sessions()
            await self._close()
        ticking.result()

    async def adopt(self, accepted: socket.socket, session: str | None, *, is_page: bool) -> None:
        """Serve a connection to the page, or of OSC, that another process accepted for a session."""
        if is_page and self._page is not None and not self._draining:
            await self._page.adopt(accepted, session)
        elif not is_page and self._streams is not None and not self._draining:
            await self._streams.adopt(accepted)
        else:
            accepted.close()

    def stop(self, *, is_quiet: bool = False) -> None:
        """End :meth:`run`. Further calls do nothing.

        Parameters
        ----------
        is_quiet : bool
            Send nothing more to senders, so that they continue at the server that has their sessions next.
        """
        self.ingress.is_mute |= is_quiet
        self._stop.set()

    async def _open(self) -> None:
        listen, sound, opened = self.config.listen, self.config.sound, self._opened
        streams, datagrams = bound_pair(listen.host, listen.port)
        self._streams = await TcpListener.open(self.ingress, streams, self.doors["osc"])
        opened.push_async_callback(self._streams.close)
        self._datagrams = UdpListener(self.ingress, datagrams)
        opened.callback(self._datagrams.close)
        opened.push_async_callback(self.studio.close)
        opened.callback(self.sinks.clear)
        for url in self.config.sinks:
            epochs = self._own.epochs if self._own else None
            sink = await open_sink(self.hub, parse_sink(url), epochs, self.studio, self.config.face.head)
            self.sinks.append(sink)
            opened.push_async_callback(sink.close)
        opened.push_async_callback(self.voice.wait_closed)
        opened.callback(self.voice.close)
        opened.callback(self.hearing.close)
        opened.callback(self._speaking.cancel)
        if sound.session is not None:
            self.speaker = Playback(
                self.hub, sound.session, opens=lambda rate_hz: open_output(rate_hz, device=sound.device)
            )
            self.speaker.open(sample_rate_hz())
            opened.callback(self.speaker.close)
        if self.hearing.model is not None:
            from fapengine.recognition.choice import check_recognizer

            check_recognizer(self.hearing.model)
        if sound.microphone is not None:
            self.microphone = Microphone(sound.microphone)
            opened.callback(self.microphone.close)
            self.hub.hold(sound.listens)
        opened.callback(self._sites.clear)
        if listen.web_port is not None and self._head is not None:
            await self._open_page(self._head)
        if (site := await open_metrics(self._metrics_text, listen, self.doors["metrics"], self._access)) is not None:
            self._sites.append(site)
            opened.push_async_callback(site.close)

    async def _open_page(self, head: FaceMesh) -> None:
        from fapengine.server.web.app import COUNTS, make_app  # reads the page's files

        listen, face, chosen = self.config.listen, self.config.face, self.config.calls
        app = make_app(
            self.hub, head, access=self._access, profile=face.profile, heard_here=self.config.sound.session,
            voice=self.config.voice, hearing=self.hearing,
        )  # fmt: skip
        self.metrics.sources.append(app[COUNTS].families)
        if chosen.on:
            from fapengine.server.calls.calls import Calls, add_calls

            form = FilmForm(face.head, (chosen.size, chosen.size), min(chosen.rate_hz, face.rate_hz))
            self.calls = Calls(self.hub, self.studio, self.hearing, form=form, most=chosen.max_calls, host=chosen.host)
            add_calls(app, self.calls, self._access)
            self.metrics.sources.append(self.calls.counts.families)
        self._page = await open_site(app, listen.host, None if self._own else listen.web_port, self.doors["page"])
        self._sites.append(self._page)
        self._opened.push_async_callback(self._page.close)
        if self.calls is not None:
            self._opened.push_async_callback(self.calls.close)

    def _begin_frame(self, now_s: float, due_s: float) -> None:
        self._frame_begun_s = now_s
        self.metrics.late_s.observe(max(0.0, now_s - due_s))
        self.ingress.before_frame()
        for request in self.receiver.sounds(now_s):
            try:
                self.hearing.hear(
                    request.session, request.utterance, request.samples, request.rate_hz,
                    first_s=request.first_s, is_placed=request.is_placed, is_last=request.is_last,
                )  # fmt: skip
            except ResourceError as error:
                log.warning("audio is not recognized: %s", error, extra={"session": request.session})
                self.receiver.refuse_sound(request, "recognizers", now_s)
        if self.microphone is not None and not self._draining:
            self._listen(self.microphone)
        self.hearing.tick(now_s)
        if self.speaker is not None:
            self.speaker.follow(self.hub.clock())

    def _end_frame(self, now_s: float) -> None:
        self.ingress.after_frame(now_s)
        requests: list[TextRequest | WordsRequest] = [*self.receiver.texts(), *self.receiver.words()]
        for request in requests:
            is_full = self._draining or len(self._speaking) >= TEXTS_AT_ONCE
            if is_full and isinstance(request, TextRequest):
                self._refuse(request, "text: too many wait for the voice")
            elif not self._draining:
                self._speaking.start(self._speak(request))
        self.metrics.tick_s.observe(self.hub.clock() - self._frame_begun_s)
        load, was_full = self.load, self.load.is_full
        if load.add(time.thread_time(), now_s):
            self.hub.engine.room = load.room
        if load.is_full and not was_full:
            faces = len(self.hub.engine.sessions)
            log.warning("no time for more faces: %d take %.0f %% of it", faces, 100 * load.share)

    def _listen(self, microphone: Microphone) -> None:
        session, samples = self.config.sound.listens, microphone.take()
        if not len(samples):
            return
        try:
            self.hearing.listen(session, samples, microphone.rate_hz, source=microphone)
        except ResourceError as error:
            log.error("the microphone is no longer used: %s", error, extra={"session": session})
            microphone.close()
            self.microphone = None

    async def _speak(self, request: TextRequest | WordsRequest) -> None:
        voice = self.config.voice
        name = request.voice or voice.name
        try:
            if isinstance(request, TextRequest):
                said = await self.hub.speak(
                    request.session, request.text, voice=name, rate_wpm=voice.rate_wpm, ssml=voice.ssml
                )
                self.texts.spoken += said is not None
            else:
                await self.hub.say_words(
                    request.session, request.words, voice=name, utterance=request.utterance, is_last=request.is_last,
                    duration_s=request.duration_s,
                )  # fmt: skip
        except FapEngineError as error:
            self._refuse(request, str(error))

    def _refuse(self, request: TextRequest | WordsRequest, reason: str) -> None:
        """Log why a text or words were not spoken, and notify the sender."""
        self.texts.refused += isinstance(request, TextRequest)
        log.warning("a text was not spoken: %s", reason, extra={"session": request.session})
        now_us = round(self.hub.clock() * 1e6)
        notice = Notice(request.session, -1, "error", engine_us=now_us, reason=reason[:MAX_REASON])
        self.ingress.send([(request.peer, encode(notice))])

    async def _drain(self) -> None:
        self._draining = True
        self.voice.close()
        self.ingress.close()
        sessions = self.hub.engine.sessions
        log.info("stopping; faces return to neutral: %d", len(sessions), extra={"sessions": len(sessions)})
        fade_s = QUIET_FADE_S if self.ingress.is_mute else DRAIN_FADE_S
        for session in sessions:
            self.hub.apply(session, Cancel(fade_s=fade_s))
        await asyncio.sleep(DRAIN_S)

    def _close_sessions(self) -> None:
        """Close every session; the next frame sends a neutral face to every sink, and the end to every sender."""
        now_s = self.hub.clock()
        self.hub.release_all()
        for session in self.hub.engine.sessions:
            self.hub.engine.close(session, now_s)
        self.hub.tick(now_s)
        self.ingress.after_frame(now_s)

    async def _close(self) -> None:
        await self._opened.aclose()
        self._datagrams = self._streams = self._page = None

    async def _metrics_text(self) -> bytes:
        return self.metrics.text()

    def _log_event(self, event: Event) -> None:
        level = logging.WARNING if event.kind in ("error", "remark") else logging.DEBUG
        details: dict[str, Any] = {"session": event.session, "utterance": event.utterance, "kind": event.kind}
        told = f"{event.kind} {event.reason}".strip()
        log.log(level, "%s: utterance %d %s", event.session, event.utterance, told, extra=details)


def _is_sure(peer: Any) -> bool:
    """Return whether a peer's address is proven: a connection's is, and that of a sender on this machine."""
    return isinstance(peer, Stream) or ip_address(peer.host).is_loopback


def _log_loop_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log in one line that a connection cannot be accepted; leave all other errors to the loop."""
    if "socket.accept()" in str(context.get("message")):
        log.error("no connection can be accepted: %s", context.get("exception"))
    else:
        loop.default_exception_handler(context)


class Serves(Protocol):
    """A :class:`Server`, or the parent of workers."""

    async def start(self) -> None:
        """Open everything."""

    async def run(self) -> None:
        """Run until stopped, and close."""


async def serve(server: Serves, ready: Callable[[], None] | None = None) -> None:
    """Start, run until stopped, and close.

    Parameters
    ----------
    server : Server or Workers
    ready : callable, optional
        Called when everything is open.
    """
    loop = asyncio.get_running_loop()
    if loop.get_exception_handler() is None:
        loop.set_exception_handler(_log_loop_error)
    await server.start()
    if ready is not None:
        ready()
    await server.run()
