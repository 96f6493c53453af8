"""A head and its motion as USD: UsdSkel reads the shapes, the weights and the turns back that were meant."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel
from typer.testing import CliRunner

import fapengine
from fapengine.app.scene_files import Into, check_avatar, export_head, face_motion
from fapengine.cli.main import app
from fapengine.errors import UsageError
from fapengine.files.heads.load import load_head
from fapengine.files.provenance import SYNTHETIC, provenance
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.ict_notice import ICT_COPYRIGHT
from fapengine.retarget.puppet import make_puppet

HEAD = "default:level=coarse"
ATOL = 1e-5
"""Of weights, which USD keeps as single floats."""


def moving() -> FapTrack:
    values = np.zeros((4, 68), np.int32)
    values[:, 2] = [0, 300, 600, 0]  # jaw
    values[:, 18] = [0, 500, 1000, 0]  # upper left lid
    values[:, 47] = [0, 5000, 9000, 0]  # head pitch
    return FapTrack.from_values(values, rate_hz=25.0)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("usd")
    fapengine.save(moving(), folder / "talk.fap")
    words = ["convert", folder / "talk.fap", "--into", HEAD, "-o", folder / "talk.usdc"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    assert "and turns head; 4 keys" in done.output
    return Usd.Stage.Open(str(folder / "talk.usdc"))


def query(stage: Any) -> Any:
    root = UsdSkel.Root(stage.GetDefaultPrim())
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    return cache.GetSkelQuery(UsdSkel.Skeleton(stage.GetPrimAtPath("/Head/Skeleton"))), cache


def test_the_cache_gives_the_weights(stage: Any) -> None:
    animation = query(stage)[0].GetAnimQuery()
    order = list(animation.GetBlendShapeOrder())
    rows = np.array([animation.ComputeBlendShapeWeights(frame) for frame in range(4)])
    wanted = approximate_arkit(moving().values.astype(np.float64))
    shown = rows[:, [order.index(name) for name in ARKIT_NAMES]]
    np.testing.assert_allclose(shown, wanted, atol=ATOL)
    assert shown.max() > 0.5
    visemes = [number for number, name in enumerate(order) if name not in ARKIT_NAMES]
    assert len(visemes) >= 14
    assert not rows[:, visemes].any()
    assert (stage.GetTimeCodesPerSecond(), stage.GetEndTimeCode()) == (25.0, 3.0)


def test_the_head_turns_as_it_was_meant_to(stage: Any) -> None:
    skeleton, _ = query(stage)
    local = np.array([skeleton.ComputeJointLocalTransforms(frame) for frame in range(4)])
    turns = face_motion(moving(), "talk").turns["head"]
    np.testing.assert_allclose(local[:, 1, :3, :3], turns.transpose(0, 2, 1), atol=1e-6)  # rows are images
    joints = make_puppet(load_head(HEAD)).joints
    at_rest = np.array(skeleton.ComputeJointSkelTransforms(0))[:, 3, :3]
    np.testing.assert_allclose(at_rest, joints, atol=1e-6)


def test_meshes_and_shapes_are_the_head_s(stage: Any) -> None:
    cache = query(stage)[1]
    parts = make_puppet(load_head(HEAD)).parts
    for part in parts:
        prim = stage.GetPrimAtPath(f"/Head/{part.name}")
        mesh, skinning = UsdGeom.Mesh(prim), cache.GetSkinningQuery(prim)
        assert np.array_equal(mesh.GetPointsAttr().Get(), part.vertices)
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        assert shapes.GetNumBlendShapes() == len(part.shapes)
        assert bool(part.shapes) == bool(skinning.HasBlendShapes())
        for number, shape in enumerate(part.shapes.values()):
            moves = np.zeros_like(part.vertices)
            moves[np.array(shapes.GetBlendShape(number).GetPointIndicesAttr().Get(), int)] = (
                shapes.GetBlendShape(number).GetOffsetsAttr().Get()
            )
            assert np.array_equal(moves, shape.moves)
    assert len(parts) >= 6


def test_a_head_alone_is_text_too(tmp_path: Path) -> None:
    export_head(HEAD, tmp_path / "head.usda")
    text = (tmp_path / "head.usda").read_text()
    assert text.startswith("#usda 1.0")
    assert "Apache-2.0" in text
    assert ICT_COPYRIGHT in text
    assert "Permission is hereby granted" in text
    assert SYNTHETIC in text
    with provenance(False):
        export_head(HEAD, tmp_path / "plain.usda")
    plain = (tmp_path / "plain.usda").read_text().splitlines()
    assert [line for line in text.splitlines() if SYNTHETIC not in line] == plain
    assert "SkelAnimation" not in text
    with pytest.raises(UsageError, match=r"ends with \.glb, \.vrm, \.usda"):
        export_head(HEAD, tmp_path / "head.fbx")


@pytest.mark.parametrize("into", [Into(Path("a.glb")), Into(Path(HEAD), keys="cubic")])
def test_foreign_avatars_are_refused(into: Into) -> None:
    with pytest.raises(UsageError, match="USD needs the name of a head"):
        check_avatar(Path("a.usda"), into)


@pytest.mark.parametrize(
    ("name", "rig", "match"),
    [("head.glb", "unity", "expected head or mixamo"), ("head.vrm", "mixamo", r"ends with \.glb"),
     ("head.usda", "mixamo", r"ends with \.glb")],
)  # fmt: skip
def test_a_rig_is_for_a_glb(tmp_path: Path, name: str, rig: str, match: str) -> None:
    with pytest.raises(UsageError, match=match):
        export_head(HEAD, tmp_path / name, rig)
    assert not list(tmp_path.iterdir())
