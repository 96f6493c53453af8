"""Learn how the relief of faces differs from person to person: ``fapengine/mesh/default_head/relief_table.py``.

    python -m design.learn_relief data

The dense face comes with the identity modes of a population of scans, each of variance 1. A face of one mode is
brought to the mean's place, size and (as seen from the front) its 68 landmarks, so that eyes, nose and mouth stay where
they are and only the relief between them differs. Its distances from the head's axis, less the mean's, are that mode's
relief. Principal components of the first :data:`IDENTITIES` reliefs are kept, with what each changes in widths of
mouth, nose and jaw. The data are not part of the project.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator
from scipy.ndimage import gaussian_filter

from design.data_files import FOLDER, asked_path
from fapengine.mesh.default_head.sections import AXIS_Z_MM, section_arrays

Array = NDArray[np.float64]

TABLE = Path(__file__).resolve().parent.parent / "fapengine" / "mesh" / "default_head" / "relief_table.py"
HEAD = 11248
"""Vertices of face, head and neck."""
IDENTITIES, KEPT = 24, 8
STEP = 1.5
"""Weight at which a mode is measured."""
WIDTHS = {"mouth_width": (48, 54), "nose_width": (31, 35), "jaw_width": (4, 12)}
"""Measure to the two of the 68 landmarks between which it is taken."""


def main(data: Path) -> None:
    face = np.load(data / "dense_face.npz")
    mean = face["vertices"][:HEAD].astype(float)
    marks = face["multipie68"]
    around = np.arctan2(np.abs(mean[:, 0]), mean[:, 2] - AXIS_Z_MM)
    ear = (np.abs(mean[:, 0]) > 76) & (around > np.deg2rad(72)) & (mean[:, 1] > -40) & (mean[:, 1] < 60)
    usual, reliefs, widths = distances(mean, ~ear), [], []
    for mode in face["identity"][:IDENTITIES, :HEAD].astype(float):
        person = placed(mean + STEP * mode, marks, mean[marks])
        widths.append([length(person[marks], ends) / length(mean[marks], ends) - 1 for ends in WIDTHS.values()])
        relief = np.nan_to_num(distances(with_landmarks(person, marks, mean[marks]), ~ear) - usual)
        reliefs.append(gaussian_filter(relief, 0.8, mode="nearest"))
    each, changes = np.array(reliefs) / STEP, np.array(widths) / STEP
    own, size, modes = np.linalg.svd(each.reshape(IDENTITIES, -1), full_matrices=False)
    print(f"{(size[:KEPT] ** 2).sum() / (size**2).sum():.3f} of the variance in {KEPT} components")
    tables = (size[:KEPT, None] * modes[:KEPT]).reshape(KEPT, *usual.shape)
    TABLE.write_text(text(tables, own[:, :KEPT].T @ changes))


def placed(person: Array, marks: NDArray[np.int_], onto: Array) -> Array:
    """(V, 3): turned, moved and scaled so that landmarks lie best on others (Umeyama 1991)."""
    seen, middle = person[marks], onto.mean(axis=0)
    centred = seen - seen.mean(axis=0)
    left, size, right = np.linalg.svd(centred.T @ (onto - middle))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    scale = (size * [1.0, 1.0, np.linalg.det(left @ right)]).sum() / (centred**2).sum()
    return np.asarray(scale * (person - seen.mean(axis=0)) @ turn + middle)


def with_landmarks(person: Array, marks: NDArray[np.int_], onto: Array) -> Array:
    """(V, 3): moved in x and y, as a thin plate, so that landmarks lie on others; less and less towards the back."""
    plate = RBFInterpolator(person[marks, :2], onto[:, :2] - person[marks, :2], smoothing=5.0, degree=1)
    share = np.exp(-np.maximum(60.0 - person[:, 2], 0.0) / 40.0)[:, None]
    return person + np.pad(share * plate(person[:, :2]), ((0, 0), (0, 1)))


def distances(points: Array, used: NDArray[np.bool_]) -> Array:
    """(heights, angles) mm: from the head's axis, as mean of both sides; NaN where there is none."""
    heights, angles, _ = section_arrays()
    x, y, z = points[used].T
    places = np.stack([100.0 * np.arctan2(x, z - AXIS_Z_MM), y], axis=-1)
    surface = LinearNDInterpolator(places, np.hypot(x, z - AXIS_Z_MM))
    # The surface ends behind the head's back, so its last angle is read just before it.
    sides = [surface(*np.meshgrid(side * 100.0 * np.minimum(angles, np.pi - 0.03), heights)) for side in (-1, 1)]
    return np.asarray(np.mean(sides, axis=0))


def length(landmarks: Array, ends: tuple[int, int]) -> float:
    """Distance of two landmarks, mm."""
    return float(np.linalg.norm(landmarks[ends[0]] - landmarks[ends[1]]))


def text(tables: Array, changes: Array) -> str:
    """Text of the table's file."""
    lines = [
        '"""How the relief of faces differs from person to person. Written by design/learn_relief.py.',
        "",
        "Learned from the identity modes of ICT-FaceKit (MIT licence, University of Southern California, Institute for",
        "Creative Technologies), which come from scans of people.",
        '"""',
        "",
        "# fmt: off",
        "WIDTHS: tuple[dict[str, float], ...] = (  # change of each width, as a share, at weight 1",
        *(f"    {{{', '.join(f'{name!r}: {value:.3f}' for name, value in zip(WIDTHS, row, strict=True))}}},"
          .replace("'", '"') for row in changes),
        ")",
        "RELIEF_TENTHS_MM: tuple[tuple[tuple[int, ...], ...], ...] = (  # component, rows and columns of sections.py",
    ]  # fmt: skip
    for table in np.round(10 * tables).astype(int):
        lines += ["    (", *(f"        ({', '.join(map(str, row))})," for row in table), "    ),"]
    return "\n".join([*lines, ")", "# fmt: on", ""])


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER, "dense_face.npz"))
