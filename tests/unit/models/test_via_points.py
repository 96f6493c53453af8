import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt

from fapengine.errors import UsageError
from fapengine.geometry.smooth import low_pass
from fapengine.models.via_points import ViaPoints, extract_via_points, reduction_curve

RATE_HZ = 120.0


def motion(seed=0, frames=400, markers=6):
    """Markers that move in three band-limited modes, about 4 mm."""
    rng = np.random.default_rng(seed)
    z = sosfiltfilt(butter(4, 5, fs=RATE_HZ, output="sos"), rng.normal(0, 1, (frames + 100, 3)), axis=0)[50:-50]
    return np.tensordot(z / z.std(axis=0), rng.normal(0, 1.5, (3, markers, 3)), axes=1)


def off_mm(points, positions):
    return np.linalg.norm(points.sample(np.arange(len(positions)) / RATE_HZ) - positions, axis=-1)


def greedy_count(positions, tolerance_mm):
    """One worst frame at a time: the plain method, as the yardstick."""
    times = np.arange(len(positions)) / RATE_HZ
    frames = [0, len(positions) // 2, len(positions) - 1]
    while True:
        off = off_mm(ViaPoints(times_s=times[frames], positions_mm=positions[frames]), positions).max(axis=1)
        if off.max() <= tolerance_mm:
            return len(frames)
        frames = sorted([*frames, int(off.argmax())])


@settings(max_examples=10)
@given(st.integers(0, 10**9), st.sampled_from([0.1, 0.5, 2.0]))
def test_every_marker_in_every_frame_is_within_the_bound(seed, tolerance):
    positions = motion(seed)
    points = extract_via_points(positions, RATE_HZ, tolerance)
    assert off_mm(points, positions).max() <= tolerance * (1 + 1e-9)
    np.testing.assert_allclose(points.sample(points.times_s), points.positions_mm, atol=1e-9)
    assert points.times_s[0] == 0
    assert points.times_s[-1] == pytest.approx(399 / RATE_HZ)


@pytest.mark.parametrize("tolerance", [0.25, 1.0])
def test_no_more_points_than_greedy_insertion(tolerance):
    positions = motion(1)
    count = len(extract_via_points(positions, RATE_HZ, tolerance).times_s)
    assert count <= greedy_count(positions, tolerance)


def test_a_wider_bound_needs_fewer_points():
    curve = reduction_curve(motion(2), RATE_HZ, [0.1, 0.3, 1.0, 3.0])
    counts = [entry.point_count for entry in curve]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < counts[0] / 1.5
    for entry in curve:
        assert 0 < entry.mean_mm < entry.max_mm <= entry.tolerance_mm * (1 + 1e-9)
        assert entry.share == entry.point_count / 400


def test_the_curve_is_the_minimum_jerk_one():
    rng = np.random.default_rng(3)
    times = np.array([0.0, 0.2, 0.5, 0.6, 1.0])
    points = ViaPoints(times_s=times, positions_mm=rng.normal(0, 5, (5, 1, 3)))
    grid = np.linspace(0, 1, 2001)
    path = points.sample(grid)[:, 0]

    def jerk(curve):
        return (np.diff(curve, n=3, axis=0) ** 2).sum()

    bump = np.prod([np.sin(np.pi * (grid - at)) for at in times], axis=0)[:, None]  # zero at all via points
    for size in (-1e-3, 1e-3):
        assert jerk(path + size * bump) > jerk(path)
    fourth = np.diff(path, n=4, axis=0) / (grid[1] ** 4)
    assert np.abs(np.diff(fourth, axis=0)).max() < 0.02 * np.abs(fourth).max()  # continuous: no jump at a via point
    assert np.abs(fourth[[0, -1]]).max() < 0.02 * np.abs(fourth).max()  # free ends


def test_before_and_behind_it_stands_still():
    points = extract_via_points(motion(4), RATE_HZ, 0.5)
    for time, end in ((-1.0, 0), (99.0, -1)):
        np.testing.assert_allclose(points.sample([time])[0], points.positions_mm[end], atol=1e-9)


def test_what_stands_still_or_bends_once_needs_three_points():
    still = np.zeros((50, 4, 3))
    assert len(extract_via_points(still, RATE_HZ, 0.1).times_s) == 3
    parabola = still + (np.arange(50)[:, None, None] - 20) ** 2
    assert len(extract_via_points(parabola, RATE_HZ, 0.1).times_s) == 3
    assert len(extract_via_points(still[:3], RATE_HZ, 0.1).times_s) == 3


def test_noise_is_worth_filtering_first():
    clean = motion(5)
    noisy = clean + np.random.default_rng(6).normal(0, 0.15, clean.shape)
    smooth = low_pass(noisy, RATE_HZ, 12.0)
    assert np.abs(smooth - clean)[20:-20].max() < 0.5
    counts = [len(extract_via_points(data, RATE_HZ, 0.6).times_s) for data in (noisy, smooth)]
    assert counts[1] < counts[0] / 2


def test_bad_input_is_refused():
    positions = motion(7, frames=30)
    with pytest.raises(UsageError, match="at least 3 frames, got 2"):
        extract_via_points(positions[:2], RATE_HZ, 1.0)
    with pytest.raises(UsageError, match=r"got 120\.0 and 0"):
        extract_via_points(positions, RATE_HZ, 0.0)
    with pytest.raises(UsageError, match=r"got -1\.0 and 1"):
        extract_via_points(positions, -1.0, 1.0)
    with pytest.raises(UsageError, match="cutoff_hz: must be"):
        low_pass(positions, RATE_HZ, 60.0)
    for times in ([0.0, 1.0], [0.0, 1.0, 1.0]):
        with pytest.raises(UsageError, match="strictly rising"):
            ViaPoints(times_s=times, positions_mm=np.zeros((len(times), 2, 3)))
