"""Hand-checked streams, and every way in which a stream can be wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fapengine.codec import bits, kernels
from fapengine.codec.decoder import Decoder, decode
from fapengine.codec.encoder import encode
from fapengine.codec.epf import PlaneOrder, encode_orders, parse_epf
from fapengine.codec.fapfile import parse_fap
from fapengine.codec.fields import SentRanges, default_ranges
from fapengine.codec.header import FrameRate, TimeCode, mask_types_of
from fapengine.errors import ConformanceError, DataError, TruncatedError, UnsupportedError, UsageError
from fapengine.mpeg4.track import FapTrack

pytestmark = pytest.mark.conformance

h = bytes.fromhex

WORKED_EXAMPLE = h(
    "00 00 01 BA"  # start code
    "B1 90 01"  # I plane: 1 01 1 00011001 0000 0 0 0, 25 Hz
    "B5 80 00 92 4B 24 80"  # q 1, masks, no ranges
    "29 88 3E 84 86 14 00 6C 7D 28 52 D1 7D 70 05 A1"  # arithmetic data; two P planes
    "7F 00 00 01 B1"  # stuffing, end code
)
EXAMPLE_FAP = b"""# worked example
2.1 example 25 3
1 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
0 10 1 63 0 100 -1000
1 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
1 10 1 40 0 131 -660
1 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
2 1 0 40 1 131 -660
"""  # noqa: E501
EXAMPLE_EPF = b"""FBM 1 FFR 0 ISI 1 FRR 25 0 0
FMT 1 1 0 1 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1 1 0 0 0 0 0
FQU 1
FBM 1 FFR 1 ISI 0
FBM 1 FFR 2 ISI 0
"""


def example_track() -> FapTrack:
    return parse_fap(EXAMPLE_FAP)


def flipped(data: bytes, *bits: int) -> bytes:
    changed = bytearray(data)
    for bit in bits:
        changed[bit // 8] ^= 0x80 >> bit % 8
    return bytes(changed)


def test_worked_example_is_encoded_to_its_bytes() -> None:
    assert encode_orders(parse_epf(EXAMPLE_EPF), example_track()) == WORKED_EXAMPLE


def test_worked_example_is_decoded_to_its_values() -> None:
    track = decode(WORKED_EXAMPLE).track
    assert track.visemes.tolist() == [[10, 1, 63, 0], [10, 1, 40, 0], [1, 0, 40, 1]]
    assert track.values[:, 2].tolist() == [100, 132, 132]
    assert track.values[:, 47].tolist() == [-1020, -680, -680]
    assert track.rate_hz == 25.0


@pytest.mark.parametrize("cut", range(len(WORKED_EXAMPLE)))
def test_every_cut_is_truncated(cut: int) -> None:
    with pytest.raises(TruncatedError):
        decode(WORKED_EXAMPLE[:cut])


def test_frames_before_the_error_are_returned_and_the_error_comes_next() -> None:
    decoder = Decoder()
    broken = flipped(WORKED_EXAMPLE, 197, 198)  # the third plane's object mask: 10, bodies
    assert len(decoder.feed(broken)) == 2
    where = r"\(at byte 24, bit 4; FBA section 2\)"
    with pytest.raises(ConformanceError, match=f"fba_object_mask 2, of which no I plane was sent {where}"):
        decoder.feed(b"")
    with pytest.raises(ConformanceError):
        decoder.close()


@pytest.mark.parametrize(
    ("bits", "kind", "message"),
    [
        ((32,), ConformanceError, "first plane"),
        ((34,), ConformanceError, "fba_object_mask: got 0"),
        ((33, 34), ConformanceError, "body group"),
        ((33,), ConformanceError, "body group"),
        ((56,), ConformanceError, "mask of group 1"),
        ((108,), UnsupportedError, "DCT"),
        ((155,), ConformanceError, "fba_object_mask: got 0, expected 1 to 3"),
        ((0,), ConformanceError, "start code"),
        ((31,), ConformanceError, "start code"),
    ],
)
def test_a_wrong_fixed_bit_is_named(bits: tuple[int, ...], kind: type[DataError], message: str) -> None:
    with pytest.raises(kind, match=message):
        decode(flipped(WORKED_EXAMPLE, *bits))


def test_a_frame_rate_of_nothing_is_refused() -> None:
    zero_rate = flipped(WORKED_EXAMPLE, 39, 40, 43)
    with pytest.raises(ConformanceError, match="frame rate"):
        decode(zero_rate)


def test_time_codes_set_the_time_and_it_goes_on() -> None:
    epf = EXAMPLE_EPF.replace(b"FQU 1", b"FQU 1 TC 1 2 1 3 SKN 4")
    data = encode_orders(parse_epf(epf), example_track())
    frames = Decoder().feed(data)
    assert [frame.time_s for frame in frames] == pytest.approx([3723.0, 3723.2, 3723.24])
    assert [frame.number for frame in frames] == [0, 5, 6]
    masks = EXAMPLE_EPF.splitlines()[1]
    later = EXAMPLE_EPF.replace(b"FFR 1 ISI 0", b"FFR 1 ISI 1 %s FQU 1 TC 1 2 1 3" % masks)
    frames = Decoder().feed(encode_orders(parse_epf(later), example_track()))
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 3723.0, 3723.04])
    hour = 32 + 4 + 13 + 1  # behind the rate; 1 -> 25 sets two more bits
    with pytest.raises(ConformanceError, match="time code"):
        decode(flipped(data, hour, hour + 1))
    with pytest.raises(ConformanceError, match="marker"):
        decode(flipped(data, hour + 11))


@pytest.mark.parametrize("skip", [1, 14, 15, 16, 30, 45, 100])
def test_skips_of_any_size(skip: int) -> None:
    for target, plane in ((b"FFR 0", 0), (b"FFR 1", 1)):
        epf = EXAMPLE_EPF.replace(target, target + b" SKN %d" % skip)
        numbers = decode(encode_orders(parse_epf(epf), example_track())).track.frame_numbers
        assert np.diff(numbers)[plane] == skip + 1


def test_an_endless_skip_is_refused() -> None:
    skip_flag = WORKED_EXAMPLE[:6] + b"\x3f" + b"\xff" * 10_000
    with pytest.raises(ConformanceError, match="frames to skip"):
        decode(skip_flag)
    p_plane = WORKED_EXAMPLE[:19] + b"\x1f" + b"\xff" * 10_000  # from bit 153: 0 01, then skips
    with pytest.raises(ConformanceError, match="frames to skip"):
        decode(p_plane)


def test_headers_of_a_visual_stream_are_passed() -> None:
    for headers in ("00 00 01 B0 61 00 00 01 B5 23", "00 00 01 B5 8A 47", "00 00 01 B2 41 42"):
        assert len(decode(h(headers) + WORKED_EXAMPLE).track) == 3
    with pytest.raises(UnsupportedError, match="visual_object_type: got 1"):
        decode(h("00 00 01 B5 0B") + WORKED_EXAMPLE)
    with pytest.raises(TruncatedError):
        decode(h("00 00 01 B5"))
    with pytest.raises(TruncatedError):
        decode(h("00 00 01 B0 61"))
    with pytest.raises(DataError, match="no face object"):
        decode(h("00 00 01 B2") + bytes(5000))
    with pytest.raises(DataError, match="no face object"):
        decode(h("00 00 01 B2") * 2000)


def test_counts_that_are_halved_keep_their_sum_and_their_tree() -> None:
    size = 9
    fields, base, totals, previous = np.zeros((1, 8), np.int64), np.zeros(1, np.int64), np.zeros(1, np.int64), [0]
    counts, tree = np.zeros((2, size + 2), np.int64)
    fields[0, kernels.ON], fields[0, kernels.P_COUNT] = 1, size
    kernels.reset_models(fields, base, counts, tree, totals)
    for rank in np.random.default_rng(1).binomial(size - 1, 0.3, kernels.LIMIT).tolist():
        kernels.keep_plane(False, np.array([[0], [rank]]), fields, previous, (base, counts, tree, totals))
    assert size < totals[0] == counts.sum() < 0.6 * kernels.LIMIT
    assert [tree[i] for i in range(1, size + 1)] == [counts[i - (i & -i) + 1 : i + 1].sum() for i in range(1, size + 1)]


def test_old_start_codes_are_read() -> None:
    assert len(decode(WORKED_EXAMPLE.replace(h("000001BA"), h("00000101"))).track) == 3
    data = encode_orders(parse_epf(EXAMPLE_EPF), example_track(), plane_start_codes=True)
    assert data[:9] == h("000001BA 7F 000001BB")
    assert len(decode(data.replace(h("000001BB"), h("00000103"))).track) == 3
    for wrong in ("CC", "00"):
        with pytest.raises(ConformanceError, match=f"got start code {wrong.lower()}"):
            decode(data.replace(h("000001BB"), h(f"000001{wrong}")))
    with pytest.raises(DataError, match="no frame"):
        decode(data.replace(h("000001BB"), h("000001B1")))


def test_decoding_without_an_end_code_is_truncated_but_resync_gives_the_frames() -> None:
    with pytest.raises(TruncatedError, match="without its end code"):
        decode(WORKED_EXAMPLE[:-4])
    rescued = decode(WORKED_EXAMPLE[:-4], errors="resync")
    assert rescued.track.equals(decode(WORKED_EXAMPLE).track)
    assert rescued.losses[0].reason.startswith("stream: ends")


def test_header_values_are_checked() -> None:
    with pytest.raises(UsageError, match="frame rate"):
        FrameRate(256)
    with pytest.raises(UsageError, match="rate_hz"):
        FrameRate.nearest(1000.0)
    with pytest.raises(UsageError, match="time code"):
        TimeCode(24, 0, 0)
    with pytest.raises(UsageError, match=r"i_max of FAP 5: must be .*, got magnitude 1861"):
        SentRanges.covering([0, 0, 1861] + [0] * 63, None, None, None)
    with pytest.raises(UsageError, match=r"i_min of FAP 3: must be .*, got magnitude -60"):
        SentRanges.covering(None, [60] + [0] * 65, None, None)
    with pytest.raises(UsageError, match="shape"):
        SentRanges.covering([1], None, None, None)
    assert FrameRate.nearest(12.5) == FrameRate(12, 8)


def test_ranges_to_send_are_whole_numbers() -> None:
    bounds = [[120] * 66, [-61] * 66, None, [0] * 66]
    sent = SentRanges.covering(*bounds)
    assert [None if row is None else (row.dtype, set(row.tolist())) for row in sent] == [
        (np.int64, {2}), (np.int64, {2}), None, (np.int64, {0})
    ]  # fmt: skip


def test_default_ranges_are_rounded_and_divided() -> None:
    assert default_ranges(1)[:, 0].tolist() == [1080, -1080, 360, -360]
    assert default_ranges(1)[:, 60].tolist()[:2] == [720, -720]  # FAP 63: 680 in the table
    assert default_ranges(7)[0, 0] == 154


def test_mask_types_are_the_shortest() -> None:
    mask = np.zeros(68, bool)
    mask[[2, 3, *range(47, 50)]] = True
    assert mask_types_of(mask) == (0, 1, 0, 0, 0, 0, 3, 0, 0, 0)
    assert mask_types_of(mask, unsent=2) == (2, 2, 2, 2, 2, 2, 3, 2, 2, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "no frame"),
        (b"\xff\xfe", "is not UTF-8 text"),
        (b"FFR 0", "expected FBM first"),
        (b"FBM 1 ISI 1", "FFR is missing"),
        (b"FBM 1 FFR 0 ISI 1", "FMT is missing"),
        (b"FBM 1 FFR 0 ISI 2", "ISI: must be 0 to 1, got 2"),
        (b"FBM 1 FFR x", "whole number"),
        (b"FBM 1 FFR --1", "FFR: must be 0 to"),
        (b"FBM 1 FFR", "got 0 numbers"),
        (b"FBM 1 FFR 0 XYZ 1", "unknown tag 'XYZ'"),
        (b"FBM 2", "body"),
        (b"FBM 1 BQU 1", "body"),
        (b"FBM 1 CDM 1", "DCT"),
        (b"FBM 1 FRR 0 0 0", "frame rate"),
        (EXAMPLE_EPF.replace(b"FQU 1", b"FIX" + b" 1861" * 66), "1861"),
        (EXAMPLE_EPF.replace(b"FMT 1 1", b"FMT 4 1"), "type of group 1"),
        *(
            (EXAMPLE_EPF.replace(old, new), new[:3].decode())
            for old, new in ((b"FBM 1", b"FBM 4"), (b"FQU 1", b"FQU 32"), (b"ISI 1", b"ISI 2"))
        ),
    ],
)
def test_bad_parameter_files_are_refused(text: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_epf(text)


def test_tags_of_a_parameter_file_reach_the_header() -> None:
    text = EXAMPLE_EPF.replace(
        b"FQU 1", b"# comment\nFQU 3 TC 1 2 1 3 GDR 1\r\nFIX" + b" 600" * 66 + b" FPN" + b" -61" * 66
    )
    header = parse_epf(text)[0].header
    assert header is not None
    assert (header.quant, header.gender, header.time_code) == (3, 1, TimeCode(1, 2, 3))
    i_max, i_min, p_max, p_min = header.ranges
    assert i_min is None
    assert p_max is None
    np.testing.assert_array_equal(i_max, [10] * 66)
    np.testing.assert_array_equal(p_min, [2] * 66)


def test_orders_that_cannot_be_carried_out() -> None:
    track = example_track()
    orders = parse_epf(EXAMPLE_EPF)
    with pytest.raises(UsageError, match="I plane first"):
        encode_orders(orders[1:], track)
    with pytest.raises(UsageError, match="frame 7"):
        encode_orders([*orders, PlaneOrder(frame=7)], track)
    narrow = parse_epf(EXAMPLE_EPF.replace(b"FQU 1", b"FQU 1 FIX" + b" 0" * 66))
    with pytest.raises(UsageError, match=r"FAP 3 \(open_jaw\)"):
        encode_orders(narrow, track)
    assert decode(encode_orders(narrow, track, clamp=True)).track.values[0, 2] == 0
    with pytest.raises(UsageError, match="viseme_select in frame 1"):
        encode_orders(orders, parse_fap(EXAMPLE_FAP.replace(b"1 10 1 40 0", b"1 15 1 40 0")))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("000001bab19001b58000924b2480000000000000006c752852d17d7005a17f000001b1", "arithmetic data: got 23 zeros"),
        (
            "000001bab19001b58000924b248029883e848614006c7d2852010000000000000001b1",
            r"FAP 1 \(viseme_select1\): got a val",
        ),
        ("000001bab19001b58000924b248229883e848614006c7d2852d17d7004a37f000001b1", "ranges at FAP 3: got marker bit 0"),
    ],
)
def test_arithmetic_data_and_ranges_that_cannot_be(data: str, message: str) -> None:
    with pytest.raises(ConformanceError, match=message):
        decode(h(data))


def test_start_codes_spell() -> None:
    assert bits.code(0xBA) == h("000001BA")


def test_the_committed_corpus_still_reads() -> None:
    corpus = sorted((Path(__file__).resolve().parents[2] / "fuzz" / "corpus").glob("*.fba"))
    whole = [path for path in corpus if path.name != "intra.fba"]  # three hits in that one
    assert [len(decode(path.read_bytes()).track) for path in whole] == [6, 6, 6, 6, 3, 3, 3]
    assert len(decode((corpus[0].parent / "intra.fba").read_bytes(), errors="resync").track) == 2


def test_a_new_frame_rate_counts_from_its_plane() -> None:
    epf = EXAMPLE_EPF.replace(b"FFR 1 ISI 0", b"FFR 1 ISI 1 FRR 50 0 0")
    planes = decode(encode_orders(parse_epf(epf), example_track())).planes
    assert np.concatenate([part.times_s for part in planes]) == pytest.approx([0.0, 1 / 25, 1 / 25 + 1 / 50])


@pytest.mark.parametrize(("sent", "numbers", "flags"), [(2, "1 20 2 30 1 1", [0, 1, 1]), (3, "0", [0, 0, 0])])
def test_flags_of_a_fap_that_the_track_does_not_have_are_0(sent: int, numbers: str, flags: list[int]) -> None:
    mask = " ".join("1" if number == sent else "0" for number in range(1, 69))
    track = parse_fap(f"2.1 a 25 1\n{mask}\n0 {numbers}\n".encode())
    track = replace(track, expressions=[[1, 20, 2, 30, 1, 1]])
    (planes,) = decode(encode_orders(parse_epf(b"FBM 1 FFR 0 ISI 1 FMT 1 0 1" + b" 0" * 9), track)).planes
    assert planes.flags.tolist() == [flags]


def test_values_outside_their_range_are_named_with_their_field() -> None:
    values = np.zeros((1, 68), int)
    values[0, [2, 3]] = 7, 20_000
    epf = b"FBM 1 FFR 0 ISI 1 FMT 0" + b" 3" * 9
    message = r"FAP 4 \(lower_t_midlip\): values 20000 to 20000 are outside"
    with pytest.raises(UsageError, match=message):
        encode_orders(parse_epf(epf), FapTrack.from_values(values, rate_hz=25.0))


def test_zeros_at_the_end_may_be_the_start_of_a_code_even_if_they_are_a_wrong_plane() -> None:
    """A P plane of zeros would set a viseme above 14; but the two last bytes may begin a start code."""
    mask = np.arange(68)[None] == 0
    found = 0
    for blend in range(64):
        track = replace(
            FapTrack.from_values(np.zeros((2, 68), int), rate_hz=25.0), mask=np.repeat(mask, 2, axis=0),
            visemes=[[3, 4, 0, 0], [5, 6, blend, 0]],
        )  # fmt: skip
        stream = encode(track)
        end = int(decode(stream).planes[-1].extents[-1, 1])
        if end % 8 == 0:
            found += 1
            with pytest.raises(TruncatedError, match="ends without its end code"):
                decode(stream[: end // 8] + bytes([0x20, 0, 0]))
    assert found >= 3
