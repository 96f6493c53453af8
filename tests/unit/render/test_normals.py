"""Normals as the shader finds them, by adding up deltas, against those of the deformed surface."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine._resources import profile_files
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import bone_transforms, channel_weights, deform
from fapengine.mesh.face_mesh import Bone, FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.profiles import parse_profile
from fapengine.render.packing import normal_deltas
from fapengine.trajectory.closures import close_lips
from fapengine.trajectory.faps import displacements_to_faps

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.fixture(scope="module")
def deltas(head: FaceMesh) -> Array:
    return normal_deltas(head).astype(np.float64)


def off_deg(head: FaceMesh, deltas: Array, faps: Array) -> Array:
    """How far the shader's normals of the lower face are from the surface's, degrees."""
    basis = head.basis
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    weight = channel_weights(basis, faps)[basis.entry_channels]
    added = [np.bincount(vertex, weight * deltas[:, axis], len(head.vertices_mm)) for axis in range(3)]
    ours = head.normals + np.stack(added, axis=-1)
    jaw = bone_transforms(head, faps)[Bone.JAW, :3, :3]
    ours += np.where(head.bone == Bone.JAW, head.bone_weight, 0.0)[:, None] * (ours @ jaw.T - ours)
    ours /= np.linalg.norm(ours, axis=1, keepdims=True)
    surface = vertex_normals(deform(head, faps), head.triangles)
    height, depth = head.vertices_mm[:, 1], head.vertices_mm[:, 2]
    seen = (head.material <= Material.LIP) & (depth > 60) & (height > -80) & (height < 10)
    return np.rad2deg(np.arccos(np.clip((ours * surface).sum(axis=1), -1, 1)))[seen]


def test_normals_of_speech_are_those_of_the_surface(head: FaceMesh, deltas: Array) -> None:
    profile = parse_profile(profile_files("grid_s1_en"))
    targets = np.array(
        [profile.phones[name].targets[0] for name in ("m", "f", "s", "ʃ", "u", "oʊ", "i", "æ", "ɑ", "ɔ")]
    )
    faps = displacements_to_faps(profile.space.to_points_mm(targets), profile.space.points, profile.fapu)
    off = np.array([off_deg(head, deltas, row) for row in close_lips(faps, np.arange(10.0), [])])
    assert off.mean() < 1.8
    assert np.quantile(off, 0.95) < 7.5  # 7.33, 7.25 before the upper lip of open vowels was an arc


def test_where_the_jaws_weight_changes_the_skin_tilts(head: FaceMesh, deltas: Array) -> None:
    faps = np.zeros(68)
    faps[fap.column(3)] = 150
    assert np.quantile(off_deg(head, deltas, faps), 0.99) < 2.5
    without = np.where((head.basis.entry_mm == 0).all(axis=1)[:, None], 0.0, deltas)
    assert np.quantile(off_deg(head, without, faps), 0.99) > 5.0  # so the test above can fail
