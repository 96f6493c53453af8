"""The part of a painting that a head shows: an avatar's is often one of the whole body."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.files.gltf.tiles import pack_tiles
from fapengine.mesh.face_mesh import FaceMesh, Material

CELL_PX = 16
"""Side of the squares in which the used part of a painting is told."""
MIN_SAVED = 0.25
"""Share of the pixels that must go, or the painting stays as it is."""
OUTSIDE = 1e-6
"""Place beyond the painting that is taken for rounding."""


def crop_painting(mesh: FaceMesh) -> FaceMesh:
    """Keep what the triangles show of a painting, in a smaller one; resolution stays.

    A head whose painting repeats or has no alpha, or that shows most of it, is returned as it is.
    """
    painted = (mesh.material != Material.EYE)[mesh.triangles].all(axis=1)  # eyes' places are not in the painting
    if mesh.texture is None or mesh.texture.shape[2] != 4 or not painted.any():
        return mesh
    at = mesh.uv[mesh.triangles[painted]].astype(np.float64)
    if at.min() < -OUTSIDE or at.max() > 1 + OUTSIDE:
        return mesh
    height, width = mesh.texture.shape[:2]
    grid = np.array([-(-width // CELL_PX), -(-height // CELL_PX)])
    cells = np.clip((at * (width, height) / CELL_PX).astype(np.int64), 0, grid - 1)
    low, high = cells.min(axis=1), cells.max(axis=1)
    used = np.zeros(grid[::-1], dtype=bool)
    for (left, top), (right, bottom) in np.unique(np.stack([low, high], axis=1), axis=0):
        used[top : bottom + 1, left : right + 1] = True
    boxes = _boxes(used)
    tiles = [mesh.texture[slice(*box[:2]), slice(*box[2:])] for box in np.multiply(boxes, CELL_PX)]
    packed, places = pack_tiles(tiles)
    if packed.shape[0] * packed.shape[1] > (1 - MIN_SAVED) * width * height:
        return mesh
    box_of = np.zeros(used.shape, np.int64)
    for number, (top, bottom, left, right) in enumerate(boxes):
        box_of[top:bottom, left:right] = number
    uv = mesh.uv.astype(np.float64).copy()
    vertices = np.unique(mesh.triangles[painted])
    pixel = uv[vertices] * (width, height)
    cell = np.clip((pixel / CELL_PX).astype(np.int64), 0, grid - 1)
    mine = box_of[cell[:, 1], cell[:, 0]]
    corner = np.array([(left * CELL_PX, top * CELL_PX) for top, _, left, _ in boxes])
    size = np.array([tile.shape[1::-1] for tile in tiles])
    place = np.array(places, np.float64)
    inside = place[mine, :2] + (pixel - corner[mine]) / size[mine] * place[mine, 2:]
    uv[vertices] = inside / packed.shape[1::-1]
    return replace(mesh, uv=uv.astype(np.float32), texture=packed)


def _boxes(used: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Boxes (top, bottom, left, right) that do not overlap and hold all used cells."""
    from scipy.ndimage import find_objects, label

    while True:
        labels, _ = label(used, np.ones((3, 3)))
        boxes = [(rows.start, rows.stop, columns.start, columns.stop) for rows, columns in find_objects(labels)]
        filled = used.copy()
        for top, bottom, left, right in boxes:
            filled[top:bottom, left:right] = True
        if (filled == used).all():
            return boxes
        used = filled  # boxes that touch become one
