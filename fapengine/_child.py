"""Child processes: starting them, exchanging messages, and ending them.

Theory of operation
-------------------
A child is a module of this package with a function ``main(parent, *arguments)``. It reads messages from its standard
input and writes messages to its standard output, so it ends with its input, however its parent ends. A message is two
lengths (``<II``, bytes), a JSON object and raw bytes: any Python reads it with its standard library alone, which the
face detector needs (:mod:`fapengine.files.detector_program`).

One policy for all: a child imports from where its parent does, never from the working directory. It is in a process
group of its own and ignores Ctrl-C, which its parent handles for it. Its niceness may be higher than its parent's.
What a library prints goes to standard error. A child that fails on purpose sends its error, which the parent raises. A
child has nothing to save, so it is ended by a kill.
"""

import contextlib
import json
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, BinaryIO, cast

from fapengine.errors import FapEngineError, ResourceError

LENGTHS = struct.Struct("<II")
"""Bytes of the JSON object, and bytes of the data."""
NICENESS = 10
"""Niceness of children that must not slow down faces."""
START = "import sys; sys.path[:] = {path!r}; from fapengine._child import run; run()"
PIPE_BYTES = 1 << 20
"""Requested size of pipes; the usual 64 KiB cut an image into many small pieces."""
LOOK_S = 0.5
"""Interval at which a child checks for its parent."""
BACK_OFF_S = (0.0, 0.5)
"""Times from the first and the second failure in a row to the next start; the third failure is the last."""
WORK = 50
"""Pieces of work, such as images, after which a failure is forgotten: 2 s at 25 per second."""

Head = dict[str, Any]
Message = tuple[Head, bytes]


def packed(head: Mapping[str, Any], data: bytes = b"") -> bytes:
    r"""Write a message.

    Examples
    --------
    >>> packed({"end": 1}, b"ab")
    b'\n\x00\x00\x00\x02\x00\x00\x00{"end": 1}ab'
    """
    text = json.dumps(head).encode()
    return LENGTHS.pack(len(text), len(data)) + text + data


def read_message(stream: BinaryIO) -> Message | None:
    """Wait for a message; None if the stream ends before it is whole."""
    lengths = stream.read(LENGTHS.size)
    if len(lengths) < LENGTHS.size:
        return None
    size, data_size = LENGTHS.unpack(lengths)
    text, data = stream.read(size), stream.read(data_size)
    return (json.loads(text), data) if len(text) == size and len(data) == data_size else None


def messages(stream: BinaryIO) -> Iterator[Message]:
    """Wait for messages until the stream ends."""
    while (message := read_message(stream)) is not None:
        yield message


def unpacked(received: bytearray) -> Iterator[Message]:
    """Remove complete messages from the beginning of the received bytes."""
    while len(received) >= LENGTHS.size:
        size, data_size = LENGTHS.unpack_from(received)
        end = LENGTHS.size + size + data_size
        if len(received) < end:
            return
        text = received[LENGTHS.size : LENGTHS.size + size]
        data = bytes(received[LENGTHS.size + size : end])
        del received[:end]
        yield json.loads(text), data


def command(module: str, *arguments: str, niceness: int = 0) -> list[str]:
    """Command that starts a module of this package as a child."""
    return [sys.executable, "-c", START.format(path=sys.path), module, str(niceness), *arguments]


class Child:
    """The parent's end of a child process. Stateful; close it.

    Parameters
    ----------
    name : str
        For error messages.
    command : sequence of str
        See :func:`command`.
    waits : bool
        True: :meth:`ask` waits for answers. False: :meth:`put` and :meth:`poll` do not wait.
    is_quiet : bool
        True if what it writes to standard error is dropped.
    environment : mapping, optional
        Variables to set.

    Raises
    ------
    ResourceError
        If no process can be started.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        *,
        waits: bool = True,
        is_quiet: bool = False,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        try:
            self.process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=-1 if waits else 0, process_group=0,
                stderr=subprocess.DEVNULL if is_quiet else None, env={**os.environ, **(environment or {})},
            )  # fmt: skip
        except OSError as error:
            raise ResourceError(f"{name}: its process cannot be started: {error.strerror or error}") from error
        self._in, self._out = cast("BinaryIO", self.process.stdin), cast("BinaryIO", self.process.stdout)
        self._unsent, self._received = b"", bytearray()
        _widen(self._out.fileno())
        if not waits:
            for pipe in (self._in, self._out):
                os.set_blocking(pipe.fileno(), False)

    @property
    def is_alive(self) -> bool:
        """False once it has ended."""
        return self.process.poll() is None

    def ask(self, head: Mapping[str, Any], data: bytes = b"") -> Message:
        """Send a message and wait for the answer.

        Raises
        ------
        EOFError
            If the child has ended.
        FapEngineError
            The error that it sent.
        """
        with contextlib.suppress(OSError, ValueError):  # it has ended, or was closed
            self._in.write(packed(head, data))
            self._in.flush()
        try:
            message = read_message(self._out)
        except ValueError:  # closed
            message = None
        if message is None:
            raise EOFError
        return _checked(message)

    def put(self, head: Mapping[str, Any], data: bytes = b"") -> None:
        """Add a message to what is sent by :meth:`flush`."""
        self._unsent += packed(head, data)

    def flush(self) -> bool:
        """Send what the pipe accepts now; True if nothing remains.

        Raises
        ------
        ResourceError
            If the child has ended.
        """
        try:
            while self._unsent:
                self._unsent = self._unsent[os.write(self._in.fileno(), self._unsent) :]
        except BlockingIOError:
            return False
        except OSError as error:
            raise self._ended() from error
        return True

    def poll(self) -> list[Message]:
        """Return the messages that have arrived.

        Raises
        ------
        ResourceError
            If the child has ended.
        FapEngineError
            The error that it sent.
        """
        is_over = False
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._out.fileno(), 1 << 16):
                self._received += data
            is_over = True
        messages = [_checked(message) for message in unpacked(self._received)]
        if is_over and not messages:
            raise self._ended()
        return messages

    def take_input(self) -> int:
        """Return the file descriptor of the pipe to the child, which the caller must close."""
        taken = os.dup(self._in.fileno())
        self._in.close()
        with contextlib.suppress(OSError):  # pipes of Windows always wait (before Python 3.12)
            os.set_blocking(taken, False)
        return taken

    def kill(self) -> None:
        """End it at once; :meth:`ask` raises EOFError then."""
        self.process.kill()

    def close(self) -> None:
        """End it, and wait for its end. Closing again does nothing."""
        self.process.kill()
        self.process.wait()
        for pipe in (self._in, self._out):
            with contextlib.suppress(OSError):  # what was not sent
                pipe.close()

    def _ended(self) -> ResourceError:
        return ResourceError(f"{self.name}: its process has ended (code {self.process.poll()})")


class Restarts:
    """When a child that has ended is started again: at once, then later, after three failures in a row never. Stateful.

    A child that ends before it has done :data:`WORK` has failed again, even if it has worked.

    Examples
    --------
    >>> restarts = Restarts()
    >>> restarts.failed(), restarts.failed(), restarts.failed()
    (0.0, 0.5, None)
    >>> for _ in range(WORK):
    ...     restarts.worked()
    >>> restarts.failed()
    0.0
    """

    def __init__(self) -> None:
        self._failures = self._done = 0

    def failed(self) -> float | None:
        """Count an end; return the time to the next start, s, or None."""
        self._failures, self._done = self._failures + 1, 0
        return BACK_OFF_S[self._failures - 1] if self._failures <= len(BACK_OFF_S) else None

    def worked(self) -> None:
        """Count a piece of work."""
        self._done += 1
        if self._done >= WORK:
            self._failures = 0


def _checked(message: Message) -> Message:
    head, data = message
    if head.get("failed"):
        raise pickle.loads(data)
    return message


def _widen(file: int) -> None:
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(file, fcntl.F_SETPIPE_SZ, PIPE_BYTES)


# In the child -------------------------------------------------------------------------------------------------------


class Parent:
    """The child's end. Stateful."""

    def __init__(self, reads: BinaryIO, writes: BinaryIO) -> None:
        self._reads, self._writes = reads, writes

    def messages(self) -> Iterator[Message]:
        """Wait for messages until the parent ends or closes."""
        return messages(self._reads)

    def tell(self, head: Mapping[str, Any], data: bytes = b"") -> None:
        """Send a message."""
        self._writes.write(packed(head, data))
        self._writes.flush()

    def fail(self, error: FapEngineError) -> None:
        """Send an error, which the parent raises."""
        self.tell({"failed": True}, pickle.dumps(error))


def ignore_signals(*others: int) -> None:
    """Ignore Ctrl-C, the end of the terminal and other signals, which the parent handles."""
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT), *others):
        signal.signal(number, signal.SIG_IGN)


def end_soon_with_parent() -> None:
    """End within a second of the parent, also in the middle of work: for children with long work."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run() -> None:
    """Run a child: its module, niceness and arguments are those of the command."""
    module, niceness, *arguments = sys.argv[1:]
    ignore_signals()
    if hasattr(os, "nice"):
        os.nice(int(niceness))
    parent = Parent(sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb"))
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    main = cast("Callable[..., int | None]", import_module(module).main)
    with contextlib.suppress(BrokenPipeError):
        try:
            sys.exit(main(parent, *arguments))
        except FapEngineError as error:
            parent.fail(error)
