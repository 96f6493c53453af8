"""The watchdog, a small process that outlives the server by a moment: if that is killed, it puts the faces to rest.

Theory of operation
-------------------
Before the server opens anything it is forked: a copy that only reads from a pipe. The server writes down which sessions
are open, and at its good end ``bye``. If the pipe ends without that, the server was killed, and its datagram sinks may
show an open mouth for ever; then the copy sends each of them a face at rest, and ends too. What needs a connection
(pages, streams) sees that it is gone, and is left alone. A system that cannot fork starts a program in its place.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np

from fapengine.errors import ResourceError
from fapengine.live.hub.messages import HubFrames
from fapengine.live.server.frame_encoders import OscFrameEncoder, continued
from fapengine.live.server.sink_address import FILMS, SOCKETS, SinkAddress, parse_sink
from fapengine.live.server.sinks import Post, encoder_of
from fapengine.mpeg4 import fap

RESTS, REST_S = 3, 0.02
"""Number of times that the last frame is sent, and seconds between them: datagrams get lost."""
AHEAD_FRAMES = 120
"""Distance of the last frame's number from the number shown: no receiver may take it for a late frame."""
CONNECTED = ("fba+tcp", *SOCKETS)
"""Sinks that the guard leaves alone: their connection is gone. Over RTP a stream of another SSRC begins, at rest."""
BYE = b"bye\n"


@dataclass(slots=True)
class Watchdog:
    """The server's end of the pipe, and a context manager. Made by :func:`start_watchdog`.

    Stateful.
    """

    process: int
    pipe: int
    program: "subprocess.Popen[bytes] | None" = None
    """The process, where it was not forked."""
    _told: tuple[str, ...] = field(default=(), repr=False)
    _late: bytes = field(default=b"", repr=False)

    def __enter__(self) -> "Watchdog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end(is_good=kind is None)

    def tell(self, sessions: tuple[str, ...]) -> None:
        """Write down which sessions are open, if that has changed. Never waits."""
        if sessions != self._told:
            self._told = sessions
            self._late = self._late.partition(b"\n")[0] if self._late else b""
            self._late += b"\n" * bool(self._late) + json.dumps(sessions).encode() + b"\n"
        if self._late:
            with contextlib.suppress(BlockingIOError):
                self._late = self._late[os.write(self.pipe, self._late) :]

    def end(self, *, is_good: bool = True) -> None:
        """Say goodbye, if the faces were put to rest in good order; else the guard does it now."""
        with contextlib.suppress(OSError):  # as it was, where pipes of Windows always wait (before Python 3.12)
            os.set_blocking(self.pipe, True)
        with contextlib.suppress(BrokenPipeError):
            os.write(self.pipe, self._late + BYE * is_good)
        os.close(self.pipe)
        if self.program is not None:
            self.program.wait()
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
    addresses = [address for address in map(parse_sink, sinks) if address.kind not in FILMS]
    if not hasattr(os, "fork"):
        return _start_program(sinks, rate_hz)
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of BLAS: it brings its own handlers for fork
        process = os.fork()
    if not process:
        os.close(writing)
        status = 1
        try:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, signal.SIG_IGN)  # the server is told, and tells
            watch(reading, lambda sessions: put_to_rest(addresses, sessions, rate_hz))
            status = 0
        finally:
            os._exit(status)
    os.close(reading)
    os.set_blocking(writing, False)
    return Watchdog(process, writing)


def _start_program(sinks: Sequence[str], rate_hz: float) -> Watchdog:
    """Start it as a program of its own, in a group that Ctrl-C does not reach."""
    command = [sys.executable, "-m", __name__, str(rate_hz), *sinks]
    group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    program = subprocess.Popen(command, stdin=subprocess.PIPE, creationflags=group)
    assert program.stdin is not None
    pipe = os.dup(program.stdin.fileno())
    program.stdin.close()
    with contextlib.suppress(OSError):
        os.set_blocking(pipe, False)
    return Watchdog(program.pid, pipe, program)


def _main(rate_hz: str, *sinks: str) -> None:
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    addresses = [address for address in map(parse_sink, sinks) if address.kind not in FILMS]
    watch(sys.stdin.fileno(), lambda sessions: put_to_rest(addresses, sessions, float(rate_hz)))


def watch(pipe: int, rest: Callable[[dict[str, float]], None]) -> None:
    """Read until the pipe ends; without a goodbye, put to rest what was open.

    Parameters
    ----------
    pipe : int
        File descriptor.
    rest : callable
        Takes each open session, with the monotonic time at which it was first told of.
    """
    sessions: dict[str, float] = {}
    with os.fdopen(pipe, "rb") as lines:
        for line in lines:
            if line == BYE:
                return
            with contextlib.suppress(ValueError):  # cut by the end
                sessions = {name: sessions.get(name, time.monotonic()) for name in json.loads(line)}
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
        if address.kind in CONNECTED or address.session not in (None, *sessions):
            continue
        encoder = encoder_of(address, rate_hz, epochs)
        if isinstance(encoder, OscFrameEncoder):
            encoder.begin_at(numbers)
        datagrams = encoder.encode(frames)
        if address.kind == "fba":
            datagrams = [continued(plane) for plane in datagrams]
        with contextlib.suppress(ResourceError):
            post = Post(address.host, address.port)
            for _ in range(RESTS):
                post.send(datagrams)
                time.sleep(REST_S)
            post.close()


if __name__ == "__main__":
    _main(*sys.argv[1:])
