"""What several tests of the mesh share."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh

Moved = Callable[[FaceMesh, NDArray[np.int64], ArrayLike], NDArray[np.float64]]


def _only(head: FaceMesh, vertices: NDArray[np.int64]) -> FaceMesh:
    """Leave a few vertices, and feature point 2.1 last, which the jaw's angle is found from."""
    kept, basis = np.append(vertices, head.feature_points["2.1"]), head.basis
    counts = np.diff(basis.offsets)[kept]
    entries = np.concatenate([np.arange(basis.offsets[v], basis.offsets[v + 1]) for v in kept])
    columns = ("vertices_mm", "normals", "uv", "albedo", "material", "occlusion", "bone", "bone_weight", "head_weight")
    return replace(
        head,
        **{name: getattr(head, name)[kept] for name in columns},
        triangles=np.zeros((0, 3), dtype=np.int32),
        feature_points={"2.1": len(kept) - 1},
        basis=DeformationBasis(
            channels=basis.channels,
            offsets=np.concatenate([[0], np.cumsum(counts)]),
            entry_channels=basis.entry_channels[entries],
            entry_mm=basis.entry_mm[entries],
        ),
    )


@pytest.fixture(scope="session")
def moved() -> Moved:
    """Where some vertices of a head go, (..., N, 3) mm; cheaper than deforming all of it."""
    return lambda head, vertices, faps: deform(_only(head, vertices), faps)[..., :-1, :]
