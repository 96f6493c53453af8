"""Connections that keep the server waiting, on virtual time, and the cost of those whose beginning is incomplete."""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from aiohttp import web

from fapengine.server.cluster import front
from fapengine.server.intake.doors import UNREAD_S, Door, Guarded, limit_unread
from fapengine.server.web.site import BODY_S, IDLE_S, Site, harden, open_site
from tests.leaping import LeapingLoop

OPENED: list[socket.socket | asyncio.Server] = []
"""What a test has opened; it is closed at its end, however that comes."""
POST = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n"


def on_virtual_time(main: Callable[[LeapingLoop], Awaitable[None]]) -> None:
    loop = LeapingLoop()
    try:
        loop.run_until_complete(main(loop))
    finally:
        while OPENED:
            OPENED.pop().close()
        loop.run_until_complete(asyncio.sleep(0))
        loop.close()


async def echo(request: web.Request) -> web.Response:
    """Answer the length of the body; this handler knows nothing of time limits."""
    return web.Response(text=str(len(await request.read())))


async def big(_: web.Request) -> web.Response:
    return web.Response(body=bytes(32 << 20))


async def site_of(door: Door) -> Site:
    app = web.Application()
    harden(app)
    app.router.add_post("/", echo)
    app.router.add_get("/big", big)
    return await open_site(app, "127.0.0.1", 0, door)


@pytest.mark.parametrize("sends", [1, 1 << 20])
def test_a_body_that_does_not_come_is_answered_with_408_and_gives_up_its_place(
    sends: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def main(loop: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        reader, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + b"Content-Length: 2000000\r\n\r\n" + bytes(sends))
        assert (await reader.readuntil(b"\r\n")) == b"HTTP/1.1 408 Request Timeout\r\n"
        assert IDLE_S <= loop.time() < IDLE_S + 1
        await reader.read()
        writer.close()
        await asyncio.sleep(0)
        assert (door.counts.open, door.counts.timed_out) == (0, 1)
        await site.close()

    on_virtual_time(main)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_body_may_come_in_pieces_but_not_without_end() -> None:
    async def main(loop: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        reader, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + b"Content-Length: 3\r\n\r\n")
        for _ in range(3):
            await asyncio.sleep(0.8 * IDLE_S)
            writer.write(b"x")
        assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200 ")
        assert await reader.readexactly(1) == b"3"
        begun_s = loop.time()
        writer.write(POST + b"Content-Length: 100\r\n\r\n")
        dripping = asyncio.create_task(drip(writer))
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 408 ")
        assert loop.time() - begun_s == pytest.approx(BODY_S, abs=1)
        dripping.cancel()
        writer.close()
        await site.close()

    on_virtual_time(main)


async def drip(writer: asyncio.StreamWriter) -> None:
    while True:
        await asyncio.sleep(0.5 * IDLE_S)
        writer.write(b"x")


@pytest.mark.parametrize("body", [b"Content-Length: 9\r\n\r\nx", b"Transfer-Encoding: chunked\r\n\r\nzz\r\n"])
def test_a_body_that_breaks_off_or_is_nonsense_leaves_no_traceback(
    body: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async def main(_: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        _, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + body)
        await asyncio.sleep(1)
        writer.close()
        await asyncio.sleep(1)
        assert door.counts.open == 0
        await site.close()

    on_virtual_time(main)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_who_does_not_read_an_answer_is_hung_up_on_and_who_reads_slowly_is_not() -> None:
    async def main(loop: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        slow = await connected(site.address)
        await loop.sock_sendall(slow, b"GET /big HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        for _ in range(8):
            await asyncio.sleep(0.6 * UNREAD_S)
            left = 3 << 20  # the system's own buffers hold some of them
            while left > 0:
                some = await loop.sock_recv(slow, left)
                assert some
                left -= len(some)
        assert (door.counts.open, door.counts.timed_out) == (1, 0)
        stopped_s = loop.time()
        while door.counts.open:
            await asyncio.sleep(1)
        assert loop.time() - stopped_s <= 2 * UNREAD_S + 1
        assert door.counts.timed_out == 1
        await site.close()

    on_virtual_time(main)


async def connected(address: tuple[str, int]) -> socket.socket:
    one = socket.socket()
    OPENED.append(one)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 64 << 10)
    one.setblocking(False)
    await asyncio.get_running_loop().sock_connect(one, address)
    return one


class Receiver(Guarded, asyncio.Protocol):
    """One that is sent frames for ever. Stateful."""

    def __init__(self, door: Door) -> None:
        self._door = door

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert self.enter(self._door, transport)
        limit_unread(transport, 8 << 10, 8 << 10)

    def show(self, frame: bytes) -> None:
        if self._link is not None and not self._is_stuck:
            self._link.write(frame)


def test_receivers_of_frames_keep_their_places_as_long_as_they_read() -> None:
    async def main(loop: LeapingLoop) -> None:
        door, made = Door(4, 4), list[Receiver]()

        def make() -> Receiver:
            made.append(Receiver(door))
            return made[-1]

        server = await loop.create_server(make, "127.0.0.1", 0)
        OPENED.append(server)
        reads, _ = [await connected(server.sockets[0].getsockname()) for _ in range(2)]
        for _ in range(5000):
            await asyncio.sleep(0.02)
            for one in made:
                one.show(bytes(500))
            with suppress(BlockingIOError):
                reads.recv(700)
        assert (door.counts.open, door.counts.timed_out) == (1, 1)

    on_virtual_time(main)


def test_beginnings_that_stay_incomplete_are_hardly_looked_at() -> None:
    looks = 0

    def find(begun: bytes) -> bytes | None:
        nonlocal looks
        looks += 1
        return begun if begun.endswith(b"\n") else None

    async def main(loop: LeapingLoop) -> None:
        nonlocal looks
        server = socket.create_server(("127.0.0.1", 0))
        client = socket.create_connection(server.getsockname())
        accepted = server.accept()[0]
        OPENED.extend((server, client, accepted))
        finding = asyncio.create_task(front._peeked(accepted, find))
        client.send(bytes(1000))
        await asyncio.sleep(10)
        assert looks <= 2  # of the one piece that came
        looks = 0
        for _ in range(1000):
            client.send(b"x")
            await asyncio.sleep(0.01)
        assert 1 <= looks <= 10
        client.send(b"\n")
        assert len(await finding or b"") == 2001
        assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT) == 1  # as the worker expects

    on_virtual_time(main)
