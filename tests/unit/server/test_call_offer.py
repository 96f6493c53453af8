"""What strangers offer: any bytes, and never an address."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError
from fapengine.server.calls.calls import MAX_OFFER, read_offer

SOUND, PICTURE = "m=audio 9 UDP/TLS/RTP/SAVPF 111", "m=video 9 UDP/TLS/RTP/SAVPF 96"
LINES = st.sampled_from(
    ["v=0", SOUND, PICTURE, "m=application 9 UDP/DTLS/SCTP webrtc-datachannel", "m=", "a=candidate:1 1 udp 1 1.2.3.4 5",
     "a=end-of-candidates", "a=mid:0", "", "\udcff"]
)  # fmt: skip


@given(
    st.one_of(st.binary(max_size=200), st.lists(LINES).map(lambda lines: "\r\n".join(lines).encode(errors="replace")))
)
def test_any_bytes_are_an_offer_without_addresses_or_refused(data: bytes) -> None:
    try:
        offer = read_offer(data)
    except DataError:
        return
    assert offer.kinds
    assert len(set(offer.kinds)) == len(offer.kinds)
    assert "candidate" not in offer.sdp
    assert offer.sdp.count("m=") == len(offer.kinds)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "'v=0'"),
        (b"\xff\xfe", "UTF-8"),
        (b"v=0\r\na=mid:0", "no media"),
        (f"v=0\r\n{SOUND}\r\n{SOUND}".encode(), "one audio and one video"),
        (b"v=0\r\nm=application 9 x", "'application'"),
        (b"v=0\r\n" + b"a" * MAX_OFFER, "bytes"),
        (b"v=0\r\n" + b"a=b\r\n" * 9000, "lines"),
    ],
)
def test_what_is_refused_is_told(data: bytes, told: str) -> None:
    with pytest.raises(DataError, match=told):
        read_offer(data)


def test_both_are_found_in_their_order() -> None:
    assert read_offer(f"v=0\n{PICTURE}\n{SOUND}".encode()).kinds == ("video", "audio")
