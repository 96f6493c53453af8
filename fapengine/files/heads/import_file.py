"""Heads from mesh files: by the blendshapes and bones of the mesh, or the built-in head fitted to a scan."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.files.gltf.document import parse_json, stated_licences, text_of_gltf
from fapengine.files.gltf.textures import pack_tiles
from fapengine.files.heads.built import load_built
from fapengine.files.heads.dense import is_profile, load_dense
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.meshes import RIG_ENDINGS, is_rig, load_neutral, load_rig
from fapengine.files.heads.tables import load_feature_points, load_mapping
from fapengine.files.paths import locating, read_bytes
from fapengine.laboratory.dense_face import DenseFace, neutral_mesh
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import still_faps
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mesh.rig.blendshape_mesh import BOTH, JAW, LEFT, RIGHT, BlendshapeMesh, can_follow_bones
from fapengine.mesh.rig.feature_points import NoSlitError, locate
from fapengine.mesh.rig.import_head import ImportedHead, head_of_bones, import_head
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.models.adapted_head import Nearness, adapt_head, scan_surface
from fapengine.models.completed_rig import complete_rig
from fapengine.models.scans import has_colours, paint_from_scan
from fapengine.mpeg4 import fap
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.rig_weights import GAZE, Choice, choose_blendshapes

WANTED_POINTS = "feature points 8.1 to 8.4 and 2.1, better also 2.2, 2.3, 3.1 to 3.6, 9.3 and 9.15"
"""What a mesh without blendshapes needs, and what it needs for lids that close."""
SHAPELESS = "no blendshapes: a blink may leave gaps at the corners; complete=True makes shapes from the built-in head"


def import_head_file(
    path: Path, points: Path | None = None, mapping: Path | None = None, *, complete: bool = False
) -> tuple[ImportedHead, HeadInfo]:
    """Make a head from a file: from blendshapes with known names, else from feature points or bones.

    Parameters
    ----------
    path : Path
        A mesh, or ICT-FaceKit's folder.
    points : Path, optional
        Table of feature points; required for a mesh without blendshapes. With blendshapes, its points replace those
        that are found.
    mapping : Path, optional
        Table of the meaning of other blendshape names.
    complete : bool
        Make the shapes of ARKit that the mesh lacks, or that are empty, from those of the built-in head.

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
    shapeless = not choice.blended and not choice.own_faps and points is None
    with locating(path):
        if shapeless and complete:
            raise DataError(
                f"complete: no shape shows where the lips and lids are, expected {WANTED_POINTS} (points=FILE)"
            )
        if shapeless:
            imported = head_of_bones(mesh, standard)
        else:
            imported, choice = _with_lips(mesh, choice, marked, standard, needed=points is None, complete=complete)
        licence = _licence(path)
    imported = replace(imported, mesh=crop_painting(imported.mesh))
    return imported, HeadInfo(path.name, licence, imported.used, choice.missing if imported.used else ())


def _licence(path: Path) -> str:
    """What a glTF file says about its licence, copyright and authors; other files say nothing."""
    if path.is_dir() or path.suffix.lower() not in RIG_ENDINGS:
        return ""
    return "; ".join(stated_licences(parse_json(text_of_gltf(read_bytes(path)), "glTF")))


def _with_lips(
    mesh: BlendshapeMesh, choice: Choice, marked: dict[str, int], standard: FaceMesh, *, needed: bool, complete: bool
) -> tuple[ImportedHead, Choice]:
    """Make a head with lips; without any, as of a drawn mouth, its bones and whole shapes move it."""
    try:
        vertices = find_points(mesh, choice, marked, standard, needed=needed)
    except NoSlitError:
        if complete or not can_follow_bones(mesh):
            raise
        lids = zip((choice.left, choice.right), ((19, 21), (20, 22)), strict=True)
        blinks: dict[str, tuple[int, ...]] = {names[0]: faps for names, faps in lids if names}
        blinks = blinks or dict.fromkeys(choice.both, (19, 20, 21, 22))
        return head_of_bones(mesh, standard, choice.jaw[0], blinks), choice
    if complete:
        mesh, choice = _completed(mesh, choice, vertices, standard)
    elif not mesh.blendshapes:
        mesh = replace(mesh, notes=(*mesh.notes, SHAPELESS))
    return import_head(mesh, choice.blended, vertices, standard, choice.own_faps), choice


def _completed(
    mesh: BlendshapeMesh, choice: Choice, points: Mapping[str, int], standard: FaceMesh
) -> tuple[BlendshapeMesh, Choice]:
    """Add the shapes of ARKit that are missing, except those of eyeballs and tongue, which are not skin."""
    faps = dict(zip(ARKIT_NAMES, arkit_map().faps, strict=True))
    made = [name for name in choice.missing if not GAZE.fullmatch(name.lower()) and name != "tongueOut"]
    if not made:
        return replace(mesh, notes=(*mesh.notes, "completed: nothing, as no shape of the skin is missing")), choice
    mesh, off_mm = complete_rig(mesh, points, {name: faps[name] for name in made}, standard)
    note = (
        f"completed: {len(made)} of ARKit's {len(ARKIT_NAMES)} shapes are made from those of the built-in head, which"
        f" was fitted to {off_mm:.1f} mm: {', '.join(made)}"
    )
    left = tuple(name for name in choice.missing if name not in made)
    blended = tuple(dict.fromkeys((*choice.blended, *made)))
    return replace(mesh, notes=(*mesh.notes, note)), replace(choice, blended=blended, missing=left)


def load_marked(
    path: Path, points: Path | None, mapping: Path | None = None
) -> tuple[BlendshapeMesh, Choice, FaceMesh, dict[str, int]]:
    """Read a mesh and the roles of its blendshapes; also return the standard head, and the feature points given.

    Parameters and errors are those of :func:`import_head_file`.
    """
    if is_rig(path):
        mesh = load_rig(path)
        choice = _choice(path, mesh, mapping, points)
    else:
        mesh, choice = load_neutral(path), choose_blendshapes(())
        if points is None:
            raise UsageError(f"{path}: has no blendshapes, so its feature points are needed (points=FILE)")
    standard = load_built(MEASURED)
    marked = load_feature_points(points, mesh.vertices, mesh.triangles) if points else {}
    return mesh, choice, standard, marked


def _choice(path: Path, mesh: BlendshapeMesh, mapping: Path | None, points: Path | None) -> Choice:
    """Choose among the blendshapes of a mesh; without any, feature points or a bone for the head are needed."""
    names = [name for name, blendshape in mesh.blendshapes.items() if len(blendshape.vertices)]
    choice = choose_blendshapes(names, load_mapping(mapping) if mapping else None)
    absent = [name for name in choice.own_faps if name not in mesh.blendshapes]
    if absent:
        raise DataError(f"mapping: got blendshape {absent[0]!r}, which the mesh does not have", where=str(mapping))
    if not choice.blended and not choice.own_faps and points is None and not can_follow_bones(mesh):
        some = ", ".join(list(mesh.blendshapes)[:8]) or "none"
        raise DataError(
            f"blendshapes: no names of ARKit, Oculus or VRM among {some}; give a mapping file (mapping=FILE) or feature"
            " points (points=FILE)",
            where=str(path),
        )
    return choice


def find_points(
    mesh: BlendshapeMesh, choice: Choice, marked: dict[str, int], standard: FaceMesh, *, needed: bool
) -> dict[str, int]:
    """Vertices of the feature points: ``marked`` ones, and those found by blendshapes; errors only if ``needed``."""
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
"""Side of the squares that are kept or removed."""
MIN_SAVED = 0.25
"""Least fraction of the pixels to remove; otherwise the texture is not changed."""
OUTSIDE = 1e-6
"""Distance of texture coordinates outside of the texture that counts as rounding."""


def crop_painting(mesh: FaceMesh) -> FaceMesh:
    """Remove the parts of the texture that no triangle shows; the resolution stays the same.

    A head is not changed if its texture repeats, has no alpha or is mostly shown.
    """
    painted = (mesh.material != Material.EYE)[mesh.triangles].all(axis=1)  # eyes have other texture coordinates
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
    """Boxes (top, bottom, left, right) without overlap that contain all used cells."""
    from scipy.ndimage import find_objects, label

    while True:
        labels, _ = label(used, np.ones((3, 3)))
        boxes = [(rows.start, rows.stop, columns.start, columns.stop) for rows, columns in find_objects(labels)]
        filled = used.copy()
        for top, bottom, left, right in boxes:
            filled[top:bottom, left:right] = True
        if (filled == used).all():
            return boxes
        used = filled  # joins boxes that touch


def adapt_head_file(
    path: Path, points: Path | None = None, mapping: Path | None = None
) -> tuple[ImportedHead, HeadInfo, Nearness]:
    """Fit the built-in head to a scan.

    Parameters
    ----------
    path : Path
        A mesh in any unit and axes, or a profile with a dense face.
    points : Path, optional
        Table of feature points; required for a mesh without blendshapes.
    mapping : Path, optional
        Table of the meaning of other blendshape names, which locate feature points.

    Returns
    -------
    ImportedHead
        The built-in head, adapted; its notes say where the colours come from.
    HeadInfo
    Nearness
        Distances from the scan before and after.

    Raises
    ------
    UsageError
        As :func:`fapengine.files.heads.import_file.import_head_file`; or if the path is a profile without a dense face.
    DataError
        If a file's content is wrong, or there are too few feature points; ``where`` is the file.
    ResourceError
        If trimesh is needed and not installed.
    """
    if is_profile(path):
        if mapping is not None:
            raise UsageError(f"mapping: got {mapping}, but a profile's modes have no other names")
        face, marked = load_dense(path, points)
        with locating(path):
            imported, nearness = adapt_dense_face(face, marked)
        return imported, adapted_info(face), nearness
    mesh, choice, standard, marked = load_marked(path, points, mapping)
    with locating(path):
        vertices = find_points(mesh, choice, marked, standard, needed=points is None)
        imported, nearness = _adapted(mesh, vertices, standard)
        licence = _licence(path)
    return imported, HeadInfo(f"fapengine's head on {path.name}", licence), nearness


def adapt_dense_face(face: DenseFace, points: Mapping[str, int] | None = None) -> tuple[ImportedHead, Nearness]:
    """Fit the built-in head to a dense face, in the neutral pose of the markers.

    ``points`` are the vertices of more feature points, and replace those of the markers.

    Raises
    ------
    DataError
        If there are too few feature points.
    """
    mesh, vertices = neutral_mesh(face, {}, points)
    return _adapted(mesh, vertices, load_built(MEASURED))


def adapted_info(face: DenseFace) -> HeadInfo:
    """Origin of the result of :func:`adapt_dense_face`."""
    return HeadInfo(f"fapengine's head on the dense face of {face.subject}", face.licence)


def _adapted(mesh: BlendshapeMesh, vertices: Mapping[str, int], standard: FaceMesh) -> tuple[ImportedHead, Nearness]:
    # At a closed mouth a point of the upper and one of the lower lip may share a vertex; place_mesh needs unique ones.
    one_name = {vertex: name for name, vertex in reversed(list(vertices.items()))}
    placed = place_mesh(mesh, {name: vertex for vertex, name in one_name.items()}, standard)
    places = {name: placed.to_head_space(mesh.vertices[vertex]) for name, vertex in vertices.items()}
    adapted, nearness = adapt_head(scan_surface(placed), places)
    note = "colours: the scan has none; the head keeps its own"
    if has_colours(placed):
        adapted = paint_from_scan(adapted, placed)
        note = f"colours: those of the scan's {'picture' if mesh.texture is not None else 'vertices'}"
    still = still_faps(adapted)
    imported = ImportedHead(
        mesh=adapted,
        moved=tuple(row.number for row in fap.FAPS if row.number > 2 and row.number not in still),
        missing=still,
        scale=placed.scale,
        notes=(*mesh.notes, note),
        used=(),
        unused=(),
        placed=placed,
    )
    return imported, nearness
