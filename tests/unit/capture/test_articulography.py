"""Articulographs and skeletons as recordings."""

import io
import struct
import zlib

import numpy as np
import pytest
import scipy.io

from fapengine.capture.articulography import parse_mview, parse_pos
from fapengine.capture.bvh import parse_bvh
from fapengine.capture.conventions import understand
from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.table import parse_table
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.files.recordings import PARSERS, RECORDINGS, load_markers
from tests.recordings import BVH, mview_file, pos_file, wave_file


def sensors(track: MarkerTrack) -> tuple[str, ...]:
    return tuple(f"S{number + 1}" for number in range(len(track.labels)))


@pytest.mark.parametrize(
    ("parse", "write", "names"),
    [(parse_pos, pos_file, sensors), (parse_table, wave_file, sensors), (parse_mview, mview_file, lambda t: t.labels)],
)
def test_sensors_become_markers(track, parse, write, names):
    found, _ = understand(parse(write(track)))
    assert found.labels == names(track)
    assert found.rate_hz == pytest.approx(track.rate_hz, rel=1e-2)
    np.testing.assert_allclose(found.positions_mm, track.positions_mm, atol=1e-4)


def test_an_ag500_has_twelve_sensors_and_no_header(track):
    twelve = MarkerTrack(
        positions_mm=np.tile(track.positions_mm, (1, 2, 1)), labels=tuple("abcdefghijkl"), rate_hz=200.0
    )
    found, _ = understand(parse_pos(pos_file(twelve, header=False)))
    assert (found.rate_hz, len(found.labels)) == (200.0, 12)
    np.testing.assert_allclose(found.positions_mm, twelve.positions_mm, atol=1e-4)


def test_sensors_that_were_not_connected_are_left_out(track):
    places = track.positions_mm.copy()
    places[:, 1] = np.nan
    gone = MarkerTrack(positions_mm=places, labels=track.labels, rate_hz=track.rate_hz)
    assert understand(parse_table(wave_file(gone)))[0].labels == ("S1", "S3", "S4", "S5", "S6")
    assert "AUDIO" in parse_mview(mview_file(track)).notes[0]


@pytest.mark.parametrize(
    ("parse", "spoil", "kind", "message"),
    [
        (parse_pos, lambda t: pos_file(t)[:100], TruncatedError, "no frames"),
        (parse_pos, lambda t: pos_file(t)[:-3], DataError, "expected a multiple of 168 for 6 sensors"),
        (parse_pos, lambda t: pos_file(t).replace(b"NumberOf", b"Numbers_"), DataError, "lacks its size"),
        (parse_pos, lambda t: pos_file(t).replace(b"Channels=6", b"Channels=0"), DataError, "got 0 sensors"),
        (parse_table, lambda t: wave_file(t).split(b"\n")[0], TruncatedError, "no frames"),
        (parse_table, lambda t: wave_file(t).replace(b"X[mm]", b"W[mm]"), DataError, "expected X, Y, Z"),
        (parse_mview, lambda t: b"MATLAB 5.0", DataError, "not a MATLAB file"),
        (parse_mview, lambda t: mview_file(t, SRATE=10.0), DataError, "differ in rate or length"),
        (parse_bvh, lambda t: b"", DataError, "expected HIERARCHY"),
        (parse_bvh, lambda t: BVH[:120], TruncatedError, "within its header"),
        (parse_bvh, lambda t: BVH[:-20], TruncatedError, "of 18 numbers"),
        (parse_bvh, lambda t: BVH.replace(b"Frames: 2", b"Frames: x"), DataError, "invalid literal"),
        (parse_bvh, lambda t: BVH.replace(b"MOTION\nFrames", b"MOTION\nFrame"), DataError, "expected MOTION"),
        (parse_bvh, lambda t: BVH.replace(b"1 2 3 90", b"1 2 3 up"), DataError, "could not convert"),
        (parse_bvh, lambda t: BVH.replace(b"Xrotation", b"Wrotation"), DataError, "expected up to six"),
        (parse_bvh, lambda t: BVH.replace(b"JOINT knee\n  {", b"JOINT knee\n"), DataError, "has no block"),
        (parse_bvh, lambda t: BVH.replace(b"}\nMOTION", b"MOTION"), DataError, "an open brace"),
        (parse_bvh, lambda t: BVH.replace(b"OFFSET 0 -5 2", b"SHIFT 0 -5 2"), DataError, "expected a joint"),
        (
            parse_bvh,
            lambda t: BVH.replace(b"End Site\n", b"End Site { }\n" * 16 + b"End Site\n"),
            DataError,
            "19 joints",
        ),
    ],
)
def test_what_is_wrong_is_named(track, parse, spoil, kind, message):
    with pytest.raises(kind, match=message):
        parse(spoil(track))


def test_a_mat_file_of_another_kind(track):
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"x": np.zeros((3, 3))})
    with pytest.raises(DataError, match="three columns"):
        parse_mview(buffer.getvalue())


def mat(*elements: bytes) -> bytes:
    return bytes(124) + b"\0\1IM" + b"".join(elements)


def element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def variable(kind: int, shape: tuple[int, ...], *parts: bytes) -> bytes:
    sizes = np.array(shape, "<i4").tobytes()
    head = (element(6, struct.pack("<II", kind, 0)), element(5, sizes), element(1, b""))
    return element(14, b"".join((*head, *parts)))


NAMES = (element(5, struct.pack("<i", 7)), element(1, b"NAME\0\0\0SRATE\0\0SIGNAL\0"))


@pytest.mark.parametrize(
    ("data", "kind", "message"),
    [
        (mat(struct.pack("<II", 14, 900)), TruncatedError, "has 900 bytes, of which 0"),
        (mat(element(15, b"no zlib")), DataError, "damaged"),
        (mat(element(15, zlib.compress(bytes(10**7)))), DataError, "100 times as large"),
        (mat(variable(2, (1, 1), element(5, bytes(4)), element(1, b"NAME"))), DataError, "got 0"),
        (mat(variable(2, (1, 2), *NAMES, *[variable(6, (1, 1), element(9, bytes(8)))] * 3)), TruncatedError, "1 of 2"),
        (mat(variable(2, (1, 1), *NAMES, variable(6, (3, 3), element(9, bytes(8))))), DataError, r"shape \(3, 3\)"),
        (mat(variable(2, (1, 1), *NAMES, variable(6, (1,) * 70, element(9, bytes(8))))), DataError, "got 1 numbers"),
        (mat(variable(6, (1, 1), element(9, bytes(8)))), DataError, "three columns"),
    ],
)
def test_damaged_mat_files_are_refused(data, kind, message):
    with pytest.raises(kind, match=message):
        parse_mview(data)


@pytest.mark.parametrize(
    ("step", "rate_hz"),
    [("0.0333333", 30.0), ("0.008333", 120.0), ("0.016666", 60.0), ("0.033367", 30 / 1.001), ("0.0301234", 33.196784)],
)
def test_a_rounded_step_is_the_whole_rate_that_was_written(step, rate_hz):
    found = parse_bvh(BVH.replace(b"Frame Time: 0.04", f"Frame Time: {step}".encode())).rate_hz
    assert found == pytest.approx(rate_hz, rel=1e-6)


def test_joints_follow_their_parents():
    raw = parse_bvh(BVH)
    assert raw.labels == ("hip", "knee", "knee end")
    assert raw.rate_hz == pytest.approx(25.0)
    straight, bent = raw.positions
    np.testing.assert_allclose(straight, [[1, 2, 3], [1, -8, 3], [1, -13, 5]], atol=1e-12)
    # the hip turns by 90 degrees about z, then the knee by 90 degrees about y
    np.testing.assert_allclose(bent, [[1, 2, 3], [11, 2, 3], [16, 4, 3]], atol=1e-12)
    with pytest.raises(DataError, match="unit"):
        understand(raw)
    assert understand(raw, units="cm")[0].positions_mm[0, 0].tolist() == [10, 20, 30]


def body(scale: float, frame: str = "0 0 0 0 0 0") -> bytes:
    """A file of a made-up person, 1.9 units from toe to head at a scale of 1, with zero positions below the root."""
    joint = "JOINT {} {{ OFFSET 0 {} 0 CHANNELS 3 Xposition Yposition Zposition {} }}"
    end = "End Site {{ OFFSET 0 {} 0 }}"
    leg = joint.format("LeftAnkle", -0.9 * scale, end.format(-0.1 * scale))
    head = joint.format("Head", 0.7 * scale, end.format(0.2 * scale))
    root = f"ROOT Hips {{ OFFSET 0 0 0 CHANNELS 3 Zrotation Xrotation Yrotation {leg} {head} }}"
    return f"HIERARCHY {root} MOTION Frames: 1 Frame Time: 0.04 0 0 0 {frame}".encode()


@pytest.mark.parametrize(
    ("scale", "said", "mm"),
    [
        (1.0, "taken as m", 1000.0),
        (100.0, "taken as cm", 10.0),
        (10.0, "taken as dm", 100.0),
        (39.4, "taken as in", 25.4),
        (16.0, "1 is taken as 62.5 mm, so that it is a person", 62.5),
    ],
)
def test_a_skeleton_tells_its_unit_by_its_height(scale, said, mm):
    track, notes = understand(parse_bvh(body(scale)))
    assert len(notes) == 2
    assert notes[1].endswith(said)
    places = dict(zip(track.labels, track.positions_mm[0], strict=True))
    assert places["Head end"][1] - places["LeftAnkle end"][1] == pytest.approx(1.9 * scale * mm)
    assert understand(parse_bvh(body(scale)), units="mm")[1][1].endswith("which is not a person: wrong units?")


def test_positions_near_zero_are_added_to_offsets_and_others_replace_them():
    near, replaced = parse_bvh(body(1, "0 0.1 0 0 0 0")), parse_bvh(body(1, "0 -0.8 0 0 0.6 0"))
    assert dict(zip(near.labels, near.positions[0, :, 1], strict=True))["LeftAnkle"] == pytest.approx(-0.8)
    assert dict(zip(replaced.labels, replaced.positions[0, :, 1], strict=True))["Head"] == pytest.approx(0.6)


def test_the_ending_selects_the_reader(track, tmp_path):
    assert set(PARSERS) < set(RECORDINGS)
    for ending, data in ((".pos", pos_file(track)), (".tsv", wave_file(track)), (".mat", mview_file(track))):
        (tmp_path / f"take{ending}").write_bytes(data)
        assert load_markers(tmp_path / f"take{ending}").markers.frame_count == 20
    with pytest.raises(UsageError, match=r"\.pos"):
        load_markers(tmp_path / "take.xyz")
