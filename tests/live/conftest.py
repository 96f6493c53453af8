"""No server and no socket outlives its test, though it fails."""

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
