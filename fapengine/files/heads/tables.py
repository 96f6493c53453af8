"""Tables that accompany a mesh: its feature points, and the meaning of its blendshapes.

Feature points may be those of other programs' faces: Xface's ``.fdp`` (XML) and Visage's (text). Supported layouts::

    <xfdp><fdp affects="SUBMESH" index="VERTEX" name="2.1">...</fdp></xfdp>

    1.0 MODEL r r r t t t
    2.1 x y z SURFACE.VERTEX
    NUL 0

Xface counts the vertices of each submesh from 0. Its units, regions and weights are ignored: units are measured, and
how skin follows a point is determined from the mesh (:func:`fapengine.mesh.rig.parts.fit_point_fields`).
"""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import MAX_BYTES, parse_toml, spell_path
from fapengine.errors import DataError
from fapengine.files.paths import locating, read_bytes
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.speech.formats.documents import parse_xml

Points = dict[str, dict[str, int]]
"""Vertex by feature point, by submesh: the chin's point may also move the teeth."""


def is_fdp(data: bytes) -> bool:
    """Detect an ``.fdp`` file of either kind by its first bytes."""
    head = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    return (head.startswith(b"<") and b"<xfdp" in head) or head.startswith(b"1.0 ")


def parse_fdp(data: bytes) -> tuple[str, dict[str, int]]:
    """Read an ``.fdp`` file of either kind: the submesh with the most points, and the vertex of each of its points.

    Raises
    ------
    DataError
        If it is neither, or contains no point.
    UnsupportedError
        For XML with entities.
    """
    points = _xface(data) if data.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") else _visage(data)
    if not points:
        raise DataError("fdp: contains no feature point")
    skin = max(points, key=lambda submesh: len(points[submesh]))
    return skin, points[skin]


def _xface(data: bytes) -> Points:
    root = parse_xml(data, "fdp")
    if root.tag != "xfdp":
        raise DataError(f"fdp: got <{root.tag[:40]}>, expected <xfdp>")
    points: Points = {}
    for number, entry in enumerate(root.iter("fdp"), start=1):
        where = f"fdp {number}"
        vertex = _whole(entry.get("index", ""), where)
        _add_point(points, entry.get("name", ""), entry.get("affects", ""), vertex, where)
    return points


def _visage(data: bytes) -> Points:
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise DataError(f"fdp: is not text ({error})") from error
    points: Points = {}
    for number, line in enumerate(lines[1:], start=2):
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "NUL":
            break
        where = f"line {number}"
        surface, dot, vertex = words[4].partition(".") if len(words) == 5 else ("", "", "")
        if not dot:
            raise DataError(f"got {line[:60]!r}, expected POINT x y z SURFACE.VERTEX", where=where)
        _add_point(points, words[0], surface, _whole(vertex, where), where)
    return points


def _add_point(points: Points, name: str, submesh: str, vertex: int, where: str) -> None:
    if name not in FEATURE_POINT_NAMES or name in points.get(submesh, ()):
        raise DataError(f"point: got {name[:40]!r}, expected a point such as 8.2, once per submesh", where=where)
    points.setdefault(submesh, {})[name] = vertex


def _whole(text: str, where: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise DataError(f"vertex: got {text[:40]!r}, expected a number from 0", where=where)
    return int(text)


UPPER_LIP, LOWER_LIP = ("2.2", "2.6", "2.7"), ("2.3", "2.8", "2.9")
"""Feature points of the inner lips; where the mouth is closed, an upper and a lower one have the same position."""
SAME_PLACE_SHARE = 1e-4
"""Distance of vertices that count as one position, as a fraction of the mesh's size."""
MAX_DISTANCE_SHARE = 0.05
"""Largest distance of a feature point's position from the nearest vertex, as a fraction of the mesh's size."""


def load_feature_points(path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> dict[str, int]:
    """Read feature points: columns ``point, vertex``, or ``point, x, y, z`` in the mesh's units; or an ``.fdp`` file.

    Where the lips touch, an upper and a lower vertex have the same position; a point of the upper lip is the one whose
    neighbours are higher. From an ``.fdp`` file of Xface or Visage come the points of the submesh with most of them.

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
        raise DataError(f"feature points: is not a table ({error})", where=str(path)) from error
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
    return points | _separate_lips(placed, points, vertices, triangles, SAME_PLACE_SHARE * size)


def _separate_lips(
    placed: list[str], points: dict[str, int], vertices: NDArray[np.float64], triangles: NDArray[np.int64], near: float
) -> dict[str, int]:
    """Choose the vertex of the right lip among those at one position; up is from the lower border to the upper."""
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
    with locating(where):
        skin, points = parse_fdp(data)
    worst = max(points.values())
    if worst >= vertices:
        raise DataError(
            f"vertex {worst} of {skin!r}: got a mesh of {vertices} vertices, expected that submesh", where=where
        )
    return points


def load_mapping(path: Path) -> dict[str, str | dict[int, float]]:
    """Read the meaning of blendshapes: a table ``[shapes]`` of names of ARKit, Oculus or VRM, ``unused``, or FAPs.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it is wrong; ``where`` is file and key.
    """
    shapes = parse_toml(read_bytes(path, MAX_BYTES), _Mapping, str(path)).shapes
    numbers = {row.name: row.number for row in fap.FAPS} | {str(row.number): row.number for row in fap.FAPS}
    meanings: dict[str, str | dict[int, float]] = {}
    for name, meaning in shapes.items():
        where = spell_path(str(path), "shapes", name)
        if isinstance(meaning, str):
            meanings[name] = meaning
            continue
        if not meaning:
            raise DataError("contains no FAP", where=where)
        for key, value in meaning.items():
            if numbers.get(key, 0) < 3:
                raise DataError(f"got {key!r}, expected a FAP by number, 3 to 68, or by name", where=f"{where}.{key}")
            if not (np.isfinite(value) and value != 0.0):
                raise DataError(
                    f"got {value}, expected FAPU at the blendshape's full weight, not 0", where=f"{where}.{key}"
                )
        meanings[name] = {numbers[key]: value for key, value in meaning.items()}
    return meanings


@dataclass(frozen=True, slots=True)
class _Mapping:
    """A mapping file, key by key."""

    shapes: dict[str, str | dict[str, float]]
