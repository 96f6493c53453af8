"""Learn how the skin of a speaking face follows its feature points: ``fapengine/mesh/default_head/skin.npz``.

    python -m design.learn_skin data

Postures: 4,000 frames of speech and 3,000 random sums of the dense face's expressions. In each, the FAPs are read off
the feature points. Every skin vertex then gets the linear map from FAPs (mm) to its displacement with the least squared
error, with a ridge that grows with the fourth power of the distance to each FAP's point, so that near points say what
the skin does. The map is made symmetric, fades far from all points, and is carried to the places of our template by the
registration of ``design/learn_faces.py``. The data are not part of the project.
"""

import csv
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.data_files import FOLDER, asked_path
from design.learn_faces import (
    MIRROR,
    Dense,
    Template,
    fill,
    nearest,
    on_grid,
    read_dense,
    read_template,
    registered,
    write_table,
)
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.skin import FAPS, mirror
from fapengine.mpeg4 import fap

SKIN = 9409
"""Vertices of the face; behind them come head, sockets, teeth and eyes."""
ANGLES_DEG, HEIGHTS_MM = tuple(range(0, 73, 2)), tuple(range(-96, 64, 3))
RIDGE, NEAR_MM = 0.2, 25.0
SMOOTH = 0.4
FADE_MM = (35.0, 60.0)
OF_BOTH_SIDES = ("mouthSmile", "mouthFrown", "mouthStretch", "cheekRaiser", "cheekPuff", "mouthDimple", "mouthUpperUp",
                 "mouthLowerDown", "cheekSquint", "noseSneer")  # fmt: skip
LIPS = ("8.3", "8.5", "8.1", "8.6", "8.4", "8.8", "8.2", "8.7")
Array = NDArray[np.float64]


def main(data: Path) -> None:
    face, speech = np.load(data / "dense_face.npz"), np.load(data / "speech_train.npz")
    layout = {
        row["marker"]: int(row["vertex"])
        for row in csv.DictReader((data / "markers.csv").open())
        if row["layout"] == "mpeg4"
    }
    points, fields = face["vertices"].astype(float), face["expr"].astype(np.float32)
    rng = np.random.default_rng(1)
    postures = np.concatenate(
        [
            speech["ict_w"][rng.choice(len(speech["ict_w"]), 4000, replace=False)].astype(np.float32),
            faces(list(face["expr_names"]), 3000, rng),
        ]
    )
    own = [layout[fap.spec(number).point] for number in FAPS]
    values = faps_of(postures, fields, own)
    test = rng.random(len(postures)) < 0.2
    learned = learn(points[:SKIN], fields[:, :SKIN], points[own], postures[~test], values[~test])
    twin = cKDTree(points[:SKIN]).query(points[:SKIN] * MIRROR)[1]
    learned = (learned + mirror(learned[twin])) / 2
    nearest_point = np.linalg.norm(points[:SKIN, None] - points[own], axis=2).min(axis=1)
    learned *= (1 - smoothstep((nearest_point - FADE_MM[0]) / (FADE_MM[1] - FADE_MM[0])))[:, None, None]
    ours = read_template()
    fields_on_grid = carried(ours, read_dense(face, layout), learned)
    write_table("skin.npz", ANGLES_DEG, HEIGHTS_MM, moves=fields_on_grid)
    outside = np.flatnonzero(~within_lips(points[:SKIN], points[[layout[name] for name in LIPS]]))
    judged = outside[nearest_point[outside] < NEAR_MM]
    real = displacement(postures[test], fields[:, judged])
    error = real - np.einsum("sf,vfa->sva", values[test], learned[judged])
    print(f"{rms(error):.2f} mm of {rms(real):.2f} mm, postures that were not learned from")


def carried(ours: Template, dense: Dense, learned: Array) -> Array:
    """Fields at the knots of the template's left half, (A, Y, F * 3)."""
    mean, sure = registered(ours, dense)
    triangle, share, _ = nearest(ours.points + mean, dense)
    whole = np.zeros((len(dense.points), *learned.shape[1:]))
    whole[:SKIN] = learned
    moves = np.einsum("vc,vcfa->vfa", share, whole[dense.triangles[triangle]])
    twin = cKDTree(ours.points).query(ours.points * MIRROR)[1]
    moves = (moves + mirror(moves[twin])) / 2
    return on_grid(ours.places, fill(ours, sure, SMOOTH)(moves.reshape(len(moves), -1)), ANGLES_DEG, HEIGHTS_MM)


def rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))


def displacement(postures: Array, fields: Array) -> Array:
    """(S, V, 3) mm."""
    return np.einsum("sk,kva->sva", postures, fields)


def faces(names: list[str], count: int, rng: np.random.Generator) -> Array:
    """Random sums of one to four fields of the lower face, some of them on both sides."""
    lower = [index for index, name in enumerate(names) if not name.startswith(("eye", "Pupil", "brow"))]
    made = np.zeros((count, len(names)), np.float32)
    for posture in made:
        chosen = rng.choice(lower, rng.integers(1, 5), replace=False)
        posture[chosen] = rng.uniform(0, 1, len(chosen))
        for name in OF_BOTH_SIDES:
            if rng.random() < 0.15:
                posture[[names.index(f"{name}_L"), names.index(f"{name}_R")]] = rng.uniform(0, 1)
    return made


def faps_of(postures: Array, fields: Array, own: list[int]) -> Array:
    """(S, F) mm along each FAP."""
    moved = displacement(postures, fields[:, own])
    directions = np.array([fap.HEAD_AXES[fap.spec(number).positive] for number in FAPS])
    return np.einsum("sfa,fa->sf", moved, directions)


def learn(points: Array, fields: Array, own: Array, postures: Array, values: Array) -> Array:
    """(V, F, 3) mm per mm."""
    second = values.T @ values / len(values)
    found = np.zeros((len(points), len(FAPS), 3))
    for start in range(0, len(points), 500):
        block = slice(start, start + 500)
        moved = displacement(postures, fields[:, block])
        shared = np.einsum("sf,sva->vfa", values, moved) / len(values)
        distance = np.linalg.norm(points[block, None] - own, axis=2)
        ridge = RIDGE * (1 + (distance / NEAR_MM) ** 4)
        found[block] = np.linalg.solve(second + ridge[:, None] * np.eye(len(FAPS)), shared)
    return found


def within_lips(points: Array, contour: Array) -> NDArray[np.bool_]:
    centre = contour.mean(axis=0)[:2]
    outline = Outline((contour[:, :2] - centre) * 1.04 + centre)
    return outline.contains_points(points[:, :2]) & (points[:, 2] > 60)


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "speech_train.npz", "dense_face.npz", "markers.csv"))
