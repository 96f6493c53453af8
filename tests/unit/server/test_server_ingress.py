"""What comes in: datagrams and streams, in turn, in slices, and never more than there is room for."""

import asyncio
import contextlib
import logging
import socket
import struct
import time
from collections.abc import Callable, Coroutine, Hashable

import pytest

from fapengine.errors import ResourceError
from fapengine.server.intake import listeners
from fapengine.server.intake.doors import Door
from fapengine.server.intake.ingress import FairQueue, Ingress
from fapengine.server.intake.listeners import Stream, TcpListener, UdpListener, bound
from fapengine.wire.framing import encode_length, encode_slip


class Echo:
    """A receiver that notes what it gets, and answers ``ping`` with ``pong``; its clock goes on as it works."""

    def __init__(self) -> None:
        self.got: list[tuple[bytes, Hashable]] = []
        self.unasked: list[tuple[Hashable, bytes]] = []
        self.forgotten: list[Hashable] = []
        self.takes_s = 0.0
        self.now_s = 0.0

    def clock(self) -> float:
        return self.now_s

    def receive(self, packet: bytes, peer: Hashable, now_s: float, wall_s: float) -> list[tuple[Hashable, bytes]]:
        self.got.append((packet, peer))
        if packet == b"/bug":
            raise RuntimeError("a bug")
        self.now_s += self.takes_s
        return [(peer, b"pong")] if packet == b"/ping" else []

    def tick(self, now_s: float, is_behind: Callable[[Hashable], bool]) -> list[tuple[Hashable, bytes]]:
        self.is_behind = is_behind
        taken, self.unasked = self.unasked, []
        return taken

    def forget(self, peer: Hashable) -> None:
        self.forgotten.append(peer)

    def packets(self) -> list[bytes]:
        return [packet for packet, _ in self.got]


def run(main: Callable[[Ingress, Echo], Coroutine[None, None, None]], queue: FairQueue | None = None) -> Ingress:
    """Run a test on a loop of its own."""
    echo = Echo()
    made: list[Ingress] = []

    async def whole() -> None:
        made.append(Ingress(echo, clock=echo.clock, wall=time.time, queue=queue))
        await main(made[0], echo)
        for _ in range(5):
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(whole(), 300))
    return made[0]


async def until(true: Callable[[], bool]) -> None:
    for _ in range(200_000):
        if true():
            return
        await asyncio.sleep(0.001)
    raise AssertionError("it never became so")


def caller() -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind(("127.0.0.1", 0))
    one.settimeout(300)
    return one


def guest(port: int) -> socket.socket:
    one = socket.socket()
    one.connect(("127.0.0.1", port))
    one.setblocking(False)
    return one


def test_datagrams_come_in_and_answers_go_back() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as one, caller() as two:
            one.sendto(b"/a", door.address)
            two.sendto(b"/ping", door.address)
            await until(lambda: len(echo.got) == 2)
            assert two.recv(99) == b"pong"
            assert sorted(echo.packets()) == [b"/a", b"/ping"]
            first = next(peer for packet, peer in echo.got if packet == b"/a")
            assert str(first) == f"udp://127.0.0.1:{one.getsockname()[1]}"
            echo.unasked = [(first, b"news")]
            ingress.after_frame(0.0)
            assert one.recv(99) == b"news"
        door.close()
        assert (ingress.counts.datagrams, ingress.counts.replies, ingress.counts.unsent) == (2, 2, 0)

    run(main)


def test_what_has_come_is_taken_before_a_frame_without_the_loop() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as one:
            one.sendto(b"/a", door.address)
            ingress.before_frame()
            assert echo.packets() == [b"/a"]
        door.close()

    run(main)


def test_a_flood_keeps_nobody_else_waiting_and_work_is_done_in_slices() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        echo.takes_s = 0.0002
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as flood, caller() as other:
            for _ in range(400):
                flood.sendto(b"/flood", door.address)
            other.sendto(b"/a", door.address)
            assert door.read() == 401
            assert ingress.queue.flooded == 400 - 50
            assert ingress.work(0.001)
            assert echo.packets()[2:4] == [b"/a", b"/flood"]  # in turn
            assert 5 <= len(echo.got) <= 7
            await until(lambda: len(echo.got) == 51)
        door.close()

    ingress = run(main, FairQueue(packets_a_peer=50, turn=2))
    assert ingress.counts.datagrams == 401


def test_a_jam_is_worked_off_in_longer_slices_and_told_to_the_receiver() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        echo.takes_s = 0.0002
        crowd = [f"peer {n}" for n in range(100)]
        for peer in crowd:
            ingress.queue.put(peer, b"/a")
        ingress.before_frame()
        assert 20 <= len(echo.got) <= 22  # 4 ms of 0.2 each
        ingress.after_frame(0.0)
        taken = {peer for _, peer in echo.got}
        assert [echo.is_behind(peer) for peer in crowd] == [peer not in taken for peer in crowd]

    run(main)


def test_at_most_so_many_datagrams_are_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "READ_AT_ONCE", 10)

    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as one, caller() as two:
            for _ in range(8):
                one.sendto(b"/1", door.address)
                two.sendto(b"/2", door.address)
            assert door.read() == 10
            await until(lambda: len(echo.got) == 16)
            assert len({str(peer) for _, peer in echo.got}) == len({peer for _, peer in echo.got}) == 2
        door.close()

    run(main)


def test_a_bug_of_the_receiver_costs_one_packet(caplog: pytest.LogCaptureFixture) -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as one, caplog.at_level(logging.ERROR):
            one.sendto(b"/bug", door.address)
            one.sendto(b"/a", door.address)
            await until(lambda: len(echo.got) == 2)
        door.close()

    assert run(main).counts.faults == 1
    assert "a packet could not be handled: 2f 62 75 67" in caplog.text


def test_answers_that_cannot_be_sent_are_counted() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        with caller() as one:
            one.sendto(b"/a", door.address)
            await until(lambda: len(echo.got) == 1)
            echo.unasked = [(echo.got[0][1], b"x" * 70_000)]
            ingress.after_frame(0.0)
        door.close()

    ingress = run(main)
    assert (ingress.counts.replies, ingress.counts.unsent) == (0, 1)


@pytest.mark.parametrize("frame", [encode_slip, lambda packet: packet + b"\xc0", encode_length])
def test_streams_find_their_framing_and_are_answered_in_it(frame: Callable[[bytes], bytes]) -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        loop = asyncio.get_running_loop()
        one = guest(door.address[1])
        for byte in frame(b"/ping") + frame(b"/a"):
            await loop.sock_sendall(one, bytes([byte]))
        await until(lambda: len(echo.got) == 2)
        assert echo.packets() == [b"/ping", b"/a"]
        answer = encode_length(b"pong") if frame is encode_length else encode_slip(b"pong")
        assert await loop.sock_recv(one, 99) == answer
        (peer,) = {peer for _, peer in echo.got}
        assert str(peer) == f"tcp://127.0.0.1:{one.getsockname()[1]}"
        own = peer._link.get_extra_info("socket")
        assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
        one.close()
        await until(lambda: ingress.counts.streams == 0)
        assert echo.forgotten == [peer]
        assert not peer.send(b"too late")
        await door.close()

    assert run(main).counts.streams_broken == 0


@pytest.mark.parametrize(
    ("data", "count"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "streams_refused"),
        (b"\xff\xff\xff\xff", "streams_refused"),  # 4 GiB
        (b"\x7f\xff\xff\xff", "streams_refused"),
        (b"\x00\x02\x00\x00", "streams_broken"),
        (encode_length(b"/a") + b"\x00\x00\x00\x00", "streams_broken"),
    ],
)
def test_what_is_no_framing_is_hung_up_on(data: bytes, count: str) -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        one = guest(door.address[1])
        loop = asyncio.get_running_loop()
        await loop.sock_sendall(one, data)
        if data.startswith(encode_length(b"/a")):  # the packet before is taken first
            await until(lambda: echo.packets() == [b"/a"])
            await loop.sock_sendall(one, b"\x00")
        with contextlib.suppress(ConnectionResetError):
            assert await loop.sock_recv(one, 99) == b""
        one.close()
        await until(lambda: ingress.counts.streams == 0)
        assert getattr(ingress.counts, count) == 1
        await door.close()

    run(main)


def test_a_stream_that_ends_inside_a_packet_is_counted() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        for data in (b"\xc0/unterminated", struct.pack(">i", 100) + b"/", b""):
            with guest(door.address[1]) as one:
                await until(lambda: ingress.counts.streams == 1)
                await asyncio.get_running_loop().sock_sendall(one, data)
            await until(lambda: ingress.counts.streams == 0)
        await door.close()

    assert run(main).counts.streams_broken == 2


def test_a_stream_that_sends_faster_is_not_read_and_loses_nothing() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        echo.takes_s = 0.0001
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        one = guest(door.address[1])
        sent = [b"/%d" % number for number in range(3000)]
        sending = asyncio.create_task(asyncio.get_running_loop().sock_sendall(one, b"".join(map(encode_slip, sent))))
        most = 0
        while len(echo.got) < len(sent):
            most = max(most, len(ingress.queue))
            await asyncio.sleep(0)
        await sending
        assert echo.packets() == sent
        assert 1 < most <= listeners.STREAM_WAITING
        one.close()
        await until(lambda: ingress.counts.streams == 0)
        await door.close()

    ingress = run(main)
    assert ingress.queue.flooded == 0


def test_a_stream_waits_for_a_place_in_a_crowd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "CROWDED_S", 0.001)

    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        ingress._working = True  # nobody takes anything out
        ingress.queue.put("crowd", b"/crowd")
        one = guest(door.address[1])
        await asyncio.get_running_loop().sock_sendall(one, encode_slip(b"/a"))
        await until(lambda: ingress.queue.crowded > 1)
        ingress.work(1.0)
        ingress._working = False
        await until(lambda: b"/a" in echo.packets())
        one.close()
        await until(lambda: ingress.counts.streams == 0)
        await door.close()

    run(main, FairQueue(peers=1))


def test_a_peer_that_does_not_read_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "UNREAD_BYTES", 10_000)

    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(64, 64))
        one = guest(door.address[1])
        await asyncio.get_running_loop().sock_sendall(one, encode_slip(b"/a"))
        await until(lambda: len(echo.got) == 1)
        peer = echo.got[0][1]
        for _ in range(2000):
            echo.unasked.append((peer, b"x" * 10_000))
        ingress.after_frame(0.0)
        assert ingress.counts.unsent > 100
        assert peer._link.get_write_buffer_size() < 40_000
        one.close()
        await until(lambda: ingress.counts.streams == 0)
        await door.close()

    run(main)


def test_too_many_streams_are_turned_away_and_a_closed_intake_takes_none() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = await TcpListener.open(ingress, bound("127.0.0.1", 0, socket.SOCK_STREAM), Door(1, 1))
        loop = asyncio.get_running_loop()
        with guest(door.address[1]) as first:
            await until(lambda: ingress.counts.streams == 1)
            with guest(door.address[1]) as second:
                assert await loop.sock_recv(second, 9) == b""
            assert ingress.counts.streams == 1
            await loop.sock_sendall(first, encode_slip(b"/a"))
            await until(lambda: len(echo.got) == 1)
            ingress.close()
            await loop.sock_sendall(first, encode_slip(b"/b"))
            await door.close()
            with contextlib.suppress(ConnectionResetError):
                assert await loop.sock_recv(first, 9) == b""
        with caller() as one:
            datagrams = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
            one.sendto(b"/c", datagrams.address)
            ingress.before_frame()
            datagrams.read()
            datagrams.close()
        assert echo.packets() == [b"/a"]

    assert run(main).counts.streams_refused == 1


def test_ports_and_hosts_that_cannot_be_had() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        door = UdpListener(ingress, bound("127.0.0.1", 0, socket.SOCK_DGRAM))
        port = door.address[1]
        with pytest.raises(ResourceError, match=rf"UDP port {port} on 127\.0\.0\.1: .*; choose another,"):
            UdpListener(ingress, bound("127.0.0.1", port, socket.SOCK_DGRAM))
        with pytest.raises(ResourceError, match=r"TCP no.such.host.invalid:1"):
            await TcpListener.open(ingress, bound("no.such.host.invalid", 1, socket.SOCK_STREAM), Door(1, 1))
        door.close()

    run(main)


def test_data_behind_the_end_of_a_connection_is_ignored() -> None:
    async def main(ingress: Ingress, echo: Echo) -> None:
        stream = Stream(ingress, set(), Door(1, 1))
        stream.data_received(b"\xc0/a\xc0")
        stream.eof_received()
        stream.close()
        assert str(stream) == "tcp://?:0"
        assert echo.got == []

    run(main)
