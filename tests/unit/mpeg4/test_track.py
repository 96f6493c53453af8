"""Tracks of FAPs cut, joined, scaled and mixed."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mpeg4.track import FapTrack

JAW = 2


def ramp(count: int, rate_hz: float = 10.0) -> FapTrack:
    values = np.zeros((count, 68), np.int32)
    values[:, JAW] = 100 * np.arange(count)
    return FapTrack.from_values(values, rate_hz=rate_hz)


def test_frames_and_times_are_cut() -> None:
    track = ramp(10)
    assert track[2:5].column("open_jaw").tolist() == [200, 300, 400]
    assert track[2:5].frame_numbers.tolist() == [0, 1, 2]
    assert track[-1:].equals(track.cut(0.9, 9.0))
    assert track.cut(0.2, 0.5).equals(track[2:5])
    assert (len(track[4:4]), track[4:4].duration_s, track.duration_s) == (0, 0.0, 1.0)


def test_tracks_are_joined() -> None:
    track = ramp(10)
    assert (track[:4] + track[4:]).equals(track)
    assert (track[:0] + track).equals(track)
    assert (track + track).duration_s == 2.0


def test_motion_is_scaled_and_mixed() -> None:
    track = ramp(3)
    assert (0.5 * track).column("open_jaw").tolist() == (track * 0.5).column("open_jaw").tolist() == [0, 50, 100]
    assert track.blend(track * 3, 0.5).column("open_jaw").tolist() == [0, 200, 400]
    assert (track * -1).column("open_jaw").tolist() == [0, 0, 0]  # it acts in one direction only
    assert (np.float64(0.5) * track).equals(track * 0.5)
    viseme = FapTrack(
        values=track.values, mask=np.ones((3, 68), bool), visemes=np.full((3, 4), 1), expressions=np.zeros((3, 6)),
        frame_numbers=np.arange(3), rate_hz=10.0,
    )  # fmt: skip
    assert not track.blend(viseme, 0.5).mask[:, :2].any()  # the visemes of the other are not taken
    assert viseme.blend(track, 0.5).mask.all()


def test_it_is_told_in_one_line() -> None:
    assert repr(ramp(10)) == "FapTrack(10 frames, 1.00 s at 10 Hz, 'fapengine')"


@pytest.mark.parametrize(
    "wrong",
    [
        lambda track: track[3], lambda track: track["open_jaw"], lambda track: track[::2], lambda track: track[0.5:1.0],
        lambda track: track + 1, lambda track: track + ramp(3, 25.0), lambda track: track * "2",
        lambda track: track * float("nan"), lambda track: track.blend(ramp(2), 0.5),
        lambda track: track.blend(track, 1.5), lambda track: track.blend(track, "x"), lambda track: track.cut(1, 0.5),
        lambda track: track.cut(-1, 1), lambda track: track.cut("0", 1), lambda track: track.column("jaw_open"),
        lambda track: track.column(3),
    ],
)  # fmt: skip
def test_wrong_calls_are_usage_errors(wrong: object) -> None:
    with pytest.raises(UsageError):
        wrong(ramp(3))


def test_numpy_takes_a_track_for_its_values() -> None:
    track = FapTrack.pose(open_jaw=300)
    assert np.array_equal(np.asarray(track), track.values)
    assert np.asarray(track, float).dtype == float
    assert np.array(track).flags.writeable
