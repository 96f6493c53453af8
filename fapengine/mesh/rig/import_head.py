"""Anybody's head: a mesh and its feature points, moved by its own blendshapes so that FAPs move their own points alone.

The mesh is laid onto the standard's face (:mod:`~fapengine.mesh.rig.placed_mesh`); eyes and what follows the skin are
found (:mod:`~fapengine.mesh.rig.parts`); the skin gets a field for each feature point
(:mod:`~fapengine.mesh.rig.point_fields`); blendshapes, fields and lids become a basis
(:mod:`~fapengine.mesh.rig.blendshape_basis`); the rest goes by bones (:mod:`~fapengine.mesh.rig.bones`). A mesh without
blendshapes is moved by its fields and bones alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh
from fapengine.mesh.rig import surfaces
from fapengine.mesh.rig.blendshape_basis import Rig, build_basis
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh
from fapengine.mesh.rig.bones import Bones, bind_bones
from fapengine.mesh.rig.parts import find_eyes
from fapengine.mesh.rig.placed_mesh import PlacedMesh, place_mesh
from fapengine.mesh.rig.point_fields import fit_point_fields
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ImportedHead:
    """A head made of somebody's mesh."""

    mesh: FaceMesh
    moved: tuple[int, ...]
    """FAPs that move it."""
    missing: tuple[int, ...]
    """Low-level FAPs that do not, because their point is unknown."""
    scale: float
    """Millimetres of the standard's face for one unit of the file."""
    notes: tuple[str, ...]
    """Sentences about what was left out or stands in for something."""
    used: tuple[str, ...]
    """Blendshapes of the file that FAPs blend."""
    unused: tuple[str, ...]
    """Blendshapes of the file that no FAP blends."""
    placed: PlacedMesh
    """The mesh as it was laid onto the standard's face."""


def import_head(
    mesh: BlendshapeMesh,
    blendshapes: Sequence[str],
    points: Mapping[str, int],
    standard: FaceMesh,
    own_faps: Mapping[str, Mapping[int, float]] | None = None,
) -> ImportedHead:
    """Make a head of a mesh.

    Parameters
    ----------
    mesh : BlendshapeMesh
    blendshapes : sequence of str
        Names of those to blend; with none, the fields of the feature points do all. Blendshapes of gaze do not belong
        here: eyes turn.
    points : mapping of str to int
        Vertex of each feature point, by hand or from :func:`fapengine.mesh.rig.feature_points.locate`.
    standard : FaceMesh
        Gives scale and axes, and what a face without that point has.
    own_faps : mapping of str to FAPs, optional
        Further blendshapes that mean FAPs by themselves: FAP number to FAPU at full weight, not 0.

    Raises
    ------
    DataError
        As :func:`fapengine.mesh.rig.placed_mesh.place_mesh`; or if a blendshape is not there.
    """
    chosen = _chosen(mesh, blendshapes, own_faps or {})
    placed = place_mesh(mesh, points, standard)
    rig = _make_rig(placed, chosen)
    fapu, notes = _measure(placed, standard)
    basis, moved = build_basis(rig, fapu)
    bones = bind_bones(placed, rig.fields, rig.eyes, rig.carried_mm, rig.opens_jaw, standard)
    reached = set(moved) | bones.reached(rig.eyes, rig.opens_jaw)
    return ImportedHead(
        mesh=_make_mesh(rig, bones, fapu, basis),
        moved=tuple(sorted(reached)),
        missing=tuple(row.number for row in fap.FAPS if row.number > 2 and row.number not in reached),
        scale=placed.scale,
        notes=(*mesh.notes, *notes),
        used=tuple(chosen),
        unused=tuple(name for name in mesh.blendshapes if name not in chosen),
        placed=placed,
    )


def _chosen(
    mesh: BlendshapeMesh, names: Sequence[str], own_faps: Mapping[str, Mapping[int, float]]
) -> dict[str, Mapping[int, float] | None]:
    """Blendshapes to use, and the FAPs of those that mean some by themselves."""
    chosen = {name: None for name in names if name not in own_faps} | dict(own_faps)
    unknown = [name for name in chosen if name not in mesh.blendshapes]
    if unknown:
        raise DataError(f"blendshapes: got {unknown[:3]}, expected some of {', '.join(list(mesh.blendshapes)[:12])}")
    return chosen


def _make_rig(mesh: PlacedMesh, chosen: Mapping[str, Mapping[int, float] | None]) -> Rig:
    """Collect what of the mesh moves; eyeballs turn, and no blendshape moves them."""
    eyes = find_eyes(mesh)
    moves = np.zeros((len(chosen), len(mesh.kept), 3))
    for row, name in zip(moves, chosen, strict=True):
        blendshape = mesh.source.blendshapes[name]
        index = np.searchsorted(mesh.kept, blendshape.vertices).clip(max=len(mesh.kept) - 1)
        kept = mesh.kept[index] == blendshape.vertices
        row[index[kept]] = mesh.scale * blendshape.moves[kept] @ mesh.rotation.T
    for eye in eyes.values():
        moves[:, eye.vertices] = 0.0
    fields = fit_point_fields(mesh, eyes)
    return Rig(mesh=mesh, moves=moves, own_faps=tuple(chosen.values()), fields=fields, eyes=eyes)


def _measure(mesh: PlacedMesh, standard: FaceMesh) -> tuple[Fapu, list[str]]:
    """Measure the face's units; a face that lacks their points has the standard's, and a note."""
    positions = mesh.positions
    try:
        return Fapu.measure(positions), []
    except UsageError as error:
        fapu = standard.fapu
        measured = Fapu(
            irisd0_mm=fapu.irisd0_mm, es0_mm=fapu.es0_mm, ens0_mm=fapu.ens0_mm, mns0_mm=fapu.mns0_mm,
            mw0_mm=float(positions["8.3"][0] - positions["8.4"][0]),
        )  # fmt: skip
        return measured, [f"FAPU: {error}; the standard face's, with this mouth's width"]


def _make_mesh(rig: Rig, bones: Bones, fapu: Fapu, basis: DeformationBasis) -> FaceMesh:
    """Put together what the renderer takes."""
    placed = rig.mesh
    normals = surfaces.smooth_normals(placed)
    blank = surfaces.blank_eyes(placed, rig.eyes)
    material = surfaces.choose_materials(placed, rig.eyes, blank)
    return FaceMesh(
        vertices_mm=placed.vertices_mm.astype(np.float32),
        normals=normals.astype(np.float32),
        uv=surfaces.texture_coordinates(placed, blank).astype(np.float32),
        albedo=surfaces.choose_colours(placed, material),
        material=material,
        occlusion=surfaces.ambient_light(placed, normals, material),
        bone=bones.bone,
        bone_weight=bones.weight.astype(np.float32),
        head_weight=bones.head_weight.astype(np.float32),
        triangles=placed.triangles.astype(np.int32),
        feature_points=placed.points,
        jaw_pivot_mm=bones.jaw_pivot_mm,
        head_pivot_mm=bones.head_pivot_mm,
        eye_pivots_mm=bones.eye_pivots_mm,
        fapu=fapu,
        basis=basis,
        texture=placed.source.texture,
    )
