"""For all bytes: frames, or DataError; and what was coded comes back."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fapengine.codec.decoder import Decoder, decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.epf import parse_epf
from fapengine.codec.fapfile import parse_fap
from fapengine.errors import DataError
from fapengine.mpeg4.track import FapTrack

START, END = b"\x00\x00\x01\xba", b"\x00\x00\x01\xb1"
VALID = encode(
    FapTrack.from_values(np.arange(40 * 68).reshape(40, 68) % 90 * ([0, 0] + [1] * 66), rate_hz=25.0),
    EncoderOptions(intra_every=12, plane_start_codes="intra"),
)


def check_total(data: bytes) -> None:
    for errors in ("strict", "resync"):
        with contextlib.suppress(DataError):
            decoded = decode(data, errors=errors)
            assert len(decoded.track) <= 8 * len(data)


@given(st.binary(max_size=400))
def test_any_bytes(data: bytes) -> None:
    check_total(data)
    check_total(START + data)
    check_total(START + b"\xb1\x90\x01\xff\xff\xff" + data + END)


@given(st.lists(st.tuples(st.integers(0, 8 * len(VALID) - 1), st.booleans()), min_size=1, max_size=6))
def test_valid_bytes_flipped_and_cut(changes: list[tuple[int, bool]]) -> None:
    data = bytearray(VALID)
    for bit, cut in changes:
        if cut:
            del data[bit // 8 :]
        elif bit // 8 < len(data):
            data[bit // 8] ^= 0x80 >> bit % 8
    check_total(bytes(data))


@settings(max_examples=30)
@given(st.lists(st.integers(0, 8 * len(VALID) - 1), max_size=3), st.integers(1, 9))
def test_pieces_of_any_size_give_what_the_whole_gives(flips: list[int], piece: int) -> None:
    data = bytearray(VALID)
    for bit in flips:
        data[bit // 8] ^= 0x80 >> bit % 8
    outcomes = []
    for size in (len(data), piece):
        decoder = Decoder()
        frames, error = [], ""
        try:
            for at in range(0, len(data), size):
                frames += decoder.feed(bytes(data[at : at + size]))
            frames += decoder.close()
        except DataError as caught:
            error = str(caught)
        outcomes.append(([frame.row.tolist() for frame in frames], error))
    assert outcomes[0] == outcomes[1]


@given(st.binary(max_size=300), st.text(max_size=200))
def test_text_parsers_are_total(data: bytes, text: str) -> None:
    for parser in (parse_epf, parse_fap):
        for given_bytes in (data, text.encode(), b"FBM 1 FFR 0 ISI 1 " + data, b"2.1 x 25 1\n" + text.encode()):
            with contextlib.suppress(DataError):
                parser(given_bytes)


@given(
    hnp.arrays(np.int32, st.tuples(st.integers(1, 12), st.just(66)), elements=st.integers(-170, 170)),
    st.integers(0, 31), st.integers(0, 5), st.sampled_from(["table", "fitted"]), st.booleans(),
)  # fmt: skip
def test_decoding_undoes_encoding_up_to_half_a_step(
    low_level: np.ndarray, quant: int, every: int, ranges: str, moving: bool
) -> None:
    low_level[:, [20, 21, 22, 23, 44, 45, 46, 47]] //= 2 if quant == 0 else 1
    values = np.hstack([np.zeros((len(low_level), 2), np.int32), low_level])
    track = FapTrack.from_values(values, rate_hz=25.0)
    options = EncoderOptions(quant=quant, intra_every=every, ranges=ranges, moving_only=moving)
    shown = decode(encode(track, options)).track
    if quant in (1, 2):  # small differences: nothing can leave the table's ranges
        steps = np.array([0, 0] + [4, 2, 2, 2] + [1] * 62) * quant
        assert (np.abs(shown.values - track.values)[:, 2:6] * (shown.mask[:, 2:6]) <= steps[2:6] // 2 + 1).all()
    assert len(shown) == len(track)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("quant", [0, 1, 5])
@pytest.mark.parametrize("every", [0, 3])
def test_a_still_face_keeps_its_last_frame_however_few_bits_it_takes(moving: bool, quant: int, every: int) -> None:
    for count in range(1, 30):
        track = FapTrack.from_values(np.zeros((count, 68), np.int32), rate_hz=25.0)
        data = encode(track, EncoderOptions(quant=quant, intra_every=every, ranges="fitted", moving_only=moving))
        assert len(decode(data).track) == count
