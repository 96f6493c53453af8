"""Connections that keep the server waiting, on virtual time, and the cost of those whose beginning is incomplete."""

import asyncio
import gzip
import logging
import socket
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from aiohttp import web

from fapengine.server.cluster import front
from fapengine.server.intake.doors import UNREAD_S, Door, Guarded, limit_unread
from fapengine.server.web.site import BODY_S, IDLE_S, Site, harden, open_site
from tests.leaping import LeapingLoop, until

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


REQUESTS: list[web.Request] = []
ENDED_S: list[float] = []
"""When the body of each request ended, or did not come in time."""


@pytest.fixture(autouse=True)
def no_requests() -> None:
    REQUESTS.clear()
    ENDED_S.clear()


async def echo(request: web.Request) -> web.Response:
    """Answer the length of the body; this handler knows nothing of time limits."""
    REQUESTS.append(request)
    try:
        return web.Response(text=str(len(await request.read())))
    finally:
        ENDED_S.append(asyncio.get_running_loop().time())


async def arrived(count: int) -> None:
    """Wait until the newest request has so many bytes of its body: no time passes while the kernel delivers them."""
    await until(lambda: REQUESTS and REQUESTS[-1].content.total_bytes == count)


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
        await arrived(sends)
        assert loop.time() == 0.0
        async with asyncio.timeout(2 * IDLE_S):
            assert (await reader.readuntil(b"\r\n")) == b"HTTP/1.1 408 Request Timeout\r\n"
        assert pytest.approx([IDLE_S]) == ENDED_S
        await reader.read()
        writer.close()
        await until(lambda: door.counts.open == 0)
        assert door.counts.timed_out == 1
        await site.close()

    on_virtual_time(main)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_body_is_not_unpacked() -> None:
    """300 MB in 305 kB took the time of 27 frames."""

    async def main(_: LeapingLoop) -> None:
        site = await site_of(Door(4, 4))
        packed = gzip.compress(bytes(1 << 20))
        reader, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + f"Content-Encoding: gzip\r\nContent-Length: {len(packed)}\r\n\r\n".encode() + packed)
        assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200 ")
        assert int(await reader.readexactly(4)) == len(packed)
        writer.close()
        await site.close()

    on_virtual_time(main)


def test_requests_through_a_proxy_are_counted_by_who_asks() -> None:
    """The test's own connections stand in for a proxy's; ``tests.oracles.proxy`` has nginx."""

    async def main(loop: LeapingLoop) -> None:
        door = Door(most=7, most_an_address=2, proxies=("127.0.0.1",))
        site, writers = await site_of(door), []

        async def ask(*callers: str, length: int = 1) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            reader, writer = await asyncio.open_connection(*site.address)
            writers.append(writer)
            named = f"X-Forwarded-For: {', '.join(callers)}\r\n" if callers else ""
            writer.write(POST + f"{named}Content-Length: {length}\r\n\r\n".encode())
            return reader, writer

        with loop.stands_still():
            first, *_ = [await ask(*callers) for callers in 2 * [("192.0.2.1",), ("192.0.2.2",), ()]]
            await until(lambda: len(REQUESTS) == 6)
            for callers in ((), ("198.51.100.1", "192.0.2.1")):  # what a caller makes up stands before
                reader, writer = await ask(*callers, length=0)
                assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503 ")
                writer.close()
                await until(lambda: door.counts.open == 6)
            assert (len(REQUESTS), door.counts.refused) == (6, 2)
            first[1].write(b"x")
            assert (await first[0].readuntil(b"\r\n")).startswith(b"HTTP/1.1 200 ")
            await ask("192.0.2.1")
            await until(lambda: len(REQUESTS) == 7)
            reader, _ = await ask("192.0.2.3", length=0)  # the total holds
            assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503 ")
            for writer in writers:
                writer.close()
            await until(lambda: not door._inside)  # no place is lost
        await site.close()

    on_virtual_time(main)


def test_a_body_may_come_in_pieces_but_not_without_end() -> None:
    async def main(loop: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        reader, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + b"Content-Length: 3\r\n\r\n")
        await arrived(0)
        for count in (1, 2, 3):
            await asyncio.sleep(0.8 * IDLE_S)
            writer.write(b"x")
            await arrived(count)
        with loop.stands_still():
            assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200 ")
            assert await reader.readexactly(1) == b"3"
        begun_s = loop.time()
        writer.write(POST + b"Content-Length: 100\r\n\r\n")
        await until(lambda: len(REQUESTS) == 2)
        count = 0
        while len(ENDED_S) < 2:
            await arrived(count)
            await asyncio.sleep(0.5 * IDLE_S)
            writer.write(b"x")
            count += 1
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 408 ")
        assert ENDED_S[1] - begun_s == pytest.approx(BODY_S, abs=1)
        writer.close()
        await site.close()

    on_virtual_time(main)


@pytest.mark.parametrize("body", [b"Content-Length: 9\r\n\r\nx", b"Transfer-Encoding: chunked\r\n\r\nzz\r\n"])
def test_a_body_that_breaks_off_or_is_nonsense_leaves_no_traceback(
    body: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async def main(_: LeapingLoop) -> None:
        door = Door(4, 4)
        site = await site_of(door)
        _, writer = await asyncio.open_connection(*site.address)
        writer.write(POST + body)
        await until(lambda: door.counts.open == 1)
        writer.close()
        await until(lambda: door.counts.open == 0)
        await asyncio.sleep(1)
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
            await read_some(loop, slow, 3 << 20)  # the system's own buffers hold some of them
            await asyncio.sleep(0.6 * UNREAD_S)
        assert (door.counts.open, door.counts.timed_out) == (1, 0)
        while door.counts.open:
            await asyncio.sleep(1)
        assert door.counts.timed_out == 1
        await site.close()

    on_virtual_time(main)


async def read_some(loop: LeapingLoop, one: socket.socket, count: int) -> None:
    """Read so many bytes, which are sure to come: no time passes."""
    with loop.stands_still():
        while count > 0:
            some = await loop.sock_recv(one, count)
            assert some
            count -= len(some)


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
        self.door = door

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert self.enter(self.door, transport)
        limit_unread(transport, 8 << 10, 8 << 10)

    def show(self, frame: bytes) -> bool:
        """Send it, unless too much is unread."""
        if self._link is None or self._is_stuck:
            return False
        self._link.write(frame)
        return True


def test_receivers_of_frames_keep_their_places_as_long_as_they_read() -> None:
    async def main(loop: LeapingLoop) -> None:
        door, made = Door(4, 4), list[Receiver]()

        def make() -> Receiver:
            made.append(Receiver(door))
            return made[-1]

        server = await loop.create_server(make, "127.0.0.1", 0)
        OPENED.append(server)
        reads = await connected(server.sockets[0].getsockname())
        await until(lambda: made)
        await connected(server.sockets[0].getsockname())
        await until(lambda: len(made) == 2)
        shown, read = 0, 0
        while shown < 3 << 20 or not door.counts.timed_out:
            assert loop.time() < 100 * UNREAD_S, "nobody is hung up on"
            for one in made:
                while one.show(bytes(500)):
                    shown += 500 * (one is made[0])
            await asyncio.sleep(0.6 * UNREAD_S)
            await read_some(loop, reads, shown - read)
            read = shown
            assert made[0]._link is not None
        assert (door.counts.open, door.counts.timed_out) == (1, 1)

    on_virtual_time(main)


class Link:
    """A connection of which the test says how much is unread. Stateful."""

    unread = 0
    is_open = True

    def get_extra_info(self, name: str) -> Any:
        return ("127.0.0.1", 1)

    def get_write_buffer_size(self) -> int:
        return self.unread

    def abort(self) -> None:
        self.is_open = False


@pytest.mark.parametrize(("less_every_s", "ends_s"), [(None, 2 * UNREAD_S), (0.9 * UNREAD_S, None)])
def test_who_reads_nothing_for_a_time_is_hung_up_on(less_every_s: float | None, ends_s: float | None) -> None:
    async def main(loop: LeapingLoop) -> None:
        door, link, guard = Door(4, 4), Link(), Guarded()
        assert guard.enter(door, link)  # type: ignore[arg-type]
        link.unread = 1000
        guard.pause_writing()
        for number in range(100):
            link.unread -= less_every_s is not None
            await asyncio.sleep(less_every_s or 1.0)
            assert link.is_open == (ends_s is None or number + 1 < ends_s)
        assert door.counts.timed_out == (ends_s is not None)
        guard.connection_lost(None)

    on_virtual_time(main)


def test_who_has_read_may_be_silent() -> None:
    async def main(_: LeapingLoop) -> None:
        door, link, guard = Door(4, 4), Link(), Guarded()
        assert guard.enter(door, link)  # type: ignore[arg-type]
        guard.pause_writing()
        guard.resume_writing()
        await asyncio.sleep(10 * UNREAD_S)
        assert link.is_open
        guard.connection_lost(None)

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
        await until(lambda: looks)
        await asyncio.sleep(10)
        assert looks <= 2  # of the one piece that came
        looks = 0
        for _ in range(1000):
            client.send(b"x")
            await asyncio.sleep(0.01)
        assert looks <= 10
        client.send(b"\n")
        assert len(await finding or b"") == 2001
        assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT) == 1  # as the worker expects

    on_virtual_time(main)
