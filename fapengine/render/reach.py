"""Which part of a picture a head covers: behind it nothing has an edge that would have to be softened.

Theory of operation
-------------------
Some hundred vertices stand for all: the feature points, and those that lie farthest out in directions all round. They
are moved as the vertex shader moves them, and bound the others' places in the picture to :data:`SLACK_MM`.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.camera import Camera
from fapengine.render.packing import FrameUniforms

Rectangle: TypeAlias = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""
Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, right and bottom in pixels."""
Array = NDArray[np.float64]

DIRECTIONS = 160
HEAD_BONE = 4
SLACK_MM = 4.0
"""Distance by which others may stand out of the box round those vertices."""
MARGIN_PX = 3
"""Reach of an edge's softening."""


class Reach:
    """Vertices that bound a mesh.

    Parameters
    ----------
    mesh : FaceMesh
    """

    def __init__(self, mesh: FaceMesh) -> None:
        used = np.unique(mesh.triangles)
        moves = mesh.head_weight[used] > 0
        moving, still = _outermost(mesh.vertices_mm, used[moves]), _outermost(mesh.vertices_mm, used[~moves])
        mine = np.unique(np.concatenate([moving, still, np.fromiter(mesh.feature_points.values(), int)]))
        self._stays = np.isin(mine, used[~moves])
        self._at = np.concatenate([mesh.vertices_mm[mine], np.ones((len(mine), 1))], axis=1)
        self._boned = np.flatnonzero(mesh.bone_weight[mine])
        self._bone, self._weight = mesh.bone[mine][self._boned], mesh.bone_weight[mine][self._boned, None]
        self._head_weight = mesh.head_weight[mine, None]
        pushes = np.zeros((mesh.basis.width, len(mine), 3), dtype=np.float32)
        for place, vertex in enumerate(mine):
            entries = slice(mesh.basis.offsets[vertex], mesh.basis.offsets[vertex + 1])
            np.add.at(pushes[:, place], mesh.basis.entry_channels[entries], mesh.basis.entry_mm[entries])
        self._pushes = pushes.reshape(len(pushes), -1)

    def _places(self, uniforms: FrameUniforms) -> Array:
        """(N, 4): where a frame moves the vertices, homogeneous."""
        at = self._at.copy()
        at[:, :3] += (uniforms.channels[: len(self._pushes)] @ self._pushes).reshape(-1, 3)
        boned = at[self._boned]
        at[self._boned] += self._weight * (np.einsum("ni,nij->nj", boned, uniforms.bones[self._bone]) - boned)
        at += self._head_weight * (at @ uniforms.bones[HEAD_BONE] - at)
        return at

    def rectangles(self, uniforms: FrameUniforms, camera: Camera, size: tuple[int, int]) -> Sequence[Rectangle]:
        """Tell which parts of a picture of width and height in pixels a frame covers: they do not overlap."""
        clip = self._places(uniforms) @ camera.clip_from_world(size[0] / size[1]).T
        if not len(clip) or clip[:, 3].min() <= 0:  # behind the camera
            return [(0, 0, *size)]
        depth = np.linalg.norm(camera.position_mm - np.asarray(camera.target_mm))
        slack_px = SLACK_MM * camera.pixels_per_mm(size[1]) * depth / clip[:, 3:] + MARGIN_PX
        places = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
        low, high = np.floor(places - slack_px), np.ceil(places + slack_px)
        head = _box(low[~self._stays], high[~self._stays], size)
        rest = _box(low[self._stays], high[self._stays], size)
        return [(left, top, right - left, bottom - top) for left, top, right, bottom in _apart(head, rest)]


def _outermost(points_mm: NDArray[np.float32], chosen: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return those of the chosen that are farthest in one direction or another, evenly spread on a sphere."""
    if not len(chosen):
        return chosen
    number = np.arange(DIRECTIONS) + 0.5
    height = 1 - 2 * number / DIRECTIONS
    angle = np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - height**2)
    directions = np.stack([flat * np.cos(angle), height, flat * np.sin(angle)])
    return np.asarray(chosen[(points_mm[chosen] @ directions).argmax(axis=0)])


def _box(low: Array, high: Array, size: tuple[int, int]) -> Box | None:
    """Bound places (N, 2), as far as they are in the picture; None if they are not."""
    if not len(low):
        return None
    left, top = np.clip(low.min(axis=0), 0, size).astype(int).tolist()
    right, bottom = np.clip(high.max(axis=0), 0, size).astype(int).tolist()
    return (left, top, right, bottom) if left < right and top < bottom else None


def _apart(head: Box | None, rest: Box | None) -> list[Box]:
    """Head above shoulders that are at least as wide, or one box round both."""
    if head is None or rest is None:
        return [box for box in (head, rest) if box is not None]
    if rest[0] <= head[0] and head[2] <= rest[2] and head[1] < rest[1] and head[3] <= rest[3]:
        return [(*head[:3], min(head[3], rest[1])), rest]
    return [(min(head[0], rest[0]), min(head[1], rest[1]), max(head[2], rest[2]), max(head[3], rest[3]))]
