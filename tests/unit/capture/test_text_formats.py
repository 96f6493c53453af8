"""TRC, tables and archives: round trips, the exports of three systems, and what cannot be read."""

import io

import numpy as np
import pytest

from fapengine.capture.arrays import format_npz, parse_npz
from fapengine.capture.conventions import understand
from fapengine.capture.table import format_table, format_trc, parse_table, parse_trc
from fapengine.errors import DataError, TruncatedError


def test_what_is_written_reads_back(track):
    for name, data, parse in [
        ("trc", format_trc(track), parse_trc),
        ("wide", format_table(track), parse_table),
        ("long", format_table(track, long=True), parse_table),
        ("tabs", format_table(track, delimiter="\t"), parse_table),
        ("npz", format_npz(track), parse_npz),
    ]:
        found, _ = understand(parse(data))
        assert found.equals(track, atol_mm=1e-5), name


def test_decimal_commas_and_old_encodings(track):
    data = format_table(track, delimiter=";").replace(b".", b",").replace(b"8,", b"8.").replace(b"2,1_", b"2.1_")
    found, _ = understand(parse_table(data))
    assert found.labels == track.labels
    assert found.rate_hz == 120.0
    for coded in (format_trc(track).decode().encode("utf-16"), b"\xef\xbb\xbf" + format_trc(track)):
        assert understand(parse_trc(coded))[0].equals(track, atol_mm=1e-5)
    assert parse_table("Ärmel_x,Ärmel_y,Ärmel_z\n1,2,3\n".encode("latin-1")).labels == ("Ärmel",)


def test_a_column_of_a_wide_table_may_hold_text() -> None:
    raw = parse_table(b"Frame;A_x;A_y;A_z;condition\n1;NA;NA;NA;\n2;1;2;3;posed_joy\n")
    assert raw.labels == ("A",)
    assert np.isnan(raw.positions[0]).all()
    assert raw.positions[1].tolist() == [[1, 2, 3]]


VICON = """Trajectories
100
,,Bob:LLIP,,,Bob:RLIP,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm
1,0,10,20,30,-10,20,30
2,0,,,,-10,20,31

Model Outputs
100
"""
QUALISYS = """NO_OF_FRAMES\t2
NO_OF_CAMERAS\t8
NO_OF_MARKERS\t2
FREQUENCY\t200
DESCRIPTION\t--
TIME_STAMP\t2024-05-01, 10:00:00
MARKER_NAMES\tLLIP\tRLIP
Frame\tTime\tLLIP X\tLLIP Y\tLLIP Z\tRLIP X\tRLIP Y\tRLIP Z
1\t0.000\t10\t20\t30\t-10\t20\t30
2\t0.005\t0\t0\t0\t-10\t20\t31
"""
OPTITRACK = """Format Version,1.23,Take Name,t1,Export Frame Rate,120.0,Length Units,Meters
,Type,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker,Marker,Marker,Marker
,Name,Head,Head,Head,Face:LLIP,Face:LLIP,Face:LLIP,Face:RLIP,Face:RLIP,Face:RLIP
,,Position,Position,Position,Position,Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,X,Y,Z,X,Y,Z
0,0.000000,1,1,1,0.010,0.020,0.030,-0.010,0.020,0.030
1,0.008333,1,1,1,,,,-0.010,0.020,0.031
"""


@pytest.mark.parametrize(
    ("text", "rate", "units", "up", "scale"),
    [
        (VICON, 100.0, "mm", "+z", 1.0),
        (QUALISYS, 200.0, "mm", "+z", 1.0),
        (OPTITRACK, 120.0, "m", "+y", 1000.0),
    ],
)
def test_exports_of_three_systems(text, rate, units, up, scale):
    raw = parse_table(text.encode())
    assert raw.rate_hz == pytest.approx(rate, rel=1e-4)
    assert (raw.units, raw.up) == (units, up)
    assert [label.rpartition(":")[2] for label in raw.labels] == ["LLIP", "RLIP"]
    np.testing.assert_allclose(scale * raw.positions[0], [[10, 20, 30], [-10, 20, 30]])
    assert scale * raw.positions[1, 1, 2] == pytest.approx(31)
    assert np.isnan(raw.positions[1, 0]).all() or (raw.positions[1, 0] == 0).all()  # Qualisys writes zeros


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", DataError, r"table: empty"),
        ("a,b,c\n1,2,3\n", DataError, "table: no header with markers; use columns marker, x, y, z"),
        ("A_x,A_y,B_z\n1,2,3\n", DataError, "table: marker 'A' has x/y only; needs x, y and z"),
        ("A_x,A_y,A_z\n", TruncatedError, "table: contains no frames"),
        ("A_x,A_y,A_z\n1,2,zwei\n", DataError, "not a number: 'zwei' .at line 2, column 3"),
        ("marker,x,y,z\nA,1,2,3\n", DataError, "table: column frame or time missing"),
        ("marker,frame,x,y,z\n,1,1,2,3\n", DataError, "marker name missing .at line 2, column 1"),
        ("marker,frame,x,y,z\nA,,1,2,3\n", DataError, "table: frame or time missing .at line 2, column 2"),
        ("marker,frame,x,y,z\nA,1,1,2,3\nA,1,1,2,3\n", DataError, "table: marker 'A' is repeated at 1"),
        ("marker,frame,x,y,z\n", TruncatedError, "no frame"),
        (VICON.replace(",,Bob:LLIP,,,Bob:RLIP,,", ",,,,,,,"), DataError, "table: marker names above X, Y, Z missing"),
        ("\n".join(VICON.splitlines()[:5]), TruncatedError, "no frame"),
        (
            OPTITRACK.replace("Marker,", "Bone,").replace(",Marker", ",Bone"),
            DataError,
            "table: contains no marker columns",
        ),
        (
            OPTITRACK.replace("Frame,Time", "Fram,Time"),
            DataError,
            "table: rows Name and Frame of a Motive export missing",
        ),
        ("\n".join(QUALISYS.splitlines()[:8]), TruncatedError, "table: no frames after MARKER_NAMES"),
        (
            QUALISYS.replace("\tRLIP\n", "\tRLIP\tNOSE\n"),
            DataError,
            r"table: must have 9 columns, or frame and time before them, got 8",
        ),
        ("A_x,A_y,A_z\n1,2,3\0\n", DataError, "NUL"),
        ('A_x,A_y,A_z\n"' + "9" * 200_000 + '",1,2\n', DataError, "table"),
    ],
)
def test_tables_that_cannot_be_read(text, error, message):
    with pytest.raises(error, match=message):
        parse_table(text.encode())


TRC_LINES = 5


@pytest.mark.parametrize(
    ("spoil", "error", "message"),
    [
        (lambda t: "x" + t, DataError, "TRC: must start with PathFileType, got"),
        (lambda t: "\n".join(t.splitlines()[:4]), TruncatedError, "header of 5 lines and frames, got 4 lines"),
        (lambda t: "\n".join([*t.splitlines()[:5], "", ""]) + "\n", TruncatedError, "no frame"),
        (lambda t: t.replace("8.1", "").replace("8.2", "").replace("8.3", "").replace("8.4", "").replace("2.1", "")
         .replace("NOSE", ""), DataError, "no marker name"),
        (lambda t: t.rstrip() + "\t1.0\n", DataError, "TRC: 21 cells; must be 2 and three for each of 6 named or"),
        (lambda t: t.rstrip() + "q\n", DataError, "not a number: .* .at line 26"),
    ],
)  # fmt: skip
def test_trc_that_cannot_be_read(track, spoil, error, message):
    with pytest.raises(error, match=message):
        parse_trc(spoil(format_trc(track).decode()).encode())


def test_trc_header_quirks(track):
    text = format_trc(track).decode()
    assert parse_trc(text.replace("\t6\tmm", "\t7\tmm").encode()).notes == ("NumMarkers says 7, but 6 are named",)
    assert parse_trc(text.replace("120\t120\t20", "x\tx\t20").encode()).rate_hz == 120.0  # from the times
    assert parse_trc(text.replace("\tmm\t", "\tm\t").encode()).units == "m"


def test_trc_with_commas_or_two_tabs_in_its_header(track):
    """As pyomeca writes it, and as files that come with OpenSim have it."""
    text = format_trc(track).decode()
    assert understand(parse_trc(text.replace("\t", ",").encode()))[0].equals(track, atol_mm=1e-5)
    lines = text.replace("\tmm\t", "\tcm\t").splitlines()
    lines[2] = " " + lines[2].replace("\t", "\t\t ", 2)
    found = parse_trc("\n".join(lines).encode())
    assert (found.units, found.rate_hz, found.labels) == ("cm", track.rate_hz, track.labels)


def archive(**arrays) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


PLACES = np.tile([1.0, 2.0, 3.0], (2, 1, 1))


def test_archives_may_say_what_is_valid():
    raw = parse_npz(archive(positions=PLACES, labels=["a"], valid=[[True], [False]], fps=50, units="cm"))
    assert np.isnan(raw.positions[1]).all()
    assert not np.isnan(raw.positions[0]).any()
    assert (raw.rate_hz, raw.units) == (50.0, "cm")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\3\4nothing", "damaged"),
        (archive(x=PLACES), r"NPZ: needs positions or positions_mm or markers or points or via_mm, has \['x'\]"),
        (
            archive(positions=PLACES[0], labels=["a"]),
            r"NPZ: must be numbers \(T, M, 3\), got float64 of shape \(1, 3\)",
        ),
        (archive(positions=PLACES.astype(object), labels=["a"]), "Python objects"),
        (
            archive(positions=PLACES, labels=["a", "b"]),
            r"NPZ: must be 1 strings, got <U1 of shape \(2,\)",
        ),
        (archive(positions=PLACES), "must be 1 strings"),
        (
            archive(positions=PLACES, labels=["a"], valid=[True]),
            r"NPZ: must have shape \(2, 1\), got \(1,\)",
        ),
        (archive(positions=PLACES, labels=["a"], rate_hz=-1), "one positive number"),
    ],
)
def test_archives_that_cannot_be_read(data, message):
    with pytest.raises(DataError, match=message):
        parse_npz(data)
