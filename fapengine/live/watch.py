"""Edge: a live face from elsewhere, for a window: over a server's WebSocket, or ``/fap/1/frame`` on a UDP port.

Both give the newest frame that has come; a frame that is not there yet is never waited for.
"""

import asyncio
import json
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.live import osc
from fapengine.live.fap_osc import FRAME as OSC_FRAME
from fapengine.live.fap_osc import FapFrame, parse_frame
from fapengine.live.web.wire import FRAME, FRAME_KIND, text_of
from fapengine.mpeg4 import fap

Faps = NDArray[np.int32]
LinkState = Literal["connecting", "open", "lost"]

RETRY_S = (0.2, 2.0)
"""First and longest pause before it is tried again."""
PING_S = 1.0
BEST_PINGS = 8
"""Of so many, the quickest tells the server's clock."""
LARGEST = 65_535
SILENT_S = 2.0
"""A port where nothing comes for so long is said to be silent."""
CLOSE_S = 3.0


@dataclass(slots=True)
class WatchCounts:
    """Stateful: what came."""

    frames: int = 0
    missed: int = 0
    """Numbers that never came."""
    refused: int = 0
    """Messages that were none of ours."""


def web_socket_of(url: str, session: str | None = None) -> str:
    """Find the socket's address, given that of a server's page.

    Raises
    ------
    UsageError
        If it is no such address.

    Examples
    --------
    >>> web_socket_of("http://127.0.0.1:8110/?token=abc", session="anna")
    'ws://127.0.0.1:8110/ws?token=abc&session=anna'
    """
    parts = urlsplit(url)
    scheme = {"http": "ws", "https": "wss", "ws": "ws", "wss": "wss"}.get(parts.scheme)
    if scheme is None or not parts.netloc:
        raise UsageError(f"source: got {url!r:.100}, expected an address such as http://127.0.0.1:8110/")
    query = dict(parse_qsl(parts.query, keep_blank_values=True))
    if session is not None:
        query["session"] = session
    return urlunsplit((scheme, parts.netloc, "/ws", urlencode(query), ""))


class ServerLink:
    """Stateful: a session of ``fapengine serve``, connected again whenever it breaks. Close it.

    Parameters
    ----------
    url : str
        Of the page; see :func:`web_socket_of`.
    session : str, optional
        By default the server's own choice, or that of the address.
    clock : callable
        The monotonic clock.

    Raises
    ------
    UsageError
        If the address cannot be.
    ResourceError
        If aiohttp is missing.
    """

    def __init__(self, url: str, *, session: str | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._url = web_socket_of(url, session)
        self.state: LinkState = "connecting"
        self.trouble = ""
        """Why there is no connection."""
        self.hello: dict[str, Any] = {}
        """What the server said of itself."""
        self.counts = WatchCounts()
        self._clock = clock
        self._frame: tuple[int, float, Faps] | None = None
        self._pings: dict[int, float] = {}
        self._trips: list[tuple[float, float]] = []
        """Round trip and the server's clock minus ours, both in s."""
        self._aiohttp = _aiohttp()
        self._loop = asyncio.new_event_loop()
        self._queue: asyncio.Queue[str] = asyncio.Queue()
        self._task: asyncio.Task[None] | None = None
        self._thread = threading.Thread(target=self._run, name="fapengine-link", daemon=True)
        self._thread.start()

    @property
    def age_s(self) -> float | None:
        """How old the newest frame is, by the server's clock; None before that is known."""
        if self._frame is None or not self._trips:
            return None
        return self._clock() + min(self._trips)[1] - self._frame[1]

    @property
    def round_trip_s(self) -> float | None:
        """Of the quickest of late pings."""
        return min(self._trips)[0] if self._trips else None

    def faps(self) -> Faps:
        """Newest frame, (68,) FAPU; a face at rest before the first, and where the server is lost."""
        frame = self._frame
        return np.zeros(fap.FAP_COUNT, np.int32) if frame is None else frame[2]

    def send(self, kind: str, **fields: object) -> None:
        """Tell the session something; see :data:`fapengine.live.web.wire.REQUESTS`. Lost while there is no server."""
        if self.state == "open":
            self._loop.call_soon_threadsafe(self._queue.put_nowait, text_of(kind, **fields))

    def close(self) -> None:
        """Leave."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(lambda: self._task.cancel() if self._task else None)
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        async def live() -> None:
            self._task = asyncio.current_task()
            await self._connect()

        try:
            self._loop.run_until_complete(live())
        except asyncio.CancelledError:
            pass
        finally:
            self._loop.close()

    async def _connect(self) -> None:
        pause_s = RETRY_S[0]
        while True:
            try:
                async with (
                    self._aiohttp.ClientSession() as client,
                    client.ws_connect(self._url, max_msg_size=1 << 24, heartbeat=5.0) as link,
                ):
                    pause_s, self.state = RETRY_S[0], "open"
                    await self._talk(link)
                self.trouble = "the server went away"
            except (self._aiohttp.ClientError, OSError, TimeoutError) as error:
                self.trouble = str(error) or type(error).__name__
            self.state = "lost"
            self._frame, self._trips = None, []
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, RETRY_S[1])

    async def _talk(self, link: Any) -> None:
        self._queue = asyncio.Queue()
        sender = asyncio.ensure_future(self._send_all(link))
        try:
            async for message in link:
                if message.type == self._aiohttp.WSMsgType.BINARY:
                    self._take_frame(message.data)
                elif message.type == self._aiohttp.WSMsgType.TEXT:
                    self._take_text(message.data)
        finally:
            sender.cancel()

    async def _send_all(self, link: Any) -> None:
        number, next_s = 0, 0.0
        while True:
            if self._clock() >= next_s:
                number, next_s = number + 1, self._clock() + PING_S
                self._pings = {number: self._clock()}
                await link.send_str(text_of("ping", number=number))
            try:
                text = await asyncio.wait_for(self._queue.get(), timeout=max(next_s - self._clock(), 0.001))
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

    def _take_text(self, text: str) -> None:
        try:
            message = json.loads(text)
            kind = message["type"]
            if kind == "hello":
                self.hello = message
            elif kind == "pong":
                self._take_pong(int(message["number"]), float(message["time_s"]))
        except (ValueError, KeyError, TypeError):
            self.counts.refused += 1

    def _take_pong(self, number: int, server_s: float) -> None:
        asked_s = self._pings.pop(number, None)
        if asked_s is not None:
            now_s = self._clock()
            self._trips = [*self._trips[-BEST_PINGS + 1 :], (now_s - asked_s, server_s - (asked_s + now_s) / 2)]


class OscFrames:
    """Stateful: listens for ``/fap/1/frame`` on a UDP port. Close it.

    Parameters
    ----------
    host, port : str, int
        Where to listen.
    session : str, optional
        Whose frames; by default of the first that comes.
    clock : callable
        The monotonic clock.

    Raises
    ------
    ResourceError
        If the port is taken.
    """

    def __init__(
        self, host: str, port: int, *, session: str | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.session = session
        self.counts = WatchCounts()
        self._clock, self._heard_s = clock, -np.inf
        self._frame: FapFrame | None = None
        self._values = np.zeros(fap.FAP_COUNT, np.int32)
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = _bound(socket.socket(family, kind), address)
        except OSError as error:
            raise ResourceError(f"osc://{host}:{port}: got {error}, expected a port that is free") from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._socket.getsockname()[1])

    @property
    def is_silent(self) -> bool:
        """Whether nothing has come for :data:`SILENT_S`."""
        return self._clock() - self._heard_s > SILENT_S

    def faps(self) -> Faps:
        """Newest frame, (68,) FAPU; late ones are dropped, what one leaves out keeps its value."""
        while True:
            try:
                data = self._socket.recv(LARGEST)
            except OSError:  # nothing more is there
                return self._values.copy()
            try:
                for message in osc.parse_packet(data):
                    self._take(message)
            except DataError:
                self.counts.refused += 1

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()

    def _take(self, message: osc.Message) -> None:
        if message.address != OSC_FRAME:
            self.counts.refused += 1
            return
        frame = parse_frame(message)
        if self.session is None:
            self.session = frame.session
        if frame.session != self.session:
            return
        before, self._heard_s = self._frame, self._clock()
        if before is not None and 0 <= before.number - frame.number < 1000 and frame.time_us <= before.time_us:
            return
        if before is not None and frame.number > before.number:
            self.counts.missed += frame.number - before.number - 1
        self.counts.frames += 1
        self._frame = frame
        self._values = np.where(frame.mask, frame.values, self._values).astype(np.int32)


def _bound(made: socket.socket, address: Any) -> socket.socket:
    try:
        made.bind(address)
    except OSError:
        made.close()
        raise
    return made


def _aiohttp() -> Any:
    try:
        import aiohttp
    except ImportError as error:
        raise ResourceError(f'server: {error}; mend it with: pip install "fapengine[live]"') from error
    return aiohttp
