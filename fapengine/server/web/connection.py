"""One connected page: its requests are read at a limited rate, and its view's messages are written in order."""

import asyncio
import contextlib
import logging
from collections import deque
from dataclasses import dataclass, field
from functools import partial

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from fapengine._counters import Counts, metric
from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
from fapengine.host.hearing import Hearing
from fapengine.host.hub import Hub
from fapengine.server.intake.rates import TokenBucket, Turns
from fapengine.server.intake.tasks import Tasks
from fapengine.server.web import messages
from fapengine.server.web.session_view import SessionView
from fapengine.speech.alphabets.convert import ALPHABETS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.voices.choice import VoiceChoice
from fapengine.wire.speech_osc import phone_labels

MAX_TEXTS = 512
MAX_FRAMES = 3
"""Waiting frames; older ones are dropped."""
MESSAGES_HZ, MESSAGES_AT_ONCE = 120.0, 240.0
"""Rate and burst of requests. A slider that is dragged sends one per displayed frame; nothing needs more."""
MAX_REFUSED = 2000
"""Invalid requests, or requests beyond the rate, after which a page is closed."""
MAX_VOICES = 3
"""Texts of one page that are spoken at the same time."""

log = logging.getLogger("fapengine.web")


@dataclass(slots=True, eq=False)
class SendQueue:
    """The messages to a page: all texts in order, and the newest frames. Stateful."""

    dropped: int = 0
    """Number of frames that were never sent."""
    overflowed: bool = False
    """True if too many texts wait: the page is closed, and must connect again."""
    filled: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when a message is added."""
    _texts: deque[str] = field(default_factory=deque)
    _frames: deque[bytes] = field(default_factory=deque)

    def put_text(self, text: str) -> None:
        """Add a text."""
        if len(self._texts) < MAX_TEXTS:
            self._texts.append(text)
        else:
            self.overflowed = True
        self.filled.set()

    def put_frame(self, frame: bytes) -> None:
        """Add a frame; the oldest is dropped if too many wait."""
        if len(self._frames) == MAX_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(frame)
        self.filled.set()

    def take(self) -> str | bytes | None:
        """Remove the next message; texts first, because they explain the frames."""
        if self._texts:
            return self._texts.popleft()
        return self._frames.popleft() if self._frames else None


@dataclass(slots=True)
class WebCounts(Counts):
    """Counts of all pages together since the start. Stateful."""

    METRIC = "page", "What pages did and met with, by kind."

    pages: int = metric("pages", "Pages that are connected.", is_gauge=True)
    connected: int = 0
    """Connections since the start."""
    refused: int = 0
    """Connections without token, from other sites, or beyond the limit."""
    messages: int = 0
    bad_messages: int = 0
    too_fast: int = 0
    """Messages beyond the allowed rate."""
    frames_dropped: int = 0
    """Frames that were not sent to a slow page."""
    misdirected: int = metric("misdirected", "Requests for a session that another process shows.")
    unheard: int = 0
    """Pieces of a microphone's audio that no recognizer accepted."""
    lost: int = 0
    """Pages closed because they were too slow, or sent too many invalid messages."""


class Connection:
    """The WebSocket of one page. Stateful.

    Parameters
    ----------
    hub : Hub
    view : SessionView
        View of the page's session.
    socket : WebSocketResponse
        Prepared.
    counts : WebCounts
        Shared by all connections.
    voice : VoiceChoice
        Default voice.
    turns : Turns
        Of all pages together.
    hearing : Hearing, optional
        Recognizes the page's microphone.
    """

    def __init__(
        self,
        hub: Hub,
        view: SessionView,
        socket: web.WebSocketResponse,
        counts: WebCounts,
        voice: VoiceChoice,
        turns: Turns,
        hearing: Hearing | None = None,
    ) -> None:
        self._voice, self._hearing = voice, hearing
        self._audio_error = ""
        self._hub, self._view, self._socket, self._counts = hub, view, socket, counts
        self.outbox = SendQueue()
        """Messages to the page."""
        self._allowance = TokenBucket(MESSAGES_HZ, MESSAGES_AT_ONCE)
        self._turns = turns
        self._refused = 0
        self._tasks = Tasks()

    async def run(self, hello: str) -> None:
        """Serve the page until it disconnects.

        Parameters
        ----------
        hello : str
            The first message.
        """
        self._counts.pages += 1
        self._counts.connected += 1
        self.outbox.put_text(hello)
        self._view.enter(self.outbox)
        writer = asyncio.create_task(self._write())
        try:
            async for message in self._socket:
                await self._turns.take(self, partial(self._receive, message))
        finally:
            self._turns.leave(self)
            self._view.leave(self.outbox)
            self._counts.pages -= 1
            self._counts.frames_dropped += self.outbox.dropped
            for task in (writer, *self._tasks):
                task.cancel()
            await asyncio.gather(writer, *self._tasks, return_exceptions=True)

    async def close(self) -> None:
        """Close the connection because the server stops; the page will try to reconnect."""
        await self._socket.close(code=WSCloseCode.GOING_AWAY, message=b"the server stops")

    async def _write(self) -> None:
        with contextlib.suppress(ConnectionError):  # it is closed: the reader notices too
            while not self._socket.closed:
                if self.outbox.overflowed:
                    self._counts.lost += 1
                    await self._socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
                    return
                match self.outbox.take():
                    case str(text):
                        await self._socket.send_str(text)
                    case bytes(frame):
                        await self._socket.send_bytes(frame)
                    case None:
                        self.outbox.filled.clear()
                        await self.outbox.filled.wait()

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
                self._answer(messages.parse_request(message.data))
            else:
                raise DataError(f"message: got {message.type.name.lower()}, expected text or audio")
        except FapEngineError as error:
            if isinstance(error, DataError):
                self._counts.bad_messages += 1
                self._refuse()
            self._report(str(error))

    def _listen(self, data: bytes) -> None:
        rate_hz, samples = messages.parse_sound(data)
        problem = "recognizer: this server has none"
        if self._hearing is not None:
            try:
                is_heard = self._hearing.listen(self._view.session, samples, rate_hz, source=self)
                problem = "" if is_heard else "microphone: another one drives this face, or too much audio waits"
            except ResourceError as error:
                problem = str(error)
        self._counts.unheard += bool(problem)
        if problem and problem != self._audio_error:  # once, not 25 times per second
            self._report(problem)
        self._audio_error = problem

    def _report(self, error: str) -> None:
        self.outbox.put_text(messages.text_of("error", message=error))

    def _refuse(self) -> None:
        self._refused += 1
        if self._refused == MAX_REFUSED:
            self._counts.lost += 1
            code, reason = WSCloseCode.POLICY_VIOLATION, b"too many invalid messages"
            self._tasks.start(self._socket.close(code=code, message=reason))

    def _answer(self, request: messages.Request) -> None:
        match request:
            case messages.Tell(command):
                self._view.tell(self.outbox, command)
            case messages.Pin(values):
                self._view.pin(values)
            case messages.Perform(values):
                self._hub.host(self._view.session).perform(values, self._hub.clock())
            case messages.Release():
                self._view.release()
            case messages.Ping(number):
                self.outbox.put_text(messages.text_of("pong", number=number, time_s=self._hub.clock()))
            case messages.Plays(on):
                self._view.plays(self.outbox, on=on)
            case messages.Watch(on):
                self._view.watches(self.outbox, on=on)
            case messages.Phones():
                self._say_phones(request)
            case messages.Say() | messages.Words():
                if len(self._tasks) >= MAX_VOICES:
                    raise UsageError("text: earlier texts are still being spoken")
                self._tasks.start(self._say(request))

    async def _say(self, request: messages.Say | messages.Words) -> None:
        session, voice = self._view.session, self._voice
        name = request.voice or voice.name
        try:
            if name != voice.name and not VoiceChoice(name).is_language:  # those are the owner's of this machine
                raise UsageError(f"voice: got {name!r:.60}, expected a language, or the server's own voice")
            if isinstance(request, messages.Words):
                number = await self._hub.say_words(
                    session, request.words, voice=name, anchor=request.anchor, at_s=request.at_s or 0.0,
                    utterance=request.utterance, is_last=request.last,
                )  # fmt: skip
                self.outbox.put_text(messages.text_of("words", utterance=number))
                return
            rate_wpm = request.rate_wpm or voice.rate_wpm
            said = await self._hub.speak(session, request.text, voice=name, rate_wpm=rate_wpm, ssml=voice.ssml)
            for warning in said.speech.remarks if said is not None else ():
                self._report(warning)
        except FapEngineError as error:
            self._report(str(error))

    def _say_phones(self, request: messages.Phones) -> None:
        alphabet = phone_labels.phone_set_named(request.set)
        if alphabet is None:
            raise UsageError(f"set: got {request.set!r}, expected one of {', '.join(ALPHABETS)}")
        phones = []
        for label, start_s, end_s in request.phones:
            name, stress = phone_labels.to_phone(label, alphabet)
            phones.append(Phone(name, start_s, end_s, stress))
        first_s = phones[0].start_s if phones else 0.0
        whole = [phone for phone in PhoneTrack.from_phones(phones).phones if phone.end_s > first_s]
        number, session, now_s = request.utterance, self._view.session, self._hub.clock()
        host = self._hub.host(session)
        if number is None:
            number = self._hub.new_number()
            host.begin(number, now_s, anchor=request.anchor, at_s=request.at_s or 0.0)
        host.phones(number, whole, now_s, is_last=request.last)
        is_open = self._hub.engine.utterance(session, number) is not None
        self.outbox.put_text(messages.text_of("words", utterance=number if is_open else None))
