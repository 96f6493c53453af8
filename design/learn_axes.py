"""Find sex, build and age among the measured differences between faces: ``AXES`` in ``mesh/default_head/style.py``.

python -m design.learn_axes

The scans come without labels, but not without lengths. An axis is a list of lengths of the face and how far each goes
for one step; of all faces that have these lengths the likeliest is taken (people are spread about the mean with a
standard deviation of 1 in every mode, and a length is known to :data:`KNOWN_MM`). For sex the lengths follow the sense
of the differences in Farkas 1994, with the difference in size taken out, as it is of the scans; their amounts are our
choice. For build and age they are what fat and slack tissue does: fuller cheeks, jaw and neck; a longer upper lip,
hollow cheeks, jowls, a nose that droops.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.mesh.default_head.faces import displacement
from fapengine.mesh.default_head.style import MODES

Array = NDArray[np.float64]

KNOWN_MM = 0.7
X, Y, Z = np.eye(3)
PLACES: dict[str, tuple[float, float, Array]] = {  # angle, degrees; height, mm; direction
    "jaw": (66.0, -48.0, X), "face": (75.0, 5.0, X), "neck": (85.0, -80.0, X), "cheek": (45.0, -28.0, X + Z),
    "hollow": (48.0, -12.0, X + Z), "jowl": (40.0, -58.0, X + Z), "nose wing": (10.0, -8.0, X), "chin": (0.0, -76.0, Y),
    "chin forward": (0.0, -68.0, Z), "lip": (0.0, -27.0, Y), "nose tip": (0.0, -2.0, Y), "nose out": (0.0, 0.0, Z),
    "brow": (14.0, 56.0, Z), "forehead": (10.0, 84.0, Z), "under chin": (20.0, -80.0, Y),
}  # fmt: skip
AXES: dict[str, dict[str, float]] = {  # mm for one step
    "sex": {"jaw": 2.4, "face": 0.3, "neck": 3.0, "cheek": -0.6, "nose wing": 0.9, "chin": -2.2, "chin forward": 1.2,
            "brow": 1.1, "forehead": -0.8, "nose out": 0.8},
    "build": {"jaw": 3.2, "face": 1.5, "neck": 4.5, "cheek": 3.2, "hollow": 1.6, "jowl": 3.0, "under chin": -1.5,
              "nose wing": 0.3, "chin": 0.0, "brow": 0.0},
    "age": {"hollow": -1.6, "jowl": 2.0, "lip": -1.4, "nose tip": -2.0, "nose wing": 0.9, "jaw": 0.6,
            "under chin": -1.5, "nose out": 0.5, "brow": 0.0, "face": -0.3},
}  # fmt: skip


def gains(names: list[str]) -> Array:
    """(N, modes) mm: what one standard deviation of each mode does to lengths."""
    places = np.array([(np.deg2rad(PLACES[name][0]), PLACES[name][1]) for name in names])
    towards = np.array([PLACES[name][2] / np.linalg.norm(PLACES[name][2]) for name in names])
    mean = displacement(places)
    rows = [((displacement(places, tuple(row)) - mean) * towards).sum(axis=1) for row in np.eye(MODES)]
    return np.stack(rows, axis=1)


def likeliest(axis: dict[str, float]) -> Array:
    """(modes,): weights of the likeliest face with these lengths."""
    gain = gains(list(axis))
    wanted = np.array([*axis.values()])
    weights: Array = gain.T @ np.linalg.solve(gain @ gain.T + KNOWN_MM**2 * np.eye(len(axis)), wanted)
    return weights


def main() -> None:
    for name, axis in AXES.items():
        weights = likeliest(axis)
        print(f'    "{name}": ({", ".join(f"{weight:.2f}" for weight in weights)}),')
        reached = gains(list(axis)) @ weights
        print(
            "    #", ", ".join(f"{key} {value:.1f} of {axis[key]:g}" for key, value in zip(axis, reached, strict=True))
        )


if __name__ == "__main__":
    main()
