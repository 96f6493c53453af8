"""C3D: what we write reads back, and what others may write is understood."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.c3d import DEC, INTEL, MIPS, format_c3d, parse_c3d
from fapengine.capture.conventions import understand
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, TruncatedError


def read(data: bytes) -> MarkerTrack:
    return understand(parse_c3d(data))[0]


def test_what_is_written_reads_back(track):
    assert read(format_c3d(track)).equals(track, atol_mm=1e-5)  # float32


def test_many_markers_and_frames_go_past_sixteen_bits():
    rng = np.random.default_rng(0)
    wide = MarkerTrack(
        positions_mm=rng.normal(0, 60, (2, 300, 3)), labels=tuple(f"m{n}" for n in range(300)), rate_hz=60.0
    )
    assert read(format_c3d(wide)).labels == wide.labels
    long = MarkerTrack(positions_mm=rng.normal(0, 60, (70_000, 1, 3)), labels=("a",), rate_hz=1000.0)
    assert read(format_c3d(long)).frame_count == 70_000


def rebuilt(track: MarkerTrack, processor: int, *, integers: bool, analog: int = 0) -> bytes:
    """The same recording as another machine would write it; every field by hand."""
    order = ">" if processor == MIPS else "<"

    def number(value: float) -> bytes:
        if processor != DEC:
            return struct.pack(f"{order}f", value)
        low, high = struct.unpack("<HH", struct.pack("<f", value * 4))
        return struct.pack("<HH", high, low)

    def record(group: int, name: str, body: bytes) -> bytes:
        return (
            struct.pack("bb", len(name), group) + name.encode() + struct.pack(f"{order}h", len(body) + 3) + body + b"\0"
        )

    count, scale = len(track.labels), 0.01 if integers else -1.0
    body = struct.pack("bb", -5, -1) + b"POINT" + struct.pack(f"{order}hB", 3, 0)  # locked: a negative length
    body += record(1, "USED", struct.pack(f"{order}bBh", 2, 0, count))
    body += record(1, "SCALE", struct.pack("bB", 4, 0) + number(scale))
    body += record(1, "UNITS", struct.pack("bBB", -1, 1, 2) + b"mm")
    width = max(map(len, track.labels))
    names = b"".join(label.encode().ljust(width) for label in track.labels)
    body += record(1, "LABELS", struct.pack("bBBB", -1, 2, width, count) + names)
    body += record(1, "BYTES", struct.pack("bBBB", 1, 1, 2, 9) + b"\x01")
    parameters = (bytes([1, 0x50, 1, processor]) + body + b"\0\0").ljust(512, b"\0")
    header = bytes([2, 0x50]) + struct.pack(f"{order}HHHHH", count, analog, 1, track.frame_count, 10)
    header += number(scale) + struct.pack(f"{order}HH", 3, 0) + number(track.rate_hz)
    data = b""
    for frame, seen in zip(track.positions_mm, track.valid, strict=True):
        for place, shown in zip(np.nan_to_num(frame), seen, strict=True):
            if integers:
                words = [round(value / scale) for value in place]
                data += struct.pack(f"{order}hhhh", *words, 0x0102 if shown else -1)
            else:
                data += b"".join(map(number, place)) + number(0.0 if shown else -1.0)
        data += b"".join(number(7.5) if not integers else struct.pack(f"{order}h", 7) for _ in range(analog))
    return header.ljust(512, b"\0") + parameters + data


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("integers", [False, True])
@pytest.mark.parametrize("analog", [0, 6])
def test_every_processor_and_number_format_is_read(track, processor, integers, analog):
    found = read(rebuilt(track, processor, integers=integers, analog=analog))
    assert found.equals(track, atol_mm=0.006 if integers else 1e-4)  # half an integer step of 0.01 mm


def test_more_points_than_labels_leave_the_others_unnamed(track):
    data = format_c3d(track).replace(b"NOSE", b"    ")
    found, notes = understand(parse_c3d(data))
    assert found.labels == track.labels[:5]
    assert notes == ("1 trajectories without a label are left out",)


@pytest.mark.parametrize(
    ("spoil", "error", "message"),
    [
        (lambda d: d[:100], TruncatedError, "C3D: must have a header of 512 bytes, got 100 bytes"),
        (lambda d: d[:513], TruncatedError, "before its parameters"),
        (lambda d: b"\0\0" + d[2:], DataError, "not a C3D file: starts with 00 00 instead of a parameter"),
        (
            lambda d: d[:515] + b"\x10" + d[516:],
            DataError,
            r"C3D: processor must be 84, 85 or 86, got 16",
        ),
        (lambda d: d[:700], TruncatedError, "runs past the end"),
        (lambda d: d[:-700], TruncatedError, r"C3D: truncated, has 12 of 20 frames"),
        (lambda d: d[: d.index(b"\x00" * 60, 600) // 512 * 512 + 512 + 9], TruncatedError, "first frame"),
        (
            lambda d: d.replace(b"\x04\x01USED", b"\x04\x01UXED").replace(struct.pack("<H", 6), b"\0\0", 1),
            DataError,
            "0 points",
        ),
    ],
)
def test_what_is_damaged_is_refused(track, spoil, error, message):
    with pytest.raises(error, match=message):
        parse_c3d(spoil(format_c3d(track)))


def test_a_missing_frame_count_is_taken_from_the_data(track):
    data = bytearray(format_c3d(track))
    data[6:10] = struct.pack("<HH", 9, 1)
    for name in (b"FRAMES", b"LONG_FRAMES", b"ACTUAL_END_FIELD", b"ACTUAL_START_FIELD"):
        at = data.index(name)
        data[at : at + len(name)] = b"X" * len(name)
    raw = parse_c3d(bytes(data))
    assert raw.notes == ("no frame count: all 20 frames in the file are read",)


def test_a_rate_of_nothing_is_no_rate(track):
    data = bytearray(format_c3d(replace(track, rate_hz=120.0)))
    data[20:24] = struct.pack("<f", 0.0)
    data[data.index(b"\x04\x01RATE") + 1 : data.index(b"\x04\x01RATE") + 2] = b"\x02"
    assert parse_c3d(bytes(data)).rate_hz is None
