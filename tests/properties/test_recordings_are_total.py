"""For all bytes a reader of recordings returns a value or raises DataError, and nothing else."""

import contextlib
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.capture.arrays import format_npz, parse_npz
from fapengine.capture.articulography import parse_mview, parse_mview_sound, parse_pos
from fapengine.capture.bvh import parse_bvh
from fapengine.capture.c3d import format_c3d, parse_c3d, parse_c3d_sound
from fapengine.capture.conventions import understand
from fapengine.capture.landmarks import Picture, parse_landmarks
from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.table import format_table, format_trc, parse_table, parse_trc
from fapengine.errors import DataError
from tests.recordings import BVH, mview_file, pos_file, wave_file

TRACK = MarkerTrack(
    positions_mm=np.random.default_rng(0).normal(0, 60, (5, 4, 3)), labels=("8.1", "8.2", "8.3", "8.4"), rate_hz=100.0
)
PICTURE = Picture(width_px=640, height_px=480, eye_corners_mm=90, rate_hz=30)


def landmarks(data: bytes):
    return parse_landmarks(data, PICTURE)


READERS = {
    "c3d": (parse_c3d, format_c3d(TRACK)),
    "trc": (parse_trc, format_trc(TRACK)),
    "wide": (parse_table, format_table(TRACK)),
    "long": (parse_table, format_table(TRACK, long=True)),
    "npz": (parse_npz, format_npz(TRACK)),
    "pos": (parse_pos, pos_file(TRACK)),
    "wave": (parse_table, wave_file(TRACK)),
    "mview": (parse_mview, mview_file(TRACK)),
    "bvh": (parse_bvh, BVH),
    "landmarks": (landmarks, json.dumps(np.random.default_rng(1).random((2, 468, 3)).round(3).tolist()).encode()),
}


def test_every_reader_is_here() -> None:
    assert len(READERS) == 10


def total(name: str, data: bytes) -> None:
    parse, _ = READERS[name]
    with contextlib.suppress(DataError):
        track, _ = understand(parse(data), units="mm")
        assert track.frame_count > 0


@pytest.mark.parametrize("name", READERS)
@given(data=st.binary(max_size=2000))
def test_any_bytes(name: str, data: bytes) -> None:
    total(name, data)
    total(name, READERS[name][1][:20] + data)


@pytest.mark.parametrize(
    ("parse", "good"), [(parse_c3d_sound, format_c3d(TRACK)), (parse_mview_sound, mview_file(TRACK))]
)
@given(data=st.data())
def test_sound_of_spoiled_files(parse, good: bytes, data: st.DataObject) -> None:
    spoiled = bytearray(good)
    spoiled[4:6] = spoiled[18:20] = b"\x50\0" if parse is parse_c3d_sound else spoiled[4:6]
    for _ in range(data.draw(st.integers(0, 6))):
        spoiled[data.draw(st.integers(0, len(spoiled) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(DataError):
        parse(bytes(spoiled))


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
def test_good_files_cut_and_spoiled(name: str, data: st.DataObject) -> None:
    good = bytearray(READERS[name][1])
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(good) - 1))
        if data.draw(st.booleans()):
            good[at] = data.draw(st.integers(0, 255))
        else:
            del good[at : at + data.draw(st.integers(1, 30))]
        if not good:
            break
    total(name, bytes(good))
