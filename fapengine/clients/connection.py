"""A client's connection to a session of a server: the sockets around an ``OscSender``, and the thread that serves them.

The thread sends, repeats and receives; methods may be called from any thread and return at once.
"""

import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Literal, Self

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.handshake import PING_S
from fapengine.wire.speech_osc.sender import OscSender

CONNECT_S = 5.0
MAX_AT_ONCE = 64
"""Datagrams that are received before the next packet is sent."""
TcpFraming = Literal["slip", "length"]


class Pipe:
    """A socket and its address. Stateful."""

    is_refused = False
    """Whether the system has reported that no program listens there; for UDP only."""

    def __init__(self, name: str, connected: socket.socket) -> None:
        self.name, self._socket = name, connected

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _wait(self, wait_s: float, wake: socket.socket) -> bool:
        """Wait up to ``wait_s`` for packets or a byte on ``wake``; return whether packets have arrived."""
        with selectors.DefaultSelector() as selector:  # unlike select.select, for sockets above number 1023 too
            for each in (self._socket, wake):
                selector.register(each, selectors.EVENT_READ)
            ready = [key.fileobj for key, _ in selector.select(wait_s)]
        if wake in ready:
            wake.recv(4096)
        return self._socket in ready


class Datagrams(Pipe):
    """A UDP socket for one address. Stateful.

    Raises ResourceError if the host is unknown.

    Parameters
    ----------
    host : str
    port : int
    """

    def __init__(self, host: str, port: int) -> None:
        name = f"udp://{host}:{port}"
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            super().__init__(name, socket.socket(family, kind, protocol))
            self._socket.connect(address)
        except OSError as error:
            raise ResourceError(f"engine at {name}: {error}") from error
        self._socket.setblocking(False)

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        try:
            self._socket.send(packet)
        except OSError as error:  # no listener, no buffer space or no network: the same as a lost datagram
            self.is_refused |= isinstance(error, ConnectionRefusedError)

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait up to ``wait_s`` for packets or a byte on ``wake``; return the packets that have arrived."""
        self._wait(wait_s, wake)
        packets: list[bytes] = []
        for _ in range(MAX_AT_ONCE):
            try:
                packets.append(self._socket.recv(65_536))
            except BlockingIOError:
                break
            except OSError as error:  # an earlier packet was not delivered: no listener, no network
                self.is_refused |= isinstance(error, ConnectionRefusedError)
        return packets


class Stream(Pipe):
    """A TCP connection. Stateful.

    Raises ResourceError if no program listens there; UsageError for another framing.

    Parameters
    ----------
    host : str
    port : int
    framing : ``"slip"`` or ``"length"``
        How packets are separated: SLIP (OSC 1.1), or lengths before them (OSC 1.0).
    """

    def __init__(self, host: str, port: int, framing: TcpFraming) -> None:
        name = f"tcp://{host}:{port}"
        if framing not in ("slip", "length"):
            raise UsageError(f"tcp: got {framing!r}, expected 'slip' or 'length'")
        try:
            super().__init__(name, socket.create_connection((host, port), timeout=CONNECT_S))
        except OSError as error:
            raise ResourceError(f"engine at {name}: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._encode = encode_slip if framing == "slip" else encode_length
        self._decoder = SlipDecoder() if framing == "slip" else LengthDecoder()

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        self._socket.sendall(self._encode(packet))

    def receive(self, wait_s: float, wake: socket.socket) -> list[bytes]:
        """Wait like :meth:`Datagrams.receive`; raises ``OSError`` or ``DataError`` if the connection ended."""
        if not self._wait(wait_s, wake):
            return []
        data = self._socket.recv(65_536)
        if not data:
            raise ConnectionError("closed by the engine")
        return self._decoder.feed(data)


LINGER_S = 5.0
"""Longest wait of :meth:`Connection.close` for what was sent to arrive."""
SILENT_S = 0.5
"""Longest wait of :meth:`Connection.close` for an engine that does not answer."""
IDLE_S = 0.25
"""Longest pause of the thread."""
LOST_S, AWAY_PING_S = 1.0, 0.5
"""For a client that a server sent to another process: time without an answer until it returns to the known port, and
time between pings.
"""
KEPT_EVENTS = 256
KEPT_ENDED = 1024
"""Number of ended utterances that are remembered."""


class Connection:
    """The connection of a :class:`fapengine.Client`; its methods add what is sent.

    Stateful.

    Parameters
    ----------
    sender : OscSender
        The protocol's state for one session.
    addresses : sequence of (str, int)
        Hosts and ports of servers that share their sessions, tried in turn.
    framing : ``"slip"`` or ``"length"``, optional
        That of TCP; None for UDP.
    on_event : callable, optional
        Called in the thread with each :class:`~fapengine.wire.speech_osc.schema.Notice`.
    clock : callable
        Monotonic clock in seconds.
    """

    def __init__(
        self,
        sender: OscSender,
        addresses: Sequence[tuple[str, int]],
        framing: TcpFraming | None,
        on_event: Callable[[schema.Notice], None] | None,
        clock: Callable[[], float],
    ) -> None:
        self._sender, self._framing = sender, framing
        self._clock, self._on_event = clock, on_event
        self._homes, self._has_answered = deque(addresses), False
        """Known addresses, the current one first; and whether the current one has answered."""
        self._at = self._homes[0]
        self._went_s = clock()
        self._is_away = False
        """Whether the server has sent us to an unknown port."""
        self._pipe = self._opened(*self._at)
        self._changed = threading.Condition()
        self._events: deque[schema.Notice] = deque(maxlen=KEPT_EVENTS)
        self._ended: dict[int, str] = {}
        """How utterances ended."""
        self._fault: ResourceError | UsageError | None = None
        self._stops = False
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_out.setblocking(False)
        self._thread = threading.Thread(target=self._work, name=f"fapengine client {sender.session}", daemon=True)
        self._thread.start()

    @property
    def now_s(self) -> float:
        """The client's clock."""
        return self._clock()

    @property
    def welcome(self) -> schema.Welcome | None:
        """The engine's answer with its limits; None before it."""
        return self._sender.handshake.welcome

    @property
    def is_connected(self) -> bool:
        """Whether the engine has answered recently."""
        with self._changed:
            return self._fault is None and self._sender.handshake.is_connected(self._clock())

    def events(self) -> list[schema.Notice]:
        """Return the new events: started, underrun, late, concealed, finished, cancelled, error."""
        with self._changed:
            taken = list(self._events)
            self._events.clear()
            return taken

    def wait(self, timeout_s: float = CONNECT_S) -> Self:
        """Wait until the engine has answered.

        Raises
        ------
        ResourceError
            If it does not in time.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._sender.handshake.welcome is not None or self._fault is not None, timeout_s
            )
            if self._fault is not None:
                raise self._fault
            if self._sender.handshake.welcome is None:
                raise ResourceError(
                    f"engine at {self._pipe.name}: no answer within {timeout_s:g} s; does it run there?"
                )
        return self

    def wait_until_finished(self, utterance: int, timeout_s: float | None = None) -> str:
        """Wait until an utterance is over; return how: ``"finished"``, ``"cancelled"``, ``"error"`` or ``"lost"``.

        ``"lost"``: its time is over and no answer came; also if the timeout or the connection ended first.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: utterance in self._ended or self._fault is not None or utterance not in self._sender.live,
                timeout_s,
            )
            return self._ended.get(utterance, "lost")

    def close(self) -> None:
        """Close, as soon as everything sent has arrived; it is still spoken. A second call does nothing."""
        if self._stops:
            return
        with self._changed:
            self._linger()
        self._stops = True
        self._wake()
        self._thread.join()
        self._pipe.close()
        self._wake_in.close()
        self._wake_out.close()

    def _linger(self) -> None:
        """Wait until everything sent has arrived, as long as the engine answers."""
        now_s = begun_s = self._clock()
        while self._fault is None and not self._sender.is_settled() and now_s < begun_s + LINGER_S:
            if now_s - max(begun_s, self._sender.handshake.heard_s) > SILENT_S:
                break
            self._changed.wait(0.1)
            now_s = self._clock()

    @contextmanager
    def _sending(self) -> Iterator[float]:
        if self._stops:
            raise _ClosedError("client: is closed")
        with self._changed:
            if self._fault is not None:
                raise self._fault
            yield self._clock()
        self._wake()

    def _send(self, message: schema.FromSender, *, repeats: bool = False) -> None:
        with self._sending() as now_s:
            self._sender.tell(message, now_s, repeats=repeats)

    def _wake(self) -> None:
        with suppress(BlockingIOError):  # full of wakes that are still to be read
            self._wake_out.send(b"\0")

    def _work(self) -> None:
        try:
            while not self._stops:
                self._send_due()
                with self._changed:
                    wait_s = min(max(self._sender.next_s(self._clock()) - self._clock(), 0.0), IDLE_S)
                self._receive(self._pipe.receive(wait_s, self._wake_in))
                if self._is_away and self._is_lost():
                    # where it has answered, it is gone; where it never has, that port cannot be reached from here
                    self._go(*self._homes[0], follows=self._has_answered, is_away=False)
                elif len(self._homes) > 1 and self._clock() - self._went_s > LOST_S / 2 and self._is_lost():
                    self._homes.rotate(-1)
                    self._go(*self._homes[0], follows=True, is_away=False)
            self._send_due()
        except (OSError, DataError) as error:
            self._fail(ResourceError(f"engine at {self._pipe.name}: the connection is lost ({error})"))
        except ResourceError as error:  # neither the new address nor the known one can be reached
            self._fail(error)
        except UsageError as error:
            self._fail(error)
            raise  # a program's mistake: the thread's hook shows its place

    def _fail(self, fault: ResourceError | UsageError) -> None:
        with self._changed:
            self._fault = fault
            self._changed.notify_all()

    def _send_due(self) -> None:
        with self._changed:
            packets = self._sender.due(self._clock())
            if packets:
                self._changed.notify_all()
        for packet in packets:
            self._pipe.send(packet)

    def _opened(self, host: str, port: int) -> Stream | Datagrams:
        return Stream(host, port, self._framing) if self._framing else Datagrams(host, port)

    def _is_lost(self) -> bool:
        with self._changed:
            return self._pipe.is_refused or self._sender.handshake.is_unanswered(self._clock(), LOST_S)

    def _go(self, host: str, port: int, *, follows: bool, is_away: bool) -> None:
        """Connect to another address."""
        pipe = self._opened(host, port)
        self._pipe.close()
        self._pipe, self._is_away, self._has_answered = pipe, is_away, False
        self._at, self._went_s = (host, port), self._clock()
        often = is_away or len(self._homes) > 1
        with self._changed:
            self._sender.move(self._clock(), follows=follows, ping_s=AWAY_PING_S if often else PING_S)

    def _receive(self, packets: list[bytes]) -> None:
        for packet in packets:
            with self._changed:
                received = self._sender.receive(packet, self._clock())
                moved = next((item for item in received if isinstance(item, schema.Moved)), None)
                self._has_answered |= any(isinstance(item, schema.Welcome) for item in received)
                notices = [item for item in received if isinstance(item, schema.Notice) and item.utterance >= 0]
                for notice in notices:
                    self._events.append(notice)
                    if notice.kind in ("finished", "cancelled", "error") and notice.reason != "checksum":
                        self._note_end(notice.utterance, notice.kind)
                self._changed.notify_all()
            for notice in notices:
                self._call(notice)
            if moved is not None:
                host = moved.host or self._at[0]
                self._go(host, moved.port, follows=True, is_away=(host, moved.port) != self._homes[0])
                return

    def _call(self, notice: schema.Notice) -> None:
        if self._on_event is None:
            return
        try:
            self._on_event(notice)
        except _ClosedError:
            if not self._stops:  # else it sent a command while the client closed
                raise
        except Exception as error:  # it is the user's and may raise anything
            raise UsageError(f"on_event: raised {error!r}") from error

    def _note_end(self, utterance: int, how: str) -> None:
        self._ended.setdefault(utterance, how)
        while len(self._ended) > KEPT_ENDED:
            del self._ended[next(iter(self._ended))]


class _ClosedError(UsageError):
    """A call after the client was closed."""
