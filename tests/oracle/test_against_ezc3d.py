"""C3D against ezc3d, the reference reader and writer in common use."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from fapengine.capture.marker_track import MarkerTrack
from fapengine.files.recordings import load_markers, save_markers


@pytest.fixture
def track() -> MarkerTrack:
    rng = np.random.default_rng(1)
    positions = rng.normal(0, 60, (40, 300, 3))
    positions[rng.random((40, 300)) < 0.1] = np.nan
    return MarkerTrack(positions_mm=positions, labels=tuple(f"m{n}" for n in range(300)), rate_hz=120.0)


def test_it_reads_what_we_write(track: MarkerTrack, tmp_path: Path) -> None:
    save_markers(tmp_path / "ours.c3d", track)
    theirs = ezc3d.c3d(str(tmp_path / "ours.c3d"))
    np.testing.assert_allclose(theirs["data"]["points"][:3].transpose(2, 1, 0), track.positions_mm, atol=1e-4)
    point = theirs["parameters"]["POINT"]
    assert [*point["LABELS"]["value"], *point["LABELS2"]["value"]] == list(track.labels)
    assert theirs["header"]["points"]["frame_rate"] == 120.0
    assert point["UNITS"]["value"] == ["mm"]


def test_we_read_what_it_writes(track: MarkerTrack, tmp_path: Path) -> None:
    c3d = ezc3d.c3d()
    few = track.select(track.labels[:200])
    c3d["parameters"]["POINT"]["RATE"]["value"] = [120.0]
    c3d["parameters"]["POINT"]["LABELS"]["value"] = few.labels
    c3d["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    c3d["parameters"]["ANALOG"]["RATE"]["value"] = [240.0]
    c3d["parameters"]["ANALOG"]["LABELS"]["value"] = ["force"]
    points = np.ones((4, 200, 40))
    points[:3] = few.positions_mm.transpose(2, 1, 0)
    c3d["data"]["points"] = points
    c3d["data"]["analogs"] = np.arange(80.0).reshape(1, 1, 80)
    c3d.write(str(tmp_path / "theirs.c3d"))
    found = load_markers(tmp_path / "theirs.c3d").markers
    assert found.equals(few, atol_mm=1e-4)
