"""glTF, GLB and VRM: every kind of accessor, transforms, skins, colours; and what is wrong with a file."""

import base64
import io
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import EpsImagePlugin, Image

from fapengine.errors import DataError, TruncatedError, UnsupportedError
from fapengine.files.gltf import document, scene, textures
from fapengine.files.gltf.document import parse_gltf, parse_json, stated_licences
from fapengine.files.gltf.scene import read_scene
from fapengine.files.gltf.textures import MAX_TEXTURE_PX, pack_tiles
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

from .glb import Builder, square


def nothing(name: str) -> bytes:
    raise DataError(f"uri: got {name}, expected none")


def read(data: bytes, fetch=nothing) -> BlendshapeMesh:
    return read_scene(parse_gltf(data, fetch))


def plain(**more: Any) -> Builder:
    builder = Builder()
    builder.node(mesh=square(builder, **more))
    return builder


def test_a_licence_that_is_null_states_nothing() -> None:
    root = {"extensions": {"VRM": {"meta": {"author": None, "otherLicenseUrl": None, "licenseName": "CC0"}}}}
    assert stated_licences(parse_json(json.dumps(root).encode(), "glTF")) == ["CC0"]


def test_three_ways_to_keep_the_bytes_are_one() -> None:
    builder = plain()
    asked = []

    def beside(name: str) -> bytes:
        asked.append(name)
        return bytes(builder.blob)

    for mesh in (read(builder.glb()), read(builder.gltf()), read(builder.gltf("the%20mesh.bin"), beside)):
        assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
        assert mesh.dense("rise").tolist() == [[0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    assert asked == ["the mesh.bin"]


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
def test_indices_of_each_size(kind: str) -> None:
    assert read(plain(indices=kind).glb()).triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_strips_fans_and_no_indices() -> None:
    for mode, order, expected in (
        (5, [0, 1, 3, 2], [[0, 1, 3], [2, 3, 1]]),
        (6, [0, 1, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (4, [0, 1, 1, 0, 2, 3], [[0, 2, 3]]),  # a triangle without area is none
    ):
        builder = plain(mode=mode)
        builder.doc["meshes"][0]["primitives"][0]["indices"] = builder.accessor(order, "u1")
        assert read(builder.glb()).triangles.tolist() == expected
    builder = plain()
    del builder.doc["meshes"][0]["primitives"][0]["indices"]
    assert read(builder.glb()).triangles.tolist() == [[0, 1, 2]]
    builder.doc["meshes"][0]["primitives"][0]["mode"] = 1
    with pytest.raises(DataError, match="contains no triangle"):
        read(builder.glb())


def test_accessors_sparse_interleaved_and_normalised() -> None:
    builder = plain(targets=("a", "b"))
    item = builder.doc["meshes"][0]["primitives"][0]
    for kind in ("u1", "u2", "u4"):
        item["targets"][0]["POSITION"] = builder.sparse(4, [1, 3], [[0, 0, 5], [0, 6, 0]], kind)
        assert read(builder.glb()).dense("a").tolist() == [[0, 0, 0], [0, 0, 5], [0, 0, 0], [0, 6, 0]]
    both = np.zeros((4, 8), "f4")  # positions and something else, turn and turn about
    both[:, :3] = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    view = builder.view(both.tobytes(), byteStride=32)
    item["attributes"]["POSITION"] = builder.row(
        "accessors", {"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"}
    )
    assert read(builder.glb()).vertices.max() == 2.0
    small = builder.view(
        np.array([[0, 0, 0, 9], [127, 0, 0, 9], [127, 127, 0, 9], [0, -128, 0, 9]], "i1").tobytes(), byteStride=4
    )
    item["attributes"]["POSITION"] = builder.row(
        "accessors", {"bufferView": small, "componentType": 5120, "count": 4, "type": "VEC3", "normalized": True}
    )
    assert read(builder.glb()).vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, -1, 0]]


def test_nodes_carry_their_meshes_and_their_shapes() -> None:
    builder = Builder()
    mesh = square(builder)
    half = np.sqrt(0.5)
    child = builder.node(shown=False, mesh=mesh, translation=[10, 0, 0], scale=[2, 3, 4])
    builder.node(children=[child], rotation=[0, 0, half, half], translation=[0, 0, 1])  # a quarter turn, x to y
    found = read(builder.glb())
    np.testing.assert_allclose(found.vertices, [[0, 10, 1], [0, 12, 1], [-3, 12, 1], [-3, 10, 1]], atol=1e-6)
    np.testing.assert_allclose(found.dense("rise")[0], [0, 0, 4], atol=1e-6)
    builder.doc["nodes"][child] = {"mesh": mesh, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]}
    turned_over = read(builder.glb())
    assert turned_over.triangles.tolist() == [[2, 1, 0], [3, 2, 0]]


def skinned() -> Builder:
    builder = plain()
    item = builder.doc["meshes"][0]["primitives"][0]
    item["attributes"]["JOINTS_0"] = builder.accessor([[0, 1, 0, 0]] * 4, "u1")
    item["attributes"]["WEIGHTS_0"] = builder.accessor([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 2, 0, 0], [0, 1, 0, 0]])
    eye = builder.node(shown=False, name="Armature:Eye_L", translation=[0, 1, 0])
    head = builder.node(name="mixamorig:Head", translation=[0, 0, 3], children=[eye])
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, 1, 3] = -1.0  # the eye's joint was bound at height 1
    matrices = builder.accessor(bind.transpose(0, 2, 1).reshape(2, 16))
    skin = builder.row("skins", {"joints": [head, eye], "inverseBindMatrices": matrices})
    builder.doc["nodes"][0] |= {"skin": skin, "translation": [99, 99, 99]}  # counts nothing
    return builder


def test_skinned_meshes_stand_as_their_joints_do() -> None:
    found = read(skinned().glb())
    np.testing.assert_allclose(found.vertices, [[0, 0, 3], [1, 0, 3], [1, 1, 3], [0, 1, 3]])
    np.testing.assert_allclose(found.bones["head"].weight, 1.0)  # the eye hangs on it
    np.testing.assert_allclose(found.bones["left eye"].weight, [0, 0.5, 1, 1])
    assert found.bones["left eye"].joint.tolist() == [0, 1, 3]


def vrm(version: int) -> Builder:
    builder = plain(targets=("Fcl_MTH_A", "Fcl_EYE_Close"))
    head = builder.node(name="J_Bip_C_Head")
    builder.doc["extensionsUsed"] = ["VRM" if version == 0 else "VRMC_vrm"]
    if version == 0:
        builder.doc["extensions"] = {
            "VRM": {
                "blendShapeMaster": {
                    "blendShapeGroups": [
                        {"name": "A", "presetName": "a", "binds": [{"mesh": 0, "index": 0, "weight": 50}]},
                        {"name": "Wow", "presetName": "unknown", "binds": [
                            {"mesh": 0, "index": 0, "weight": 100}, {"mesh": 0, "index": 1, "weight": 100}]},
                    ]
                },
                "humanoid": {"humanBones": [{"bone": "head", "node": head}, {"bone": "hips", "node": 0}]},
            }
        }  # fmt: skip
    else:
        builder.doc["extensions"] = {
            "VRMC_vrm": {
                "expressions": {
                    "preset": {"a": {"morphTargetBinds": [{"node": 0, "index": 0, "weight": 0.5}]}},
                    "custom": {"Wow": {"morphTargetBinds": [{"node": 0, "index": 0}, {"node": 0, "index": 1}]}},
                },
                "humanoid": {"humanBones": {"head": {"node": head}}},
            }
        }
    return builder


@pytest.mark.parametrize("version", [0, 1])
def test_vrm_s_expressions_are_shapes(version: int) -> None:
    found = read(vrm(version).glb())
    assert list(found.blendshapes) == ["Fcl_MTH_A", "Fcl_EYE_Close", "a", "Wow"]
    assert found.dense("a")[:, 2].tolist() == [0.5, 0, 0, 0]
    assert found.dense("Wow")[:, 2].tolist() == [1, 1, 0, 0]
    assert found.bones["head"].weight.tolist() == [0, 0, 0, 0]


def test_a_target_s_own_name_goes_before_an_expression_s() -> None:
    builder = vrm(1)
    custom = builder.doc["extensions"]["VRMC_vrm"]["expressions"]["custom"]
    custom["Fcl_MTH_A"] = {"morphTargetBinds": [{"node": 0, "index": 1}]}
    assert read(builder.glb()).dense("Fcl_MTH_A")[:, 2].tolist() == [1, 0, 0, 0]


def test_shapes_of_one_name_in_two_meshes_are_one_and_unnamed_ones_are_numbered() -> None:
    builder = plain(targets=("jawOpen",))
    builder.node(mesh=square(builder, targets=("jawOpen", "x")))
    del builder.doc["meshes"][1]["extras"]
    builder.doc["accessors"][builder.doc["meshes"][1]["primitives"][0]["targets"][0]["POSITION"]]["name"] = "jawOpen"
    found = read(builder.glb())
    assert list(found.blendshapes) == ["jawOpen", "target 1"]
    assert found.blendshapes["jawOpen"].vertices.tolist() == [0, 4]


PIXELS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8).repeat(32, 0).repeat(32, 1)


def textured(coordinates: Any, pixels: Any = PIXELS, **material: Any) -> Builder:
    builder = plain()
    texture = builder.image(pixels)
    info = {"index": texture} | material.pop("info", {})
    surface = {"baseColorTexture": info} | material.pop("surface", {})
    row = builder.row("materials", {"name": "Skin", "pbrMetallicRoughness": surface} | material)
    item = builder.doc["meshes"][0]["primitives"][0]
    item["material"] = row
    item["attributes"]["TEXCOORD_0"] = builder.accessor(coordinates)
    return builder


def colour_at(mesh: BlendshapeMesh, vertex: int) -> list[int]:
    assert mesh.texture is not None
    assert mesh.uv is not None
    height, width = mesh.texture.shape[:2]
    x, y = mesh.uv[vertex] * (width, height)
    return mesh.texture[int(y), int(x)].tolist()


CORNERS = [[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8]]
SEEN = [[255, 0, 0, 255], [0, 255, 0, 255], [255, 255, 255, 255], [0, 0, 255, 255]]


@pytest.mark.parametrize(
    ("coordinates", "more"),
    [
        (CORNERS, {}),
        (np.add(CORNERS, [3.0, -2.0]), {}),
        (np.multiply(CORNERS, 0.5), {"info": {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}}),
        (np.add(CORNERS, 0.25), {"info": {"extensions": {"KHR_texture_transform": {"offset": [-0.25, -0.25]}}}}),
        # turned by a quarter about its corner, then moved back
        ([[y, 1 - x] for x, y in CORNERS],
         {"info": {"extensions": {"KHR_texture_transform": {"rotation": -np.pi / 2, "offset": [1, 0]}}}}),
    ],
)  # fmt: skip
def test_texture_coordinates_find_their_colours(coordinates: Any, more: dict[str, Any]) -> None:
    mesh = read(textured(coordinates, **more).glb())
    assert [colour_at(mesh, vertex) for vertex in range(4)] == SEEN


def test_repeated_textures_are_repeated() -> None:
    mesh = read(textured([[0.2, 0.2], [1.8, 0.2], [1.8, 1.8], [0.2, 1.8]]).glb())
    assert [colour_at(mesh, vertex) for vertex in range(4)] == SEEN
    assert mesh.notes == ()
    many = read(textured([[0.2, 0.2], [7.2, 0.2], [7.2, 0.8], [0.2, 0.8]]).glb())
    assert many.notes == ("material 'Skin': its texture repeats 8 times, 4 are kept",)
    builder = textured([[-2, 0.2], [3, 0.2], [3, 0.8], [-2, 0.8]])
    builder.doc["textures"][0]["sampler"] = builder.row("samplers", {"wrapS": 33071})
    clamped = read(builder.glb())
    assert [colour_at(clamped, vertex) for vertex in range(4)] == SEEN
    assert clamped.notes == ()


def test_factors_vertex_colours_and_parts_without_a_texture() -> None:
    builder = textured(CORNERS, surface={"baseColorFactor": [0.5, 1, 1, 1]})
    builder.doc["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = builder.accessor([[1, 0.5, 1, 1]] * 4)
    second = builder.row("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0, 0.25, 0, 1]}})
    builder.node(mesh=square(builder, material=second))
    mesh = read(builder.glb())
    assert mesh.albedo is not None
    assert mesh.albedo[0].tolist() == [0.5, 0.5, 1.0]
    assert mesh.albedo[4].tolist() == [0.0, 0.25, 0.0]
    assert colour_at(mesh, 4) == [255, 255, 255, 255]
    assert [colour_at(mesh, vertex) for vertex in range(4)] == SEEN
    old = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.1, 0.2, 0.3, 1.0]}}
    builder.doc["materials"][second] = {"extensions": old}
    changed = read(builder.glb()).albedo
    assert changed is not None
    assert changed[4].tolist() == [0.1, 0.2, 0.3]


def test_holes_are_cut_and_what_nobody_would_see_is_left_out() -> None:
    fading = np.dstack([PIXELS, np.full((64, 64), 100, np.uint8)])
    fading[:32, :, 3] = 255
    opaque = read(textured(CORNERS, fading).glb())
    assert colour_at(opaque, 2)[3] == 255
    masked = read(textured(CORNERS, fading, alphaMode="MASK", alphaCutoff=0.5).glb())
    assert (colour_at(masked, 0)[3], colour_at(masked, 2)[3]) == (255, 0)
    blended = read(textured(CORNERS, fading, alphaMode="BLEND").glb())
    assert (colour_at(blended, 0)[3], colour_at(blended, 2)[3]) == (255, 100)
    for surface in ({"baseColorFactor": [1, 1, 1, 0.3]}, {}):
        builder = textured(
            CORNERS, np.dstack([PIXELS, np.full((64, 64), 50, np.uint8)]), alphaMode="BLEND", surface=surface
        )
        builder.doc["nodes"][0]["name"] = "Cornea"
        builder.node(mesh=square(builder))
        found = read(builder.glb())
        assert len(found.vertices) == 4
        assert found.notes == ("Cornea / Skin: left out, as it is translucent",)


def test_a_pane_without_a_texture_is_left_out() -> None:
    builder = plain(material=0)
    builder.node(mesh=square(builder))
    pane = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}}
    builder.row("materials", pane)
    assert len(read(builder.glb()).vertices) == 4
    pane["alphaMode"] = "OPAQUE"
    assert len(read(builder.glb()).vertices) == 8


def test_textures_of_other_kinds_leave_their_colour() -> None:
    builder = textured(CORNERS)
    builder.doc["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    builder.doc["images"][0]["mimeType"] = "image/ktx2"
    builder.doc["extensionsRequired"] = ["KHR_texture_basisu"]  # as it must be where there is no other source
    found = read(builder.glb())
    assert found.texture is None
    assert "'Skin': its texture is KTX2 (KHR_texture_basisu), which is not read" in found.notes[0]
    builder.doc["textures"][0] = {}
    assert "of a kind that is not read (it names no image)" in read(builder.glb()).notes[0]
    builder.doc["textures"][0] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    assert read(builder.glb()).texture is not None


def test_too_much_texture_is_halved_until_it_fits() -> None:
    tiles = [np.full((3000, 3000, 4), (number, 0, 0, 255), np.uint8) for number in (1, 2, 3)]
    packed, places = pack_tiles(tiles)
    assert max(packed.shape) <= MAX_TEXTURE_PX
    for number, (x, y, width, height) in enumerate(places, 1):
        assert (packed[y - 2 : y + height + 2, x - 2 : x + width + 2, 0] == number).all()  # its gutter too


def change(path: str, value: Any):
    def apply(builder: Builder) -> None:
        *way, last = [int(key) if key.isdigit() else key for key in path.split(".")]
        place: Any = builder.doc
        for key in way:
            place = place[key]
        if value is ...:
            del place[last]
        else:
            place[last] = value

    return apply


WRONG = [
    (plain, "asset.version", "1.0", r"asset.version: got '1.0', expected 2.x"),
    (plain, "extensionsRequired", ["ACME_origami"], "ACME_origami, which is not supported"),
    (plain, "meshes.0.primitives.0.extensions", {"KHR_draco_mesh_compression": {}}, r"bufferView: got None.*draco"),
    (plain, "bufferViews.0.extensions", {"EXT_meshopt_compression": {}}, r"count: got None.*bufferViews\[0\]"),
    (plain, "scene", 4, r"scene: got 4, expected a whole number, 0 to 0"),
    (lambda: vrm(0), "scenes.0.nodes", [0, True], "nodes: got .0, True., expected indices"),
    (plain, "scenes.0.nodes", [7], "nodes: got .7., expected indices 0 to 0"),
    (plain, "scenes.0.nodes", [0, 0], "got it twice in the scene"),
    (plain, "nodes.0.children", [0], "two parents"),
    (plain, "nodes.0.mesh", -1, r"mesh: got -1.*at nodes\[0\].mesh"),
    (plain, "nodes.0.rotation", [0, 0, 0, 0], "a quaternion that is not 0"),
    (plain, "nodes.0.scale", [1, 1], "expected 3 numbers"),
    (plain, "nodes.0.matrix", [1e300] * 16, "16 finite numbers"),
    (plain, "nodes.0.name", "\ud800", "is not JSON.*surrogates not allowed"),
    (plain, "nodes", {"0": 1}, "expected an array of objects"),
    (plain, "meshes.0", 5, "expected an array of objects"),
    (plain, "meshes.0.extras.targetNames", ["a", 5], "expected an array of strings"),
    (plain, "meshes.0.primitives.0.attributes", [], "expected an object"),
    (plain, "meshes.0.primitives.0.mode", True, "mode: got True"),
    (plain, "meshes.0.primitives.0.attributes.POSITION", 2, r"POSITION: got shape .6, 1., expected .any, 3."),
    (plain, "meshes.0.primitives.0.targets.0.POSITION", 2, r"POSITION: got shape \(6, 1\), expected \(4, 3\)"),
    (plain, "meshes.0.primitives.0.indices", 0, "expected unsigned scalars"),
    (plain, "accessors.2.componentType", 5124, "componentType: got 5124"),
    (plain, "accessors.1.count", 3, "indices: got 3, expected 0 to 2"),
    (plain, "accessors.1.type", "MAT3", "type: got 'MAT3'"),
    (plain, "accessors.1.type", 3, "expected a string"),
    (plain, "accessors.1.count", 10**12, "count: got 1000000000000"),
    (plain, "accessors.1.count", 5, "got 5 elements from byte 0 on"),
    (plain, "accessors.1.normalized", 1, "expected true or false"),
    (plain, "accessors.1.bufferView", 9, "bufferView: got 9"),
    (plain, "accessors.1.sparse", {"count": 9}, "count: got 9"),
    (plain, "accessors.1.sparse", {"count": 1, "indices": {"componentType": 5126}}, "expected 5121, 5123 or 5125"),
    (plain, "accessors.1.sparse", {"count": 2, "indices": {"componentType": 5121, "bufferView": 0, "byteOffset": 0},
     "values": {"bufferView": 0}}, "expected rising ones below 4"),
    (plain, "bufferViews.1.byteOffset", 100, r"got bytes 100 to 148, expected at most"),
    (plain, "bufferViews.1.byteStride", 4, "byteStride: got 4, expected at least 12"),
    (plain, "bufferViews.1.buffer", 3, "buffer: got 3"),
    (skinned, "skins.0.joints", [], "expected nodes of the scene"),
    (skinned, "skins.0.inverseBindMatrices", 0, "expected .any, 16."),
    (skinned, "scenes.0.nodes", [0], "expected nodes of the scene"),
    (skinned, "meshes.0.primitives.0.attributes.WEIGHTS_0", 0, "WEIGHTS_0: got shape"),
    (skinned, "meshes.0.primitives.0.attributes.JOINTS_0", 4, "not indices"),
    (skinned, "skins.0.joints", [1], "JOINTS: got 1, expected 0 to 0"),
    (lambda: vrm(0), "extensions.VRM.blendShapeMaster.blendShapeGroups.0.binds.0.index", 2, "index: got 2"),
    (lambda: vrm(1), "extensions.VRMC_vrm.expressions.preset.a.morphTargetBinds.0.node", 1, "mesh: got None"),
    (lambda: vrm(1), "extensions.VRMC_vrm.expressions.preset.a.morphTargetBinds.0.weight", "1", "a finite number"),
    (lambda: vrm(1), "extensions.VRMC_vrm.expressions.preset.a.morphTargetBinds.0.weight", 10**400, "a finite number"),
    (lambda: textured(CORNERS), "meshes.0.primitives.0.attributes.TEXCOORD_0", 0, "TEXCOORD_0: got shape"),
    (lambda: textured(CORNERS), "meshes.0.primitives.0.attributes.COLOR_0", 2, "COLOR_0: got shape"),
    (lambda: textured(CORNERS), "images.0.bufferView", 0, "image: got no PNG or JPEG or WEBP"),
    (lambda: textured(CORNERS), "images.0", {"uri": "data:image/png,hello"}, "expected base64 data"),
    (lambda: textured(CORNERS), "images.0", {"uri": "data:image/png;base64,@@"}, "is not base64"),
    (lambda: textured(CORNERS), "images.0", {"uri": "skin.png"}, "got skin.png"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "path", "value", "message"), WRONG, ids=[f"{row[1]}={row[2]!r:.20}" for row in WRONG])
def test_what_is_wrong_is_said(make: Any, path: str, value: Any, message: str) -> None:
    builder = make()
    read(builder.glb())
    change(path, value)(builder)
    with pytest.raises(DataError, match=message):
        read(builder.glb())
    assert len(WRONG) >= 40


def test_what_a_file_may_leave_out() -> None:
    builder = plain(targets=("still", "rise"))
    del builder.doc["scenes"], builder.doc["scene"]
    builder.doc["meshes"][0]["primitives"][0]["targets"][0] = {"NORMAL": 0}
    builder.doc["nodes"].append({"name": "Empty", "children": [0]})
    found = read(builder.glb())
    assert len(found.vertices) == 4
    assert {name: len(shape.vertices) for name, shape in found.blendshapes.items()} == {"still": 0, "rise": 1}
    empty = plain()
    empty.doc["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = empty.row(
        "accessors", {"bufferView": 0, "componentType": 5126, "count": 0, "type": "VEC3"}
    )
    with pytest.raises(DataError, match=r"indices: got 3, expected 0 to -1"):
        read(empty.glb())


def test_an_image_larger_than_the_whole_is_made_smaller() -> None:
    wide = np.zeros((2, MAX_TEXTURE_PX + 100, 3), np.uint8)
    wide[:, MAX_TEXTURE_PX // 2 :] = 200
    found = read(textured(CORNERS, wide).glb())
    assert found.texture is not None
    assert found.texture.shape[1] <= MAX_TEXTURE_PX
    many = read(textured(np.multiply(CORNERS, [4, 1]), np.zeros((8, 2000, 3), np.uint8)).glb())
    assert many.texture is not None
    assert many.texture.shape[1] <= MAX_TEXTURE_PX
    assert [colour_at(found, vertex)[0] for vertex in range(4)] == [0, 200, 200, 0]


def test_parts_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    builder = plain()
    builder.node(mesh=0)
    for place, name, most, message in (
        (scene, "MAX_VERTICES", 8, r"vertices: got 8 in all, expected at most 7 .at meshes.0..primitives.0.\)"),
        (document, "MAX_ELEMENTS_IN_ALL", 28, r"elements: got 28 in all, expected at most 27 .at accessors.0.\)"),
    ):
        monkeypatch.setattr(place, name, most)
        assert len(read(builder.glb()).vertices) == 8
        monkeypatch.setattr(place, name, most - 1)
        with pytest.raises(DataError, match=message):
            read(builder.glb())
        monkeypatch.undo()
    monkeypatch.setattr(document, "MAX_ELEMENTS_IN_ALL", 30)
    assert list(read(vrm(1).glb()).blendshapes) == ["Fcl_MTH_A", "Fcl_EYE_Close", "a", "Wow"]
    bound = vrm(1)
    bound.doc["extensions"]["VRMC_vrm"]["expressions"]["custom"]["Wow"]["morphTargetBinds"] *= 7
    with pytest.raises(DataError, match="elements: got 31 in all, expected at most 30"):
        read(bound.glb())


def test_images_and_tiles_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    builder = textured([[0.2, 0.2], [1.8, 0.2], [1.8, 0.8], [0.2, 0.8]], alphaMode="MASK", alphaCutoff=0.1)
    builder.doc["materials"].append(builder.doc["materials"][0] | {"alphaCutoff": 0.2, "name": "Other"})
    second = dict(builder.doc["meshes"][0]["primitives"][0], material=1)
    builder.node(mesh=builder.row("meshes", {"primitives": [second]}))
    needed = 64 * 64 + 2 * (64 * 128)  # one image, and seen twice in a row in two tiles
    monkeypatch.setattr(textures, "MAX_PIXELS_IN_ALL", needed)
    assert read(builder.glb()).texture is not None
    monkeypatch.setattr(textures, "MAX_PIXELS_IN_ALL", needed - 1)
    with pytest.raises(DataError, match=rf"pixels of images: got {needed} in all, .*material 'Other'"):
        read(builder.glb())
    monkeypatch.setattr(textures, "MAX_PIXELS_IN_ALL", 64 * 64 - 1)
    with pytest.raises(DataError, match=r"pixels of images: got 4096 in all, .*at images.0."):
        read(builder.glb())


def test_more_images_than_the_whole_has_pixels() -> None:
    dot = np.zeros((1, 1, 4), np.uint8)
    with pytest.raises(DataError, match="textures: got 300000, expected what fits into 4096 pixels each way"):
        pack_tiles([dot] * 300_000)


@pytest.mark.parametrize("kind", ["EPS", "GIF", "JPEG"])
def test_images_of_other_formats_are_not_tried(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *given, **named: started.append(given))
    buffer = io.BytesIO()
    Image.fromarray(PIXELS).save(buffer, kind)
    builder = textured(CORNERS)
    builder.doc["images"][0] = {"uri": "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()}
    if kind == "JPEG":
        assert read(builder.glb()).texture is not None
        return
    with pytest.raises(DataError, match=r"image: got no PNG or JPEG or WEBP"):
        read(builder.glb())
    assert started == []


@pytest.mark.parametrize("extras", ["hi", 5, [1], {"targetNames": ["rise"]}, {"more": True}])
def test_extras_may_be_anything(extras: Any) -> None:
    builder = plain()
    builder.doc["meshes"][0]["primitives"][0]["extras"] = extras
    assert list(read(builder.glb()).blendshapes) == ["rise"]
    builder.doc["meshes"][0]["extras"] = extras
    assert len(read(builder.glb()).blendshapes) == 1


def test_transforms_that_grow_beyond_numbers() -> None:
    builder = Builder()
    mesh = square(builder)
    for number in range(12):
        builder.node(shown=number == 0, children=[number + 1], scale=[1e29] * 3)
    builder.node(shown=False, mesh=mesh)
    with pytest.raises(DataError, match=r"node 1: got a transform beyond 1e\+30 in all .at nodes.1.\)"):
        read(builder.glb())


def test_a_long_chain_of_nodes_is_no_matter() -> None:
    builder = Builder()
    mesh, count = square(builder), 20_000
    for number in range(count):
        builder.node(shown=number == 0, name="Head", children=[number + 1], translation=[0, 0, 0.001])
    builder.node(shown=False, mesh=mesh)
    assert read(builder.glb()).vertices[0, 2] == pytest.approx(0.001 * count)


def test_numbers_that_are_none() -> None:
    builder = plain()
    builder.doc["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = builder.accessor(np.full((4, 3), 0.0))
    builder.blob[-4:] = np.float32(np.nan).tobytes()
    with pytest.raises(DataError, match="not finite"):
        read(builder.glb())
    weightless = skinned()
    attributes = weightless.doc["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = weightless.accessor(np.zeros((4, 4)))
    with pytest.raises(DataError, match="negative weights or none"):
        read(weightless.glb())
    with pytest.raises(DataError, match="is not JSON"):
        read(b'{"asset": {"version": NaN}}')
    with pytest.raises(DataError, match="is not JSON"):
        read(b'{"a":' * 100_000)
    with pytest.raises(DataError, match="got list, expected a JSON object"):
        read(b"[]")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "pointer of Git LFS"),
        (b"Kaydara FBX Binary  \0", "got FBX, .* exported as .glb"),
        (b"PK\x03\x04", "a ZIP archive"),
        (b"\n<!doctype html>", "a web page"),
        (b"PXR-USDC\0\x08", "got USD, .* exported as .glb"),
    ],
)  # fmt: skip
def test_files_with_another_content_are_named(data: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(data)


@pytest.mark.parametrize("writer", ["three_r187", "gltf_transform"])
def test_files_of_other_exporters(writer: str) -> None:
    vectors = Path(__file__).resolve().parent.parent.parent / "vectors" / "gltf"
    found = read((vectors / f"{writer}.glb").read_bytes())
    np.testing.assert_allclose(found.vertices, [[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2]], atol=1e-6)
    assert found.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    np.testing.assert_allclose(found.dense("jawOpen"), [[0, 0, 0], [0, 0, 0], [0, 0, -1], [0, 0, -1]], atol=1e-6)
    np.testing.assert_allclose(found.dense("mouthSmileLeft")[0], [0, -0.5, 0], atol=1e-6)
    assert found.surfaces == ("Face / Skin",)
    np.testing.assert_allclose(found.bones["head"].joint, [0, 0, 3], atol=1e-6)
    assert found.bones["head"].weight.tolist() == [1, 1, 1, 1]
    assert found.albedo is not None
    np.testing.assert_allclose(found.albedo, ((0x80 / 255 + 0.055) / 1.055) ** 2.4, atol=1e-4)


def test_an_image_too_large_to_unpack_is_refused() -> None:
    builder = textured(CORNERS, np.zeros((8200, 8200), np.uint8))
    with pytest.raises(UnsupportedError, match="8200x8200"):
        read(builder.glb())


def test_every_cut_is_noticed() -> None:
    whole = plain().glb()
    for length in range(len(whole)):
        with pytest.raises(TruncatedError if length >= 4 else DataError):
            read(whole[:length])
    with pytest.raises(DataError, match="version 9"):
        read(whole[:4] + b"\x09" + whole[5:])
    with pytest.raises(DataError, match="contains no JSON chunk"):
        read(whole[:16] + b"ELSE" + whole[20:])
    with pytest.raises(TruncatedError, match="GLB chunk"):
        read(whole[:12] + b"\xff\xff\xff" + whole[15:])
    with pytest.raises(TruncatedError, match="buffer: got"):
        read(plain().gltf("a.bin"), lambda name: b"")


@given(st.data())
def test_whatever_the_bytes_are_it_is_a_mesh_or_a_data_error(data: st.DataObject) -> None:
    whole = bytearray(
        data.draw(st.sampled_from([plain().glb(), skinned().glb(), vrm(0).gltf(), textured(CORNERS).glb()]))
    )
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    with suppress(DataError):
        read(bytes(whole))


@given(st.recursive(st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.text(max_size=3),
                    lambda inner: st.lists(inner, max_size=3), max_leaves=4), st.data())  # fmt: skip
def test_whatever_the_json_says_it_is_a_mesh_or_a_data_error(value: Any, data: st.DataObject) -> None:
    builder = data.draw(st.sampled_from([plain, skinned, lambda: vrm(0), lambda: vrm(1), lambda: textured(CORNERS)]))()
    place: Any = builder.doc
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            break
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or data.draw(st.integers(0, 3)) == 0:
            place[key] = value
            break
        place = place[key]
    try:
        text = json.dumps(builder.doc)
    except ValueError:
        return
    assert text
    with suppress(DataError):
        read(builder.glb())


def test_a_mesh_that_many_nodes_show_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene, "MAX_PARTS", 20)
    builder = Builder()
    number = square(builder)
    for _ in range(20):
        builder.node(mesh=number)
    assert len(read(builder.glb()).surfaces) >= 1
    builder.node(mesh=number)
    with pytest.raises(DataError, match="scene: got more than 20 parts"):
        read(builder.glb())
