"""How a face is drawn, as a value: what it refuses, and what it reads from text."""

import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.render.camera import Camera, preset
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, RenderOptions, parse_background, parse_edges, parse_size


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": (8, 192)}, r"size: got 8x192, expected a width and a height of 16 to 4096 pixels"),
        ({"size": (512, 4097)}, "size: got 512x4097"),
        ({"size": (512,)}, "size: got 512, expected a width and a height"),
        ({"camera": "front"}, "camera: got 'front', expected a Camera"),
        ({"samples": 3}, "samples: got 3, expected one of 0, 1, 2, 4, 8"),
        ({"shading": "flat"}, "shading: got 'flat', expected one of auto, pixels, vertices"),
        ({"scale": 1.5}, r"scale: got 1\.5, expected 0\.1 to 1"),
        ({"rest": 1.5}, r"rest: got 1\.5, expected 0 to 1"),
        ({"scale": 0.05}, r"scale: got 0\.05, expected"),
        ({"background": (1, 2)}, r"background: got \(1, 2\), expected 'studio', 'transparent', three integers"),
        ({"background": (0, 0, 256)}, r"background: got \(0, 0, 256\)"),
        ({"background": (0, 0, 0.5)}, r"background: got \(0, 0, 0\.5\)"),
        ({"background": "blue"}, "background: got 'blue'"),
        ({"background": None}, "background: got None"),
        ({"background": np.zeros((2, 2, 3))}, r"background: got float64 of shape \(2, 2, 3\), expected \(H, W, 3\)"),
        ({"background": np.zeros((2, 2, 4), np.uint8)}, r"background: got uint8 of shape \(2, 2, 4\)"),
        ({"background": np.zeros((0, 2, 3), np.uint8)}, r"background: got uint8 of shape \(0, 2, 3\)"),
    ],
)
def test_refuses(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=f"^{message}"):
        RenderOptions(**wrong)


def test_it_is_a_value() -> None:
    picture = np.zeros((4, 6, 3), np.uint8)
    drawing = RenderOptions(background=picture)
    picture[:] = 255
    assert isinstance(drawing.background, np.ndarray)
    assert not drawing.background.any()
    assert not drawing.background.flags.writeable
    other = replace(drawing, wire=True)
    assert other.background is drawing.background
    assert (other.wire, drawing.wire) == (True, False)
    with pytest.raises(FrozenInstanceError):
        drawing.wire = True  # type: ignore[misc]


def test_what_follows_from_it() -> None:
    drawing = RenderOptions(size=(300, 200), scale=0.35, background="transparent")
    assert (drawing.aspect, drawing.components, drawing.drawn_size) == (1.5, 4, (105, 70))
    assert (DEFAULT_RENDER_OPTIONS.components, DEFAULT_RENDER_OPTIONS.drawn_size) == (3, DEFAULT_RENDER_OPTIONS.size)


def test_it_is_read_from_text() -> None:
    drawing = RenderOptions.parse(size="640X480", camera="20,-5", background="#fa3", edges="soft", wire=True)
    assert (drawing.size, drawing.samples, drawing.wire) == ((640, 480), 0, True)
    assert drawing.camera == Camera(yaw_deg=20.0, pitch_deg=-5.0)
    assert drawing.background == (255, 170, 51)
    plain = RenderOptions.parse()
    assert (plain.size, plain.camera, plain.background, plain.samples) == ((512, 512), preset("front"), "studio", 0)
    picture = np.zeros((4, 6, 3), np.uint8)
    assert np.array_equal(RenderOptions.parse(background=picture).background, picture)
    assert [parse_edges(name) for name in ("fine", "soft", "none")] == [4, 0, 1]
    assert parse_size("96") == (96, 96)
    assert [parse_background(name) for name in ("studio", "none", "transparent")] == [
        "studio",
        "transparent",
        "transparent",
    ]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": "big"}, "size: got 'big', expected WIDTHxHEIGHT such as 512x512"),
        ({"size": "8x8"}, "size: got 8x8"),
        ({"camera": "behind"}, "camera: got 'behind', expected one of front"),
        ({"background": "#12345"}, "background: got '#12345', expected a colour such as #f0e8d8"),
        ({"background": "pink"}, "background: got 'pink', expected studio, none, a colour"),
        ({"edges": "hard"}, "edges: got 'hard', expected one of fine, soft, none"),
    ],
)
def test_refuses_text(wrong: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=f"^{message}"):
        RenderOptions.parse(**wrong)


def test_describing_needs_no_opengl() -> None:
    code = "import sys, fapengine.render.drawing; sys.exit('moderngl' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
