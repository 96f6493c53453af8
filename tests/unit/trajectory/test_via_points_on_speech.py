"""Minimum-jerk curves through captured lips at 30 % of each phone; the points are good to about 0.7 mm."""

import numpy as np
import pytest

from fapengine.trajectory.via_points import ViaPoints

RATE_HZ = 25.0
PAUSE_S = 0.3
MARGIN_S = 0.1


@pytest.mark.shared
def test_captured_positions_at_30_per_cent_of_each_phone_retrace_the_lips(shared):
    data = dict(np.load(shared / "data" / "speech_train.npz"))
    lips = np.flatnonzero(data["marker_is_lip"])
    times = np.arange(75) / RATE_HZ
    errors = []
    for sentence in np.random.default_rng(7).permutation(520)[:40]:
        steps = data["marker_delta"][:, 75 * sentence : 75 * sentence + 75].astype(np.int32)
        path = np.cumsum(steps, axis=1).T.reshape(75, -1, 3)[:, lips] * float(data["marker_step_mm"])
        mine = data["phone_clip"] == sentence
        start, end, silent = data["phone_start"][mine], data["phone_end"][mine], data["phone"][mine] == "sil"
        keys = [0.7 * a + 0.3 * b for a, b in zip(start[~silent], end[~silent], strict=True)]
        for a, b in zip(start[silent], end[silent], strict=True):  # a long pause is held between two points
            keys += [a + MARGIN_S, b - MARGIN_S] if b - a > PAUSE_S else [(a + b) / 2]
        inner = np.sort([key for key in keys if 0.02 < key < times[-1] - 0.02])
        at = np.concatenate([[0.0], inner[np.diff(inner, prepend=0.0) > 0.015], times[-1:]])
        flat = path.reshape(75, -1)
        poses = np.stack([np.interp(at, times, column) for column in flat.T], axis=-1).reshape(len(at), -1, 3)
        curve = ViaPoints(times_s=at, positions_mm=poses).sample(times)
        spoken = (times > start[~silent].min() - 0.1) & (times < end[~silent].max() + 0.1)
        errors.append(np.linalg.norm(curve - path, axis=-1)[spoken].mean(axis=1))
    assert np.concatenate(errors).mean() < 0.79
