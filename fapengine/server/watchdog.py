"""The watchdog: a small process that returns all faces to neutral if the server is killed.

Theory of operation
-------------------
Before the server opens anything, it forks a copy that only reads from a pipe. The server sends the names of the open
sessions, and a goodbye at a regular end (messages of :mod:`fapengine._child`). If the pipe ends without a goodbye, the
server was killed and its datagram sinks may show an open mouth forever; then the copy sends each of them a neutral
face, and ends too. Receivers with a connection (pages, streams) notice its end themselves. A system that cannot fork
starts a child process instead.
"""

import contextlib
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fapengine._child import Child, Message, Parent, command, ignore_signals, messages, packed
from fapengine.errors import ResourceError
from fapengine.host.listeners import HubFrames
from fapengine.mpeg4 import fap
from fapengine.server.sinks.kinds import SinkAddress, kind_of, parse_sink
from fapengine.server.sinks.opening import Post, encoder_of

RESTS, REST_S = 3, 0.02
"""Number of times that the last frame is sent, and the time between them: datagrams get lost."""
AHEAD_FRAMES = 120
"""Distance of the last frame's number from the number shown last: no receiver may treat it as a late frame."""


@dataclass(slots=True)
class Watchdog:
    """The server's end of the pipe; a context manager, made by :func:`start_watchdog`. Stateful."""

    process: int
    pipe: int
    child: Child | None = None
    """The process, if it was not forked."""
    _sent: tuple[str, ...] = field(default=(), repr=False)
    _begun: bytes = field(default=b"", repr=False)
    """Rest of a message that was partly written."""
    _waiting: bytes = field(default=b"", repr=False)
    """The next message; a newer one replaces it."""

    def __enter__(self) -> "Watchdog":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.end(is_good=kind is None)

    def tell(self, sessions: tuple[str, ...]) -> None:
        """Send the names of the open sessions if they have changed. Never blocks."""
        if sessions != self._sent:
            self._sent, self._waiting = sessions, packed({"sessions": sessions})
        with contextlib.suppress(BlockingIOError):
            while self._begun or self._waiting:
                if not self._begun:
                    self._begun, self._waiting = self._waiting, b""
                self._begun = self._begun[os.write(self.pipe, self._begun) :]

    def end(self, *, is_good: bool = True) -> None:
        """End the watchdog; unless the end is good, it returns the faces to neutral now."""
        with contextlib.suppress(OSError):  # pipes of Windows always block (before Python 3.12)
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
    """Fork the watchdog; call it before sockets are opened and threads started.

    Raises UsageError if a sink's URL is not valid.

    Parameters
    ----------
    sinks : sequence of str
        URLs.
    rate_hz : float
        Frame rate.
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
                watch(messages(stream), lambda sessions: send_neutral(addresses, sessions, rate_hz))
            status = 0
        finally:
            os._exit(status)
    os.close(reading)
    os.set_blocking(writing, False)
    return Watchdog(process, writing)


def main(parent: Parent, rate_hz: str, *sinks: str) -> None:
    """Run the watchdog as a child process."""
    ignore_signals(signal.SIGTERM)
    addresses = [parse_sink(url) for url in sinks]
    watch(parent.messages(), lambda sessions: send_neutral(addresses, sessions, float(rate_hz)))


def watch(received: Iterable[Message], rest: Callable[[dict[str, float]], None]) -> None:
    """Read messages to the end; without a goodbye, call ``rest``.

    Parameters
    ----------
    received : iterable of Message
        Messages of the server.
    rest : callable
        Called with each open session and the monotonic time at which it was first reported.
    """
    sessions: dict[str, float] = {}
    for head, _ in received:
        if "bye" in head:
            return
        sessions = {name: sessions.get(name, time.monotonic()) for name in head["sessions"]}
    if sessions:
        rest(sessions)


def send_neutral(
    addresses: Sequence[SinkAddress],
    sessions: Mapping[str, float],
    rate_hz: float,
    epochs: Mapping[str, int] | None = None,
) -> None:
    """Send every datagram sink a neutral face; for a face stream, as an I plane.

    Parameters
    ----------
    addresses : sequence of SinkAddress
        Sinks; those of a session that is not given are skipped.
    sessions : mapping of str to float
        Sessions that were open, each with the monotonic time at which it opened.
    rate_hz : float
        Frame rate.
    epochs : mapping of str to int, optional
        Epochs of the sessions.
    """
    now_s = time.monotonic()
    numbers = {name: round((now_s - since_s) * rate_hz) + AHEAD_FRAMES for name, since_s in sessions.items()}
    faps = np.zeros((len(sessions), fap.FAP_COUNT), np.int32)
    frames = HubFrames(max(numbers.values(), default=0), now_s, tuple(sessions), faps)
    for address in addresses:
        if kind_of(address).medium != "datagrams" or address.session not in (None, *sessions):
            continue  # receivers of other kinds see the end of their connection
        encoder = encoder_of(address, rate_hz, epochs)
        encoder.resume(numbers)
        datagrams = encoder.encode(frames)
        with contextlib.suppress(ResourceError):
            post = Post(address.host, address.port)
            for _ in range(RESTS):
                post.send(datagrams)
                time.sleep(REST_S)
            post.close()
