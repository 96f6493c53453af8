"""Import of a head: a mesh file in, a head that FAPs move out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.files.gltf.textures import pack_tiles
from fapengine.files.heads.built import load_built
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.meshes import is_rig, load_neutral, load_rig
from fapengine.files.heads.tables import load_feature_points, load_mapping
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.axes import BOTH, JAW, LEFT, RIGHT
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.feature_points import locate
from fapengine.mesh.rig.import_head import ImportedHead, can_follow_bones, head_of_bones, import_head
from fapengine.retarget.blendshape_names import Choice, choose_blendshapes


def import_head_file(
    path: Path, points: Path | None = None, mapping: Path | None = None
) -> tuple[ImportedHead, HeadInfo]:
    """Make a head from a file: by its blendshapes if some have known names, else by feature points or bones.

    Parameters
    ----------
    path : Path
        A mesh, or ICT-FaceKit's folder.
    points : Path, optional
        Table of feature points; required for a mesh without blendshapes. With blendshapes, its points replace those
        found.
    mapping : Path, optional
        Table of the meaning of other blendshape names.

    Raises
    ------
    UsageError
        If a file cannot be read, or points for a mesh without blendshapes are missing.
    DataError
        If its content is wrong, or no face can be made from it; ``where`` is the file.
    ResourceError
        If trimesh is needed and not installed.
    """
    mesh, choice, standard, marked = load_marked(path, points, mapping)
    try:
        imported = _imported(mesh, choice, marked, standard, by_points=points is not None)
    except DataError as error:
        raise type(error)(error.message, where=str(path)) from error
    imported = replace(imported, mesh=crop_painting(imported.mesh))
    return imported, HeadInfo(path.name, "", imported.used, choice.missing if imported.used else ())


def load_marked(
    path: Path, points: Path | None, mapping: Path | None = None
) -> tuple[BlendshapeMesh, Choice, FaceMesh, dict[str, int]]:
    """Read a mesh and the roles of its blendshapes; also return the standard head, and the points set by hand.

    Parameters and errors are those of :func:`import_head_file`.
    """
    if is_rig(path):
        mesh = load_rig(path)
        choice = _choice(path, mesh, mapping, points)
    elif points is None:
        raise UsageError(f"{path}: has no blendshapes, so its feature points are needed (points=FILE)")
    else:
        mesh, choice = load_neutral(path), choose_blendshapes(())
    standard = load_built(HeadStyle())
    marked = load_feature_points(points, mesh.vertices, mesh.triangles) if points else {}
    return mesh, choice, standard, marked


def _imported(
    mesh: BlendshapeMesh, choice: Choice, marked: dict[str, int], standard: FaceMesh, *, by_points: bool
) -> ImportedHead:
    if not choice.blended and not choice.own_faps and not by_points:
        return head_of_bones(mesh, standard)
    vertices = find_points(mesh, choice, marked, standard, needed=not by_points)
    return import_head(mesh, choice.blended, vertices, standard, choice.own_faps)


def _choice(path: Path, mesh: BlendshapeMesh, mapping: Path | None, points: Path | None) -> Choice:
    """Choose among the blendshapes of a mesh; without any, feature points are needed, or a bone for the head."""
    names = [name for name, blendshape in mesh.blendshapes.items() if len(blendshape.vertices)]
    choice = choose_blendshapes(names, load_mapping(mapping) if mapping else None)
    absent = [name for name in choice.own_faps if name not in mesh.blendshapes]
    if absent:
        raise DataError(f"mapping: got blendshape {absent[0]!r}, which the mesh does not have", where=str(mapping))
    if not choice.blended and not choice.own_faps and points is None and not can_follow_bones(mesh):
        some = ", ".join(list(mesh.blendshapes)[:8]) or "none"
        raise DataError(
            f"blendshapes: got {some}; expected some that are named as ARKit's, Oculus' or VRM's, a mapping file"
            " (mapping=FILE), or feature points (points=FILE)",
            where=str(path),
        )
    return choice


def find_points(
    mesh: BlendshapeMesh, choice: Choice, marked: dict[str, int], standard: FaceMesh, *, needed: bool
) -> dict[str, int]:
    """Vertices of the feature points: those set by hand, and those found by blendshapes, if any are ``needed``."""
    moves = {
        role: mesh.dense(names[0])
        for role, names in ((LEFT, choice.left), (RIGHT, choice.right), (BOTH, choice.both), (JAW, choice.jaw))
        if names
    }
    located: dict[str, int] = {}
    try:
        located = locate(mesh, moves, standard)
    except DataError:
        if needed:
            raise
    taken = set(marked.values())
    return {name: vertex for name, vertex in located.items() if vertex not in taken} | marked


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
