"""Tables beside a mesh that tell what its names do not: feature points, and meanings of blendshapes."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import parse_toml, spell_path
from fapengine.errors import DataError
from fapengine.files.paths import read_bytes
from fapengine.mesh.rig.fdp_files import is_fdp, parse_fdp
from fapengine.mpeg4 import fap
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES

UPPER_LIP, LOWER_LIP = ("2.2", "2.6", "2.7"), ("2.3", "2.8", "2.9")
"""Feature points of the inner lips, which lie at one place where the mouth is shut."""
SAME_PLACE_SHARE = 1e-4
"""Distance within which vertices lie at one place, as a share of the mesh's size."""
MAX_DISTANCE_SHARE = 0.05
"""Distance of a feature point given as a position from the nearest vertex, as a share of the mesh's size."""


def load_feature_points(path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> dict[str, int]:
    """Read feature points: columns ``point, vertex``, or ``point, x, y, z`` in the mesh's units; or an ``.fdp`` file.

    Where the lips are shut, an upper and a lower vertex lie at one place; a point of the upper lip is the one whose
    neighbours lie higher.

    Of an ``.fdp`` file, Xface's or Visage's, those points are taken that lie on the submesh with most of them.

    Parameters
    ----------
    path : Path
    vertices : (V, 3) float64
    triangles : (F, 3) int64
        The mesh.

    Returns
    -------
    dict of str to int
        Vertex by feature point.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        For an unknown or repeated point, or a position away from the mesh; ``where`` is the line.
    """
    from scipy.spatial import cKDTree

    data = read_bytes(path)
    if is_fdp(data):
        return _points_on_skin(data, str(path), len(vertices))
    try:
        text = data.decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text), skipinitialspace=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"feature points: is no table ({error})", where=str(path)) from error
    tree, size = cKDTree(vertices), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    points: dict[str, int] = {}
    placed: list[str] = []
    for line, row in enumerate(rows, 2):
        where = f"{path}, line {line}"
        name = (row.get("point") or "").strip()
        if name not in FEATURE_POINT_NAMES or name in points:
            raise DataError(f"point: got {name!r}, expected a feature point such as 8.2, once", where=where)
        try:
            if row.get("vertex"):
                points[name] = int(row["vertex"])
                continue
            position = np.array([float(row[axis]) for axis in "xyz"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{name}: got {row}, expected a vertex, or x, y and z", where=where) from error
        distance, index = tree.query(position) if np.isfinite(position).all() else (np.inf, 0)
        if not distance <= MAX_DISTANCE_SHARE * size:
            raise DataError(f"{name}: got {position.tolist()}, {distance:.4g} away from the mesh", where=where)
        points[name] = int(index)
        placed.append(name)
    return points | _lips_told_apart(placed, points, vertices, triangles, SAME_PLACE_SHARE * size)


def _lips_told_apart(
    placed: list[str], points: dict[str, int], vertices: NDArray[np.float64], triangles: NDArray[np.int64], near: float
) -> dict[str, int]:
    """Choose, of vertices at one place, the one of the right lip; up is from the lower lip's border to the upper's."""
    borders = [points.get(name, -1) for name in ("8.1", "8.2")]
    if not all(0 <= vertex < len(vertices) for vertex in borders):
        return {}
    up = vertices[borders[0]] - vertices[borders[1]]
    chosen = {}
    for names, sign in ((UPPER_LIP, 1.0), (LOWER_LIP, -1.0)):
        for name in set(placed) & set(names):
            same = np.flatnonzero(np.linalg.norm(vertices - vertices[points[name]], axis=1) <= near)
            around = {int(one): triangles[(triangles == one).any(axis=1)] for one in same}
            heights = {one: sign * float((vertices[ring] @ up).mean()) for one, ring in around.items() if len(ring)}
            if heights:
                chosen[name] = max(heights, key=lambda one: heights[one])
    return chosen


def _points_on_skin(data: bytes, where: str, vertices: int) -> dict[str, int]:
    try:
        fdp = parse_fdp(data)
    except DataError as error:
        raise type(error)(error.message, where=f"{where}, {error.where}" if error.where else where) from error
    worst = max(fdp.skin_points.values())
    if worst >= vertices:
        raise DataError(
            f"vertex {worst} of {fdp.skin!r}: got a mesh of {vertices} vertices, expected that submesh",
            where=where,
        )
    return fdp.skin_points


def load_mapping(path: Path) -> dict[str, str | dict[int, float]]:
    """Read what blendshapes mean: a table ``[shapes]`` of ARKit's, Oculus' or VRM's names, ``unused``, or FAPs.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it is wrong; ``where`` is file and key.
    """
    shapes = parse_toml(read_bytes(path), _Mapping, str(path)).shapes
    meanings: dict[str, str | dict[int, float]] = {}
    for name, meaning in shapes.items():
        where = spell_path(str(path), "shapes", name)
        if isinstance(meaning, str):
            meanings[name] = meaning
        elif meaning:
            meanings[name] = {
                _fap(key, f"{where}.{key}"): _value(value, f"{where}.{key}") for key, value in meaning.items()
            }
        else:
            raise DataError("got no FAP, expected some", where=where)
    return meanings


@dataclass(frozen=True, slots=True)
class _Mapping:
    """A mapping file, key by key."""

    shapes: dict[str, str | dict[str, float]]


def _fap(key: str, where: str) -> int:
    numbers = {row.name: row.number for row in fap.FAPS} | {str(row.number): row.number for row in fap.FAPS}
    if numbers.get(key, 0) < 3:
        raise DataError(f"got {key!r}, expected a FAP by number, 3..68, or by name", where=where)
    return numbers[key]


def _value(value: float, where: str) -> float:
    if not (np.isfinite(value) and value != 0.0):
        raise DataError(f"got {value}, expected FAPU at the blendshape's full weight, not 0", where=where)
    return value
