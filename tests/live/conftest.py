"""No server outlives its test."""

from collections.abc import Iterator

import pytest

from tests.live.stage import STARTED


@pytest.fixture(autouse=True)
def _nothing_runs_on() -> Iterator[None]:
    yield
    while STARTED:
        process = STARTED.pop()
        process.kill()
        process.wait()
