"""What a stranger sees of the mouth: lips that come forward, from the side; the tongue of θ, from the front."""

from functools import cache

import numpy as np
import pytest

from design.phones_sheet import MOUTH, pose
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.render.camera import Camera
from fapengine.render.drawing import Drawing
from fapengine.render.renderer import FaceRenderer

SIZE = (200, 200)
FRONT = Camera(target_mm=MOUTH, distance_mm=500.0, field_deg=9.0)
SIDE = Camera(target_mm=(0.0, -36.0, 100.0), distance_mm=500.0, field_deg=9.0, yaw_deg=90.0)
TONGUE = [fap.column(number) for number in (44, 45, 46)]


@cache
def head() -> FaceMesh:
    return build_head()


def draw(faps: list[np.ndarray], camera: Camera) -> list[np.ndarray]:
    drawing = Drawing(size=SIZE, camera=camera, samples=4, background="transparent")
    with FaceRenderer(head(), drawing) as renderer:
        return [renderer.draw(row).astype(float) for row in faps]


def tongue_pixels(label: str) -> int:
    """Number of pixels that the tongue's own movement changes by a fifth of the range and more."""
    spoken = pose(label).copy()
    still = spoken.copy()
    still[TONGUE] = 0
    with_tongue, without = draw([spoken, still], FRONT)
    return int((np.abs(with_tongue - without)[..., :3].max(axis=-1) > 50).sum())


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
    assert seen > 150  # of 40,000, the mouth having some 900
    assert seen > 3 * tongue_pixels("s")


@pytest.mark.parametrize("label", ["u", "y", "w", "ʃ"])
def test_round_lips_come_forward_in_profile(label: str) -> None:
    forward, spread = lips_mm(label), lips_mm("i")
    assert min(forward) > 2.0
    assert forward[0] - spread[0] > 3.0
    assert forward[1] - spread[1] > 4.0
