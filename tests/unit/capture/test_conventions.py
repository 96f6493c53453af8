"""Every way in which a recording says "not seen", its units and axes, its names, and what is wrong with it."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.conventions import SENTINELS, check_track, understand
from fapengine.capture.marker_track import RawTrack
from fapengine.errors import DataError, UsageError


def raw(track, **changes) -> RawTrack:
    whole = {"positions": track.positions_mm, "labels": track.labels, "rate_hz": track.rate_hz, "units": "mm"}
    return RawTrack(**(whole | changes))


def test_a_clean_recording_brings_no_notes(track):
    found, notes = understand(raw(track))
    assert found.equals(track)
    assert notes == ()


@pytest.mark.parametrize("value", [0.0, *SENTINELS, 3e7])
def test_numbers_that_stand_for_not_seen(track, value):
    positions = track.positions_mm.copy()
    positions[np.isnan(positions)] = value
    found, notes = understand(raw(track, positions=positions))
    assert found.equals(track)
    assert "8.3 4x" in notes[0]


def test_one_marker_may_truly_be_at_the_origin(track):
    positions = track.positions_mm.copy()
    positions[3, 0] = 0.0
    found, notes = understand(raw(track, positions=positions))
    assert found.valid[3, 0]
    assert notes == ()


@pytest.mark.parametrize(("name", "length"), [("mm", 1), ("cm", 10), ("m", 1000), ("in", 25.4), ("inch", 25.4)])
def test_units_come_from_the_file_or_from_the_caller(track, name, length):
    positions = track.positions_mm / length
    for got in (
        understand(raw(track, positions=positions, units=name)),
        understand(raw(track, positions=positions), units=name),
    ):
        assert got[0].equals(track, atol_mm=1e-9)
        assert got[1] == ()


def test_units_are_never_guessed_in_silence(track):
    _, notes = understand(raw(track, units=None))
    assert notes[0].startswith("units are not stated: taken as mm, the markers span")
    with pytest.raises(DataError, match=r"not stated.*m would make it \d+ mm.*units=UNIT"):
        understand(raw(track, positions=track.positions_mm / 1000, units=None))
    _, notes = understand(raw(track, positions=track.positions_mm / 1000))
    assert "which is not a face: wrong units? (m would make it" in notes[0]
    _, notes = understand(raw(track, units="parsec"))
    assert notes[0] == "the file's unit 'parsec' is unknown"
    with pytest.raises(UsageError, match="units: unknown unit 'ell'"):
        understand(raw(track), units="ell")


@pytest.mark.parametrize("up", ["+y", "-y", "+x", "-x", "+z", "-z", "z", "Y"])
def test_axes_turn_without_mirroring(track, up):
    found, _ = understand(raw(track), up=up)
    axis = "xyz".index(up[-1].lower())
    sign = -1.0 if up[0] == "-" else 1.0
    np.testing.assert_allclose(found.positions_mm[..., 1], sign * track.positions_mm[..., axis])
    before, after = (np.linalg.det(t.positions_mm[0, :3]) for t in (track, found))
    assert after == pytest.approx(before)


def test_an_axis_that_is_none_is_refused(track):
    with pytest.raises(UsageError, match=r"up: unknown axis 'w'; use \+x, -x, \+y, -y, \+z, -z"):
        understand(raw(track), up="w")
    found, notes = understand(raw(track, up="q"))
    assert found.equals(track)
    assert notes == ("the file's upward axis 'q' is unknown: taken as +y",)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        (("Bob:8.1", "Bob:8.2"), ("8.1", "8.2")),
        (("Bob:a", "Eve:a"), ("Bob:a", "Eve:a")),
        (("FDP_8_1", "8-2"), ("8.1", "8.2")),
        ((" LLIP ", "fp2.10"), ("LLIP", "2.10")),
    ],
)
def test_labels_lose_what_the_system_added(given, wanted):
    positions = np.random.default_rng(0).normal(0, 50, (4, 2, 3))
    assert understand(RawTrack(positions=positions, labels=given, rate_hz=10.0, units="mm"))[0].labels == wanted


@pytest.mark.parametrize("label", ["", "*12", "U_3", "Unlabeled 1402", "unlabelled", "Bob:*7"])
def test_trajectories_without_a_name_are_left_out(track, label):
    found, notes = understand(raw(track, labels=(*track.labels[:5], label)))
    assert found.labels == track.labels[:5]
    assert notes == ("1 trajectories without a label are left out",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": np.zeros((0, 6, 3))}, r"recording: contains no frames or no markers, got shape \(0, 6, 3\)"),
        ({"rate_hz": None}, r"recording: frame rate missing; give rate_hz \(in session.toml\), or rising times"),
        ({"labels": ("*1",) * 6}, "recording: none of 6 trajectories is labelled"),
        ({"rate_hz": -3.0}, "rate_hz"),
    ],
)
def test_what_is_no_recording_is_refused(track, changes, message):
    with pytest.raises(DataError, match=message):
        understand(raw(track, **changes))


def test_swapped_and_jumping_and_frozen_markers_are_found(track):
    assert check_track(track) == ()
    positions = track.positions_mm.copy()
    positions[10:, [2, 3]] = positions[10:, [3, 2]]
    assert "markers 8.3 and 8.4 exchange places at frame 10" in check_track(replace(track, positions_mm=positions))
    positions = track.positions_mm.copy()
    positions[12:, 4] += 80.0
    (found,) = check_track(replace(track, positions_mm=positions))
    assert found.startswith("marker 2.1 jumps by 13")
    assert found.endswith("mm at frame 12")
    positions[::2, 4] -= 80.0
    assert check_track(replace(track, positions_mm=positions))[-1].startswith("and ")
    positions = track.positions_mm.copy()
    positions[:, 5] = positions[0, 5]
    assert check_track(replace(track, positions_mm=positions)) == ("marker NOSE never moves",)


def test_a_head_that_is_turned_fast_is_no_jump(track):
    positions = track.positions_mm + np.arange(20)[:, None, None] * [30.0, 0, 0]
    assert check_track(replace(track, positions_mm=positions)) == ()


def test_one_frame_is_looked_at_too(track):
    assert check_track(replace(track, positions_mm=track.positions_mm[:1])) == ()
