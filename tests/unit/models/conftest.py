import csv
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial import cKDTree

from design.speech_sample import load_statistics, make
from fapengine.capture.landmarks import FEATURE_POINTS
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import Material
from fapengine.trajectory.faps import displacements_to_faps

SIZE = 41
FACE = 14062
"""Vertices of the dense face that come first: face, head, neck and the sockets."""


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
    """Speech of one person, in two kinds: recorded by a video tracker, or made from statistics of that recording."""

    kind: str
    """``"captured"`` or ``"made"`` (:mod:`design.speech_sample`)."""
    motion_mm: np.ndarray
    """(T, 229, 3) displacements from the rest face, good to about 0.7 mm."""
    columns: dict[str, list[int]]
    """Layout to columns of ``motion_mm``."""
    sentence: np.ndarray
    """(T,) sentence of each frame."""
    held_out: np.ndarray
    """Sentences to judge on."""
    weights: np.ndarray
    """(T, F) of the dense face's fields."""
    phones: np.ndarray
    """(N, 4) sentence, start and end in s, and the row in ``labels``."""
    labels: list[str]
    is_lip: np.ndarray
    """(229,)"""
    dense: "Dense"

    @property
    def training(self):
        return ~np.isin(self.sentence, self.held_out)

    def held(self, label):
        """Frames at 30 % of a phone's tokens in the training sentences."""
        tokens = self.phones[self.phones[:, 3] == self.labels.index(label)]
        tokens = tokens[~np.isin(tokens[:, 0], self.held_out)]
        frames = 75 * tokens[:, 0] + np.minimum(np.round((0.7 * tokens[:, 1] + 0.3 * tokens[:, 2]) * 25), 74)
        return frames.astype(int)


@dataclass
class Dense:
    """A dense face whose motion is a sum of fields."""

    vertices_mm: np.ndarray
    triangles: np.ndarray
    fields_mm: np.ndarray
    """(F, V, 3) displacements at weight 1."""
    marked: dict[str, np.ndarray]
    """Layout to vertices."""


def captured_speech(folder):
    data = np.load(folder / "speech_train.npz")
    column = {int(number): index for index, number in enumerate(data["marker_mediapipe"])}
    columns: dict[str, list[int]] = {}
    marked: dict[str, list[int]] = {}
    with (folder / "markers.csv").open() as file:
        for row in csv.DictReader(file):
            if int(row["mediapipe"]) in column:
                columns.setdefault(row["layout"], []).append(column[int(row["mediapipe"])])
                marked.setdefault(row["layout"], []).append(int(row["vertex"]))
    face = np.load(folder / "dense_face.npz")
    dense = Dense(
        face["vertices"][:FACE].astype(np.float64),
        face["triangles"][(face["triangles"] < FACE).all(axis=1)],
        face["expr"][:, :FACE].astype(np.float64),
        {layout: np.array(vertices) for layout, vertices in marked.items()},
    )
    return read_speech("captured", data, columns, data["ict_w"].astype(np.float64), dense, held_out=100)


def made_speech(sentences=80):
    statistics = load_statistics()
    data = make(statistics, sentences)
    columns = {name.removeprefix("layout_"): row.tolist() for name, row in statistics.items() if "layout_" in name}
    profile, head = load_profile("grid_s1_en"), build_head(MEASURED)
    at = {FEATURE_POINTS.get(int(number)): index for index, number in enumerate(data["marker_mediapipe"])}
    steps = data["marker_delta"].T.reshape(sentences, 75, -1).astype(np.int32)
    moved = np.cumsum(steps, axis=1).reshape(75 * sentences, -1, 3) * float(data["marker_step_mm"])
    faps = displacements_to_faps(moved[:, [at[name] for name in profile.space.points]], profile.space.points, head.fapu)
    skin = np.unique(head.triangles[(head.material[head.triangles] == Material.SKIN).all(axis=1)])
    rest = head.vertices_mm.astype(np.float64)
    used = np.flatnonzero(faps.any(axis=0))
    fields = (deform(head, 100.0 * np.eye(68)[used])[:, skin] - rest[skin]) / 100.0
    near = skin[cKDTree(rest[skin]).query(statistics["marker_neutral"])[1]]
    row = np.searchsorted(skin, near)
    triangles = head.triangles[np.isin(head.triangles, skin).all(axis=1)]
    dense = Dense(
        rest[skin], np.searchsorted(skin, triangles), fields, {name: row[chosen] for name, chosen in columns.items()}
    )
    return read_speech("made", data, columns, faps[:, used], dense, held_out=sentences // 5)


def read_speech(kind, data, columns, weights, dense, *, held_out):
    steps = data["marker_delta"].T.astype(np.int32)
    clips = [
        np.cumsum(steps[start : start + length], axis=0)
        for start, length in zip(data["offset"], data["n_frames"], strict=True)
    ]
    labels = sorted(set(data["phone"].tolist()))
    rows = [labels.index(phone) for phone in data["phone"].tolist()]
    return Speech(
        kind=kind,
        motion_mm=np.concatenate(clips).reshape(len(steps), -1, 3) * float(data["marker_step_mm"]),
        columns=columns,
        sentence=np.repeat(np.arange(len(clips)), data["n_frames"]),
        held_out=np.random.default_rng(7).permutation(len(clips))[:held_out],
        weights=weights,
        phones=np.stack([data["phone_clip"], data["phone_start"], data["phone_end"], rows], axis=1),
        labels=labels,
        is_lip=data["marker_is_lip"],
        dense=dense,
    )


@pytest.fixture(
    scope="session", params=["made", pytest.param("captured", marks=[pytest.mark.shared, pytest.mark.nightly])]
)
def speech(request):
    """Both kinds of speech, one after the other: made speech in every clone, captured speech where the data are."""
    return made_speech() if request.param == "made" else captured_speech(request.getfixturevalue("shared") / "data")
