"""Our own head as a stranger would bring it: its surface, and ARKit's shapes that our own basis makes of it."""

from collections.abc import Mapping
from functools import cache

import numpy as np

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import Bone, FaceMesh, Material
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh
from fapengine.mesh.rig.import_head import ImportedHead, import_head
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES

PARTS = {
    Material.EYE: "Eyeball", Material.TEETH: "Teeth", Material.TONGUE: "Tongue", Material.HAIR: "Hair",
    Material.LASH: "Lashes", Material.CLOTH: "Clothes", Material.GUM: "Gums", Material.MOUTH: "Mouth",
}  # fmt: skip


def shape_of(head: FaceMesh, faps: np.ndarray) -> Blendshape:
    moves = deform(head, faps) - head.vertices_mm
    kept = np.flatnonzero(np.abs(moves).max(axis=1) > 1e-3)
    return Blendshape(kept, moves[kept])


@cache
def own_rig(names: tuple[str, ...] = ARKIT_NAMES, level: str = "normal") -> BlendshapeMesh:
    """In mm, on the standard's axes."""
    head = build_head(HeadStyle(charm=0), level=level)
    shapes = arkit_map()
    kinds = [None, *PARTS]
    surface = np.zeros(len(head.vertices_mm), int)
    for number, kind in enumerate(kinds):
        if kind is not None:
            surface[head.material == kind] = number
    return BlendshapeMesh(
        vertices=head.vertices_mm,
        triangles=head.triangles,
        blendshapes={name: shape_of(head, shapes.faps[shapes.names.index(name)]) for name in names},
        albedo=head.albedo,
        surfaces=("Skin", *PARTS.values()),
        surface=surface,
    )


def skin_of(head: FaceMesh) -> np.ndarray:
    return np.flatnonzero(np.isin(head.material, (Material.SKIN, Material.LIP)) & (head.bone != Bone.LEFT_EYE))


def import_plain(
    vertices: np.ndarray,
    triangles: np.ndarray,
    points: Mapping[str, int],
    standard: FaceMesh,
    albedo: np.ndarray | None = None,
) -> ImportedHead:
    """Make a head of a mesh that has nothing but feature points."""
    mesh = BlendshapeMesh(vertices=vertices, triangles=triangles, blendshapes={}, albedo=albedo)
    return import_head(mesh, (), points, standard)
