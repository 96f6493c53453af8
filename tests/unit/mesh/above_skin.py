"""Height of points above the skin of a head."""

import numpy as np
from scipy.spatial import cKDTree

from fapengine.mesh.face_mesh import FaceMesh, Material


def above_skin(points: np.ndarray, bald: FaceMesh) -> np.ndarray:
    """(N,) mm: height of points, (N, 3) mm, above the skin of a head without hair, negative inside."""
    skin = np.flatnonzero(bald.material == Material.SKIN)
    under = skin[cKDTree(bald.vertices_mm[skin]).query(points)[1]]
    return np.asarray(((points - bald.vertices_mm[under]) * bald.normals[under]).sum(axis=1))
