"""What must not go through what: lips, teeth, tongue, lids and eyeballs, over random plausible frames."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.mesh.default_head import mouth
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Moved = Callable[[FaceMesh, Indices, Array], Array]


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


def frame(**values: float) -> Array:
    faps = np.zeros(68)
    for name, value in values.items():
        faps[fap.column(fap.by_name(name).number)] = value
    return faps


@pytest.fixture(scope="module")
def rims(head: FaceMesh, moved: Moved) -> tuple[Indices, Indices]:
    """Vertices of the upper and of the lower lip where they touch."""
    template = build_head(HeadStyle(charm=0))  # the line between the lips is known of this shape; vertices are the same
    rest, corner = template.vertices_mm.astype(np.float64), float(template.point_mm("2.4")[0])
    near = np.abs(rest[:, 1] - mouth.line(rest[:, 0] / corner)) < 0.25
    rim = np.flatnonzero((head.material == Material.LIP) & near & (np.abs(rest[:, 0]) < corner) & (rest[:, 2] > 90))
    down = frame(raise_b_midlip=-200, raise_b_lip_lm=-200, raise_b_lip_rm=-200)
    goes_down = moved(head, rim, down)[:, 1] - head.vertices_mm[rim, 1] < -1e-3
    return rim[~goes_down], rim[goes_down]


def test_lips_never_go_through_each_other(
    head: FaceMesh, moved: Moved, frames: Array, rims: tuple[Indices, Indices]
) -> None:
    upper, lower = (moved(head, rim, frames) for rim in rims)
    assert min(map(len, rims)) > 40
    along = np.linspace(-17.0, 17.0, 35)

    def heights(rim: Array) -> Array:
        order = np.argsort(rim[:, 0])
        return np.interp(along, rim[order, 0], rim[order, 1])

    gaps = np.array([heights(above) - heights(below) for above, below in zip(upper, lower, strict=True)])
    assert gaps.max() > 10  # mm: they do part
    assert gaps.min() > -0.05


def test_neither_lip_moves_the_other(head: FaceMesh, moved: Moved, rims: tuple[Indices, Indices]) -> None:
    upper, lower = rims
    middle = [rim[np.abs(head.vertices_mm[rim, 0]) < 20] for rim in rims]
    assert min(map(len, middle)) > 30
    for rim, names in (
        (upper, ("raise_b_midlip", "raise_b_lip_lm", "raise_b_lip_rm_o", "raise_b_midlip_o", "push_b_lip", "open_jaw")),
        (lower, ("lower_t_midlip", "lower_t_lip_lm", "lower_t_lip_rm_o", "lower_t_midlip_o", "push_t_lip")),
    ):
        for name in names:
            off = moved(head, rim, frame(**{name: 200.0})) - head.vertices_mm[rim]
            assert np.abs(off).max() < 1e-3, name


def test_teeth_stay_behind_lips_and_skin(head: FaceMesh, moved: Moved, frames: Array) -> None:
    rest = head.vertices_mm
    skin = (head.material <= Material.LIP) & (rest[:, 2] > 70) & (rest[:, 1] < 0) & (rest[:, 1] > -80)
    skin &= np.abs(rest[:, 0]) < 45
    triangles = head.triangles[skin[head.triangles].all(axis=1)]
    used, corners = np.unique(triangles, return_inverse=True)
    corners = corners.reshape(-1, 3)
    teeth = np.flatnonzero(head.material == Material.TEETH)
    inside = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
    clear = []
    for faces, bite in zip(moved(head, used, frames[::5]), moved(head, teeth, frames[::5]), strict=True):
        points = (inside @ faces[corners]).reshape(-1, 3)
        cells = np.round(points[:, :2]).astype(int) + 150
        front = np.full((300, 300), -np.inf)
        np.maximum.at(front, (cells[:, 0], cells[:, 1]), points[:, 2])
        before = front[tuple((np.round(bite[:, :2]).astype(int) + 150).T)]
        covered = np.isfinite(before)
        clear.append((before - bite[:, 2])[covered].min())
    assert min(clear) > 0.5  # mm


def test_the_tongue_stays_behind_the_teeth_until_it_is_asked_out(head: FaceMesh, moved: Moved, frames: Array) -> None:
    tongue = np.flatnonzero(head.material == Material.TONGUE)
    lower = np.array([head.feature_points["9.11"]])
    assert (moved(head, tongue, frames)[..., 2].max(axis=1) < moved(head, lower, frames)[:, 0, 2]).all()
    out = moved(head, tongue, frame(open_jaw=400, thrust_tongue_tip=900, raise_tongue_tip=100))
    lip = moved(head, np.array([head.feature_points["2.3"]]), frame(open_jaw=400, raise_b_midlip=-300))
    assert out[:, 2].max() > lip[0, 2] + 2


@pytest.mark.parametrize("side", ["l", "r"])
def test_lids_slide_over_the_ball(head: FaceMesh, moved: Moved, side: str) -> None:
    centre = head.eye_pivots_mm[0 if side == "l" else 1]
    away = np.linalg.norm(head.vertices_mm - centre, axis=1)
    ball_mm = away[(head.material == Material.EYE) & (away < 30)].max()
    lids = (away > ball_mm + 0.3) & (away < ball_mm + 5) & (head.vertices_mm[:, 2] > centre[2])
    vertices = np.flatnonzero(lids & (head.material == Material.SKIN) & (np.abs(head.vertices_mm[:, 1] - 36) < 12))
    assert len(vertices) > 60
    for upper in (-300, 0, 250, 500, 750, 1024):
        for lower in (0, 200, 400):
            names = {f"close_t_{side}_eyelid": upper, f"close_b_{side}_eyelid": min(lower, 1024 - max(upper, 0))}
            off = np.linalg.norm(moved(head, vertices, frame(**names)) - centre, axis=1)
            assert off.min() > ball_mm + 0.15, names


def test_lashes_go_with_their_lid(head: FaceMesh, moved: Moved) -> None:
    lashes = np.flatnonzero((head.material == Material.STRAND) & (head.vertices_mm[:, 0] > 0))
    height = head.vertices_mm[lashes, 1]
    above = (height > 44) & (height < 52) & (np.abs(head.vertices_mm[lashes, 0] - head.eye_pivots_mm[0, 0]) < 9)
    tips = lashes[above]
    assert len(tips) > 10
    drop = moved(head, tips, frame(close_t_l_eyelid=1024)) - head.vertices_mm[tips]
    assert drop[:, 1].max() < -5
    assert np.abs(moved(head, tips, frame(close_t_r_eyelid=1024)) - head.vertices_mm[tips]).max() < 1e-6
