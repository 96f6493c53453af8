"""The self-test of a head: lips that open, meet, and are measured as lips are; lids that close."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fapengine
from fapengine.app.head_check import check_avatar, draw_sheet, self_test
from fapengine.files.pictures import GAP, LABEL_HEIGHT, MARGIN, TILE
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.retarget.blend import ARKIT_NAMES
from tests.unit.files.glb import write_rig
from tests.unit.mesh.rigs import own_rig

HEAD = "default:level=coarse"
TITLE_HEIGHT = 40


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return fapengine.load_head(HEAD)


@pytest.mark.parametrize("name", [HEAD, "woman", "child"])
def test_our_heads_speak(name: str) -> None:
    tested = self_test(fapengine.load_head(name))
    assert tested.remarks == ()
    assert tested.summary.endswith("mm on ɑ (expected 8 to 20), close on m, lids close")
    assert 8.0 < tested.facts["lips_ɑ_mm"] < 20.0
    assert 1.0 < tested.facts["lips_f_mm"] < tested.facts["lips_ɑ_mm"]


def test_a_mouth_that_is_too_near_to_the_nose(head: FaceMesh) -> None:
    """As of an avatar of VRoid whose point 9.15 lay at the lip."""
    (remark,) = self_test(replace(head, fapu=replace(head.fapu, mns0_mm=1.94))).remarks
    assert remark.startswith("FAPU: MNS0 is 1.9 mm, 0.03 of the eyes' distance, expected 0.22 to 0.5; points=FILE sets")


def test_a_mouth_that_hardly_opens(head: FaceMesh) -> None:
    weak = replace(head.basis, entry_mm=head.basis.entry_mm / 5)
    tested = self_test(replace(head, basis=weak))
    opening_mm = tested.facts["lips_ɑ_mm"]
    assert 1.6 < opening_mm < 4.0
    assert f"lips: they open {opening_mm:.1f} mm on ɑ, expected 8 to 20 mm" in tested.remarks
    assert tested.summary.startswith("lips open 2 mm on ɑ (expected 8 to 20)")


def test_lips_that_are_apart_at_rest(head: FaceMesh) -> None:
    vertices = np.array(head.vertices_mm)
    vertices[head.feature_points["2.3"], 1] -= 6.0
    tested = self_test(replace(head, vertices_mm=vertices))
    assert tested.remarks == ("lips: they are 6.00 mm apart on m, expected at most 0.5 mm",)
    assert "stay 6.0 mm open on m" in tested.summary


def test_lids_that_stay_open(head: FaceMesh) -> None:
    vertices = np.array(head.vertices_mm)
    vertices[head.feature_points["3.4"], 1] -= 3.0
    tested = self_test(replace(head, vertices_mm=vertices))
    (remark,) = tested.remarks
    assert remark.startswith("lids: the right eye stays 2.")
    assert tested.summary.endswith("lids stay open")


def test_a_mesh_without_points_says_that_nothing_is_known(head: FaceMesh) -> None:
    tested = self_test(replace(head, feature_points={"2.1": head.feature_points["2.1"]}))
    assert tested.remarks == ()
    assert tested.summary == "lips not measured, lids not measured"
    assert tested.facts["lips_ɑ_mm"] is None


def avatar_file(path: Path, names: dict[str, str]) -> Path:
    """Write our own head as an avatar with shapes of ARKit under other names."""
    rig = own_rig(tuple(names))
    shapes = {names[name]: shape for name, shape in rig.blendshapes.items()}
    path.write_bytes(write_rig(replace(rig, blendshapes=shapes)).glb())
    return path


def test_an_avatar_file_is_measured_by_its_own_shapes(tmp_path: Path) -> None:
    names = {name: name for name in ("jawOpen", "mouthClose", "eyeBlinkLeft", "eyeBlinkRight", "browInnerUp")}
    tested = check_avatar(avatar_file(tmp_path / "a.glb", names))
    assert 8.0 < tested.facts["lips_ɑ_mm"] < 20.0
    assert tested.facts["lips_m_mm"] < 1.0
    assert tested.facts["left_lid_mm"] < 3.0  # a straight way round the ball; 13 mm at rest
    gone = check_avatar(avatar_file(tmp_path / "b.glb", {"jawOpen": "jawOpen"}))
    assert gone.summary == "lips not measured, lids not measured"  # no lids show where the face is


def test_another_mapping_of_the_same_name_is_read_again(tmp_path: Path) -> None:
    names = {"jawOpen": "mund", "eyeBlinkLeft": "links", "eyeBlinkRight": "rechts"}
    avatar, mapping = avatar_file(tmp_path / "a.glb", names), tmp_path / "map.toml"
    mapping.write_text('[shapes]\nmund = "unused"\n')
    assert check_avatar(avatar, mapping).summary.startswith("lips not measured")
    mapping.write_text("[shapes]\n" + "".join(f'{own} = "{arkit}"\n' for arkit, own in names.items()))
    assert check_avatar(avatar, mapping).summary.startswith("lips open")


def test_a_mouth_without_jaw_open_follows_its_vowels(tmp_path: Path) -> None:
    """VRoid files have 38 of ARKit's shapes, but not jawOpen: with --into the mouth opened 2 mm."""
    names = {name: name for name in ARKIT_NAMES if not name.startswith(("jaw", "tongue"))} | {"jawOpen": "Fcl_MTH_A"}
    assert check_avatar(avatar_file(tmp_path / "a.glb", names)).facts["lips_ɑ_mm"] > 6.0


def test_the_contact_sheet_shows_nine_different_faces(head: FaceMesh) -> None:
    sheet = draw_sheet(head)
    tiles = [
        sheet[top : top + TILE, left : left + TILE].tobytes()
        for top in range(MARGIN + TITLE_HEIGHT, sheet.shape[0] - TILE, TILE + LABEL_HEIGHT + GAP)
        for left in range(MARGIN, sheet.shape[1] - TILE, TILE + GAP)
    ][:9]
    assert len(set(tiles)) == 9
