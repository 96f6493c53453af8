"""Edge: receiver of a live face over a server's WebSocket, for a window (over UDP: :mod:`.osc_viewer`).

Both return the newest frame that has arrived, and never wait for one.
"""

import asyncio
import io
import json
import threading
import time
import wave
from collections import deque
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Literal
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

import numpy as np
from numpy.typing import NDArray

from fapengine._late import needed
from fapengine.audio.device import open_output
from fapengine.audio.output import OpenOutput, Playing, SoundPlayer
from fapengine.clients.osc_viewer import Faps, ViewerCounts
from fapengine.errors import DataError, UsageError
from fapengine.mpeg4 import fap
from fapengine.server.web.messages import FRAME, FRAME_KIND, text_of

LinkState = Literal["connecting", "open", "lost"]

RETRY_S = (0.2, 2.0)
"""First and longest pause between two attempts to connect."""
PING_S = 1.0
BEST_PINGS = 8
"""Number of pings of which the quickest estimates the server's clock."""
CLOSE_S = 3.0
SOUND_PATH = "/sound.wav?"
MAX_SOUND = 1 << 26
"""Bytes of one sound: more than half an hour."""
STOPPED, OVER = ("cancelled", "error"), ("cancelled", "error", "finished")
"""Events that stop the sound of an utterance, and all that end an utterance."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnouncedSound:
    """Audio of the server's voice."""

    utterance: int
    samples: NDArray[np.int16]
    """(N,) mono."""
    sample_rate_hz: int


def web_socket_of(url: str, session: str | None = None) -> str:
    """Return the address of the WebSocket, given that of a server's page.

    Raises UsageError if it is not such an address.

    Examples
    --------
    >>> web_socket_of("http://127.0.0.1:8110/?token=abc", session="anna")
    'ws://127.0.0.1:8110/ws?token=abc&session=anna'
    """
    try:
        parts = urlsplit(url)
    except ValueError:  # a bracket without its other
        parts = urlsplit("")
    scheme = {"http": "ws", "https": "wss", "ws": "ws", "wss": "wss"}.get(parts.scheme)
    if scheme is None or not parts.netloc:
        raise UsageError(f"source: got {url!r:.100}, expected an address such as http://127.0.0.1:8110/")
    query = dict(parse_qsl(parts.query, keep_blank_values=True))
    if session is not None:
        query["session"] = session
    return urlunsplit((scheme, parts.netloc, "/ws", urlencode(query), ""))


class WebSocketViewer:
    """A session of ``fapengine serve``, reconnected whenever the connection breaks. Close it.

    Stateful. Raises UsageError if the address is invalid; ResourceError if aiohttp is missing.

    Parameters
    ----------
    url : str
        Of the page; see :func:`web_socket_of`.
    session : str, optional
        By default the server's own choice, or that of the address.
    plays : bool
        Whether the caller plays the sounds and reports their positions (:class:`ViewerSound`): the face waits for that.
    clock : callable
        The monotonic clock.
    """

    def __init__(
        self, url: str, *, session: str | None = None, plays: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._url = web_socket_of(url, session)
        self._plays = plays
        self._sounds: deque[AnnouncedSound] = deque()
        self._ended: deque[int] = deque()
        self._saying: set[int] = set()
        self._fetching: dict[int, asyncio.Task[None]] = {}
        """Utterance to the task that loads its sound."""
        self.state: LinkState = "connecting"
        self.trouble = ""
        """Reason why there is no connection."""
        self._refusal = ""
        """Reason of the server for refusing the connection."""
        self.hello: dict[str, Any] = {}
        """Fields of the server's hello."""
        self.counts = ViewerCounts()
        self._clock = clock
        self._frame: tuple[int, float, Faps] | None = None
        self._pings: dict[int, float] = {}
        self._trips: deque[tuple[float, float]] = deque(maxlen=BEST_PINGS)
        """Round trip and the server's clock minus ours, both in s."""
        self._aiohttp = needed("aiohttp", "aiohttp", "server")
        self._loop = asyncio.new_event_loop()
        self._queue: asyncio.Queue[str] = asyncio.Queue()
        self._task = self._loop.create_task(self._connect())
        self._thread = threading.Thread(target=self._run, name="fapengine-link", daemon=True)
        self._thread.start()

    @property
    def age_s(self) -> float | None:
        """Age of the newest frame by the server's clock; None before that is known."""
        server_s = self.server_s(self._clock())
        return None if self._frame is None or server_s is None else server_s - self._frame[1]

    @property
    def round_trip_s(self) -> float | None:
        """Round trip of the quickest recent ping."""
        return min(self._trips)[0] if self._trips else None

    @property
    def is_speaking(self) -> bool:
        """Whether an utterance is spoken or waits."""
        return bool(self._saying)

    def server_s(self, now_s: float) -> float | None:
        """Convert a time of the monotonic clock to the server's; None before that is known."""
        return now_s + min(self._trips)[1] if self._trips else None

    def sounds(self) -> list[AnnouncedSound]:
        """Return the sounds that have arrived since the last call."""
        return [self._sounds.popleft() for _ in range(len(self._sounds))]

    def ended(self) -> list[int]:
        """Return the utterances that were cancelled since the last call; call it before :meth:`sounds`."""
        return [self._ended.popleft() for _ in range(len(self._ended))]

    def faps(self) -> Faps:
        """Return the newest frame, (68,) FAPU; a neutral face before the first, and without a connection."""
        frame = self._frame
        return np.zeros(fap.FAP_COUNT, np.int32) if frame is None else frame[2]

    def send(self, kind: str, **fields: object) -> None:
        """Send a message of :func:`fapengine.server.web.messages.structs`; it is dropped without a connection."""
        if self.state == "open":
            self._loop.call_soon_threadsafe(self._queue.put_nowait, text_of(kind, **fields))

    def close(self) -> None:
        """Close the connection."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        with closing(self._loop), suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)

    async def _connect(self) -> None:
        pause_s = RETRY_S[0]
        while True:
            try:
                async with (
                    self._aiohttp.ClientSession() as client,
                    client.ws_connect(self._url, max_msg_size=1 << 24, heartbeat=5.0) as link,
                ):
                    self._refusal = ""
                    await self._talk(client, link)
                self.trouble = self._refusal or "the server closed the connection"
            except (self._aiohttp.ClientError, OSError, TimeoutError) as error:
                self.trouble = self._described(error)
            if self.state == "open":
                pause_s = RETRY_S[0]
            self.state = "lost"
            self._frame = None
            self._trips.clear()
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, RETRY_S[1])

    def _described(self, error: Exception) -> str:
        """Describe an error of the connection, and what to do."""
        where = urlsplit(self._url).netloc
        if isinstance(error, self._aiohttp.WSServerHandshakeError):
            if error.status == HTTPStatus.FORBIDDEN:
                return "the server requires its token: use the address that it printed"
            return f"the program at {where} is not fapengine serve (status {error.status})"
        if isinstance(error, ConnectionRefusedError | self._aiohttp.ClientConnectorError):
            return f"no answer from {where}: is fapengine serve running there?"
        if isinstance(error, TimeoutError):
            return f"{where} does not answer in time"
        return f"the connection to {where} broke"

    async def _talk(self, client: Any, link: Any) -> None:
        self._queue = asyncio.Queue()
        self._saying.clear()
        if self._plays:
            await link.send_str(text_of("plays", on=True))
        sender, turn = asyncio.ensure_future(self._send_all(link)), asyncio.Lock()
        try:
            async for message in link:
                if message.type == self._aiohttp.WSMsgType.BINARY:
                    self._take_frame(message.data)
                elif message.type == self._aiohttp.WSMsgType.TEXT:
                    sound = self._take_text(message.data)
                    if sound is not None:
                        self._fetching[sound[0]] = asyncio.ensure_future(self._fetch(client, turn, *sound))
        finally:
            tasks = (sender, *self._fetching.values())
            self._fetching.clear()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _fetch(self, client: Any, turn: asyncio.Lock, utterance: int, path: str) -> None:
        """Load a sound after those before it: they are played in this order."""
        parts = urlsplit(self._url)
        token = dict(parse_qsl(parts.query)).get("token")
        query = f"&{urlencode({'token': token})}" if token else ""
        scheme = "https" if parts.scheme == "wss" else "http"
        try:
            async with turn, client.get(f"{scheme}://{parts.netloc}{path}{query}") as answer:
                data = await _body(answer) if answer.status == HTTPStatus.OK else b""
            samples, rate_hz = parse_wav(data)
        except (self._aiohttp.ClientError, OSError, TimeoutError, DataError):
            self.counts.refused += 1
            return
        finally:
            self._fetching.pop(utterance, None)
        self._sounds.append(AnnouncedSound(utterance, samples, rate_hz))

    async def _send_all(self, link: Any) -> None:
        number, next_s = 0, 0.0
        while True:
            if self._clock() >= next_s:
                number, next_s = number + 1, self._clock() + PING_S
                self._pings = {number: self._clock()}
                await link.send_str(text_of("ping", number=number))
            try:
                # Not wait_for: until Python 3.12 it may lose a cancellation.
                async with asyncio.timeout(max(next_s - self._clock(), 0.001)):
                    text = await self._queue.get()
            except TimeoutError:
                continue
            await link.send_str(text)

    def _take_frame(self, data: bytes) -> None:
        if len(data) != FRAME.size or data[0] != FRAME_KIND:
            self.counts.refused += 1
            return
        _, number, time_s, *values = FRAME.unpack(data)
        if self._frame is not None:
            self.counts.missed += max((number - self._frame[0] - 1) & 0xFFFFFFFF, 0)
        self.counts.frames += 1
        self._frame = (number, time_s, np.array(values, np.int32))

    def _take_text(self, text: str) -> tuple[int, str] | None:
        """Process a message; return the utterance and address of a sound that is to be loaded."""
        try:
            message = json.loads(text)
            kind = message["type"]
            if kind == "hello":
                self.hello, self.state = message, "open"
            elif kind == "error" and self.state != "open":
                self._refusal = str(message["message"])
            elif kind == "pong":
                self._take_pong(int(message["number"]), float(message["time_s"]))
            elif kind == "begin":
                self._saying.add(int(message["utterance"]))
            elif kind == "event" and message["kind"] in OVER:
                self._take_end(int(message["utterance"]), message["kind"])
            elif kind == "sound" and self._plays and str(message["url"]).startswith(SOUND_PATH):
                return int(message["utterance"]), str(message["url"])
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            self.counts.refused += 1
        return None

    def _take_end(self, number: int, kind: str) -> None:
        self._saying.discard(number)
        if kind in STOPPED:
            self._ended.append(number)
            if number in self._fetching:
                self._fetching.pop(number).cancel()

    def _take_pong(self, number: int, server_s: float) -> None:
        asked_s, now_s = self._pings.pop(number, None), self._clock()
        if asked_s is not None:
            self._trips.append((now_s - asked_s, server_s - (asked_s + now_s) / 2))


async def _body(answer: Any) -> bytes:
    """Read an answer to its end; aiohttp's ``read(n)`` may return less.

    Raises DataError if it is longer than :data:`MAX_SOUND`.
    """
    data = bytearray()
    async for piece in answer.content.iter_any():
        data += piece
        if len(data) > MAX_SOUND:
            raise DataError(f"sound: got more than {MAX_SOUND} bytes")
    return bytes(data)


def parse_wav(data: bytes) -> tuple[NDArray[np.int16], int]:
    """Decode a WAV of 16 bits: samples (N,) of the first channel, and the rate in Hz.

    Raises DataError if it is not one.
    """
    try:
        with wave.open(io.BytesIO(data), "rb") as sound:
            channels, width, rate_hz = sound.getnchannels(), sound.getsampwidth(), sound.getframerate()
            frames = sound.readframes(sound.getnframes())
    except (wave.Error, EOFError, ValueError, RuntimeError) as error:
        raise DataError(f"sound: is not a WAV file ({str(error) or type(error).__name__})") from error
    if width != np.dtype(np.int16).itemsize or not rate_hz:
        raise DataError(f"sound: got {8 * width} bits at {rate_hz} Hz, expected 16 bits")
    whole = frames[: len(frames) - len(frames) % (2 * channels)]
    return np.frombuffer(whole, "<i2").reshape(-1, channels)[:, 0].astype(np.int16), rate_hz


class ViewerSound(SoundPlayer):
    """The sound of a :class:`WebSocketViewer` that plays. Close it.

    It reports its position to the server, so that the face follows our sound. Frames reach us some time after they were
    made; the position that is reported is ahead by this time, so that the image matches the sound. Stateful.

    Parameters
    ----------
    link : WebSocketViewer
        Made with ``plays``.
    opens : callable
        Sample rate in Hz to an output; called once for each rate.
    """

    def __init__(self, link: WebSocketViewer, *, opens: OpenOutput = open_output) -> None:
        super().__init__(opens)
        self._link = link

    def play(self, now_s: float) -> None:
        """Play the sounds that have arrived, and report their positions; call it before each frame.

        Parameters
        ----------
        now_s : float
            Monotonic clock.
        """
        ended = self._link.ended()
        for announced in self._link.sounds():
            self.add(announced.utterance, announced.samples, announced.sample_rate_hz, now_s)
        if self._link.state != "open":
            self.stop()
        for utterance in ended:
            self.drop(utterance)
        for entry in self.follow(now_s):
            self._report(entry, now_s)

    def _report(self, entry: Playing, now_s: float) -> None:
        place_s, server_s = entry.position_s(now_s), self._link.server_s(now_s)
        if place_s is None or server_s is None or not entry.is_due(place_s, now_s):
            return
        if self.is_paused and not entry.is_still:  # while the face is paused, positions are not reported
            return
        ahead_s = 0.0 if entry.is_still else max(self._link.age_s or 0.0, 0.0)
        rate = 0.0 if entry.is_still else 1.0
        self._link.send("audio", utterance=entry.utterance, at_s=server_s, position_s=place_s + ahead_s, rate=rate)
