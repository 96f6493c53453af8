"""The watchdog: a small process that outlives the server by a moment; if that is killed, it puts the faces to rest.

Theory of operation
-------------------
Before the server opens anything it is forked: a copy that only reads from a pipe. The server sends which sessions are
open, and at its good end that it is over (messages of :mod:`fapengine._child`). If the pipe ends without that, the
server was killed, and its datagram sinks may show an open mouth for ever; then the copy sends each of them a face at
rest, and ends too. What needs a connection (pages, streams) sees that it is gone, and is left alone. A system that
cannot fork starts a child process in its place.
"""

import contextlib
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np

from fapengine._child import Child, Message, Parent, command, ignore_signals, messages, packed
from fapengine.errors import ResourceError
from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.server.sinks.address import SinkAddress
from fapengine.server.sinks.datagrams import Post
from fapengine.server.sinks.kinds import DatagramKind, kind_of, parse_sink

RESTS, REST_S = 3, 0.02
"""Number of times that the last frame is sent, and seconds between them: datagrams get lost."""
AHEAD_FRAMES = 120
"""Distance of the last frame's number from the number shown: no receiver may take it for a late frame."""


@dataclass(slots=True)
class Watchdog:
    """The server's end of the pipe, and a context manager. Made by :func:`start_watchdog`.

    Stateful.
    """

    process: int
    pipe: int
    child: Child | None = None
    """The process, where it was not forked."""
    _told: tuple[str, ...] = field(default=(), repr=False)
    _begun: bytes = field(default=b"", repr=False)
    """Rest of a message that the pipe has taken a part of."""
    _waiting: bytes = field(default=b"", repr=False)
    """Message that follows; a newer one takes its place."""

    def __enter__(self) -> "Watchdog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end(is_good=kind is None)

    def tell(self, sessions: tuple[str, ...]) -> None:
        """Write down which sessions are open, if that has changed. Never waits."""
        if sessions != self._told:
            self._told, self._waiting = sessions, packed({"sessions": sessions})
        with contextlib.suppress(BlockingIOError):
            while self._begun or self._waiting:
                if not self._begun:
                    self._begun, self._waiting = self._waiting, b""
                self._begun = self._begun[os.write(self.pipe, self._begun) :]

    def end(self, *, is_good: bool = True) -> None:
        """Say that the server is over, if the faces were put to rest; else the watchdog does it now."""
        with contextlib.suppress(OSError):  # as it was, where pipes of Windows always wait (before Python 3.12)
            os.set_blocking(self.pipe, True)
        with contextlib.suppress(BrokenPipeError):
            os.write(self.pipe, self._begun + self._waiting + packed({"bye": True}) * is_good)
        os.close(self.pipe)
        if self.child is not None:
            self.child.process.wait()
            self.child.close()
        else:
            os.waitpid(self.process, 0)


def start_watchdog(sinks: Sequence[str], rate_hz: float) -> Watchdog:
    """Fork it off; to be called before sockets and threads are there.

    Parameters
    ----------
    sinks : sequence of str
        URLs, as for the server.
    rate_hz : float
        Frames a second.

    Raises
    ------
    UsageError
        If a sink's URL cannot be understood.
    """
    addresses = [parse_sink(url) for url in sinks]
    if not hasattr(os, "fork"):
        child = Child("watchdog", command(__name__, str(rate_hz), *sinks), waits=False)
        return Watchdog(child.process.pid, child.take_input(), child)
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of BLAS: it brings its own handlers for fork
        process = os.fork()
    if not process:
        os.close(writing)
        status = 1
        try:
            ignore_signals(signal.SIGTERM)
            with os.fdopen(reading, "rb") as stream:
                watch(messages(stream), lambda sessions: put_to_rest(addresses, sessions, rate_hz))
            status = 0
        finally:
            os._exit(status)
    os.close(reading)
    os.set_blocking(writing, False)
    return Watchdog(process, writing)


def main(parent: Parent, rate_hz: str, *sinks: str) -> None:
    """Be the process, where it was not forked."""
    ignore_signals(signal.SIGTERM)
    addresses = [parse_sink(url) for url in sinks]
    watch(parent.messages(), lambda sessions: put_to_rest(addresses, sessions, float(rate_hz)))


def watch(received: Iterable[Message], rest: Callable[[dict[str, float]], None]) -> None:
    """Read to the end; if the server did not say that it is over, put to rest what was open.

    Parameters
    ----------
    received : iterable of Message
        What the server sends.
    rest : callable
        Takes each open session, with the monotonic time since when it is known.
    """
    sessions: dict[str, float] = {}
    for head, _ in received:
        if "bye" in head:
            return
        sessions = {name: sessions.get(name, time.monotonic()) for name in head["sessions"]}
    if sessions:
        rest(sessions)


def put_to_rest(
    addresses: Sequence[SinkAddress],
    sessions: Mapping[str, float],
    rate_hz: float,
    epochs: Mapping[str, int] | None = None,
) -> None:
    """Send every datagram sink a face at rest; a face stream, an I plane of it.

    Parameters
    ----------
    addresses : sequence of SinkAddress
        Sinks; those of one face that names none of the sessions are left alone.
    sessions : mapping of str to float
        Sessions that were open, each with the monotonic time since when.
    rate_hz : float
        Frames a second.
    epochs : mapping of str to int, optional
        Of the sessions, where they have such.
    """
    now_s = time.monotonic()
    numbers = {name: round((now_s - since_s) * rate_hz) + AHEAD_FRAMES for name, since_s in sessions.items()}
    faps = np.zeros((len(sessions), fap.FAP_COUNT), np.int32)
    frames = HubFrames(max(numbers.values(), default=0), now_s, tuple(sessions), faps)
    for address in addresses:
        kind = kind_of(address)
        if not isinstance(kind, DatagramKind) or address.session not in (None, *sessions):
            continue  # a receiver of another kind sees that its connection is gone
        encoder = kind.encoder(address, rate_hz, epochs)
        encoder.resume(numbers)
        datagrams = encoder.encode(frames)
        with contextlib.suppress(ResourceError):
            post = Post(address.host, address.port)
            for _ in range(RESTS):
                post.send(datagrams)
                time.sleep(REST_S)
            post.close()
