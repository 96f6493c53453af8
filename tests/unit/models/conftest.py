import csv
from dataclasses import dataclass

import numpy as np
import pytest

SIZE = 41


def make_mask(nose_mm=25.0):
    """A half cylinder with a nose, and three smooth ways to deform it: a face for geometry's purposes."""
    turn, y = np.meshgrid(np.linspace(-1.4, 1.4, SIZE), np.linspace(-90, 90, SIZE))
    nose = nose_mm * np.exp(-((turn / 0.25) ** 2) - ((y / 30) ** 2))
    vertices = np.stack([(70 + nose) * np.sin(turn), y, (70 + nose) * np.cos(turn)], axis=-1).reshape(-1, 3)
    at = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    x, y, _ = vertices.T
    low = np.exp(-(((y + 50) / 35) ** 2) - (x / 40) ** 2)
    wide = np.exp(-(((y + 30) / 30) ** 2))
    modes = np.stack(
        [
            np.stack([0 * x, -8 * low, -3 * low], axis=-1),
            np.stack([4 * wide * x / 70, 0 * x, 3 * wide * np.abs(x) / 70], axis=-1),
            np.stack([0 * x, 0 * x, 4 * np.exp(-(((y - 40) / 30) ** 2))], axis=-1),
        ]
    )
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), modes


@pytest.fixture(scope="session")
def mask():
    return make_mask


@dataclass
class Speech:
    """Tracked speech of one person: points from video, good to about 0.7 mm."""

    motion_mm: np.ndarray
    """(T, 229, 3) displacements from the rest face."""
    columns: dict[str, list[int]]
    """Layout to columns of ``motion_mm``."""
    sentence: np.ndarray
    """(T,) sentence of each frame."""
    held_out: np.ndarray
    """(100,) sentences to judge on."""
    weights: np.ndarray
    """(T, 57) of the dense face's expression fields."""
    phones: np.ndarray
    """(N, 4) sentence, start and end in s, and the row in ``labels``."""
    labels: list[str]
    is_lip: np.ndarray
    """(229,)"""

    @property
    def training(self):
        return ~np.isin(self.sentence, self.held_out)


@pytest.fixture(scope="session")
def speech(shared):
    data = np.load(shared / "data" / "speech_train.npz")
    steps = data["marker_delta"].T.astype(np.int32)
    clips = [
        np.cumsum(steps[start : start + length], axis=0)
        for start, length in zip(data["offset"], data["n_frames"], strict=True)
    ]
    column = {int(number): index for index, number in enumerate(data["marker_mediapipe"])}
    columns: dict[str, list[int]] = {}
    with (shared / "data" / "markers.csv").open() as file:
        for row in csv.DictReader(file):
            if int(row["mediapipe"]) in column:
                columns.setdefault(row["layout"], []).append(column[int(row["mediapipe"])])
    labels = sorted(set(data["phone"].tolist()))
    return Speech(
        motion_mm=np.concatenate(clips).reshape(len(steps), -1, 3) * float(data["marker_step_mm"]),
        columns=columns,
        sentence=np.repeat(np.arange(len(clips)), data["n_frames"]),
        held_out=np.random.default_rng(7).permutation(len(clips))[:100],
        weights=data["ict_w"].astype(np.float64),
        phones=np.stack(
            [
                data["phone_clip"],
                data["phone_start"],
                data["phone_end"],
                [labels.index(phone) for phone in data["phone"].tolist()],
            ],
            axis=1,
        ),
        labels=labels,
        is_lip=data["marker_is_lip"],
    )
