"""The renderer's savings: edges are softened where the head is, and what no FAP moves is drawn once a camera."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import single_fap
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.render.camera import PRESETS, Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.model import still_vertices
from fapengine.render.packing import frame_uniforms, pack
from fapengine.render.renderer import FaceRenderer, Reach

SIZE = (128, 128)
POSES = np.array([single_fap(number) for number in range(3, 69)])


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.mark.parametrize("camera", ["front", "profile"])
def test_softening_parts_is_softening_all(head: FaceMesh, camera: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with FaceRenderer(head, RenderOptions(size=SIZE, camera=PRESETS[camera])) as renderer:
        in_parts = [renderer.draw(faps).copy() for faps in POSES]
        monkeypatch.setattr(Reach, "rectangles", lambda *_: [(0, 0, *SIZE)])
        for number, part, faps in zip(range(3, 69), in_parts, POSES, strict=True):
            assert np.array_equal(part, renderer.draw(faps)), fap.spec(number).name


def test_a_head_before_its_shoulders_leaves_much_out(head: FaceMesh) -> None:
    upper, lower = Reach(head).rectangles(frame_uniforms(head, np.zeros(68)), PRESETS["front"], SIZE)
    assert upper[1] + upper[3] == lower[1]
    assert upper[2] * upper[3] + lower[2] * lower[3] < 0.75 * 128**2


def test_what_is_behind_the_camera_has_no_bounds(head: FaceMesh) -> None:
    for target_z_mm in (-40.0, -1500.0):  # from within the head, and with all of it behind
        camera = Camera(target_mm=(0.0, 10.0, target_z_mm), distance_mm=101.0)
        assert Reach(head).rectangles(frame_uniforms(head, np.zeros(68)), camera, SIZE) == [(0, 0, *SIZE)]


def test_a_head_without_shoulders_or_outside_of_the_picture(head: FaceMesh) -> None:
    floating = replace(head, head_weight=np.ones_like(head.head_weight))
    reach, rest = Reach(floating), frame_uniforms(head, np.zeros(68))
    assert len(reach.rectangles(rest, PRESETS["front"], SIZE)) == 1
    aside = replace(PRESETS["front"], target_mm=(2000.0, 0.0, 0.0))
    assert reach.rectangles(rest, aside, SIZE) == []


def test_a_picture_behind_the_head_is_softened_everywhere(head: FaceMesh) -> None:
    stripes = np.zeros((*SIZE, 3), dtype=np.uint8)
    stripes[np.add.outer(np.arange(128), np.arange(128)) % 16 < 8] = 255
    with FaceRenderer(head, RenderOptions(size=SIZE, background=stripes)) as renderer:
        corner = renderer.draw(np.zeros(68))[:20, :20]
    assert len(np.unique(corner)) > 2


@pytest.mark.parametrize(
    "change",
    [
        {"camera": PRESETS["profile"]},
        {"background": (200, 30, 30)},
        {"wire": True},
        {"shading": "pixels"},
        {"scale": 0.5},
    ],
)
def test_shoulders_and_wall_are_drawn_anew_where_they_change(head: FaceMesh, change: dict[str, object]) -> None:
    before = RenderOptions(size=SIZE)
    after = replace(before, **change)  # type: ignore[arg-type]
    with FaceRenderer(head, before) as changed, FaceRenderer(head, after) as fresh:
        first = changed.draw(POSES[0]).copy()
        changed.drawing = after
        assert np.array_equal(changed.draw(POSES[0]), fresh.draw(POSES[0]))
        changed.drawing = before
        assert np.array_equal(changed.draw(POSES[0]), first)


def test_what_stands_still_is_the_shirt(head: FaceMesh) -> None:
    still, cloth = still_vertices(pack(head)), head.material == Material.CLOTH
    assert still[cloth & (head.head_weight == 0)].all()
    assert still[cloth].mean() > 0.35  # the rest is the collar
    assert head.vertices_mm[still, 1].max() < -97  # and where the neck ends, 2 mm higher with charm
