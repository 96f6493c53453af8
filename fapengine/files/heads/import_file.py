"""Import of a head: a mesh file in, a head that FAPs move out."""

from dataclasses import replace
from pathlib import Path

from fapengine.errors import DataError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.cropped import crop_painting
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.meshes import is_rig, load_neutral, load_rig
from fapengine.files.heads.tables import load_feature_points, load_mapping
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.axes import BOTH, JAW, LEFT, RIGHT
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.bone_head import can_follow_bones, head_of_bones
from fapengine.mesh.rig.feature_points import locate
from fapengine.mesh.rig.import_head import ImportedHead, import_head
from fapengine.retarget.blendshape_names import Choice, choose_blendshapes


def import_head_file(
    path: Path, points: Path | None = None, mapping: Path | None = None
) -> tuple[ImportedHead, HeadInfo]:
    """Make a head of a file: by its blendshapes, where it has some with known names, else by feature points or bones.

    Parameters
    ----------
    path : Path
        A mesh, or ICT-FaceKit's folder.
    points : Path, optional
        Table of feature points; needed for a mesh without blendshapes. With blendshapes, its points go before those
        found.
    mapping : Path, optional
        Table of what blendshapes with other names mean.

    Raises
    ------
    UsageError
        If a file cannot be read, or a mesh without blendshapes comes without points.
    DataError
        If its content is wrong, or no face can be made of it; ``where`` is the file.
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
    """Read a mesh and what its blendshapes are for; give our head, and the points marked by hand.

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
    """Choose among a mesh's blendshapes; without any, feature points are needed, or a bone that carries the head."""
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
    """Vertices of the feature points: those marked by hand, and those that blendshapes show, if any are ``needed``."""
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
