"""Our own head on a scan: a mesh file and its feature points in, a head with all of our FAPs out."""

from pathlib import Path

from fapengine.errors import DataError, UsageError
from fapengine.files.heads.dense import is_profile
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.import_file import find_points, load_marked
from fapengine.mesh.deform import still_faps
from fapengine.mesh.rig.import_head import ImportedHead
from fapengine.mesh.rig.placed_mesh import place_mesh
from fapengine.models.adapted_head import Nearness, adapt_head, scan_surface
from fapengine.models.scan_colours import has_colours, paint_from_scan
from fapengine.mpeg4 import fap


def adapt_head_file(
    path: Path, points: Path | None = None, mapping: Path | None = None
) -> tuple[ImportedHead, HeadInfo, Nearness]:
    """Put our own head on to a scan.

    Parameters
    ----------
    path : Path
        A mesh in any unit and axes.
    points : Path, optional
        Table of feature points; needed for a mesh without blendshapes.
    mapping : Path, optional
        Table of what blendshapes with other names mean; they tell where feature points are.

    Returns
    -------
    ImportedHead
        Its mesh is ours, adapted; its notes say whose colours it has.
    HeadInfo
    Nearness
        Distances from the scan before and after.

    Raises
    ------
    UsageError
        As :func:`fapengine.files.heads.import_file.import_head_file`, or if the path is a profile.
    DataError
        If a file's content is wrong, or the feature points are too few; ``where`` is the file.
    ResourceError
        If trimesh is needed and not installed.
    """
    if is_profile(path):
        raise UsageError(f"scan: got {path}, a profile, expected a file")
    mesh, choice, standard, marked = load_marked(path, points, mapping)
    try:
        vertices = find_points(mesh, choice, marked, standard, needed=points is None)
        # Of a closed mouth's upper and lower lip both points may be one vertex, which an imported head could not use.
        one_name = {vertex: name for name, vertex in reversed(vertices.items())}
        placed = place_mesh(mesh, {name: vertex for vertex, name in one_name.items()}, standard)
        places = {name: placed.to_head_space(mesh.vertices[vertex]) for name, vertex in vertices.items()}
        adapted, nearness = adapt_head(scan_surface(placed), places)
    except DataError as error:
        raise type(error)(error.message, where=str(path)) from error
    note = "colours: the file has none; the head keeps its own"
    if has_colours(placed):
        adapted = paint_from_scan(adapted, placed)
        note = f"colours: those of the file's {'picture' if mesh.texture is not None else 'vertices'}"
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
    return imported, HeadInfo(f"fapengine's head on {path.name}", "", ()), nearness
