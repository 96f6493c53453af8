"""Minimum-jerk curves through lips, made and captured, at 30 % of each phone; captured ones are good to 0.7 mm."""

import numpy as np
import pytest

from design.speech_sample import load_statistics, make
from fapengine.models.via_points import ViaPoints

RATE_HZ = 25.0
PAUSE_S = 0.3
MARGIN_S = 0.1


@pytest.fixture(params=["made", pytest.param("captured", marks=[pytest.mark.shared, pytest.mark.nightly])])
def data(request):
    """Both kinds of speech: made in every clone, captured where the data are."""
    if request.param == "made":
        return make(load_statistics(), 40)
    return dict(np.load(request.getfixturevalue("shared") / "data" / "speech_train.npz"))


def test_positions_at_30_per_cent_of_each_phone_retrace_the_lips(data):
    lips = np.flatnonzero(data["marker_is_lip"])
    times = np.arange(75) / RATE_HZ
    errors = []
    for sentence in np.random.default_rng(7).permutation(len(data["ids"]))[:40]:
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
