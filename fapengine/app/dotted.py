"""Markers as dots on a surface that moves with them, as a mesh for the renderer: films and figures of recordings."""

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices
from fapengine.files.heads.built import load_built
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import BONE_COUNT
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh, Material

LARGE, SMALL, SKIN = (0.75, 0.06, 0.04), (0.9, 0.9, 0.9), (0.50, 0.30, 0.22)
"""Linear RGB of large and small dots, and of the surface."""
DOT_MM = {True: 2.6, False: 1.2}
"""Radius of a large and of a small dot."""
OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
FACETS = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
MAX_WEIGHTS = 128
"""Weights that a renderer takes."""
WIDEST_MM = 170.0
"""Width of a face that fills the image."""
PLACE_MM = np.array([0.0, 20.0, 60.0])
"""Position of the middle of a face without a head, head space."""
MOVED_BONES = np.tile(np.eye(4), (BONE_COUNT, 1, 1))
"""Bones of a head that keeps still."""


def fitting(surface_mm: Array) -> tuple[float, Array]:
    """Scale and shift, (3,) mm, that put a surface, (N, 3) mm, into the image."""
    scale = min(1.0, WIDEST_MM / max(float(np.ptp(surface_mm[:, 0])), 1e-9))
    return scale, PLACE_MM - scale * surface_mm.mean(axis=0)


def dotted_mesh(
    surface: tuple[Array, Array], triangles: Indices, dots: tuple[Array, Array], is_large: NDArray[np.bool_]
) -> FaceMesh:
    """Make a mesh that W weights move, and the head's bone.

    Parameters
    ----------
    surface : (N, 3) and (W, N, 3) mm
        Vertices at rest in head space, and how far each weight moves them.
    triangles : (F, 3)
        Of the surface, counter-clockwise seen from outside.
    dots : (D, 3) and (W, D, 3) mm
        The same of the dots.
    is_large : (D,)
        Large dots are red.
    """
    sizes = np.where(is_large, DOT_MM[True], DOT_MM[False])
    balls = (dots[0][:, None] + sizes[:, None, None] * OCTAHEDRON).reshape(-1, 3)
    vertices = np.concatenate([surface[0], balls])
    corners = np.concatenate(
        [triangles, (len(surface[0]) + 6 * np.arange(len(dots[0]))[:, None, None] + FACETS).reshape(-1, 3)]
    )
    moves = np.concatenate([surface[1], np.repeat(dots[1], 6, axis=1)], axis=1)
    colours = np.repeat(np.where(is_large[:, None], LARGE, SMALL), 6, axis=0)
    total, width = len(vertices), len(moves)
    return FaceMesh(
        vertices_mm=vertices.astype(np.float32),
        normals=vertex_normals(vertices, corners).astype(np.float32),
        uv=np.zeros((total, 2), np.float32),
        albedo=np.concatenate([np.tile(SKIN, (len(surface[0]), 1)), colours]).astype(np.float32),
        material=np.full(total, Material.SKIN, np.uint8),
        occlusion=np.ones(total, np.float32),
        bone=np.zeros(total, np.uint8),
        bone_weight=np.zeros(total, np.float32),
        head_weight=np.ones(total, np.float32),
        triangles=corners.astype(np.int32),
        feature_points={},
        jaw_pivot_mm=np.zeros(3),
        head_pivot_mm=np.zeros(3),
        eye_pivots_mm=np.zeros((2, 3)),
        fapu=load_built(MEASURED).fapu,
        basis=DeformationBasis(
            channels=(Channel(3, -np.inf, np.inf),),
            offsets=(width * np.arange(total + 1)).astype(np.int32),
            entry_channels=np.tile(np.arange(width), total).astype(np.int32),
            entry_mm=moves.swapaxes(0, 1).reshape(-1, 3).astype(np.float32),
            mix=np.zeros((width, 1), np.float32),
        ),
    )
