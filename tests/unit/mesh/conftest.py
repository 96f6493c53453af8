"""What several tests of the mesh share."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from fapengine._resources import profile_files
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh
from fapengine.profiles import parse_profile
from fapengine.trajectory.closures import close_lips
from fapengine.trajectory.faps import displacements_to_faps
from tests.unit.mesh.unpainted import unpainted

FRAMES = 1000
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
        folds=None,
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


@pytest.fixture(scope="session")
def frames() -> NDArray[np.float64]:
    """(1000, 68): mixtures of two phones, too weak or too strong, half of them with an expression."""
    profile, rng = parse_profile(profile_files("grid_s1_en")), np.random.default_rng(4)
    targets = np.concatenate([phone.targets for phone in profile.phones.values()])
    shares, pairs = rng.dirichlet([1, 1], FRAMES), targets[rng.integers(0, len(targets), (FRAMES, 2))]
    weights = (shares[:, :, None] * pairs).sum(axis=1) * rng.uniform(0.3, 1.4, (FRAMES, 1))
    expressions = list(profile.expressions.values())
    which = rng.integers(0, len(expressions), FRAMES)
    amount = (rng.uniform(0, 1, FRAMES) * (rng.random(FRAMES) < 0.5))[:, None]
    weights += amount * np.array([expression.target for expression in expressions])[which]
    faps = displacements_to_faps(profile.space.to_points_mm(weights), profile.space.points, profile.fapu)
    faps += amount * np.array([expression.fap for expression in expressions])[which]
    return close_lips(faps, np.arange(float(FRAMES)), [])


@pytest.fixture
def no_paint() -> Iterator[None]:
    with unpainted():
        yield
