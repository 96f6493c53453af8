"""Damage costs as little as it can, is told, and never shows garbage."""

from types import SimpleNamespace

import numpy as np
import pytest

from fapengine.codec import kernels
from fapengine.codec.bits import unpack
from fapengine.codec.decoder import HELD, PLANE_CODE_BITS, Decoder, decode, find_intact_intra
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.header import IntraHeader, intra_header_bits, mask_types_of
from fapengine.codec.planes import PlaneState
from fapengine.errors import DataError
from fapengine.mpeg4.track import FapTrack


def walk(frames: int = 200) -> FapTrack:
    rng = np.random.default_rng(3)
    values = np.zeros((frames, 68), int)
    values[:, 2:] = np.clip(np.cumsum(rng.integers(-6, 7, (frames, 66)), axis=0), -300, 300)
    return FapTrack.from_values(values, rate_hz=25.0)


@pytest.mark.parametrize("start_codes", ["none", "intra"])
@pytest.mark.parametrize("seed", range(6))
def test_frames_after_damage_are_right_or_absent(start_codes: str, seed: int) -> None:
    stream = encode(walk(), EncoderOptions(intra_every=25, plane_start_codes=start_codes))
    good = decode(stream)
    wanted = {row.tobytes() for part in good.planes for row in part.values}
    rng = np.random.default_rng(seed)
    at = int(rng.integers(200, len(stream) - 600))
    hurt = stream[:at] + rng.bytes(12) + stream[at + 12 :]
    rescued = decode(hurt, errors="resync")
    shown = [row.tobytes() for part in rescued.planes for row in part.values]
    assert all(row in wanted for row in shown)
    assert len(shown) >= 200 - 2 * 25 - HELD  # what is left of one group, perhaps of two
    assert rescued.losses
    assert all(loss.end_bit is not None and loss.start_bit < loss.end_bit for loss in rescued.losses)
    with pytest.raises(DataError):
        decode(hurt)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_live_resync_gives_what_whole_streams_give(share: float) -> None:
    stream = encode(walk(), EncoderOptions(intra_every=25))
    at = int(share * len(stream))
    hurt = stream[:at] + b"\x5a" * 20 + stream[at + 20 :]
    whole = decode(hurt, errors="resync")
    decoder = Decoder(errors="resync")
    frames = [frame for n in range(0, len(hurt), 7) for frame in decoder.feed(hurt[n : n + 7])]
    assert decoder.close() == []  # it went on as soon as it could: the end code lets the last ones go
    np.testing.assert_array_equal(
        [frame.row for frame in frames], np.concatenate([part.values for part in whole.planes])
    )
    assert decoder.losses == list(whole.losses)


def test_a_lost_beginning_is_bridged() -> None:
    stream = encode(walk(100), EncoderOptions(intra_every=25))
    rescued = decode(stream[300:], errors="resync")
    assert 0 < len(rescued.track) < 100
    assert rescued.losses[0].start_bit == 0


def test_many_hits_on_a_stream_of_i_planes_cost_a_bounded_number_of_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = encode(walk(150), EncoderOptions(intra_every=1))
    hurt = bytearray(stream)
    hits = 16
    for at in np.linspace(200, len(stream) - 100, hits).astype(int):
        hurt[at] ^= 0x55
    searches = 0

    def lose(self: Decoder, *arguments: object, **named: object) -> None:
        nonlocal searches
        searches += 1
        assert searches <= 2 * HELD * hits, "each damage is searched for again and again"
        first_lose(self, *arguments, **named)  # type: ignore[arg-type]

    first_lose = Decoder._lose
    monkeypatch.setattr(Decoder, "_lose", lose)
    rescued = decode(bytes(hurt), errors="resync")
    assert searches >= len(rescued.losses) > 1
    assert sum(len(part) for part in rescued.planes) >= 150 - hits * (HELD + 1)


def test_noise_is_no_stream() -> None:
    noise = np.random.default_rng(1).bytes(60_000)  # holds an I plane by chance; nothing proves it
    for data in (noise, b""):
        with pytest.raises(DataError, match=r"no frames \(at byte 0, bit 0\)"):
            decode(data, errors="resync")


def test_an_i_plane_of_unknown_shape_proves_itself_by_eight_planes_behind_it() -> None:
    stream = encode(walk(40))
    bits, extents = unpack(stream), np.concatenate([part.extents for part in decode(stream).planes])
    start = int(extents[0, 0])
    no_p_plane = np.ones(400, np.uint8)
    for behind, is_found in ((1, False), (7, False), (8, True), (20, True)):
        piece = np.concatenate([np.zeros(3, np.uint8), bits[start : int(extents[behind, 1])], no_p_plane])
        found = find_intact_intra(piece, 0, PlaneState(), None, bodies=False, final=True)
        assert (found == 3) is is_found, behind


def test_an_i_plane_behind_a_start_code_needs_no_further_proof() -> None:
    stream = encode(walk(40))
    start, end = (int(bit) for bit in decode(stream).planes[0].extents[0, :2])
    plane = np.concatenate([unpack(stream)[start:end], np.ones(400, np.uint8)])
    for before, found in ((PLANE_CODE_BITS, 32), (np.zeros(32, np.uint8), None)):
        piece = np.concatenate([before, plane])
        assert find_intact_intra(piece, 0, PlaneState(), None, bodies=False, final=True) == found


def test_every_candidate_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one beside another, as there may be where planes have bodies."""
    every = {"find_intra": lambda bits, start, bodies: start if start < 40 else -1}
    monkeypatch.setattr(kernels, "loops", SimpleNamespace(**vars(kernels.loops) | every))
    stream = encode(walk(40))
    bits = unpack(stream)[int(decode(stream).planes[0].extents[0, 0]) :]
    for at in (8, 9):
        piece = np.concatenate([np.zeros(at, np.uint8), bits])
        assert find_intact_intra(piece, 0, PlaneState(), None, bodies=False, final=True) == at


def test_frames_that_are_dropped_are_counted_once_however_often_a_search_comes_to_the_same_damage() -> None:
    """From each I plane among them it does."""
    stream = encode(walk(60), EncoderOptions(intra_every=2))
    dropped = []
    for at in range(1500, 4000, 500):
        rescued = decode(stream[:at] + b"\x5a" * 6 + stream[at + 6 :], errors="resync")
        dropped += [loss.frames_dropped for loss in rescued.losses]
    assert len(dropped) >= 3
    assert max(dropped) == HELD


@pytest.mark.parametrize("piece", [40, 10_000])
@pytest.mark.parametrize("left", [0.3, 0.55, 0.8])
def test_what_is_cut_off_is_one_loss_from_the_last_whole_plane_to_the_end(left: float, piece: int) -> None:
    stream = encode(walk(60), EncoderOptions(intra_every=25))
    stream, whole = stream[: int(left * len(stream))], decode(stream)
    decoder = Decoder(errors="resync")
    frames = [frame for n in range(0, len(stream), piece) for frame in decoder.feed(stream[n : n + piece])]
    frames += decoder.close()
    ends = np.concatenate([part.extents[:, 1] for part in whole.planes])
    (loss,) = decoder.losses
    assert loss.end_bit == 8 * len(stream)
    assert loss.start_bit == ends[len(frames) - 1] == ends[ends <= loss.end_bit].max()
    assert loss.frames_dropped == 0


def test_a_live_decoder_refuses_a_p_plane_at_the_beginning_as_soon_as_it_is_there() -> None:
    decoder = Decoder()
    assert decoder.feed(encode(walk(1))[:4] + bytes([0b00100000] * 9)) == []
    with pytest.raises(DataError, match="first plane: got a P plane, expected an I plane"):
        decoder.feed(b"more")


@pytest.mark.parametrize("errors", ["strict", "resync"])
def test_a_long_live_stream_needs_no_more_memory(errors: str) -> None:
    stream = encode(walk(1500), EncoderOptions(intra_every=50))
    decoder = Decoder(errors=errors)
    longest = frames = 0
    for at in range(0, len(stream), 50):
        frames += len(decoder.feed(stream[at : at + 50]))
        longest = max(longest, decoder.waiting_bits)
    assert frames + len(decoder.close()) == 1500
    assert longest < 8 * 2000  # an I plane, the frames held back, a piece


def find_intra(stream_bits: np.ndarray) -> int:
    """Search in Python, which checks every index, and in C where it is installed: both find the same."""
    found = kernels.loops.find_intra(stream_bits, 0, False)
    assert kernels.find_intra(stream_bits, 0, False) == found
    return found


@pytest.mark.parametrize("unsent", [1, 2])
@pytest.mark.parametrize("sent", [0, 1, 30, 68])
@pytest.mark.parametrize("skip", [0, 1, 14, 15, 16, 30, 40])
def test_headers_with_skipped_frames_are_found(skip: int, sent: int, unsent: int) -> None:
    mask = np.isin(np.arange(68), np.random.default_rng(skip).permutation(68)[:sent])
    header = intra_header_bits(IntraHeader(1, mask, mask_types_of(mask, unsent), skip=skip))
    whole = np.array([0, 0, *header, *[0] * 60], np.uint8)
    assert find_intra(whole) == 2
    assert {find_intra(whole[:end]) for end in range(len(whole))} == {-1, 2}  # cut off anywhere


def test_nothing_is_found_where_nothing_is() -> None:
    assert find_intra(np.zeros(200, np.uint8)) == -1
    assert find_intra(np.zeros(3, np.uint8)) == -1
