"""A smile's cheeks: no dent beside the mouth, no skin that goes over the lower lid."""

import numpy as np
import pytest

from design.face_page import pose
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material


def smile(head: FaceMesh) -> np.ndarray:
    return deform(head, pose(load_profile("grid_s1_en"), "joy"))


def skin_triangles(head: FaceMesh, low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Those of the front whose middle lies between two places, mm."""
    triangles = head.triangles[(head.material[head.triangles] == Material.SKIN).all(axis=1)]
    x, y, z = head.vertices_mm[triangles].mean(axis=1).T
    inside = (abs(x) > low[0]) & (abs(x) < high[0]) & (y > low[1]) & (y < high[1]) & (z > 60)
    return triangles[inside]


def normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = points[triangles].swapaxes(0, 1)
    crossed = np.cross(b - a, c - a)
    return crossed / np.linalg.norm(crossed, axis=-1, keepdims=True)


@pytest.mark.parametrize("level", ["coarse", "normal"])
def test_a_smile_folds_no_skin_over_the_lower_lid(level: str) -> None:
    head = build_head(level=level)
    triangles = skin_triangles(head, (15.0, 8.0), (44.0, 25.0))
    assert len(triangles) > 50
    facing = normals(smile(head), triangles)[:, 2]
    assert np.percentile(facing, 5) > 0.2  # -0.1 and -0.4 where the cheek went over the lid


def test_a_smile_bends_the_cheek_no_more_than_a_cheek_bends() -> None:
    """Between neighbouring triangles above the corners of the mouth, where the skin had a dent."""
    head = build_head()
    triangles = skin_triangles(head, (29.0, -28.0), (44.0, -12.0))
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, number, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    owners = np.repeat(np.arange(len(triangles)), 3)[np.argsort(number, kind="stable")]
    starts = np.cumsum(count) - count
    pairs = np.stack([owners[starts[count == 2]], owners[starts[count == 2] + 1]])
    assert pairs.shape[1] > 100
    first, second = normals(smile(head), triangles)[pairs]
    bend_deg = np.rad2deg(np.arccos(np.clip((first * second).sum(axis=-1), -1, 1)))
    assert np.percentile(bend_deg, 95) < 15.0  # 26 at the dent


def test_a_lifted_cheek_has_no_step_beside_the_mouth() -> None:
    """Where its motion ends, which was seen as a ripple above the corner of a smiling mouth."""
    head = build_head()
    basis = head.basis
    lifts = [number for number, channel in enumerate(basis.channels) if channel.fap == 41]
    mine = np.isin(basis.entry_channels, lifts)
    moves = np.zeros(len(head.vertices_mm))
    moves[basis.entry_vertices[mine]] = np.linalg.norm(basis.entry_mm[mine], axis=1)
    triangles = skin_triangles(head, (15.0, -30.0), (45.0, -12.0))
    at_the_end = triangles[(moves[triangles] == 0).any(axis=1)]
    assert len(at_the_end) > 20
    assert moves[at_the_end].max() < 0.1 * moves.max()  # 0.21 where it was cut off
