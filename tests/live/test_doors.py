"""Who comes in and who is hung up on: limits of connections, silence, names, and what answers give away."""

import asyncio
import contextlib
import io
import logging
import re
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest

from fapengine.server.config import Listen
from fapengine.server.intake import listeners
from fapengine.server.logs import begin_log
from fapengine.server.server import Server
from fapengine.server.web import site as web_site
from fapengine.wire import osc
from fapengine.wire.framing import encode_slip
from tests.live.stage import config_of, on_a_loop, running, until
from tests.processes import start

HALF_A_REQUEST = b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "


class Guests:
    """Connections that are closed at the end.

    Stateful.
    """

    def __init__(self) -> None:
        self._writers: list[asyncio.StreamWriter] = []

    async def come(self, site: tuple[str, int], data: bytes = b"", host: str = "127.0.0.1") -> asyncio.StreamReader:
        reader, writer = await asyncio.open_connection(*site, local_addr=(host, 0))
        self._writers.append(writer)
        writer.write(data)
        return reader

    def say(self, data: bytes) -> None:
        """What the last one says."""
        self._writers[-1].write(data)

    async def go(self) -> None:
        for writer in self._writers:
            writer.close()
        for writer in self._writers:
            with contextlib.suppress(OSError):
                await writer.wait_closed()


@asynccontextmanager
async def guests_of() -> AsyncIterator[Guests]:
    guests = Guests()
    try:
        yield guests
    finally:
        await guests.go()


@asynccontextmanager
async def watched(token: str | None = None, **limits: int) -> AsyncIterator[tuple[Server, tuple[str, int]]]:
    """A server with metrics, and where they are."""
    listen = Listen(port=0, web_port=None, metrics_port=0, token=token)
    async with running(replace(config_of(**limits), listen=listen)) as server:
        (site,) = server.sites
        yield server, site


async def ask(site: tuple[str, int], *lines: str) -> tuple[str, dict[str, str]]:
    """Status line and headers of an answer."""
    reader, writer = await asyncio.open_connection(*site)
    writer.write("\r\n".join([*lines, "", ""]).encode())
    status, *headers = (await reader.readuntil(b"\r\n\r\n")).decode().strip().split("\r\n")
    writer.close()
    await writer.wait_closed()
    return status, dict(header.split(": ", 1) for header in headers)


async def is_hung_up_on(reader: asyncio.StreamReader) -> bool:
    with contextlib.suppress(ConnectionResetError):
        return await reader.read() == b""
    return True


async def is_told_that_it_is_full(reader: asyncio.StreamReader) -> bool:
    answer = await reader.read()
    return answer.startswith(b"HTTP/1.1 503 ") and b"Retry-After: 5" in answer and b"nosniff" in answer


def test_a_request_that_never_ends_and_a_silence_are_hung_up_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_site, "IDLE_S", 0.2)

    async def main() -> None:
        async with watched() as (server, site), guests_of() as guests:
            silent = await guests.come(site)
            slow = await guests.come(site, HALF_A_REQUEST)
            assert await is_hung_up_on(silent)
            assert await is_hung_up_on(slow)
            done = await guests.come(site, HALF_A_REQUEST + b"1\r\n\r\n")
            assert (await done.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200")
            with contextlib.suppress(ConnectionResetError):
                await done.read()  # the answer, then the end: nothing more was asked
            await until(lambda: server.doors["metrics"].counts.open == 0)
            assert server.doors["metrics"].counts.timed_out == 3

    on_a_loop(main)


def test_one_address_cannot_take_all_places() -> None:
    async def main() -> None:
        async with watched(connections=5, connections_per_address=3) as (server, site), guests_of() as guests:
            counts = server.doors["metrics"].counts
            for _ in range(3):
                await guests.come(site)
            assert await is_told_that_it_is_full(await guests.come(site))
            for _ in range(2):
                await guests.come(site, host="127.0.0.2")
            await until(lambda: counts.open == 5)
            assert await is_told_that_it_is_full(await guests.come(site, host="127.0.0.3"))
            await guests.go()
            await until(lambda: counts.open == 0)
            assert counts.refused == 2
            assert (await ask(site, "GET /metrics HTTP/1.1", "Host: 127.0.0.1"))[0] == "HTTP/1.1 200 OK"

    on_a_loop(main)


def test_streams_that_say_nothing_give_their_place_to_one_that_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "FIRST_S", 0.2)
    monkeypatch.setattr(listeners, "IDLE_S", 0.6)

    async def main() -> None:
        async with running(config_of(streams=2)) as server, guests_of() as guests:
            counts = server.doors["osc"].counts
            for silent in [await guests.come(server.osc_address) for _ in range(2)]:
                assert await is_hung_up_on(silent)
            assert (counts.open, counts.timed_out) == (0, 2)
            hello = encode_slip(osc.message("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 3))
            speaks = await guests.come(server.osc_address, hello)
            for _ in range(4):
                assert await speaks.read(4096)
                await asyncio.sleep(0.2)
                guests.say(hello)
            assert (counts.open, counts.timed_out) == (1, 2)  # it spoke, if not often
            while await speaks.read(4096):
                pass
            assert (counts.open, counts.timed_out) == (0, 3)

    on_a_loop(main)


def test_metrics_are_kept_from_pages_of_other_names_and_from_wrong_tokens() -> None:
    async def main() -> None:
        async with watched() as (_, site):
            assert (await ask(site, "GET /metrics HTTP/1.1", "Host: evil.example"))[0] == "HTTP/1.1 403 Forbidden"
            foreign = await ask(site, "GET /metrics HTTP/1.1", "Host: 127.0.0.1", "Origin: http://evil.example")
            assert foreign[0] == "HTTP/1.1 403 Forbidden"
        async with watched(token="tö") as (_, site):
            for word, status in (("t", "403 Forbidden"), ("tö", "200 OK"), ("", "403 Forbidden")):
                told = await ask(site, "GET /metrics HTTP/1.1", "Host: evil.example", f"Authorization: Bearer {word}")
                assert told[0] == f"HTTP/1.1 {status}"

    on_a_loop(main)


@pytest.mark.parametrize("asked", ["GET /nothing HTTP/1.1", "GET /metrics HTTP/1.1", "GET", "PUT /metrics HTTP/1.1"])
def test_every_answer_is_guarded_and_tells_no_version(asked: str) -> None:
    async def main() -> None:
        async with watched() as (_, site):
            _, headers = await ask(site, asked, "Host: 127.0.0.1")
        assert headers["Server"] == "fapengine"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert "default-src 'self'" in headers["Content-Security-Policy"]

    on_a_loop(main)


def test_more_connections_than_files_are_refused_and_senders_are_heard() -> None:
    command = [sys.executable, "-m", "fapengine", "serve", "--port", "0", "--no-page", "--metrics-port", "0"]
    few_files = ["sh", "-c", 'ulimit -Sn 64 && ulimit -Hn 200 && exec "$@"', "sh", *command]

    with (
        start(few_files, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server,
        contextlib.ExitStack() as held,
    ):
        lines = [server.stdout.readline() for _ in range(2)]
        osc_port, metrics_port = (int(re.search(r":(\d+)", line)[1]) for line in lines)
        for _ in range(250):
            one = held.enter_context(socket.create_connection(("127.0.0.1", metrics_port)))
            with contextlib.suppress(ConnectionError):
                one.sendall(HALF_A_REQUEST)
        with socket.create_connection(("127.0.0.1", osc_port), timeout=300.0) as sender:
            sender.sendall(encode_slip(osc.message("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 3)))
            assert b"/fap/1/welcome" in sender.recv(4096)
        server.terminate()
        _, told = server.communicate(timeout=300)
        assert server.returncode == 0
        assert "Traceback" not in told
        assert len(told) < 1000


def test_a_log_line_that_repeats_itself_is_counted() -> None:
    stream, log = io.StringIO(), logging.getLogger("fapengine.test")
    handler = begin_log("info", "text", stream)
    try:
        for n in range(1000):
            log.warning("a text was not spoken: %d", n)
        log.warning("another")
        later = logging.makeLogRecord({"name": log.name, "levelno": logging.WARNING, "levelname": "WARNING"})
        later.msg, later.args, later.created = "a text was not spoken: %d", (1000,), later.created + 11.0
        handler.handle(later)
    finally:
        logging.getLogger("fapengine").removeHandler(handler)
    lines = [line.split("warning: ")[1] for line in stream.getvalue().splitlines()]
    assert lines == [*(f"a text was not spoken: {n}" for n in range(5)), "another",
                     "a text was not spoken: 1000 (995 more like it before)"]  # fmt: skip
