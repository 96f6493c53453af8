"""A face over RTP: what arrives is what was sent; a loss holds the face still, no longer than to an I plane."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fapengine.codec.encoder import Encoder, EncoderOptions
from fapengine.errors import DataError
from fapengine.wire import rtp
from fapengine.wire.rtp import RtpSender
from tests.unit.wire.rtp_receiver import REORDERED, RtpReceiver, parse_packet

RATE_HZ = 60.0
Frames = list[tuple[int, list[int]]]


def walk(frames: int) -> np.ndarray:
    values = np.cumsum(np.random.default_rng(8).integers(-40, 41, (frames, 68)), axis=0).clip(-800, 800)
    values[:, :2] = 0
    return values


def sent(values: np.ndarray, *, intra_every: int = 60, first: int = 0) -> list[list[bytes]]:
    """Packets of each frame."""
    encoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(plane_start_codes="all", intra_every=intra_every))
    sender = RtpSender(ssrc=7, sequence=first, time=2**32 - 90_000)
    return [sender.plane(encoder.frame(row), n / RATE_HZ) for n, row in enumerate(values)]


def received(packets: Sequence[bytes], receiver: RtpReceiver | None = None) -> Frames:
    receiver = receiver or RtpReceiver()
    return [(time, frame.values.tolist()) for data in packets for time, frame in receiver.packet(data)]


def flat(packets: Sequence[Sequence[bytes]]) -> list[bytes]:
    return [each for plane in packets for each in plane]


@pytest.fixture(scope="module")
def planes() -> list[list[bytes]]:
    return sent(walk(180), first=65_500)


@pytest.fixture(scope="module")
def whole(planes: list[list[bytes]]) -> Frames:
    return received(flat(planes))


def test_all_frames_arrive_at_once_and_in_time(planes: list[list[bytes]], whole: Frames) -> None:
    receiver = RtpReceiver()
    for n, plane in enumerate(planes):
        got = received(plane, receiver)
        assert len(got) == 1, n
        assert got[0][0] == (2**32 - 90_000 + round(n * 90_000 / RATE_HZ)) & 0xFFFFFFFF
    step = 4  # of the coarsest FAP at quantiser 1
    assert np.abs(np.array([faps for _, faps in whole]) - walk(180))[:, [3, 4, 16]].max() <= step


def test_large_planes_are_cut_and_joined(monkeypatch: pytest.MonkeyPatch, whole: Frames) -> None:
    monkeypatch.setattr(rtp, "MAX_PAYLOAD", 50)
    planes = sent(walk(180), first=65_500)
    assert max(map(len, planes)) == 3
    assert [parse_packet(each).is_last for each in planes[0]] == [False] * (len(planes[0]) - 1) + [True]
    assert received(flat(planes)) == whole
    del planes[5][1]
    shown = [time for time, _ in received(flat(planes))]
    assert shown == [time for n, (time, _) in enumerate(whole) if not 5 <= n < 60]


@given(st.randoms(use_true_random=False))
def test_order_does_not_matter_within_a_few_packets(planes: list[list[bytes]], whole: Frames, chance: object) -> None:
    packets = flat(planes)
    mixed = [packets[0]]
    for start in range(1, len(packets), 4):
        part = packets[start : start + 4]
        chance.shuffle(part)  # type: ignore[attr-defined]
        mixed += [*part, part[0]]  # and one of them twice
    assert received(mixed) == whole


@given(st.sets(st.integers(1, 179 - 2 * REORDERED), max_size=40))
def test_a_loss_costs_the_frames_up_to_the_next_i_plane(
    planes: list[list[bytes]], whole: Frames, lost: set[int]
) -> None:
    receiver = RtpReceiver()
    got = received([packet for n, plane in enumerate(planes) if n not in lost for packet in plane], receiver)
    expected, follows = [], True
    for n in range(180):
        follows = n not in lost and (follows or n % 60 == 0)
        if follows:
            expected.append(whole[n])
    assert got == expected
    assert receiver.counts.lost == sum(len(planes[n]) for n in lost)


def test_one_in_twenty_lost() -> None:
    """Ten seconds with an I plane every half second."""
    planes = sent(walk(600), intra_every=30)
    chance = np.random.default_rng(2)
    receiver = RtpReceiver()
    got = received([packet for plane in planes for packet in plane if chance.random() > 0.05], receiver)
    assert (len(got), receiver.counts.lost) == (318, 29)  # as docs/measurements.md says


def test_a_sender_that_begins_anew_is_followed(whole: Frames) -> None:
    receiver = RtpReceiver()
    received(flat(sent(walk(5))), receiver)
    again = [packet[:8] + b"\0\0\0\x09" + packet[12:] for packet in flat(sent(walk(180), first=65_500))]
    assert received(again, receiver) == whole


@given(st.one_of(st.binary(max_size=64), st.binary(max_size=8).map(lambda tail: b"\0\0\1" + tail)))
@example(b"\0\0\1")
def test_any_datagram_is_survived(data: bytes) -> None:
    receiver = RtpReceiver()
    receiver.packet(data)
    receiver.packet(b"\x80\xe0\0\x01\0\0\0\0\0\0\0\x07" + data)
    assert receiver.counts.taken + receiver.counts.refused <= 3


@pytest.mark.parametrize("data", [b"", bytes(12), b"\x90" + bytes(20), b"\x40" + bytes(20)])
def test_what_is_no_packet_is_named(data: bytes) -> None:
    with pytest.raises(DataError, match="RTP: got"):
        parse_packet(data)
