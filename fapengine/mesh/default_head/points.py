"""The parts of the default head, and the vertices of the FDP feature points on them."""

from dataclasses import dataclass

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.mesh.default_head.eyes import Eye
from fapengine.mesh.default_head.mesh_builder import Rings
from fapengine.mesh.default_head.mouth import HALF_WAY
from fapengine.mesh.default_head.parts import TONGUE_TIP


@dataclass(frozen=True, slots=True, eq=False)
class HeadParts:
    """Vertices of each part of the head, for the deformation basis."""

    grid: Indices
    """(rows, columns): the skin."""
    mouth: Rings
    eyes: tuple[Eye, Eye]
    brows: tuple[Indices, Indices]
    ears: tuple[Indices, Indices]
    upper_teeth: Indices
    lower_teeth: Indices
    tongue: Indices
    hair: Indices
    """Empty on a bald head."""
    crown: int
    """The vertex that closes the skin at the top."""
    pivot: int
    """A vertex without triangles: feature point 7.1, the top of the spine."""


# fmt: off
ON_SKIN = {  # left or middle point: (x, y, z) mm near which the skin vertex is taken; right ones mirror it
    "2.1": (0, -75, 105),     "2.10": (0, -61, 111),   "2.11": (20, -73, 98),  "2.13": (50, -54, 69),
    "4.1": (12, 53, 107),     "4.3": (34, 57, 100),    "4.5": (53, 53, 84),
    "5.1": (38, -12, 97),     "5.3": (52, 13, 86),
    "9.1": (17, -4, 103),     "9.5": (12, -10, 106),   "9.7": (8, 34, 103),       "9.12": (0, 26, 115),
    "9.13": (10, 17, 111),    "9.15": (0, -12, 115),
    "10.7": (72, -12, 14),    "10.9": (74, 34, 12),
    "11.1": (0, 92, 97),      "11.3": (45, 84, 65),
}
MIRRORED = {
    "2.12": "2.11", "2.14": "2.13", "4.2": "4.1", "4.4": "4.3", "4.6": "4.5", "5.2": "5.1", "5.4": "5.3",
    "9.2": "9.1", "9.4": "9.5", "9.6": "9.7", "9.14": "9.13", "10.8": "10.7", "10.10": "10.9", "11.2": "11.3",
}
# fmt: on


def locate(points: Array, head: HeadParts) -> dict[str, int]:
    """Find the vertex of every feature point among points, (V, 3) mm."""
    vertices: dict[str, int] = {}
    skin = np.unique(np.concatenate([head.grid.ravel(), head.mouth.indices[head.mouth.level > 1].ravel()]))
    skin = np.setdiff1d(skin, _covered(head))

    def nearest(candidates: Indices, target: tuple[float, float, float] | Array) -> int:
        return int(candidates[np.linalg.norm(points[candidates] - np.asarray(target), axis=1).argmin()])

    ridge = skin[(np.abs(points[skin, 0]) < 0.5) & (points[skin, 1] > -12) & (points[skin, 1] < 22)]
    vertices["9.3"] = int(ridge[points[ridge, 2].argmax()])  # the tip of the nose is the foremost point
    for name, target in ON_SKIN.items():
        vertices[name] = nearest(skin, target)
    for name, other in MIRRORED.items():
        vertices[name] = nearest(skin, points[vertices[other]] * [-1, 1, 1])
    vertices |= _on_lips(head)
    vertices |= _on_eyes(points, head)
    for index, (side, ear) in enumerate(zip((1, -1), head.ears, strict=True)):
        rim = ear[-5]
        vertices[f"10.{1 + index}"] = nearest(rim, np.array([side * 82, 50, -5]))
        vertices[f"10.{3 + index}"] = nearest(rim, np.array([side * 85, 12, -25]))
        vertices[f"10.{5 + index}"] = nearest(rim, np.array([side * 78, -30, 5]))
    middle = head.upper_teeth.shape[1] // 2
    for name, teeth, row in (
        ("9.8", head.upper_teeth, 3), ("9.10", head.upper_teeth, 7),
        ("9.9", head.lower_teeth, 3), ("9.11", head.lower_teeth, 7),
    ):  # fmt: skip
        vertices[name] = int(teeth[row, middle])
    vertices["6.1"] = int(head.tongue[-1])
    for name, offset in (("6.2", (0, 8, -26)), ("6.3", (40, 0, -26)), ("6.4", (-40, 0, -26))):
        vertices[name] = nearest(head.tongue, TONGUE_TIP + offset)
    vertices |= {"7.1": head.pivot, "11.4": head.crown}
    vertices["11.5"] = int(head.hair[-1]) if len(head.hair) else head.crown
    vertices["11.6"] = nearest(head.grid.ravel(), np.array([0, 60, -100]))
    return vertices


def _covered(head: HeadParts) -> Indices:
    """Grid vertices inside the blocks of mouth and eyes, which are in no triangle."""
    covered = []
    for rings in (head.mouth, head.eyes[0].lids, head.eyes[1].lids):
        at = np.isin(head.grid, rings.indices[0])
        rows, columns = np.flatnonzero(at.any(axis=1)), np.flatnonzero(at.any(axis=0))
        covered.append(head.grid[rows[1] : rows[-1], columns[1] : columns[-1]].ravel())
    return np.concatenate(covered)


def _on_lips(head: HeadParts) -> dict[str, int]:
    mouth = head.mouth
    inner, outer = (mouth.indices[np.flatnonzero(mouth.level == level)[0]] for level in (0.0, 1.0))

    def at(ring: Indices, t: float, upper: bool) -> int:
        side = np.flatnonzero(mouth.upper == upper) if abs(t) < 1 else np.arange(len(ring))
        return int(ring[side[np.abs(mouth.t[side] - t).argmin()]])

    vertices = {"2.2": at(inner, 0, True), "2.3": at(inner, 0, False), "8.1": at(outer, 0, True)}
    vertices |= {"8.2": at(outer, 0, False), "8.10": at(outer, 0.3, True), "8.9": at(outer, -0.3, True)}
    for name, ring, t, upper in (
        ("2.4", inner, 1.0, True), ("2.6", inner, HALF_WAY, True), ("2.8", inner, HALF_WAY, False),
        ("8.3", outer, 1.0, True), ("8.5", outer, HALF_WAY, True), ("8.7", outer, HALF_WAY, False),
    ):  # fmt: skip
        group, number = name.split(".")
        vertices[name] = at(ring, t, upper)
        vertices[f"{group}.{int(number) + 1}"] = at(ring, -t, upper)
    return vertices


def _on_eyes(points: Array, head: HeadParts) -> dict[str, int]:
    vertices: dict[str, int] = {}
    for index, eye in enumerate(head.eyes):
        lids = eye.lids
        margin = lids.indices[np.flatnonzero(lids.level == 1.0)[0]]
        fold = lids.indices[np.abs(lids.level - 1.44).argmin()]
        below = lids.indices[np.abs(lids.level - 1.34).argmin()]
        upper = np.flatnonzero(lids.upper)[points[margin[lids.upper], 1].argmax()]
        lower = np.flatnonzero(~lids.upper)[points[margin[~lids.upper], 1].argmin()]
        vertices[f"3.{1 + index}"] = int(margin[upper])
        vertices[f"3.{3 + index}"] = int(margin[lower])
        vertices[f"3.{5 + index}"] = int(eye.ball[-1])
        vertices[f"3.{9 + index}"] = int(below[lower])
        vertices[f"3.{13 + index}"] = int(fold[upper])
        # 3.7 and 3.12 are the outer corners, 3.11 and 3.8 the inner ones.
        vertices["3.7" if index == 0 else "3.12"] = int(margin[lids.t.argmax()])
        vertices["3.11" if index == 0 else "3.8"] = int(margin[lids.t.argmin()])
    return vertices
