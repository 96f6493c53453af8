"""One connected page: its requests are read, at a limited rate, and what its view tells it is written, in order."""

import asyncio
import contextlib
import logging
from collections import deque
from dataclasses import dataclass, field

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from fapengine._counters import Counts, metric
from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.server.web.messages import (
    Perform,
    Phones,
    Pin,
    Ping,
    Plays,
    ReleaseAll,
    Request,
    Say,
    Tell,
    Watch,
    Words,
    parse_request,
    parse_sound,
    text_of,
)
from fapengine.server.web.session_view import SessionView
from fapengine.speech.alphabets.convert import ALPHABETS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.voices.choice import VoiceChoice
from fapengine.wire.speech_osc import phone_labels

MAX_TEXTS = 512
MAX_FRAMES = 3
"""Frames that wait; older ones are of no use to anybody."""
MESSAGES_HZ, MESSAGES_AT_ONCE = 120.0, 240.0
"""A slider that is dragged sends one a picture; nothing needs more."""
MAX_REFUSED = 2000
"""A page that sends so much nonsense, or so much too fast, is closed."""
MAX_VOICES = 3
"""Texts of one page that are turned into sound at the same time."""

log = logging.getLogger("fapengine.web")


@dataclass(slots=True)
class SendQueue:
    """A send queue: all texts in order; frames only as long as they are fresh.

    Stateful.
    """

    dropped: int = 0
    """Frames that were never sent."""
    overflowed: bool = False
    """More texts wait than a page can catch up with: it is closed, and must connect again."""
    _texts: deque[str] = field(default_factory=deque)
    _frames: deque[bytes] = field(default_factory=deque)

    def put_text(self, text: str) -> None:
        """Add a text."""
        if len(self._texts) < MAX_TEXTS:
            self._texts.append(text)
        else:
            self.overflowed = True

    def put_frame(self, frame: bytes) -> None:
        """Add a frame; the oldest goes where too many wait."""
        if len(self._frames) == MAX_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(frame)

    def take(self) -> str | bytes | None:
        """Take what is to be sent next: texts first, for they explain the frames."""
        if self._texts:
            return self._texts.popleft()
        return self._frames.popleft() if self._frames else None


@dataclass(slots=True)
class TokenBucket:
    """A token bucket: a rate of messages a second, and a burst.

    Stateful.
    """

    rate_hz: float
    burst: float
    _left: float = field(init=False)
    _since_s: float | None = None

    def __post_init__(self) -> None:
        self._left = self.burst

    def take(self, now_s: float) -> bool:
        """Whether one more is allowed now.

        Examples
        --------
        >>> allowance = TokenBucket(rate_hz=1.0, burst=2)
        >>> [allowance.take(0.0) for _ in range(3)], allowance.take(1.5)
        ([True, True, False], True)
        """
        if self._since_s is not None:
            self._left = min(self.burst, self._left + (now_s - self._since_s) * self.rate_hz)
        self._since_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


@dataclass(slots=True)
class WebCounts(Counts):
    """Counts of all pages together since the start.

    Stateful.
    """

    METRIC = "page", "What pages did and met with, by kind."

    pages: int = metric("pages", "Pages that are connected.", is_gauge=True)
    connected: int = 0
    """Connections since the start."""
    refused: int = 0
    """Connections without token, from elsewhere, or one too many."""
    messages: int = 0
    bad_messages: int = 0
    too_fast: int = 0
    """Messages beyond the allowance."""
    frames_dropped: int = 0
    """Frames that a slow page was not sent."""
    unheard: int = 0
    """Pieces of a microphone's sound that no ear took."""
    lost: int = 0
    """Pages closed because they did not keep up, or sent nothing but nonsense."""


class Connection:
    """One WebSocket.

    Stateful.

    Parameters
    ----------
    hub : Hub
        The server.
    view : SessionView
        What the page watches.
    socket : WebSocketResponse
        Prepared.
    counts : WebCounts
        Shared by all.
    voice : VoiceChoice
        Speaks where the page does not choose.
    hearing : Hearing, optional
        Hears the page's microphone.
    """

    def __init__(
        self,
        hub: Hub,
        view: SessionView,
        socket: web.WebSocketResponse,
        counts: WebCounts,
        voice: VoiceChoice,
        hearing: Hearing | None = None,
    ) -> None:
        self._voice, self._hearing = voice, hearing
        self._told_unheard = ""
        self._hub, self._view, self._socket, self._counts = hub, view, socket, counts
        self._outbox = SendQueue()
        self._waiting = asyncio.Event()
        self._allowance = TokenBucket(MESSAGES_HZ, MESSAGES_AT_ONCE)
        self._refused = 0
        self._voices: set[asyncio.Task[None]] = set()

    def put_text(self, text: str) -> None:
        """Send a message; see :class:`fapengine.server.web.session_view.Member`."""
        self._outbox.put_text(text)
        self._waiting.set()

    def put_frame(self, frame: bytes) -> None:
        """Send a frame, unless newer ones come before it can leave."""
        self._outbox.put_frame(frame)
        self._waiting.set()

    async def run(self, hello: str) -> None:
        """Serve the page until it goes.

        Parameters
        ----------
        hello : str
            The first message.
        """
        self._counts.pages += 1
        self._counts.connected += 1
        self.put_text(hello)
        self._view.enter(self)
        writer = asyncio.create_task(self._write())
        try:
            async for message in self._socket:
                self._receive(message)
        finally:
            self._view.leave(self)
            self._counts.pages -= 1
            self._counts.frames_dropped += self._outbox.dropped
            for task in (writer, *self._voices):
                task.cancel()
            await asyncio.gather(writer, *self._voices, return_exceptions=True)

    async def close(self) -> None:
        """Say goodbye, for the server stops; the page will look for it again."""
        await self._socket.close(code=WSCloseCode.GOING_AWAY, message=b"the server stops")

    async def _write(self) -> None:
        with contextlib.suppress(ConnectionError):  # it is gone: the reader notices, too
            while not self._socket.closed:
                if self._outbox.overflowed:
                    self._counts.lost += 1
                    await self._socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
                    return
                match self._outbox.take():
                    case str(text):
                        await self._socket.send_str(text)
                    case bytes(frame):
                        await self._socket.send_bytes(frame)
                    case None:
                        self._waiting.clear()
                        await self._waiting.wait()

    def _receive(self, message: WSMessage) -> None:
        self._counts.messages += 1
        if not self._allowance.take(self._hub.clock()):
            self._counts.too_fast += 1
            self._refuse()
            return
        try:
            if message.type is WSMsgType.BINARY:
                self._listen(message.data)
            elif message.type is WSMsgType.TEXT:
                self._answer(parse_request(message.data))
            else:
                raise DataError(f"message: got {message.type.name.lower()}, expected text or sound")
        except DataError as error:
            self._counts.bad_messages += 1
            self._refuse()
            self.put_text(text_of("error", message=str(error)))
        except UsageError as error:
            self.put_text(text_of("error", message=str(error)))

    def _listen(self, data: bytes) -> None:
        rate_hz, samples = parse_sound(data)
        trouble = "ear: this server has none"
        if self._hearing is not None:
            try:
                is_heard = self._hearing.listen(self._view.session, samples, rate_hz, source=self)
                trouble = "" if is_heard else "microphone: another one moves this face, or too much sound waits"
            except ResourceError as error:
                trouble = str(error)
        self._counts.unheard += bool(trouble)
        if trouble and trouble != self._told_unheard:  # once, not 25 times a second
            self.put_text(text_of("error", message=trouble))
        self._told_unheard = trouble

    def _refuse(self) -> None:
        self._refused += 1
        if self._refused == MAX_REFUSED:
            self._counts.lost += 1
            self._voices.add(asyncio.create_task(self._expel()))

    async def _expel(self) -> None:
        await self._socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too much that cannot be used")

    def _answer(self, request: Request) -> None:
        match request:
            case Tell(command):
                self._view.tell(self, command)
            case Pin(values):
                self._view.pin(values)
            case Perform(values):
                self._hub.host(self._view.session).perform(values, self._hub.clock())
            case ReleaseAll():
                self._view.release()
            case Ping(number):
                self.put_text(text_of("pong", number=number, time_s=self._hub.clock()))
            case Plays(on):
                self._view.plays(self, on=on)
            case Watch(on):
                self._view.watches(self, on=on)
            case Phones():
                self._say_phones(request)
            case Say() | Words() if len(self._voices) < MAX_VOICES:
                task = asyncio.create_task(self._say(request) if isinstance(request, Say) else self._say_words(request))
                self._voices.add(task)
                task.add_done_callback(self._voices.discard)
            case Say() | Words():
                raise UsageError("text: still busy with what was asked before")

    def _voice_of(self, request: Say | Words) -> str:
        """Name of the wished voice; files and accounts of this machine are its owner's to choose."""
        name = request.voice or self._voice.name
        if ":" in name and name != self._voice.name:
            raise UsageError(f"voice: got {name!r:.60}, expected a language, or the server's own voice")
        return name

    async def _say_words(self, request: Words) -> None:
        try:
            number = await self._hub.say_words(
                self._view.session,
                request.words,
                voice=self._voice_of(request),
                anchor=request.anchor,
                at_s=request.at_s or 0.0,
                utterance=request.utterance,
                is_last=request.last,
            )
        except FapEngineError as error:
            self.put_text(text_of("error", message=str(error)))
        else:
            self.put_text(text_of("words", utterance=number))

    def _say_phones(self, request: Phones) -> None:
        alphabet = phone_labels.phone_set_named(request.set)
        if alphabet is None:
            raise UsageError(f"set: got {request.set!r}, expected one of {', '.join(ALPHABETS)}")
        phones = []
        for label, start_s, end_s in request.phones:
            name, stress = phone_labels.to_phone(label, alphabet)
            phones.append(Phone(name, start_s, end_s, stress))
        first_s = phones[0].start_s if phones else 0.0
        whole = [phone for phone in PhoneTrack.of(phones).phones if phone.end_s > first_s]
        number, session, now_s = request.utterance, self._view.session, self._hub.clock()
        host = self._hub.host(session)
        if number is None:
            number = self._hub.new_number()
            host.begin(number, now_s, anchor=request.anchor, at_s=request.at_s or 0.0)
        host.phones(number, whole, now_s, is_last=request.last)
        is_there = self._hub.engine.utterance(session, number) is not None
        self.put_text(text_of("words", utterance=number if is_there else None))

    async def _say(self, request: Say) -> None:
        try:
            said = await self._hub.speak(
                self._view.session,
                request.text,
                voice=self._voice_of(request),
                rate_wpm=request.rate_wpm or self._voice.rate_wpm,
                ssml=self._voice.ssml,
            )
            for remark in said.speech.remarks if said is not None else ():
                self.put_text(text_of("error", message=remark))
        except FapEngineError as error:
            self.put_text(text_of("error", message=str(error)))
