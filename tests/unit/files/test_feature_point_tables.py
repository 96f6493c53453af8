"""Feature points in a table beside a mesh."""

from pathlib import Path

import numpy as np

from fapengine.files.heads.tables import load_feature_points

PLACES = {"8.1": (0, 2, 0), "8.2": (0, -2, 0), "2.2": (0, 0, 0), "2.3": (0, 0, 0)}
VERTICES = np.array([(0, -2, 0), (2, -2, 0), (0, 0, 0), (0, 0, 0), (0, 2, 0), (2, 2, 0)], float)
"""A lower lip (0, 1, 2 or 3) and an upper one, whose inner vertices lie at one place."""


def test_of_shut_lips_each_has_its_own_vertex(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    for lower, upper in ((2, 3), (3, 2)):
        for unit in (np.eye(3), np.diag([1.0, -1.0, 1.0])):  # in any axes
            triangles = np.array([(0, 1, lower), (upper, 5, 4)])
            vertices = VERTICES @ unit
            rows = [",".join([name, *map(str, np.array(place) @ unit)]) for name, place in PLACES.items()]
            path.write_text("\n".join(["point,x,y,z", *rows]))
            found = load_feature_points(path, vertices, triangles)
            assert found == {"8.1": 4, "8.2": 0, "2.2": upper, "2.3": lower}
