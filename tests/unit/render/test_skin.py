"""Skin keeps its colour in the light: a highlight is a small part of it, on dark skin too."""

import numpy as np
import pytest

from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.render.camera import Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from tests.projection import project

SIZE = (240, 240)


@pytest.mark.parametrize("tone", [0.2, 0.75, 1.0])
@pytest.mark.parametrize("yaw_deg", [0.0, -40.0])
def test_lit_cheeks_are_as_brown_as_the_skin(tone: float, yaw_deg: float) -> None:
    head = build_head(HeadStyle(skin_tone=tone, hair=False))
    camera = Camera(target_mm=(0.0, 5.0, 60.0), distance_mm=500.0, field_deg=12.0, yaw_deg=yaw_deg)
    with FaceRenderer(head, RenderOptions(size=SIZE, camera=camera)) as renderer:
        picture = (renderer.draw(np.zeros(68))[..., :3] / 255.0) ** 2.2
    x, y = project(camera, head.vertices_mm[[head.feature_points["5.2"]]].astype(float), SIZE)[0].round().astype(int)
    red, _, blue = picture[y - 24 : y + 25, x - 16 : x + 17].mean(axis=(0, 1))
    skin = Palette.of(tone).base
    assert blue / red == pytest.approx(skin[2] / skin[0], rel=0.12)
