"""Datagrams that no honest caller sends, to the port of a call: on virtual time, over loopback."""

import asyncio
import random
import socket
import struct
from collections.abc import Callable, Coroutine
from typing import Any

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.rtcrtpreceiver import RTCRtpReceiver

from fapengine.server.calls.calls import Calls
from fapengine.server.calls.offer import BURST, MAX_SOURCES, PACKETS_HZ
from tests.leaping import LeapingLoop
from tests.unit.server.test_calls import Hub, Studio

HEADER = struct.Struct(">BBHII")
PAYLOAD_TYPE = 96
MALFORMED_CHECK = struct.pack(">HHI", 1, 8, 0x2112A442) + bytes(12) + struct.pack(">HH", 0x24, 2) + bytes(4)
"""A STUN request whose PRIORITY has 2 bytes instead of 4."""


class Hearing:
    is_possible = True

    def listen(self, session: str, samples: Any, rate_hz: int, *, source: object) -> bool:
        return True


Attack = Callable[[Calls, RTCPeerConnection, Any], Coroutine[Any, Any, None]]


def run(attack: Attack) -> list[str]:
    """Connect a call that speaks, attack it, and close; return what the loop reported, and calls that were lost."""
    troubles: list[str] = []

    async def whole() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, told: troubles.append(str(told.get("exception"))))
        calls = Calls(Hub(), Studio(), Hearing())  # type: ignore[arg-type]
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        peer.addTransceiver("audio", direction="sendonly")
        await peer.setLocalDescription(await peer.createOffer())
        name, answer = await calls.speak("anna", peer.localDescription.sdp.encode(), "127.0.0.1", "127.0.0.1")
        await peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))
        while "connecting" in (peer.connectionState, calls._calls[name].peer.connectionState):
            await asyncio.sleep(0.01)
        await attack(calls, peer, calls._calls[name].peer)
        troubles.extend(calls._reasons.values())
        await asyncio.wait_for(asyncio.gather(calls.close(), peer.close()), 60)
        await asyncio.sleep(1.0)  # tasks of the library end

    loop = LeapingLoop()
    try:
        loop.run_until_complete(whole())
    finally:
        loop.close()
    return troubles


def port_of(own: RTCPeerConnection) -> int:
    (transceiver,) = own.getTransceivers()
    candidates = transceiver.receiver.transport.transport.iceGatherer.getLocalCandidates()
    return next(int(candidate.port) for candidate in candidates if candidate.ip == "127.0.0.1")


async def send_rtp(peer: RTCPeerConnection, number: int, ssrc: int) -> None:
    (transceiver,) = peer.getTransceivers()
    packet = HEADER.pack(0x80, PAYLOAD_TYPE, number & 0xFFFF, 960 * number & 0xFFFFFFFF, ssrc) + b"\xf8\xff\xfe"
    await transceiver.sender.transport._send_rtp(packet)


def test_a_caller_with_many_sources_is_not_given_memory_and_does_not_stop_the_server_from_ending() -> None:
    async def attack(calls: Calls, peer: RTCPeerConnection, own: RTCPeerConnection) -> None:
        for number in range(600):
            await send_rtp(peer, number, 1000 + number)
            await asyncio.sleep(0.004)
        await asyncio.sleep(5.0)  # reports of reception are sent
        (transceiver,) = own.getTransceivers()
        assert 0 < len(transceiver.receiver._RTCRtpReceiver__remote_streams) <= MAX_SOURCES

    assert run(attack) == []


def test_datagrams_of_strangers_end_no_call_and_fill_no_log() -> None:
    async def attack(calls: Calls, peer: RTCPeerConnection, own: RTCPeerConnection) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            port = port_of(own)
            for data in (
                b"",
                MALFORMED_CHECK,
                b"\x16\xfe\xfd" + bytes(40),
                b"\x80" + bytes(40),
                random.Random(5).randbytes(1200),
            ):
                stranger.sendto(data, ("127.0.0.1", port))
                await asyncio.sleep(0.1)
        await asyncio.sleep(1.0)
        assert own.connectionState == "connected"

    assert run(attack) == []


def test_a_flood_of_a_caller_is_cut_to_a_rate() -> None:
    heard: list[int] = []
    handle = RTCRtpReceiver._handle_rtp_packet

    async def count(self: RTCRtpReceiver, packet: Any, arrival_time_ms: int) -> None:
        heard.append(packet.sequence_number)
        await handle(self, packet, arrival_time_ms)

    async def attack(calls: Calls, peer: RTCPeerConnection, own: RTCPeerConnection) -> None:
        for number in range(6000):  # 3 s, 2000 packets per second
            await send_rtp(peer, number, 1000)
            await asyncio.sleep(0.0005)

    RTCRtpReceiver._handle_rtp_packet = count  # type: ignore[method-assign]
    try:
        assert run(attack) == []
    finally:
        RTCRtpReceiver._handle_rtp_packet = handle  # type: ignore[method-assign]
    assert 2 * PACKETS_HZ < len(heard) <= BURST + 4 * PACKETS_HZ
