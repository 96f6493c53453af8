"""Scenes of glTF against trimesh (MIT), which reads everything but morph targets and skins."""

import io

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fapengine.files.gltf.document import parse_gltf
from fapengine.files.gltf.scene import read_scene
from tests.unit.files.glb import Builder, square


def test_nested_nodes_stand_at_the_same_places() -> None:
    rng = np.random.default_rng(0)
    builder = Builder()
    meshes = [square(builder, indices=kind) for kind in ("u1", "u2", "u4")]
    above: list[int] = []
    for number in range(12):
        turn = Rotation.random(rng=rng).as_quat().tolist()
        fields = {"mesh": meshes[number % 3], "rotation": turn, "translation": rng.normal(0, 5, 3).tolist()}
        children = above[-2:] if number % 4 == 3 else []
        node = builder.node(shown=False, **fields, scale=rng.uniform(0.5, 2, 3).tolist(), children=children)
        above = [one for one in above if one not in children] + [node]
    builder.doc["scenes"][0]["nodes"] = above
    ours = read_scene(parse_gltf(builder.glb(), lambda name: b""))
    theirs = trimesh.load_scene(io.BytesIO(builder.glb()), file_type="glb", process=False).to_mesh()
    assert len(ours.vertices) == len(theirs.vertices) == 48
    assert cKDTree(theirs.vertices).query(ours.vertices)[0].max() < 1e-5
    assert np.isclose(trimesh.Trimesh(ours.vertices, ours.triangles).area, theirs.area, rtol=1e-6)
