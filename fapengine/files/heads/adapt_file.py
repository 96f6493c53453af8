"""Fit of the built-in head to a scan: a mesh file and its feature points in, a head with all FAPs out."""

from collections.abc import Mapping
from pathlib import Path

from fapengine.errors import UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.dense import is_profile, load_dense
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.import_file import find_points, load_marked
from fapengine.files.paths import locating
from fapengine.laboratory.dense_face import DenseFace, neutral_mesh
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import still_faps
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.import_head import ImportedHead
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.models.adapted_head import Nearness, adapt_head, scan_surface
from fapengine.models.scans import has_colours, paint_from_scan
from fapengine.mpeg4 import fap


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
    return imported, HeadInfo(f"fapengine's head on {path.name}", "", ()), nearness


def adapt_dense_face(face: DenseFace, points: Mapping[str, int] | None = None) -> tuple[ImportedHead, Nearness]:
    """Fit the built-in head to a dense face, in the neutral pose of the markers.

    ``points`` are the vertices of more feature points, and replace those of the markers.

    Raises
    ------
    DataError
        If there are too few feature points.
    """
    mesh, vertices = neutral_mesh(face, {}, points)
    return _adapted(mesh, vertices, load_built(HeadStyle()))


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
