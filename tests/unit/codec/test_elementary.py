"""Access units are the planes of a stream; levels bound bits and frame rate; errors of points follow their levers."""

import numpy as np
import pytest

from fapengine.codec.decoder import decode
from fapengine.codec.elementary import LEVELS, access_units, level_of, visual_headers
from fapengine.codec.encoder import EYE_LEVER_MM, HEAD_LEVER_MM, TONGUE_LEVER, EncoderOptions, encode, point_errors_mm
from fapengine.codec.epf import parse_epf
from fapengine.codec.fit import LIP_PARTNERS, SIDE_PARTNERS, fill
from fapengine.errors import DataError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import FapTrack

FACE = Fapu(irisd0_mm=11.0, es0_mm=62.0, ens0_mm=47.0, mns0_mm=22.0, mw0_mm=50.0)


def noise(frames: int, size: int, rate_hz: float = 25.0) -> FapTrack:
    values = np.random.default_rng(2).integers(-size, size + 1, (frames, 68))
    values[:, :2] = 0
    return FapTrack.from_values(values, rate_hz=rate_hz)


def test_access_units_join_to_the_stream_and_begin_with_start_codes() -> None:
    stream = encode(noise(7, 50), EncoderOptions(intra_every=3, plane_start_codes="all"))
    units = access_units(stream)
    assert b"".join(unit.data for unit in units) == stream
    assert [unit.data[:4].hex() for unit in units] == ["000001ba"] + ["000001bb"] * 6
    assert [(unit.frame, unit.intra) for unit in units] == [(n, n % 3 == 0) for n in range(7)]
    with pytest.raises(DataError, match="share bytes"):
        access_units(encode(noise(7, 50)))
    single = encode(noise(1, 50))
    assert [(unit.data, unit.frame, unit.intra) for unit in access_units(single)] == [(single, 0, True)]


def test_visual_headers_end_with_the_stuffing_of_their_code() -> None:
    """A zero and ones up to the next byte, as before every start code."""
    for profile in (0x61, 0xC1):
        headers = visual_headers(profile)
        assert headers[4] == profile
        assert headers[-1] & 0b111 == 0b011


def test_levels_bound_the_bits_of_a_second_and_the_frame_rate() -> None:
    assert level_of(decode(encode(noise(30, 1)))) is LEVELS[0]
    rates = {}
    for size in (1, 5, 20, 60, 400, 1000):
        decoded = decode(encode(noise(60, size, 60.0), EncoderOptions(quant=0)))
        bits = sum(int((part.extents[:, 1] - part.extents[:, 0]).sum()) for part in decoded.planes)
        rates[bits] = level_of(decoded)
    for bits, level in rates.items():
        fitting = [one for one in LEVELS if bits <= one.max_bit_s]
        assert level is (fitting[0] if fitting else None)
    assert {*LEVELS, None} >= set(rates.values()) >= {None}, rates
    assert level_of(decode(encode(noise(10, 1, 100.0)))) is None


@pytest.mark.conformance
def test_levels_have_the_bytes_and_bounds_of_the_standard() -> None:
    """Simple Face Animation of [FBA] section 1 and [MEM]."""
    levels = [(one.number, one.profile, one.max_bit_s, one.max_rate_hz) for one in LEVELS]
    assert levels == [(1, 0b0110_0001, 16_000, 72.0), (2, 0b0110_0010, 32_000, 72.0)]


@pytest.mark.parametrize("number", range(3, 69))
def test_the_error_of_a_fap_moves_its_point_by_its_lever(number: int) -> None:
    levers = {47: TONGUE_LEVER * FACE.mw0_mm} | dict.fromkeys(range(23, 27), EYE_LEVER_MM)
    levers |= dict.fromkeys(range(48, 51), HEAD_LEVER_MM)
    errors = np.zeros(66)
    errors[number - 3] = -2.0
    moved = 2.0 * FACE.steps()[fap.column(number)] * levers.get(number, 1.0)
    same = [row.point == fap.spec(number).point or number in (48, 49, 50) for row in fap.FAPS]
    np.testing.assert_allclose(point_errors_mm(errors, FACE), np.where(same, moved, 0.0))


def test_partners_have_the_same_names_but_for_their_side_or_their_edge() -> None:
    names = {row.number: row.name for row in fap.FAPS}
    for left, right in SIDE_PARTNERS:
        assert names[left].replace("_l_", "_r_").replace("_lm", "_rm") == names[right] != names[left]
    for inner, outer in LIP_PARTNERS:
        assert f"{names[inner]}_o" == names[outer]


@pytest.mark.parametrize(("one", "other"), SIDE_PARTNERS + LIP_PARTNERS)
def test_each_partner_fills_the_other(one: int, other: int) -> None:
    for sent, filled in ((one, other), (other, one)):
        values, mask = np.zeros((1, 68), np.int32), np.zeros((1, 68), bool)
        values[0, sent - 1], mask[0, sent - 1] = 17, True
        assert fill(values, mask, np.ones_like(mask))[0][0, filled - 1] == 17


@pytest.mark.parametrize(("one", "other"), [(6, 7), (8, 9), (10, 11), (12, 13)])
def test_the_other_side_comes_before_the_other_contour_of_that_side(one: int, other: int) -> None:
    values, mask = np.zeros((1, 68), np.int32), np.zeros((1, 68), bool)
    for number, value in ((one, 17), (dict(LIP_PARTNERS)[one], 5)):
        values[0, number - 1], mask[0, number - 1] = value, True
    assert fill(values, mask, np.ones_like(mask))[0][0, other - 1] == 17


def test_bounds_of_a_parameter_file_have_32_bits() -> None:
    with pytest.raises(DataError, match="FIN: must be -2147483648 to"):
        parse_epf(b"FBM 1 FFR 0 FIN" + b" -2147483649" * 66)
