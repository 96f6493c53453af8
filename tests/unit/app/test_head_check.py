"""Heads are held against what is plausible: lips that open, meet, and are measured as lips are."""

from dataclasses import replace

import numpy as np
import pytest

import fapengine
from fapengine.app.head_check import AH, lip_remarks
from fapengine.mesh.face_mesh import FaceMesh

HEAD = "default:level=coarse"


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return fapengine.load_head(HEAD)


@pytest.mark.parametrize("name", [HEAD, "woman", "child"])
def test_our_heads_speak(name: str) -> None:
    assert lip_remarks(fapengine.load_head(name)) == ()


def test_a_mouth_that_is_too_near_to_the_nose(head: FaceMesh) -> None:
    """As of an avatar of VRoid whose point 9.15 lay at the lip."""
    (remark,) = lip_remarks(replace(head, fapu=replace(head.fapu, mns0_mm=1.94)))
    assert remark.startswith("lips: mouth and nose are 1.9 mm apart, 0.03 of the eyes' distance, expected 0.15 to")


def test_a_mouth_that_hardly_opens(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fapengine.app.head_check.AH", {number: value / 9 for number, value in AH.items()})
    (remark,) = lip_remarks(head)
    assert remark.startswith("lips: they open by 1.2 mm on a wide ah, expected 8 to 20 mm")


def test_lips_that_are_apart_at_rest(head: FaceMesh) -> None:
    vertices = np.array(head.vertices_mm)
    vertices[head.feature_points["2.3"], 1] -= 6.0
    (remark,) = lip_remarks(replace(head, vertices_mm=vertices))
    assert remark.startswith("lips: they do not meet, and are 6.0 mm apart at rest")


def test_a_mesh_without_points_on_the_lips_has_no_remarks(head: FaceMesh) -> None:
    points = {name: vertex for name, vertex in head.feature_points.items() if name != "2.3"}
    assert lip_remarks(replace(head, feature_points=points)) == ()
