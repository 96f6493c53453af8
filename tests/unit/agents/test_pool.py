"""A pool of avatar workers: who may ask for a face, and how many there are. The work is a stand-in."""

import asyncio
from typing import Any

import pytest
from aiohttp import ClientSession, web

from fapengine.agents.pool import Pool
from fapengine.server.web.access import Access

JOB = {"url": "wss://host", "token": "one"}


class StandInWork:
    """Shows a face until it is told to end, or fails."""

    def __init__(self) -> None:
        self.begun: list[tuple[str, str]] = []
        self.ends = asyncio.Event()
        self.cancelled = 0

    async def __call__(self, url: str, token: str) -> None:
        self.begun.append((url, token))
        if token == "wrong":
            raise ConnectionError(url)
        try:
            await self.ends.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise


def asked(*jobs: Any, secret: str | None = None, given: str = "") -> tuple[list[int], StandInWork]:
    async def ask() -> tuple[list[int], StandInWork]:
        work = StandInWork()
        runner = web.AppRunner(Pool(work, 2, Access(secret)).application())
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        host, port = runner.addresses[0][:2]
        found = []
        async with ClientSession(f"http://{host}:{port}", headers={"Authorization": f"Bearer {given}"}) as http:
            for job in jobs:
                async with http.post("/faces", json=job) as answer:
                    found.append(answer.status)
        await runner.cleanup()
        return found, work

    return asyncio.run(ask())


def test_workers_are_taken_until_all_are_busy_and_end_with_the_pool() -> None:
    codes, work = asked(JOB, JOB, JOB)
    assert codes == [201, 201, 503]
    assert work.begun == [("wss://host", "one")] * 2
    assert work.cancelled == 2


def test_a_face_that_fails_frees_its_place(caplog: pytest.LogCaptureFixture) -> None:
    codes, work = asked(*[{**JOB, "token": "wrong"}] * 4, JOB)
    assert codes == [201] * 5
    assert len(work.begun) == 5
    assert "a face ended" in caplog.text


def test_what_is_wrong_is_refused() -> None:
    assert asked({"url": "wss://host"}, [], 3, JOB | {"url": None})[0] == [400] * 4
    assert asked(JOB, secret="secret")[0] == [403]
    assert asked(JOB, secret="secret", given="secret")[0] == [201]
