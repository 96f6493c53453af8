"""Programs that tests start: none outlives the tests, even if these are killed. And ports for them."""

import ctypes
import itertools
import os
import signal
import socket
import subprocess
from collections.abc import Sequence
from typing import Any

PR_SET_PDEATHSIG = 1
PORTS = range(20_000, 30_000)
"""Below the ports that systems choose for connections and for port 0: no socket of another test takes one of these."""
NEXT = itertools.count(os.getpid() * 100)
"""Position in ``PORTS`` of the next port; processes begin at different ones."""


def end_with_parent() -> None:
    """Have the kernel end this process when its parent ends. For ``preexec_fn``.

    It also hears Ctrl-C again, which shells switch off for what they run in the background.
    """
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def free_port() -> int:
    """A port on which nothing listens, by TCP or UDP; it stays free until the test uses it."""
    while True:
        port = PORTS[next(NEXT) % len(PORTS)]
        with socket.socket() as stream, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
            try:
                stream.bind(("127.0.0.1", port))
                datagrams.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a program as ``subprocess.Popen`` does; it ends with this process."""
    return subprocess.Popen(command, preexec_fn=end_with_parent, **options)
