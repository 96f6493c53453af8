"""Folds: which FAPs draw them, how age shows, how lids come to light; glasses; the axes of the measured faces."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.default_head.folds import fold_map
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import MAX_WEIGHT, HeadStyle, parse_person
from fapengine.mesh.deform import channel_weights, deform
from fapengine.mesh.face_mesh import FaceMesh, Folds, Material
from fapengine.mpeg4 import fap


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def shares(head: FaceMesh, **values: float) -> np.ndarray:
    """Folds, or of lids what the occlusion gains, as the shader adds them up: (V,)."""
    assert head.folds is not None
    faps = np.zeros(68)
    for name, value in values.items():
        faps[fap.column(fap.by_name(name).number)] = value
    weight = channel_weights(head.basis, faps)[head.basis.entry_channels]
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(head.basis.offsets))
    added = np.bincount(vertex, weight * head.folds.entries, len(head.vertices_mm))
    skin = head.folds.rest > 0
    return np.where(head.folds.rest < 0, added, np.where(skin, np.clip(head.folds.rest + added, 0, 1), 0.0))


@pytest.mark.parametrize(
    ("faps", "place"),
    [
        ({"raise_l_i_eyebrow": 180, "raise_l_m_eyebrow": 230}, (15, 78)),
        ({"squeeze_l_eyebrow": 100, "raise_l_i_eyebrow": -150}, (7, 54)),
        ({"lift_l_cheek": 150}, (53, 34)),
        ({"raise_nose": 70}, (9, 22)),
        ({"raise_l_cornerlip_o": 330}, (30, -28)),
        ({"depress_chin": 60}, (4, -62)),
    ],
)
def test_a_fap_draws_its_folds_on_its_side_alone(
    head: FaceMesh, faps: dict[str, float], place: tuple[float, float]
) -> None:
    drawn = shares(head, **faps) - shares(head)
    front = head.vertices_mm[:, 2] > 40
    skin = np.flatnonzero(front & (head.material == Material.SKIN))
    near = skin[np.linalg.norm(head.vertices_mm[skin, :2] - place, axis=1) < 7]
    assert drawn[near].max() > 0.15
    far = skin[head.vertices_mm[skin, 0] < -12]
    if all("_l_" in name for name in faps):
        assert np.abs(drawn[far]).max() < 1e-6


def test_folds_rest_with_youth_and_stay_with_age(head: FaceMesh) -> None:
    older = build_head(HeadStyle(age=1.0))
    assert head.folds is not None
    assert older.folds is not None
    assert head.folds.rest.max() < 0.15
    assert older.folds.rest.max() > 0.35
    assert not head.folds.rest[head.material == Material.HAIR].any()


def test_a_smile_draws_crows_feet_with_age_alone() -> None:
    drawn = {}
    for age in (0.0, 1.0):
        head = build_head(HeadStyle(age=age))
        at = head.vertices_mm[:, :2]
        near = (head.material == Material.SKIN) & (np.linalg.norm(at - (53, 34), axis=1) < 7)
        drawn[age] = (shares(head, lift_l_cheek=215) - shares(head))[near].max()
    assert drawn[0.0] == 0.0
    assert drawn[1.0] > 0.4


def test_a_lid_comes_to_light_as_it_shuts(head: FaceMesh) -> None:
    assert head.folds is not None
    lids = (head.folds.rest < 0) & (head.material == Material.SKIN)
    shut = head.occlusion[lids] + shares(head, close_t_l_eyelid=1080, close_t_r_eyelid=1080)[lids]
    assert head.occlusion[lids].min() < 0.75
    assert (shut > 0.75).mean() > 0.95
    assert shut.min() > 0.6  # towards the brow


def test_a_tongue_that_is_drawn_back_lies_in_the_dark(head: FaceMesh) -> None:
    """And one that is put out in the light; so the round mouth of u has a dark hole."""
    assert head.folds is not None
    tongue = (head.folds.rest < 0) & (head.material == Material.TONGUE)
    assert tongue.sum() > 100
    back, out = (shares(head, thrust_tongue_tip=fapu)[tongue] for fapu in (-500, 500))
    assert back.min() < -0.4
    assert back.max() <= 0.0
    np.testing.assert_allclose(out, -back, atol=1e-6)


def test_the_map_lies_over_the_painting_and_mostly_changes_nothing(head: FaceMesh) -> None:
    light = fold_map().astype(float) - 127.5
    assert head.texture is not None
    assert light.shape == head.texture.shape[:2]
    assert np.median(np.abs(light)) < 0.25 * 127.5  # pores, within what the shader takes for them
    assert (np.abs(light) > 0.3 * 127.5).mean() > 0.01


def test_folds_of_another_mesh_are_refused(head: FaceMesh) -> None:
    parts = {name: getattr(head, name) for name in FaceMesh.__slots__}
    with pytest.raises(UsageError, match="folds: got"):
        FaceMesh(**(parts | {"folds": Folds(fold_map(), np.zeros(3, np.float32), np.zeros(4, np.float32))}))


def test_glasses_go_with_the_head_alone() -> None:
    person = parse_person("woman,glasses")
    assert person is not None
    assert person[0].glasses
    bare, worn = build_head(HeadStyle(), level="coarse"), build_head(HeadStyle(glasses=True), level="coarse")
    added = np.ones(len(worn.vertices_mm), dtype=bool)
    added[: len(bare.vertices_mm)] = False
    faps = np.zeros(68)
    faps[[fap.column(number) for number in (3, 19, 31, 41, 59)]] = 200.0
    assert np.array_equal(deform(worn, faps)[added], worn.vertices_mm[added])
    assert (worn.head_weight[added] == 1).all()
    front = worn.vertices_mm[added & (worn.vertices_mm[:, 2] > 80)]
    lids = bare.vertices_mm[[bare.feature_points[name] for name in ("3.1", "3.2", "3.9", "3.10")]]
    assert front[:, 2].min() > lids[:, 2].max() - 17
    assert np.abs(front[:, 0]).max() > 50


def test_axes_add_to_the_identity_and_stay_within_bounds() -> None:
    assert HeadStyle().weights == ()
    man, woman = HeadStyle(sex=1).weights, HeadStyle(sex=-1).weights
    assert np.allclose(man, -np.array(woman))
    assert np.allclose(HeadStyle(sex=1, identity=(0.5,)).weights[1:], man[1:])
    assert max(map(abs, HeadStyle(sex=2, build=2, age=1, identity=(2.5,) * 16).weights)) <= MAX_WEIGHT
    wide, narrow = (build_head(HeadStyle(build=step), level="coarse").point_mm("2.13")[0] for step in (1, -1))
    assert abs(wide) > abs(narrow) + 2
