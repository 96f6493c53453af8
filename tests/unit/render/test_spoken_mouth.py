"""What a stranger sees of the mouth: lips that come forward, from the side; the tongue of θ, from the front."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from design.phones_sheet import MOUTH, pose
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.render.camera import Camera
from fapengine.render.drawing import Drawing
from fapengine.render.renderer import FaceRenderer

SIZE = (200, 200)
FRONT = Camera(target_mm=MOUTH, distance_mm=500.0, field_deg=9.0)
SIDE = Camera(target_mm=(0.0, -36.0, 100.0), distance_mm=500.0, field_deg=9.0, yaw_deg=90.0)


@cache
def head() -> FaceMesh:
    return build_head()


def draw(faps: list[np.ndarray], camera: Camera, mesh: FaceMesh | None = None) -> list[np.ndarray]:
    drawing = Drawing(size=SIZE, camera=camera, samples=4, background="transparent")
    with FaceRenderer(mesh or head(), drawing) as renderer:
        return [renderer.draw(row).astype(float) for row in faps]


@cache
def head_without_tip() -> FaceMesh:
    """A head whose tongue lacks its foremost 7 mm."""
    whole = head()
    reach = whole.point_mm("6.1")[2] - whole.vertices_mm[:, 2]
    tip = (whole.material == Material.TONGUE) & (reach < 7.0)
    return replace(whole, triangles=whole.triangles[~tip[whole.triangles].any(axis=1)])


def tongue_pixels(*labels: str, at: int = 0) -> int:
    """Number of pixels that the tip of the tongue changes by a sixth of the range and more."""
    with_tip, without = (draw([pose(*labels, at=at)], FRONT, mesh)[0] for mesh in (head(), head_without_tip()))
    return int((np.abs(with_tip - without)[..., :3].max(axis=-1) > 42).sum())


def lips_mm(label: str) -> tuple[float, float]:
    """How far the lips reach beyond those at rest, seen from the side: upper and lower, in mm."""
    rest, spoken = draw([np.zeros(68, np.int32), pose(label)], SIDE)
    scale = SIDE.pixels_per_mm(SIZE[1])
    found = []
    for low, high in ((-31.0, -22.0), (-50.0, -38.0)):
        top, bottom = (round(SIZE[1] / 2 - (y + 36.0) * scale) for y in (high, low))
        reach = [np.argmax(picture[top:bottom, :, 3] > 127, axis=1).min() for picture in (rest, spoken)]
        found.append(float(reach[0] - reach[1]) / scale)
    return found[0], found[1]


def test_the_tongue_of_th_is_seen_and_that_of_s_is_not_so() -> None:
    seen = tongue_pixels("θ")
    assert seen > 150  # of 40,000
    assert seen > 3 * tongue_pixels("s")


@pytest.mark.parametrize("word", ["*θ ɹ i", "w ɪ *θ", "ə *ð ə", "*θ ɪ ŋ k"])
def test_the_tongue_of_th_is_seen_in_words_too(word: str) -> None:
    labels = word.replace("*", "").split()
    assert tongue_pixels(*labels, at=word.split("*")[0].count(" ")) > 120


def test_a_round_mouth_has_a_dark_hole() -> None:
    """The tongue of u is drawn back: between its lips it is half as light as on them, and darker than in i."""

    def light(label: str, high_mm: float, low_mm: float) -> np.ndarray:
        picture = draw([pose(label)], FRONT)[0][..., :3].mean(axis=-1)
        top, bottom = (round(SIZE[1] / 2 - (y - MOUTH[1]) * FRONT.pixels_per_mm(SIZE[1])) for y in (high_mm, low_mm))
        return picture[top:bottom, SIZE[0] // 2 - 5 : SIZE[0] // 2 + 6].mean(axis=1)

    hole, lip = light("u", -35.5, -37.5), light("u", -40.0, -48.0)
    assert hole.max() < 0.55 * lip.max()
    assert hole.max() < light("i", -35.5, -37.5).max()


@pytest.mark.parametrize("label", ["u", "y", "w", "ʃ"])
def test_round_lips_come_forward_in_profile(label: str) -> None:
    forward, spread = lips_mm(label), lips_mm("i")
    assert min(forward) > 2.0
    assert forward[0] - spread[0] > 3.0
    assert forward[1] - spread[1] > 4.0


def test_the_inside_of_the_mouth_is_as_grey_as_in_films_of_people() -> None:
    whole = head()
    inside = np.isin(whole.material, [Material.TEETH, Material.GUM, Material.TONGUE, Material.MOUTH])
    hollow = replace(whole, triangles=whole.triangles[~inside[whole.triangles].any(axis=1)])
    spoken = [pose(label) for label in ("ɑ", "ɛ", "e", "a", "i", "ʌ", "n", "s")]
    drawn, without = (np.array(draw(spoken, FRONT, mesh)) for mesh in (whole, hollow))
    seen = np.abs(drawn - without).max(axis=-1) > 0
    seen[:, 1:-1, 1:-1] &= seen[:, :-2, 1:-1] & seen[:, 2:, 1:-1]  # not the lips' edge
    grey = (drawn[..., :3] @ [0.299, 0.587, 0.114])[seen]
    assert len(grey) > 2000
    low, high = np.percentile(grey, [10, 90])
    assert low == pytest.approx(81, abs=15)  # levels of real clips; ours were 35 and 205
    assert high == pytest.approx(135, abs=15)
