from dataclasses import replace

import numpy as np
import pytest

from fapengine.capture.marker_track import MarkerTrack, Session, Take
from fapengine.errors import DataError, UsageError


def test_gaps_select_and_equality(track):
    assert track.valid.sum() == 20 * 6 - 4
    assert track.frame_count == 20
    assert track.duration_s == pytest.approx(1 / 6)
    chosen = track.select(("2.1", "8.1"))
    np.testing.assert_array_equal(chosen.positions_mm, track.positions_mm[:, [4, 0]])
    assert chosen.equals(track.select(("2.1", "8.1")))
    assert not chosen.equals(track)
    moved = replace(track, positions_mm=track.positions_mm + 0.01)
    assert track.equals(moved, atol_mm=0.02)
    assert not track.equals(moved)
    assert not track.equals(replace(track, rate_hz=60.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": ("a",)}, "labels: must be 2, one for each marker, got 1"),
        ({"labels": ("a", "a")}, "'a' twice"),
        ({"labels": ("a", "")}, "twice or empty"),
        ({"rate_hz": 0.0}, r"rate_hz: must be positive, got 0\.0"),
        ({"rate_hz": np.nan}, "rate_hz"),
        ({"positions_mm": [[[0, 1, np.nan], [0, 0, 0]]]}, "'a' at frame 0, expected three finite"),
        ({"positions_mm": [[[0, 1, 2], [np.inf, 0, 0]]]}, "'b' at frame 0"),
        ({"positions_mm": [[0, 1, 2]]}, "positions_mm: got shape"),
    ],
)
def test_what_is_no_track_is_refused(change, message):
    whole = {"positions_mm": np.zeros((1, 2, 3)), "labels": ("a", "b"), "rate_hz": 100.0}
    with pytest.raises(UsageError, match=message):
        MarkerTrack(**(whole | change))


def test_select_names_what_is_missing(track):
    with pytest.raises(UsageError, match=r"labels: unknown marker '9\.9'; use 8\.1, 8\.2, 8\.3, 8\.4, 2\.1, NOSE"):
        track.select(("9.9",))


def test_takes_of_a_session_have_the_same_markers_and_rate(track):
    session = Session("S", (Take("a", track), Take("b", track.select(track.labels[::-1]))))
    assert session.labels == track.labels
    assert session.rate_hz == 120.0
    with pytest.raises(DataError, match=r"markers: differ from take 'a' in NOSE") as caught:
        Session("S", (Take("a", track), Take("b", track.select(track.labels[:5]))))
    assert caught.value.where == "take b"
    with pytest.raises(DataError, match=r"rate: must be 120 Hz as in 'a', got 60 Hz"):
        Session("S", (Take("a", track), Take("b", replace(track, rate_hz=60.0))))
    with pytest.raises(UsageError, match="session 'S': contains no take"):
        Session("S", ())
