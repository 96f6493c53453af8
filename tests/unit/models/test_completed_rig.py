"""A rig with a few visemes gets the other shapes of ARKit from the built-in head."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.rig.blendshape_mesh import Blendshape
from fapengine.models.completed_rig import complete_rig
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES
from tests.unit.mesh.rigs import own_rig, skin_of

MADE = ("mouthSmileLeft", "browInnerUp", "jawOpen", "eyeBlinkRight", "mouthUpperUpLeft", "mouthLowerDownLeft")


@pytest.fixture(scope="module")
def standard():
    return build_head(HeadStyle(charm=0))


@pytest.fixture(scope="module")
def completed(standard):
    """Another face, turned and in metres, that names some shapes but has nothing in them."""
    rig = own_rig()
    points = {name: index for name, index in standard.feature_points.items() if index in np.unique(rig.triangles)}
    empty = Blendshape(np.zeros(0, np.int64), np.zeros((0, 3)))
    quarter = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    bare = replace(rig, vertices=rig.vertices @ quarter.T / 1000, blendshapes={"jawOpen": empty, "hat": empty})
    shapes = arkit_map()
    wanted = {name: shapes.faps[ARKIT_NAMES.index(name)] for name in MADE}
    mesh, off_mm = complete_rig(bare, points, wanted, standard)
    assert off_mm < 1.0
    back = {
        name: 1000 * mesh.dense(name) @ quarter for name in mesh.blendshapes if len(mesh.blendshapes[name].vertices)
    }
    return rig, mesh, back


def test_eight_points_are_enough_and_lips_part_between_the_outer_ones(standard):
    """None of them is between the lips."""
    rig = own_rig()
    points = {name: standard.feature_points[name] for name in ("8.1", "8.2", "8.3", "8.4", "2.1", "9.1", "9.2", "9.3")}
    opening = {"jawOpen": arkit_map().faps[ARKIT_NAMES.index("jawOpen")]}
    moved = complete_rig(replace(rig, blendshapes={}), points, opening, standard)[0].dense("jawOpen")[:, 1]
    upper, lower = (moved[standard.feature_points[name]] for name in ("2.2", "2.3"))
    assert upper - lower > 10.0  # mm
    assert abs(upper) < 0.3 * abs(lower)


def test_shapes_that_are_missing_or_empty_are_made(completed):
    _, mesh, back = completed
    assert set(mesh.blendshapes) == {*MADE, "hat"}
    assert set(back) == set(MADE)


@pytest.mark.parametrize("name", MADE)
def test_they_move_the_skin_as_its_own_would(completed, standard, name):
    rig, _, back = completed
    skin = skin_of(standard)
    truth = rig.dense(name)[skin]
    error = np.linalg.norm(back[name][skin] - truth, axis=1)
    assert np.mean(error) < 0.25 * np.mean(np.linalg.norm(truth, axis=1))


def test_each_lip_moves_with_its_own_side(completed, standard):
    """They touch at rest: a nearest place alone would take both lips along."""
    rig, _, back = completed
    checked = 0
    for name in ("jawOpen", "mouthUpperUpLeft", "mouthLowerDownLeft"):
        truth = rig.dense(name)
        for upper, lower in (("2.2", "2.3"), ("2.6", "2.8")):
            pair = [standard.feature_points[upper], standard.feature_points[lower]]
            parted = truth[pair[0], 1] - truth[pair[1], 1]
            if parted > 2.0:  # mm
                assert back[name][pair[0], 1] - back[name][pair[1], 1] == pytest.approx(parted, rel=0.25), (name, upper)
                checked += 1
    assert checked >= 4
