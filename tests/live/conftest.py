"""No server and no socket outlives its test, though it fails."""

import socket
from collections.abc import Iterator

import pytest

from tests.live.stage import OPENED, STARTED


@pytest.fixture(autouse=True)
def _nothing_runs_on() -> Iterator[None]:
    yield
    while STARTED:
        process = STARTED.pop()
        process.kill()
        process.wait()
    while OPENED:
        OPENED.pop().close()


@pytest.fixture
def free_port() -> int:
    """A TCP port of the loopback at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
