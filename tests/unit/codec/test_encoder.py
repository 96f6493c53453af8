"""The encoder's choices: each keeps its promise, and a plain decoder reads all of them."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.codec.decoder import Decoder, decode
from fapengine.codec.encoder import (
    FIRST_QUANT,
    WINDOW_S,
    Encoder,
    EncoderOptions,
    coarsest_quant,
    encode,
    fit_ranges,
    guaranteed_quant,
    moving,
    point_errors_mm,
    quantise,
    table_ranges,
)
from fapengine.codec.fields import FIELD_COUNT, UNIT, SentRanges
from fapengine.codec.fit import fill
from fapengine.codec.header import mask_types_of
from fapengine.codec.kernels import SKIP_LIMIT
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import FapTrack

FACE = Fapu(irisd0_mm=11.0, es0_mm=62.0, ens0_mm=47.0, mns0_mm=22.0, mw0_mm=50.0)
RATE_HZ = 25.0


def talking(seconds: float = 8.0, faps: tuple[int, ...] = (3, 4, 5, 6, 19, 20, 48, 51, 52)) -> FapTrack:
    """Smooth motion of a few FAPs, all sent."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    values = np.zeros((len(t), 68))
    for number in faps:
        step = fap.spec(number).quantiser_step
        values[:, fap.column(number)] = step * 60 * np.sin(t * (2 + number % 7)) * (1 + 0.3 * np.sin(t / 2))
    return FapTrack.from_values(np.round(values).astype(int), rate_hz=RATE_HZ)


def errors_of(track: FapTrack, stream: bytes) -> np.ndarray:
    return np.abs(decode(stream).track.values - track.values)


@pytest.mark.parametrize("quant", [0, 1, 2, 7, 15, 31])
@pytest.mark.parametrize("ranges", ["table", "fitted"])
def test_the_error_is_half_a_step_at_most(quant: int, ranges: str) -> None:
    track = talking(4.0, faps=(3, 4, 5, 6, 19, 20, 51))
    stream = encode(track, EncoderOptions(quant=quant, ranges=ranges, intra_every=30))
    steps = np.array([0, 0] + [row.quantiser_step for row in fap.FAPS]) * quant if quant else np.zeros(68)
    assert (errors_of(track, stream) <= steps // 2).all()


def test_fitted_ranges_are_never_longer_and_here_much_shorter() -> None:
    track = talking()
    plain, fitted = (encode(track, EncoderOptions(ranges=ranges)) for ranges in ("table", "fitted"))
    assert len(fitted) < 0.9 * len(plain)
    short = talking(0.2)
    assert len(encode(short, EncoderOptions(ranges="fitted"))) <= len(encode(short))


@pytest.mark.parametrize(("ranges", "kbit_s"), [("table", 1.5), ("table", 2.5), ("fitted", 1.0), ("fitted", 1.5)])
def test_rate_control_meets_its_target(ranges: str, kbit_s: float) -> None:
    track = talking(20.0)
    stream = encode(track, EncoderOptions(kbit_s=kbit_s, ranges=ranges))
    assert 0.8 * kbit_s < 8 * len(stream) / 20 / 1000 <= kbit_s * 1.02
    assert len(decode(stream).track) == len(track)


def test_groups_share_what_a_target_rate_leaves_over() -> None:
    track = talking(20.0)
    stream = encode(track, EncoderOptions(kbit_s=3.0, intra_every=50))
    assert 0.95 < 8 * len(stream) / 20 / 3000 <= 1.02


@pytest.mark.parametrize(("ranges", "kbit_s"), [("table", 4.0), ("fitted", 1.5)])
def test_live_rate_control_settles_at_its_target(ranges: str, kbit_s: float) -> None:
    """Steady motion gets a steady quantiser, once the first groups have shown what it costs."""
    track = talking(70.0)
    encoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(kbit_s=kbit_s, ranges=ranges))
    stream = b"".join(encoder.frame(row) for row in track.values) + encoder.finish()
    assert 8 * len(stream) / 70 / 1000 == pytest.approx(kbit_s, rel=0.05)
    quants = [part.header.quant for part in decode(stream).planes if part.intra]
    assert quants[0] == FIRST_QUANT
    assert max(quants[2:]) <= 2 * min(quants[2:])


def test_live_ranges_hold_the_motion_of_the_last_seconds() -> None:
    """Of :data:`WINDOW_S`, and not what went before."""
    column, rows = fap.column(19), np.zeros((round((WINDOW_S + 4.0) * RATE_HZ), 68), int)
    rows[: round(2 * RATE_HZ) : 2, column] = 600
    encoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(ranges="fitted"))
    stream = b""
    for number, row in enumerate(rows):
        if number in (round(0.9 * WINDOW_S * RATE_HZ), round((WINDOW_S + 3.0) * RATE_HZ)):
            encoder.request_intra()
        stream += encoder.frame(row)
    within, after = [part.header for part in decode(stream + encoder.finish()).planes if part.intra][1:]
    assert within.ranges.p_max[column - 2] >= 600 // UNIT > after.ranges.p_max[column - 2]


def test_intra_refresh_comes_on_time_and_where_asked() -> None:
    track = talking(2.0)
    planes = decode(encode(track, EncoderOptions(intra_every=15))).planes
    assert [int(part.numbers[0]) for part in planes if part.intra] == [0, 15, 30, 45]
    encoder = Encoder(rate_hz=RATE_HZ)
    stream = encoder.frame(track.values[0]) + encoder.frame(track.values[1])
    encoder.request_intra()
    stream += encoder.frame(track.values[2]) + encoder.finish()
    planes = decode(stream).planes
    assert [part.intra for part in planes] == [True, False, True]
    assert planes[2].header.rate == planes[0].header.rate is not None  # who begins here knows how fast to show it


def test_faps_at_rest_are_left_out_and_come_back_when_they_move() -> None:
    values = talking(4.0, faps=(3, 51)).values.copy()
    values[50:, fap.column(31)] = np.arange(50) * 4
    track = FapTrack.from_values(values, rate_hz=RATE_HZ)
    stream = encode(track, EncoderOptions(moving_only=True, intra_every=50))
    sent = [part.header.mask for part in decode(stream).planes if part.intra]
    assert [np.flatnonzero(mask).tolist() for mask in sent] == [[2, 50], [2, 30, 50]]
    assert (errors_of(track, stream) <= 2).all()
    assert len(stream) < 0.8 * len(encode(track, EncoderOptions(intra_every=50)))


@pytest.mark.parametrize("limit_mm", [0.2, 0.5, 2.0])
def test_the_error_bound_holds_in_mm_and_the_next_quantiser_would_break_it(limit_mm: float) -> None:
    track = talking()
    stream = encode(track, EncoderOptions(max_error_mm=limit_mm, fapu=FACE))
    assert point_errors_mm(errors_of(track, stream)[:, 2:].astype(float), FACE).max() <= limit_mm
    quant = decode(stream).planes[0].header.quant
    low_level = track.values[:, 2:].astype(np.int64)
    assert quant == coarsest_quant(low_level, np.ones(66, bool), FACE, limit_mm)
    if quant < 31:
        coarser = low_level - quantise(low_level, quant + 1)[1]
        assert point_errors_mm(coarser.astype(float), FACE).max() > limit_mm


def test_a_bound_that_no_quantiser_keeps_switches_it_off() -> None:
    assert coarsest_quant(talking().values[:, 2:].astype(np.int64), np.ones(66, bool), FACE, 1e-6) == 0
    assert guaranteed_quant(np.ones(66, bool), FACE, 1e-6) == 0
    assert guaranteed_quant(np.ones(66, bool), FACE, 0.5) < guaranteed_quant(np.ones(66, bool), FACE, 2.0)


def test_a_head_turn_of_one_milliradian_moves_the_far_points_by_its_lever() -> None:
    errors = np.zeros(66)
    errors[48 - 3] = 100  # 1e-5 rad each
    assert point_errors_mm(errors, FACE).max() == pytest.approx(0.12)


def test_live_frames_are_complete_at_once_with_start_codes() -> None:
    track = talking(2.0)
    encoder, decoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(plane_start_codes="all")), Decoder()
    for row in track.values:
        assert len(decoder.feed(encoder.frame(row))) == 1
    assert decoder.feed(encoder.finish()) == []
    assert decoder.ended
    whole = encode(track, EncoderOptions(plane_start_codes="all"))
    assert decode(whole).track.equals(decode(encode(track)).track)


@pytest.mark.parametrize(
    "options",
    [
        EncoderOptions(ranges="fitted", intra_every=20),
        EncoderOptions(moving_only=True, intra_every=20),
        EncoderOptions(max_error_mm=0.5, fapu=FACE),
        EncoderOptions(plane_start_codes="intra", intra_every=20, unsent="interpolate"),
    ],
)
def test_live_streams_decode_with_every_choice(options: EncoderOptions) -> None:
    track = talking(4.0)
    encoder = Encoder(rate_hz=RATE_HZ, options=options)
    stream = b"".join(encoder.frame(row) for row in track.values) + encoder.finish()
    shown = decode(stream).track
    assert len(shown) == len(track)
    assert point_errors_mm(np.abs(shown.values - track.values)[:, 2:].astype(float), FACE)[:20].max() < 1.0


@pytest.mark.conformance
def test_visemes_and_expressions_go_through() -> None:
    encoder = Encoder(rate_hz=30.0, faps=(1, 2, 3))
    stream = encoder.frame([0] * 68, viseme=(3, 4, 70, 1), expression=(1, 63, 2, 5, 0, 1), skip=2)
    stream += encoder.frame([0] * 68, viseme=(14, 0, 0, 0), expression=(6, 0, 0, 63, 1, 0)) + encoder.finish()
    frames = Decoder().feed(stream)
    assert [frame.viseme for frame in frames] == [(3, 4, 63, 1), (14, 0, 0, 0)]
    assert [frame.expression for frame in frames] == [(1, 63, 2, 5, 0, 1), (6, 0, 0, 63, 1, 0)]
    assert [frame.number for frame in frames] == [0, 3]
    assert frames[0].values.tolist() == [0] * 68
    without = Decoder().feed(WORKED := encode(talking(0.1)))[0]
    assert without.viseme == (0,) * 4
    assert without.expression == (0,) * 6
    assert len(WORKED) > 20
    with pytest.raises(UsageError, match="FAP: must be 3 to 68, got 2"):
        without.fap(2)


def test_a_frame_without_an_expression_sends_that_of_a_neutral_face() -> None:
    plain, told = (Encoder(rate_hz=30.0, faps=(1, 2, 3)) for _ in range(2))
    assert plain.frame([0] * 68) == told.frame([0] * 68, viseme=(0,) * 4, expression=(0,) * 6)


def test_a_margin_widens_fitted_ranges_by_its_factor() -> None:
    levels = quantise(talking().values[:, 2:], 1)[0]
    plain, wide = fit_ranges(levels, 4), fit_ranges(levels, 4, margin=2.0)
    assert plain.p_max is not None
    assert wide.p_max is not None
    assert wide.p_max.max() >= 2 * plain.p_max.max() - 1 > 2


def test_masks_that_change_begin_a_group_and_gaps_are_skips() -> None:
    track = talking(1.0)
    mask = track.mask.copy()
    mask[10:, 30:] = False
    changed = FapTrack(
        values=np.where(mask, track.values, 0), mask=mask, visemes=track.visemes, expressions=track.expressions,
        frame_numbers=np.arange(25) * 3, rate_hz=RATE_HZ,
    )  # fmt: skip
    decoded = decode(encode(changed)).track
    np.testing.assert_array_equal(decoded.mask, mask)
    np.testing.assert_array_equal(decoded.frame_numbers, changed.frame_numbers)


@pytest.mark.parametrize(
    "options",
    [
        {"quant": 32}, {"quant": -1}, {"intra_every": -1}, {"kbit_s": 0.0}, {"kbit_s": float("nan")},
        {"max_error_mm": 1.0}, {"max_error_mm": 0.0, "fapu": FACE}, {"max_error_mm": 1.0, "fapu": FACE, "kbit_s": 1.0},
    ],
)  # fmt: skip
def test_choices_that_make_no_sense_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        EncoderOptions(**options)


def test_a_live_frame_beyond_what_can_be_sent_is_as_near_as_can_be() -> None:
    shown = []
    for most in (1_000, 20_000, 30_000):
        encoder = Encoder(rate_hz=RATE_HZ, faps=(3,))
        stream = encoder.frame([most] * 68) + encoder.frame([-most] * 68) + encoder.finish()
        shown.append(decode(stream).track.values[:, fap.column(3)].tolist())
    assert shown[0][0] < shown[1][0] == shown[2][0]
    assert shown[1] == shown[2]


@pytest.mark.parametrize(("field", "moved"), [(0, 0), (2, 0), (3, 1), (6, 1), (7, 2), (72, 67)])
def test_each_field_moves_its_own_fap(field: int, moved: int) -> None:
    row = np.zeros((1, FIELD_COUNT), np.int64)
    row[0, field] = 1
    assert np.flatnonzero(moving(row, np.zeros(FIELD_COUNT, np.int64))).tolist() == [moved]


def test_bad_frames_are_refused() -> None:
    encoder = Encoder(rate_hz=25.0, faps=(1, 3))
    with pytest.raises(UsageError, match="shape"):
        encoder.frame([0] * 66)
    with pytest.raises(UsageError, match="of float64"):
        encoder.frame([0.5] * 68)
    with pytest.raises(UsageError, match="expected 4 and 6"):
        encoder.frame([0] * 68, viseme=(1,))
    with pytest.raises(UsageError, match="viseme_select"):
        encoder.frame([0] * 68, viseme=(15, 0, 0, 0))
    with pytest.raises(UsageError, match="skip"):
        encoder.frame([0] * 68, skip=-1)
    with pytest.raises(UsageError, match="no frames"):
        encode(FapTrack.from_values(np.zeros((0, 68), int), rate_hz=25.0))


@pytest.mark.parametrize(("unsent", "kind"), [("keep", 1), ("interpolate", 2)])
def test_headers_say_what_decoders_do_with_what_is_not_sent(unsent: str, kind: int) -> None:
    track, options = talking(0.2), EncoderOptions(unsent=unsent)
    mask = track.mask & (np.arange(68) % 2 == 0)
    encoder = Encoder(rate_hz=RATE_HZ, faps=(np.flatnonzero(mask[0]) + 1).tolist(), options=options)
    live = encoder.frame(track.values[0]) + encoder.finish()
    for stream in (live, encode(replace(track, values=np.where(mask, track.values, 0), mask=mask), options)):
        header = decode(stream).planes[0].header
        assert header.mask_types == mask_types_of(mask[0], kind)
        assert kind in header.mask_types
        assert (header.gender, header.time_code) == (0, None)


@pytest.mark.conformance
def test_what_is_not_sent_is_held_or_taken_from_its_partner() -> None:
    values, mask = np.zeros((2, 68), np.int32), np.zeros((2, 68), bool)
    for number, value in ((4, 11), (6, 22), (19, 33)):
        values[0, number - 1], mask[:, number - 1] = value, True
    wanted = np.array([[True], [False]]) & np.ones_like(mask)
    (shown, held), unreal = fill(values, mask, wanted)
    expected = {4: 11, 51: 11, 6: 22, 53: 22, 7: 22, 54: 22, 19: 33, 20: 33, 3: 0, 31: 0}
    assert {number: int(shown[number - 1]) for number in expected} == expected
    assert held[51 - 1] == 11
    assert held[4 - 1] == 0
    assert unreal == 0


def test_ranges_never_say_zero_for_fap_4() -> None:
    ranges = fit_ranges(np.zeros((2, 66), np.int64), 1)
    assert ranges.i_max is not None
    assert ranges.i_max[1] == 1
    assert ranges.i_max.sum() == 1


def test_more_than_an_hour_may_be_skipped() -> None:
    assert SKIP_LIMIT > 3600 * 25


@pytest.mark.parametrize("options", [EncoderOptions(ranges="fitted", intra_every=40), EncoderOptions(moving_only=True)])
def test_a_sudden_motion_after_rest_is_followed_at_once(options: EncoderOptions) -> None:
    values = talking(4.0, faps=(3, 51)).values.copy()
    values[70:, fap.column(19)] = 1000
    track = FapTrack.from_values(values, rate_hz=RATE_HZ)
    encoder = Encoder(rate_hz=RATE_HZ, options=options)
    stream = b"".join(encoder.frame(row) for row in track.values) + encoder.finish()
    decoded = decode(stream)
    assert (np.abs(decoded.track.values - track.values)[70:] <= 2).all()
    assert 70 in [int(part.numbers[0]) for part in decoded.planes if part.intra]


def test_a_face_without_an_error_bound_changes_nothing() -> None:
    track = talking(2.0)
    assert encode(track, EncoderOptions(fapu=FACE)) == encode(track)
    live = [Encoder(rate_hz=RATE_HZ, options=options) for options in (EncoderOptions(fapu=FACE), EncoderOptions())]
    assert live[0].frame(track.values[0]) == live[1].frame(track.values[0])


def test_live_ranges_of_the_table_are_not_sent() -> None:
    encoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(intra_every=5))
    stream = b"".join(encoder.frame(row) for row in talking(1.0).values) + encoder.finish()
    headers = [part.header for part in decode(stream).planes if part.intra]
    assert len(headers) == 5
    assert all(header.ranges == SentRanges() for header in headers)


def test_a_live_group_near_its_target_does_not_end_early() -> None:
    """With the bits that its quantiser takes as the target; with a tenth of them it does."""
    rows = talking(9.0).values
    plain = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(quant=FIRST_QUANT))
    kbit_s = 8 * len(b"".join(plain.frame(row) for row in rows)) / 9.0 / 1000
    for share, early in ((1.0, False), (0.1, True)):
        encoder = Encoder(rate_hz=RATE_HZ, options=EncoderOptions(kbit_s=share * kbit_s))
        stream = b"".join(encoder.frame(row) for row in rows) + encoder.finish()
        assert (len([part for part in decode(stream).planes if part.intra]) > 1) == early, share


def test_after_fitted_ranges_those_of_the_table_are_tried_too(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []
    monkeypatch.setattr("fapengine.codec.encoder.table_ranges", lambda: tried.append(True) or table_ranges())
    planes = decode(encode(talking(4.0), EncoderOptions(ranges="fitted", intra_every=50))).planes
    assert planes[0].header.ranges.p_max is not None
    assert tried
    tried.clear()
    encode(talking(4.0), EncoderOptions(intra_every=50))
    assert not tried  # they are in force
