"""The channel between the parent and a worker: whole messages in order, which may carry open sockets.

It is a pair of Unix sockets that keep message boundaries (SOCK_SEQPACKET, Linux). Messages that cannot be sent at once
wait, except datagrams, which are dropped.
"""

import array
import socket
from collections import deque
from collections.abc import Iterator, Sequence

import msgspec

SESSIONS_AT_ONCE = 1000
"""Sessions in one message."""
READ_AT_ONCE = 512
MAX_WAITING = 10_000
"""Messages that may wait for a worker; beyond that its channel counts as broken."""
BUFFER = 4 << 20
MAX_MESSAGE = 1 << 20


class Message(msgspec.Struct, tag=True, array_like=True):
    """One message."""


class Begin(Message):
    """To a worker: begin."""

    config: bytes
    """Pickled :class:`fapengine.server.config.ServerConfig`."""
    number: int
    """The worker's number, for its log."""
    front_port: int


class Own(Message):
    """To a worker: a session is assigned to it."""

    session: str
    epoch: int


class Until(Message):
    """To a worker: its sessions are surely its own until this monotonic time, or a later one that follows."""

    time_s: float


class Leave(Message):
    """To a worker: leave a session if it is not open."""

    session: str


class Packet(Message):
    """To a worker: a datagram from the known port."""

    address: tuple[str | int, ...]
    """Sender, as the system reports it; longer for IPv6."""
    data: bytes


class Connection(Message):
    """To a worker: a connection, with its socket; nothing was read from it."""

    is_page: bool
    """False: OSC."""
    session: str | None = None
    """Session that the parent has read; None: any process may answer."""


class AskMetrics(Message):
    """To a worker: send the metrics."""


class Ready(Message):
    """From a worker: it is ready."""

    port: int
    """Its own OSC port."""
    sinks: list[str]


class Failed(Message):
    """From a worker: it cannot start."""

    reason: str
    kind: str
    """Class of the error."""


class Sessions(Message):
    """From a worker: sessions that it has opened and closed."""

    opened: list[str]
    closed: list[str]


class Left(Message):
    """From a worker: it has left a session."""

    session: str


class Alive(Message):
    """From a worker: a sign of life."""


class Metrics(Message):
    """From a worker: a part of its metrics; the last part is empty."""

    text: bytes


ToWorker = Own | Until | Leave | Packet | Connection | AskMetrics
FromWorker = Ready | Failed | Sessions | Left | Alive | Metrics
_encode = msgspec.msgpack.Encoder().encode
_decode_to_worker = msgspec.msgpack.Decoder(ToWorker).decode
_decode_from_worker = msgspec.msgpack.Decoder(FromWorker).decode
decode_begin = msgspec.msgpack.Decoder(Begin).decode
"""Reads the first message to a worker."""


class Channel:
    """One end of a channel. Stateful.

    Parameters
    ----------
    end : socket
    is_worker : bool
        True for the worker's end.
    """

    def __init__(self, end: socket.socket, *, is_worker: bool) -> None:
        self._socket = end
        self._decode = _decode_to_worker if is_worker else _decode_from_worker
        self._waiting: deque[tuple[bytes, socket.socket | None]] = deque()
        self.is_broken = False
        """True if the other end is closed."""
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)

    @staticmethod
    def pair() -> tuple[socket.socket, socket.socket]:
        """Open both ends."""
        return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._socket.fileno()

    def put(self, message: Message, handed: socket.socket | None = None) -> bool:
        """Send a message, with a socket, which is then closed here; False if a datagram was dropped."""
        if self.is_broken:
            if handed is not None:
                handed.close()
            return False
        is_datagram = isinstance(message, Packet)
        if is_datagram and self._waiting:
            return False
        self._waiting.append((_encode(message), handed))
        self.flush()
        if is_datagram and self._waiting:
            self._waiting.clear()
            return False
        if len(self._waiting) > MAX_WAITING:
            self._break()
        return not self.is_broken

    def flush(self) -> None:
        """Send waiting messages as far as there is room."""
        while self._waiting:
            data, handed = self._waiting[0]
            try:
                socket.send_fds(self._socket, [data], [] if handed is None else [handed.fileno()])
            except BlockingIOError:
                return
            except OSError:
                self._break()
                return
            self._waiting.popleft()
            if handed is not None:
                handed.close()

    def take(self) -> Iterator[tuple[ToWorker | FromWorker, socket.socket | None]]:
        """Read the received messages, each with its socket."""
        for _ in range(READ_AT_ONCE):
            try:
                data, rights, _, _ = self._socket.recvmsg(MAX_MESSAGE, socket.CMSG_SPACE(4), socket.MSG_CMSG_CLOEXEC)
            except BlockingIOError:
                return
            except OSError:
                data, rights = b"", []
            if not data:
                self._break()
                return
            yield self._decode(data), _handed(rights)

    def close(self) -> None:
        """Close this end."""
        self._break()
        self._socket.close()

    def _break(self) -> None:
        self.is_broken = True
        for _, handed in self._waiting:
            if handed is not None:
                handed.close()
        self._waiting.clear()


def _handed(rights: Sequence[tuple[int, int, bytes]]) -> socket.socket | None:
    for level, kind, data in rights:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS) and len(data) >= array.array("i").itemsize:
            return socket.socket(fileno=int(array.array("i", data[:4])[0]))
    return None
