"""What strangers offer: any bytes, and never an address to which anything is sent."""

import asyncio
from asyncio import selector_events
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from aiortc import RTCConfiguration, RTCPeerConnection
from aiortc.sdp import SessionDescription
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import DataError
from fapengine.server.calls import offer as module
from fapengine.server.calls.offer import MAX_ADDRESSES, MAX_OFFER, addresses_for, answer_offer, read_offer
from tests.leaping import LeapingLoop

SOUND, PICTURE = "m=audio 9 UDP/TLS/RTP/SAVPF 111", "m=video 9 UDP/TLS/RTP/SAVPF 96"
CODEC = "a=rtpmap:111 opus/48000/2"
DATA = "m=application 9 UDP/DTLS/SCTP webrtc-datachannel"
VICTIM, PORT = "127.0.0.77", 24119
CANDIDATE = f"a=candidate:1 1 udp 2130706431 {VICTIM} {PORT} typ host"
SEPARATORS = ["\r\n", "\n", "\r", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029", "\x00", "\t"]
LINES = st.sampled_from(
    ["v=0", SOUND, PICTURE, DATA, "m=", CANDIDATE, "a=end-of-candidates", "a=mid:0", "a=mid:1", "", "\udcff",
     "a=ice-lite", "a=group:BUNDLE 1 0", "a=group:BUNDLE x", "a=ice-ufrag:abcd", "a=ice-pwd:" + 22 * "p", "a=sendrecv",
     f"c=IN IP4 {VICTIM}", f"a=rtcp:{PORT} IN IP4 {VICTIM}", "a=rtcp-mux", "a=rtpmap:96 VP8/90000", "a=setup:actpass",
     CODEC, "a=rtcp-fb:* nack", "a=fmtp:111 x=1", "a=fmtp:96 apt=97", "a=inactive", "a=candidate:", "a=ssrc:1 cname:x",
     "a=fingerprint:sha-256 " + ":".join(["AB"] * 32), "a=extmap:1 urn:ietf:params:rtp-hdrext:sdes:mid"]
)  # fmt: skip


def run(work: Callable[[], Any]) -> Any:
    loop = LeapingLoop()
    try:
        return loop.run_until_complete(work())
    finally:
        loop.close()


@cache
def honest(*kinds: str, data: bool = False) -> str:
    """An offer as aiortc makes it."""

    async def offer() -> str:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        for kind in kinds:
            peer.addTransceiver(kind, direction="recvonly")
        if data:
            peer.createDataChannel("x")
        await peer.setLocalDescription(await peer.createOffer())
        sdp = str(peer.localDescription.sdp)
        await peer.close()
        return sdp

    return str(run(offer))


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """Honest offers with lines added, taken away, repeated, and with odd separators."""
    lines = honest("audio", "video", data=draw(st.booleans())).split("\r\n")
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(1, len(lines) - 1))
        line = draw(st.one_of(LINES, st.sampled_from(lines)))
        kind = draw(st.sampled_from(["insert", "join", "cut", "replace"]))
        if kind == "insert":
            lines.insert(place, line)
        elif kind == "join":
            lines[place] += draw(st.sampled_from(SEPARATORS)) + line
        elif kind == "cut" and len(lines) > 2:
            del lines[place]
        else:
            lines[place] = line
    return "\r\n".join(lines).encode(errors="surrogateescape")


def sent_for(offer: bytes, monkeypatch: pytest.MonkeyPatch) -> tuple[set[Any], str]:
    """Answer an offer, wait 30 s of virtual time; return the addresses to which datagrams went, and the answer."""
    sent: set[Any] = set()

    async def answer() -> str:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        try:
            answer = await answer_offer(peer, read_offer(offer), "127.0.0.1", lambda: None)
            await asyncio.sleep(30.0)
            return answer
        finally:
            await peer.close()
            await asyncio.sleep(1.0)  # tasks of the library end

    with monkeypatch.context() as patch:
        transport = selector_events._SelectorDatagramTransport  # type: ignore[attr-defined]
        patch.setattr(transport, "sendto", lambda _, data, addr=None: sent.add(addr))
        return sent, run(answer)


@given(
    st.one_of(
        st.binary(max_size=200), mutated(),
        st.lists(LINES).map(lambda lines: "\r\n".join(["v=0", *lines]).encode(errors="surrogateescape")),
    )
)  # fmt: skip
def test_any_bytes_are_an_offer_without_addresses_or_refused(data: bytes) -> None:
    try:
        offer = read_offer(data)
    except DataError:
        return
    again = SessionDescription.parse(offer.sdp)
    assert [media.kind for media in again.media] == list(offer.kinds)
    assert set(offer.kinds) in ({"audio"}, {"video"}, {"audio", "video"})
    assert len(set(offer.kinds)) == len(offer.kinds)
    assert not any(media.ice_candidates for media in again.media)
    assert "candidate" not in offer.sdp
    assert VICTIM not in offer.sdp


@settings(max_examples=30)
@given(mutated())
def test_nothing_is_sent_to_an_address_that_an_offer_names(data: bytes) -> None:
    with pytest.MonkeyPatch.context() as patch:
        try:
            sent, answer = sent_for(data, patch)
        except DataError:
            return
    assert sent == set()
    assert "m=application" not in answer


@pytest.mark.parametrize("separator", SEPARATORS)
def test_no_separator_hides_an_address_or_a_data_channel(separator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with_data = honest("audio", data=True)
    assert "\r\nm=application" in with_data
    offers = [
        with_data.replace("m=application", f"a=x{separator}m=application"),
        honest("audio").replace("a=mid:0", f"a=mid:0\r\na=x{separator}{CANDIDATE}"),
        honest("audio").replace("a=mid:0", f"a=mid:0\r\na=x{separator}{CANDIDATE.replace(VICTIM, 'named.local')}"),
    ]
    for number, offer in enumerate(offers):
        try:
            sent, answer = sent_for(offer.encode(), monkeypatch)
        except DataError:
            continue
        assert sent == set()
        assert "m=application" not in answer
        assert (separator, number > 0) in (("\r\n", True), ("\n", True))


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "'v=0'"),
        (b"\xff\xfe", "UTF-8"),
        (b"v=0\r\na=mid:0", "no media"),
        (f"v=0\r\n{SOUND}\r\na=ice-ufrag:abcd\r\na=ice-pwd:{'p' * 22}\r\n{SOUND}".encode(), "one audio and one video"),
        (f"v=0\r\n{DATA}".encode(), "'application'"),
        (f"v=0\r\n{SOUND}\r\na=ice-ufrag:a b c\r\na=ice-pwd:{'p' * 22}".encode(), "ice-ufrag 'a b c'"),
        (f"v=0\r\n{SOUND}\r\na=ice-ufrag:abcd\r\na=ice-pwd:p".encode(), "ice-pwd"),
        (f"v=0\r\n{SOUND}\r\n{CODEC}\r\n{CODEC}".encode(), "payload type of audio twice"),
        (f"v=0\r\n{SOUND}\r\na=rtpmap:111".encode(), "understood"),
        ("v=0\r\na=x\u2028b".encode(), "printable"),
        (b"v=0\r\n" + b"a" * MAX_OFFER, "bytes"),
        (b"v=0\r\n" + b"a=b\r\n" * 9000, "lines"),
        (honest("audio", "video").replace("a=mid:1", "a=mid:0").encode(), "one mid"),
    ],
)
def test_what_is_refused_is_told(data: bytes, told: str) -> None:
    with pytest.raises(DataError, match=told):
        read_offer(data)


def test_both_are_found_in_their_order() -> None:
    assert read_offer(honest("video", "audio").encode()).kinds == ("video", "audio")
    assert read_offer(honest("audio").replace("\r\n", "\n").encode()).kinds == ("audio",)


def test_an_offer_of_many_codecs_and_feedbacks_is_not_multiplied() -> None:
    codecs = "".join(f"a=rtpmap:{number} x{number}/8000\r\n" for number in range(10, 64)) + "a=rtcp-fb:* nack\r\n" * 300
    offer = read_offer(honest("audio").replace("a=mid:0", f"a=mid:0\r\n{codecs}").encode())
    assert offer.sdp.count("a=rtcp-fb") < 80
    assert len(offer.sdp) < MAX_OFFER


def test_checks_are_sent_to_few_addresses() -> None:
    """Checks may come with forged addresses: each is answered, but few are checked in turn."""
    checked: list[Any] = []

    async def answer() -> None:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        await answer_offer(peer, read_offer(honest("audio").encode()), "127.0.0.1", lambda: None)
        (transceiver,) = peer.getTransceivers()
        connection = transceiver.sender.transport.transport.iceGatherer._connection
        connection.check_start_task = lambda pair: checked.append(pair.remote_addr)
        message = type("Message", (), {"attributes": {"PRIORITY": 1}})()
        for number in range(1000):
            connection.check_incoming(message, ("127.0.0.1", 1000 + number % 500), connection._protocols[0])
        await peer.close()
        await asyncio.sleep(1.0)

    run(answer)
    assert len(set(checked)) == MAX_ADDRESSES


def test_vp8_is_answered_where_h264_is_offered_first() -> None:
    both = honest("audio", "video")
    lines = both.split("\r\n")
    vp8 = next(line.split()[0].split(":")[1] for line in lines if line.endswith("VP8/90000"))
    place = next(number for number, line in enumerate(lines) if line == f"a=rtpmap:{vp8} VP8/90000")
    lines.append(lines.pop(place))  # the last codec of the offer
    lines.append(lines.pop(-2))

    async def answered() -> str:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        try:
            return await answer_offer(peer, read_offer("\r\n".join(lines).encode()), "127.0.0.1", lambda: None)
        finally:
            await peer.close()
            await asyncio.sleep(1.0)

    video = next(line for line in run(answered).split("\r\n") if line.startswith("m=video"))
    assert "H264/90000" in both
    assert video.split()[3] == vp8


def test_a_caller_on_this_machine_gets_its_own_address_too(monkeypatch: pytest.MonkeyPatch) -> None:
    class StandInSocket:
        has_network = True

        def __enter__(self) -> "StandInSocket":
            return self

        def __exit__(self, *_: object) -> None: ...

        def connect(self, address: tuple[str, int]) -> None:
            if not self.has_network:
                raise OSError("Network is unreachable")

        def getsockname(self) -> tuple[str, int]:
            return "198.51.100.7", 4242

    monkeypatch.setattr(module.socket, "socket", lambda *_: StandInSocket())
    assert addresses_for("127.0.0.1") == ("127.0.0.1", "198.51.100.7")
    assert addresses_for("203.0.113.9") == ("203.0.113.9",)
    assert addresses_for("host.example") == ("host.example",)
    StandInSocket.has_network = False
    assert addresses_for("127.0.0.1") == ("127.0.0.1",)
