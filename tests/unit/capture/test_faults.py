"""Faults of real C3D and TRC files, one of each kind, in files of our own making: read, or refused with the reason.

The kinds are those that public files showed (c3d.org's samples, files of BTK and ezc3d): labels that old systems cut to
four letters, so that they come twice; parameters that a reader runs out of; a data start of 0; results of a body model
among the markers; exports of Cortex with unnamed trajectories behind the named ones.
"""

import struct
import warnings
from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.c3d import BLOCK, format_c3d, parse_c3d
from fapengine.capture.conventions import check_track, understand
from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.table import format_trc, parse_trc
from fapengine.errors import DataError


def value_at(data: bytes, name: bytes) -> int:
    """Byte of a parameter's first number, behind name, step, kind and (of one dimension) shape."""
    return data.index(name) + len(name) + 2 + 2 + data[data.index(name) + len(name) + 3]


def last_record(data: bytes | bytearray) -> tuple[int, int]:
    """Bytes at which the last parameter begins, and ends."""
    at, last = BLOCK + 4, 0
    while data[at]:
        letters = abs(struct.unpack_from("b", data, at)[0])
        last, at = at, at + 2 + letters + struct.unpack_from("<h", data, at + 2 + letters)[0]
    return last, at


def with_data_start(data: bytes, parameter: int, header: int) -> bytes:
    spoiled = bytearray(data)
    at = value_at(data, b"DATA_START")
    spoiled[at : at + 2] = struct.pack("<H", parameter)
    spoiled[16:18] = struct.pack("<H", header)
    return bytes(spoiled)


def test_labels_that_come_twice_are_numbered(track):
    cut = replace(track, labels=("8.1", "8.2", "RKNE", "LKNE", "2.1", "NOSE"))
    data = format_c3d(cut).replace(b"LKNE", b"RKNE").replace(b"NOSE", b"RKNE")
    found, notes = understand(parse_c3d(data))
    assert found.labels == ("8.1", "8.2", "RKNE", "RKNE#2", "2.1", "RKNE#3")
    assert found.positions_mm.shape == track.positions_mm.shape
    assert notes == ("labels RKNE are repeated: later ones are called RKNE#2 ...",)


def test_a_label_that_looks_numbered_keeps_its_name(track):
    cut = replace(track, labels=("A", "B", "A#2", "C", "D", "E"))
    assert understand(parse_c3d(format_c3d(cut).replace(b"C ", b"A ")))[0].labels == ("A", "B", "A#2", "A#3", "D", "E")


def test_records_end_with_their_blocks(track):
    """The last parameter tells of a next one, which would lie among the numbers."""
    data = bytearray(format_c3d(track))
    last, _ = last_record(data)
    end = BLOCK * (1 + data[BLOCK + 2])
    letters = struct.unpack_from("b", data, last)[0]
    struct.pack_into("<h", data, last + 2 + letters, end - (last + 2 + letters))
    data[end : end + 4] = b"\x7f\x01\x41\x41"  # as a record, it runs past the end
    assert parse_c3d(bytes(data)).labels == track.labels


@pytest.mark.parametrize("parameter", [0, 1, 60000])
def test_a_wrong_data_start_is_taken_from_the_header(track, parameter):
    data = format_c3d(track)
    header = struct.unpack_from("<H", data, 16)[0]
    found, notes = understand(parse_c3d(with_data_start(data, parameter, header)))
    assert found.equals(track, atol_mm=1e-4)
    assert notes == ((f"POINT:DATA_START is {parameter}: using the header's block {header}",) if parameter else ())


def test_data_without_any_start_lie_behind_the_parameters(track):
    found, notes = understand(parse_c3d(with_data_start(format_c3d(track), 0, 0)))
    assert found.equals(track, atol_mm=1e-4)
    assert "after the parameters" in notes[0]


def test_a_rate_that_is_a_signalling_nan_is_taken_from_the_header(track):
    data = bytearray(format_c3d(track))
    number = value_at(bytes(data), b"RATE")
    data[number : number + 4] = b"\x01\x00\x80\x7f"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert parse_c3d(bytes(data)).rate_hz == track.rate_hz


def test_a_file_without_room_for_data_is_refused(track):
    data = format_c3d(track)
    with pytest.raises(DataError, match=r"C3D: data must be after the parameters, got blocks \[0, 0\] of 2 \(at byte"):
        parse_c3d(with_data_start(data[: BLOCK * (1 + data[BLOCK + 2])], 0, 0))


def test_results_of_a_body_model_are_no_markers(track):
    named = replace(track, labels=("8.1", "LHipAngles", "8.3", "RKneeForce", "2.1", "NOSE"))
    data = format_c3d(named)
    assert parse_c3d(data).labels == named.labels  # nothing lists them
    _, at = last_record(data)
    record = struct.pack("bb", 6, 1) + b"ANGLES" + struct.pack("<hbBBB", 5 + 24, -1, 2, 12, 2)
    record += b"LHipAngles  RKneeForce  "
    listed = data[:at] + record + data[at + len(record) :]
    found, notes = understand(parse_c3d(listed))
    assert found.labels == ("8.1", "8.3", "2.1", "NOSE")
    np.testing.assert_allclose(found.positions_mm[:, 1], track.positions_mm[:, 2], atol=1e-4)
    assert "2 trajectories are model outputs (angles, forces ...), not markers: left out" in notes


def test_a_body_in_metres_is_told_so():
    """Not inches, which would make a face of it."""
    body = np.tile(np.random.default_rng(0).uniform(0, 1, (20, 3)), (60, 1, 1))
    track = MarkerTrack(positions_mm=body, labels=tuple(f"M{n}" for n in range(20)), rate_hz=100.0)
    data = format_c3d(track).replace(b"\x05\x01UNITS", b"\x05\x01XNITS")
    with pytest.raises(DataError, match=r"\(m would make it 1\d{3} mm, a body"):
        understand(parse_c3d(data))


def test_frames_that_show_nothing_are_looked_over_in_silence(track):
    places = np.array(track.positions_mm)
    places[10] = np.nan
    places[15, 0] += 40
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        remarks = check_track(replace(track, positions_mm=places))
    assert any(remark.startswith("marker 8.1 jumps") and remark.endswith("at frame 15") for remark in remarks)


def trc_lines(track: MarkerTrack) -> list[str]:
    return format_trc(track).decode().splitlines()


def test_cortex_leaves_trajectories_unnamed(track):
    lines = trc_lines(track)
    wide = lines[:5] + [line + "\t1.0\t2.0\t3.0\t4.0\t5.0\t6.0" if line else line for line in lines[5:]]
    found, notes = understand(parse_trc("\n".join(wide).encode()))
    assert found.equals(track, atol_mm=1e-4)
    assert notes == ("2 of 8 trajectories have no name and are left out",)


def test_a_name_stands_over_its_own_columns(track):
    lines = trc_lines(track)
    lines[3] = lines[3].replace("8.2", "")
    found, notes = understand(parse_trc("\n".join(lines).encode()))
    assert found.labels == ("8.1", "8.3", "8.4", "2.1", "NOSE")
    np.testing.assert_allclose(found.positions_mm[:, 1], track.positions_mm[:, 2], atol=1e-4)
    assert notes == ("1 of 6 trajectories have no name and are left out",)


def test_names_close_together_are_read_in_order(track):
    lines = trc_lines(track)
    lines[3] = "Frame#\tTime\t" + "\t".join(track.labels)
    assert understand(parse_trc("\n".join(lines).encode()))[0].equals(track, atol_mm=1e-4)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda lines: [*lines[:3], "Frame#\tTime", *lines[4:]], r"TRC: contains no marker names"),
        (
            lambda lines: [*lines[:-1], lines[-1] + "\t7"],
            r"TRC: 21 cells; must be 2 and three for each of 6 named or more markers",
        ),
        (lambda lines: lines[:5], r"TRC: must have a header of 5 lines and frames, got 5 lines"),
        (lambda lines: [*lines[:5], "no numbers", ""], r"TRC: contains no frames"),
        (
            lambda lines: [line.replace("\t0.008333\t", "\t0.008333\tx") for line in lines],
            r"not a number: 'x-0\.33000'",
        ),
        (lambda lines: lines[1:], "TRC: must start with PathFileType, got"),
    ],
)
def test_a_broken_trc_is_refused_with_the_reason(track, spoil, message):
    with pytest.raises(DataError, match=message):
        parse_trc("\n".join(spoil(trc_lines(track))).encode())
