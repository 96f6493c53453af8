"""Learn how the skin of a speaking face follows its feature points: ``fapengine/mesh/default_head/skin_table.py``.

    python -m design.learn_skin data

Postures: 4,000 frames of speech and 3,000 random sums of the dense face's expressions. In each, the FAPs are read off
the feature points. Every skin vertex then gets the linear map from FAPs (mm) to its displacement with the least squared
error, with a ridge that grows with the fourth power of the distance to each FAP's point, so that near points say what
the skin does. The map is made symmetric, fades far from all points, and is kept at :data:`SAMPLES` places of the left
half. The data are not part of the project.
"""

import csv
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.data_files import FOLDER, asked_path
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.skin import ANCHORS, FAPS, MIRRORED, mirror, read_fields
from fapengine.mpeg4 import fap

TABLE = Path(__file__).resolve().parent.parent / "fapengine" / "mesh" / "skin_table.py"
SKIN = 9409
"""Vertices of the face; behind them come head, sockets, teeth and eyes."""
SAMPLES = 120
RIDGE, NEAR_MM = 0.2, 25.0
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
    twin = cKDTree(points[:SKIN]).query(points[:SKIN] * MIRRORED)[1]
    learned = (learned + mirror(learned[twin])) / 2
    nearest = np.linalg.norm(points[:SKIN, None] - points[own], axis=2).min(axis=1)
    learned *= (1 - smoothstep((nearest - FADE_MM[0]) / (FADE_MM[1] - FADE_MM[0])))[:, None, None]
    outside = np.flatnonzero(~within_lips(points[:SKIN], points[[layout[name] for name in LIPS]]))
    places, moves = sample(points[:SKIN], learned, outside)
    write(places, moves, {name: points[layout[name]] for name in ANCHORS})
    judged = outside[nearest[outside] < NEAR_MM]
    real = displacement(postures[test], fields[:, judged])
    for what, found in (("learned", learned[judged]), ("as sampled", read_fields(places, moves, points[judged]))):
        error = real - np.einsum("sf,vfa->sva", values[test], found)
        print(f"{what}: {rms(error):.2f} mm of {rms(real):.2f} mm, postures that were not learned from")


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


def sample(points: Array, learned: Array, outside: NDArray[np.intp]) -> tuple[Array, Array]:
    """Places that stand apart, closer where the skin moves more, each with the mean of its five nearest vertices."""
    size = np.abs(learned).max(axis=(1, 2))
    left = outside[(points[outside, 0] >= -0.5) & (points[outside, 2] > 0) & (size[outside] > 0.005)]
    chosen = [left[size[left].argmax()]]
    apart = np.full(len(left), np.inf)
    while len(chosen) < SAMPLES:
        apart = np.minimum(apart, np.linalg.norm(points[left] - points[chosen[-1]], axis=1))
        chosen.append(left[(apart * (0.25 + size[left])).argmax()])
    around = outside[cKDTree(points[outside]).query(points[chosen], k=5)[1]]
    places, moves = points[around].mean(axis=1), learned[around].mean(axis=1)
    middle = np.abs(places[:, 0]) < 1.5
    places[middle, 0] = 0.0
    moves[middle] = (moves[middle] + mirror(moves[middle])) / 2
    return places.round(1), moves.round(2)


def write(places: Array, moves: Array, anchors: dict[str, Array]) -> None:
    lines = [
        '"""How skin follows feature points, at places of the left half of a face. Written by design/learn_skin.py.',
        "",
        "Learned from ICT-FaceKit (MIT licence, University of Southern California, Institute for Creative",
        "Technologies) and from speech of the GRID corpus (Cooke et al. 2006), through the points of ISO/IEC 14496-2.",
        '"""',
        "",
        "# fmt: off",
        "ANCHORS_MM: dict[str, tuple[float, float, float]] = {",
    ]
    lines += [f'    "{name}": ({", ".join(f"{value:.1f}" for value in place)}),' for name, place in anchors.items()]
    lines += ["}", "MOVES: tuple[tuple[tuple[float, float, float], dict[int, tuple[float, float, float]]], ...] = ("]
    for place, rows in zip(places, moves, strict=True):
        line = f"    (({', '.join(f'{value:g}' for value in place)}), {{"
        for number, row in zip(FAPS, rows, strict=True):
            if np.abs(row).max() >= 0.015:
                entry = f"{number}: ({', '.join(f'{value + 0.0:g}' for value in row)}), "
                if len(line) + len(entry) > 116:
                    lines.append(line.rstrip())
                    line = "        "
                line += entry
        lines.append(line.rstrip(", ") + "}),")
    TABLE.write_text("\n".join([*lines, ")"]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "speech_train.npz", "dense_face.npz", "markers.csv"))
