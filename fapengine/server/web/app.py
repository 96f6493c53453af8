"""The web application: page, head, shaders, audio, and the WebSocket."""

import asyncio
import gzip
import io
import json
import logging
import wave
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import PurePosixPath

from aiohttp import WSCloseCode, web

from fapengine import _resources
from fapengine.errors import ResourceError, UsageError
from fapengine.files.provenance import mark
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.mesh.default_head.style import PEOPLE
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.server.intake.rates import Turns
from fapengine.server.web.access import Access
from fapengine.server.web.connection import Connection, WebCounts
from fapengine.server.web.messages import MAX_MESSAGE, PROTOCOL, text_of
from fapengine.server.web.page_files import Heads, head_binary, setup
from fapengine.server.web.session_view import SessionView, open_session_view
from fapengine.server.web.site import asked_session, harden, own_sessions
from fapengine.speaking import DEFAULT_RATE_WPM
from fapengine.voices import espeak
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech

MAX_BYTES = 64 << 20
"""Total size of the kept audio, at two bytes per sample."""
DEFAULT_CHOICE = VoiceChoice()
MAX_PAGES = 256
HEARTBEAT_S = 20.0
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
NOT_FOR_ALL = ("/head.bin", "/setup.json")
"""Files that need permission, because the face may be private."""

log = logging.getLogger("fapengine.web")
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(slots=True)
class SoundCache:
    """A cache of spoken audio; the oldest is dropped first. Stateful."""

    most_bytes: int = MAX_BYTES
    _kept: OrderedDict[tuple[str, int], Speech] = field(default_factory=OrderedDict)

    def put(self, session: str, utterance: int, speech: Speech) -> None:
        """Add the audio of an utterance."""
        self._kept.pop((session, utterance), None)
        self._kept[session, utterance] = speech
        while len(self._kept) > 1 and sum(kept.samples.nbytes for kept in self._kept.values()) > self.most_bytes:
            self._kept.popitem(last=False)

    def wav(self, session: str, utterance: int) -> bytes | None:
        """Return the audio of an utterance as a WAV file; None if it is not in the cache."""
        speech = self._kept.get((session, utterance))
        if speech is None:
            return None
        buffer = io.BytesIO()
        with wave.open(buffer, "wb") as file:
            file.setparams((1, 2, speech.sample_rate_hz, 0, "NONE", ""))
            file.writeframes(speech.samples.astype("<i2").tobytes())
        return buffer.getvalue()


@dataclass(slots=True, eq=False)
class _Handlers:
    """The request handlers and their state. Stateful."""

    hub: Hub
    access: Access
    hello: dict[str, object]
    heard_here: str | None
    voice: VoiceChoice
    hearing: Hearing | None
    counts: WebCounts = field(default_factory=WebCounts)
    sounds: SoundCache = field(default_factory=SoundCache)
    views: dict[str, SessionView] = field(default_factory=dict)
    connections: set[Connection] = field(default_factory=set)
    heads: Heads = field(default_factory=Heads)
    turns: Turns = field(default_factory=Turns)
    """Of the messages of all pages."""

    async def socket(self, request: web.Request) -> web.StreamResponse:
        """``/ws?session=NAME``: the WebSocket of a page."""
        self.admit(request)
        session = asked_session(request)
        if self.counts.pages >= MAX_PAGES:
            self.counts.refused += 1
            raise web.HTTPBadRequest(text=f"pages: got one more than {MAX_PAGES}")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=4 * MAX_MESSAGE, compress=False)
        if not socket.can_prepare(request).ok:
            # the page asks this way why it was refused
            raise web.HTTPUpgradeRequired(text="This address serves WebSocket.")
        await socket.prepare(request)
        try:  # only now, so that a request that failed earlier leaves no open view
            view = open_session_view(self.hub, session, self.views, server_plays_audio=session == self.heard_here)
        except UsageError as error:
            self.counts.refused += 1
            await socket.send_str(text_of("error", message=str(error)))
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"no room")
            return socket
        connection = Connection(self.hub, view, socket, self.counts, self.voice, self.turns, self.hearing)
        self.connections.add(connection)
        try:
            sound = "server" if view.server_plays_audio else "page"
            state = {"sound": sound, "paused": view.is_paused, "manner": view.manner}
            await connection.run(text_of("hello", session=session, **state, **self.hello))
        finally:
            self.connections.discard(connection)
            if not len(view) and self.views.get(session) is view:
                del self.views[session]
        return socket

    async def sound(self, request: web.Request) -> web.StreamResponse:
        """``/sound.wav?session=NAME&utterance=N``: the audio of an utterance."""
        self.admit(request)
        session = asked_session(request)
        number = request.query.get("utterance", "")
        wav = self.sounds.wav(session, int(number)) if number.isdecimal() and len(number) < 12 else None
        if wav is None:
            raise web.HTTPNotFound(text="This audio is not, or no longer, available.")
        return web.Response(body=wav, content_type="audio/wav")

    async def head(self, own: Handler, request: web.Request) -> web.StreamResponse:
        """``/head.bin``: the server's head, or with ``?name=woman`` another built-in head, built on demand."""
        name = request.query.get("name", "")
        if not name:
            return await own(request)
        self.admit(request)
        if name not in PEOPLE:
            raise web.HTTPNotFound(text=f"name: got {name!r:.60}, expected one of {', '.join(PEOPLE)}")
        try:
            packed = await self.heads.packed(name)
        except ResourceError as error:
            raise web.HTTPServiceUnavailable(text=str(error)) from error
        body = packed if _accepts_gzip(request) else await asyncio.to_thread(gzip.decompress, packed)
        return await self.file("application/octet-stream", body, packed, request)

    async def file(self, kind: str, body: bytes, packed: bytes, request: web.Request) -> web.StreamResponse:
        """Send a file of the page, compressed if the client accepts that."""
        if request.path in NOT_FOR_ALL:
            self.admit(request)
        headers = {"Content-Encoding": "gzip"} if _accepts_gzip(request) else {}
        content = packed if headers else body
        charset = "utf-8" if kind.startswith(("text/", "application/json", "image/svg")) else None
        return web.Response(body=content, content_type=kind, charset=charset, headers=headers)

    def admit(self, request: web.Request) -> None:
        """Refuse a request that is not allowed."""
        self.access.admit(request, self.counts)

    async def stop(self, app: web.Application) -> None:
        """Close the connections of all pages."""
        self.heads.close()
        for connection in tuple(self.connections):
            await connection.close()


COUNTS: web.AppKey[WebCounts] = web.AppKey("counts", WebCounts)
"""Key of the application's counters."""
HANDLERS: web.AppKey[_Handlers] = web.AppKey("handlers", _Handlers)


def make_app(
    hub: Hub,
    head: FaceMesh,
    *,
    access: Access | None = None,
    profile: str = "",
    heard_here: str | None = None,
    voice: VoiceChoice = DEFAULT_CHOICE,
    hearing: Hearing | None = None,
) -> web.Application:
    """Build the web application. The caller ticks the hub.

    Raises UsageError if the head has more channels than the shaders have room for.

    Parameters
    ----------
    hub : Hub
        Sessions, frames and voice.
    head : FaceMesh
        Head that the pages show.
    access : Access, optional
        Who may send requests; by default all pages of this server.
    profile : str
        Name of the speaker profile, which the page shows.
    heard_here : str, optional
        Session whose audio the server plays; its pages play none.
    voice : VoiceChoice
        Voice of texts that pages send without a voice.
    hearing : Hearing, optional
        Recognizes the microphones of pages; the caller ticks it too. By default pages offer no microphone.

    Returns
    -------
    Application
        ``app[COUNTS]`` has its counters.
    """
    try:
        voices = espeak.voices()
    except ResourceError:
        voices = {}
    hello = {
        "protocol": PROTOCOL, "rate_hz": hub.pacer.rate_hz, "profile": profile, "voice": bool(voices),
        "recognizer": hearing is not None and hearing.is_possible, **mark(),
    }  # fmt: skip
    access = access or Access()
    handlers = _Handlers(hub, access, hello, heard_here, voice, hearing)
    hub.listeners.on_speech(
        None, lambda spoken: handlers.sounds.put(spoken.session, spoken.utterance, spoken.speech), plays=False
    )
    app = web.Application(middlewares=[own_sessions(hub, handlers.counts)])
    harden(app, access.origins)
    app[HANDLERS], app[COUNTS] = handlers, handlers.counts
    app.on_shutdown.append(handlers.stop)
    app.router.add_get("/ws", handlers.socket)
    app.router.add_get("/sound.wav", handlers.sound)
    for path, (kind, body) in page_files(head, voices, voice.rate_wpm).items():
        handler = partial(handlers.file, kind, body, gzip.compress(body, 6, mtime=0))
        app.router.add_get(path, partial(handlers.head, handler) if path == "/head.bin" else handler)
    return app


def page_files(
    head: FaceMesh, voices: dict[str, str], rate_wpm: int = DEFAULT_RATE_WPM
) -> dict[str, tuple[str, bytes]]:
    """Return the path, media type and content of all static files."""
    pages = {
        "/head.bin": ("application/octet-stream", head_binary(head)),
        "/setup.json": (
            "application/json",
            json.dumps(setup(voices=voices, rate_wpm=rate_wpm), ensure_ascii=False).encode(),
        ),
    }
    for name, content in _resources.page_files().items():
        suffix = PurePosixPath(name).suffix
        if suffix in KINDS:
            pages["/" if name == "index.html" else f"/{name}"] = (KINDS[suffix], content)
    return pages


def _accepts_gzip(request: web.Request) -> bool:
    return "gzip" in request.headers.get("Accept-Encoding", "")
