"""Pictures of a smile, of surprise and of a blink: light teeth, no white below the iris, and no dark slits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from design.face_page import pose
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import with_rest
from fapengine.mesh.face_mesh import Bone, FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.render.camera import Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer

MOUTH = Camera(target_mm=(0.0, -28.0, 80.0), distance_mm=700.0, field_deg=7.0)
EYE = Camera(target_mm=(31.0, 33.0, 90.0), distance_mm=700.0, field_deg=4.0)
SIZE = (200, 200)
GREY = np.array([0.299, 0.587, 0.114])


def draw(head: FaceMesh, does: str | np.ndarray, camera: Camera) -> np.ndarray:
    faps = pose(load_profile("grid_s1_en"), does) if isinstance(does, str) else does
    with FaceRenderer(head, RenderOptions(size=SIZE, camera=camera, samples=4, rest=0.0)) as renderer:
        return renderer.draw(faps).astype(float)


def without(head: FaceMesh, gone: np.ndarray) -> FaceMesh:
    return replace(head, triangles=head.triangles[~gone[head.triangles].any(axis=1)])


def teeth_of(head: FaceMesh, *bones: Bone) -> np.ndarray:
    return (head.material == Material.TEETH) & np.isin(head.bone, bones)


def test_teeth_of_a_smile_are_light_and_no_khaki() -> None:
    head = build_head()
    smile = draw(head, "joy", MOUTH)
    teeth = smile[np.abs(smile - draw(without(head, teeth_of(head, *Bone)), "joy", MOUTH)).max(axis=-1) > 20]
    assert len(teeth) > 800
    lightest = teeth[teeth @ GREY > np.median(teeth @ GREY)].mean(axis=0)
    assert lightest @ GREY > 176  # 168 before
    red, green, blue = lightest
    assert red - blue < 40
    assert green < (red + blue) / 2 + 1  # 1.3 before, which is khaki beside lips


def test_a_smile_shows_the_upper_teeth_alone_and_a_vowel_both() -> None:
    head = build_head()

    upper, lower, tongue = teeth_of(head, Bone.NONE), teeth_of(head, Bone.JAW), head.material == Material.TONGUE

    def seen(does: str | np.ndarray, part: np.ndarray) -> int:
        change = np.abs(draw(head, does, MOUTH) - draw(without(head, part), does, MOUTH))
        return int((change.max(axis=-1) > 20).sum())

    joy = with_rest(pose(load_profile("grid_s1_en"), "joy"), 1.0)
    assert seen("joy", upper) > 800
    assert seen(joy, upper) > 2000  # 1,200 before: a thin strip
    assert [seen(does, part) for does in ("joy", joy) for part in (lower, tongue)] == pytest.approx([0] * 4, abs=8)
    assert min(seen("ɑ", part) for part in (upper, lower, tongue)) > 100
    surprise = 0.8 * pose(load_profile("grid_s1_en"), "surprise")
    assert seen(surprise, upper) < 8  # 32 before: the tips, two white dashes below the lip


def test_a_full_smile_shows_single_teeth() -> None:
    """Seams on both sides of the middle: pixels darker than the light teeth next to them, on the left and right."""
    head, joy = build_head(), with_rest(pose(load_profile("grid_s1_en"), "joy"), 1.0)
    smile = draw(head, joy, MOUTH)
    seen = np.abs(smile - draw(without(head, teeth_of(head, Bone.NONE)), joy, MOUTH)).max(axis=-1) > 20
    rows = seen.sum(axis=1) > 0.9 * seen.sum(axis=1).max()
    grey = (smile @ GREY)[rows].mean(axis=0)[seen[rows].all(axis=0)]
    beside = sliding_window_view(np.pad(grey, 5, mode="edge"), 6).max(axis=-1)
    depth = np.minimum(beside[:-5], beside[5:]) - grey
    seams = np.flatnonzero((depth[1:-1] > 12) & (grey[1:-1] < grey[:-2]) & (grey[1:-1] <= grey[2:]))
    middle = len(grey) / 2
    assert min((seams < middle - 5).sum(), (seams > middle + 5).sum()) >= 3


@pytest.mark.parametrize("name", ["surprise", "fear"])
def test_a_wide_eye_shows_little_white_above_its_iris_and_none_below(name: str) -> None:
    picture = draw(build_head(HeadStyle(charm=0)), name, EYE)
    column = picture[:, SIZE[0] // 2 - 3 : SIZE[0] // 2 + 4].mean(axis=1)
    white = (column.min(axis=-1) > 150) & (np.ptp(column, axis=-1) < 30)
    above, below = white[: SIZE[1] // 2].sum(), white[SIZE[1] // 2 :].sum()
    assert below == 0
    assert 1.0 < above / EYE.pixels_per_mm(SIZE[1]) < 2.3  # mm; 2.7 and 2.9 before


def test_a_half_shut_eye_is_as_light_as_an_open_one() -> None:
    head = build_head()
    blind = without(head, head.material == Material.EYE)

    def light(closing: float) -> float:
        faps = np.zeros(68)
        faps[fap.columns(19, 20)] = closing
        picture = draw(head, faps, EYE)
        seen = np.abs(picture - draw(blind, faps, EYE)).max(axis=-1) > 20
        assert seen.sum() > 1000
        return float((picture @ GREY)[seen].mean())

    assert light(700.0) > light(0.0)  # 0.91 of it in a shadow as deep as that of an open lid
