"""The 30 streams of another encoder: the same bytes one way, the same values the other."""

from collections.abc import Mapping

import numpy as np
import pytest

from fapengine.codec import kernels
from fapengine.codec.decoder import Decoder, decode
from fapengine.codec.epf import encode_orders, parse_epf
from fapengine.codec.fapfile import parse_fap

NAMES = [
    "t01-talk-all-q1", "t02-talk-subset-q4", "t03-talk-visexp-q8", "t04-intra-only-q1", "t05-noise-q0",
    "t06-noise-q15", "t07-noise-q31", "t08-q-steps-minmax", "t09-mask-changes", "t10-skips", "t11-timecode-rates",
    "t12-one-frame", "t13-talk-1000", "t14-tight-minmax", "t15-clip", "t16-extremes", "t17-rescale",
    "t18-epf-mask-override", "t19-asym-partial-minmax", "t20-viseme-only", "t21-q-change-no-minmax", "t22-steps",
    "t23-ref-talk-q1", "t24-ref-talk-q8", "t25-ref-noise-q15", "t26-ref-noise-q0", "t27-ref-mask-skip-tc",
    "t28-ref-noise-q3", "t29-plane-start-codes", "t30-lookahead-zeros",
]  # fmt: skip
FED_BY_BYTES = ["t10-skips", "t12-one-frame", "t20-viseme-only", "t27-ref-mask-skip-tc", "t30-lookahead-zeros"]

pytestmark = pytest.mark.conformance


def test_no_vector_is_left_out(vectors: Mapping[str, bytes]) -> None:
    assert len(NAMES) == 30
    assert sorted(vectors) == sorted(
        f"{name}.{kind}" for name in NAMES for kind in ("decoded.fap", "epf", "fap", "fba")
    )


@pytest.mark.parametrize("name", NAMES)
def test_encoding_gives_the_same_bytes(vectors: Mapping[str, bytes], name: str) -> None:
    orders = parse_epf(vectors[f"{name}.epf"])
    track = parse_fap(vectors[f"{name}.fap"])
    data = encode_orders(orders, track, clamp=name.startswith("t15"), plane_start_codes=name.startswith("t29"))
    assert data == vectors[f"{name}.fba"]


@pytest.mark.parametrize("name", NAMES)
def test_decoding_gives_the_same_values(vectors: Mapping[str, bytes], name: str) -> None:
    track = decode(vectors[f"{name}.fba"]).track
    wanted = parse_fap(vectors[f"{name}.decoded.fap"])
    for field in ("mask", "values", "visemes", "expressions", "frame_numbers"):
        np.testing.assert_array_equal(getattr(track, field), getattr(wanted, field), err_msg=field)
    assert track.rate_hz == pytest.approx(wanted.rate_hz, rel=0.0011)  # the file says 30 for 30000/1001


@pytest.mark.parametrize("name", FED_BY_BYTES[:-1])
def test_the_loops_in_python_read_and_write_them_where_those_in_c_are_installed_too(
    vectors: Mapping[str, bytes], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = vectors[f"{name}.fba"]
    compiled = decode(data)
    monkeypatch.setattr(kernels, "loops", kernels)
    assert encode_orders(parse_epf(vectors[f"{name}.epf"]), parse_fap(vectors[f"{name}.fap"])) == data
    decoder = Decoder()
    step = len(data) // 3 if len(data) > 1000 else 1
    pieces = [data[at : at + step] for at in range(0, len(data), step)]
    rows = [frame.row for piece in pieces for frame in decoder.feed(piece)]
    np.testing.assert_array_equal(rows, np.concatenate([part.values for part in compiled.planes]))


@pytest.mark.parametrize("name", FED_BY_BYTES)
def test_feeding_byte_by_byte_equals_feeding_at_once(vectors: Mapping[str, bytes], name: str) -> None:
    data = vectors[f"{name}.fba"]
    decoder = Decoder()
    frames = [frame for byte in data for frame in decoder.feed(bytes([byte]))]
    assert decoder.ended
    assert decoder.close() == []
    whole = decode(data)
    np.testing.assert_array_equal(
        [frame.row for frame in frames], np.concatenate([part.values for part in whole.planes])
    )
    np.testing.assert_array_equal([frame.number for frame in frames], whole.track.frame_numbers)
