"""The window, on a display of software (Xvfb) with Mesa."""

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from fapengine.errors import ResourceError, UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.render.camera import PRESETS
from fapengine.render.drawing import RenderOptions
from fapengine.render.renderer import FaceRenderer
from fapengine.render.window import BORDER, FaceWindow, _fitted, start_glfw, try_window
from tests.processes import start

SIZE = (320, 320)


@pytest.fixture(scope="module")
def display() -> Iterator[None]:
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"]
    with start(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        with os.fdopen(read) as pipe, pytest.MonkeyPatch.context() as patch:
            patch.setenv("DISPLAY", f":{pipe.readline().strip()}")
            patch.delenv("WAYLAND_DISPLAY", raising=False)
            patch.delenv("XDG_SESSION_TYPE", raising=False)
            yield
            import glfw

            glfw.terminate()
        server.terminate()


@pytest.fixture
def window(display: None) -> Iterator[FaceWindow]:
    with FaceWindow(mesh(), RenderOptions(size=SIZE), vsync=False) as opened:
        yield opened


REST = np.zeros(68)


def mesh() -> FaceMesh:
    return build_head(level="coarse")


def speaking() -> np.ndarray:
    faps = np.zeros(68)
    faps[fap.column(3)] = 400
    return faps


def test_it_gives_quality_up_for_a_rate(display: None) -> None:
    with FaceWindow(build_head(), RenderOptions(size=SIZE), coarser=[mesh()], vsync=False, hold_hz=1000.0) as hasty:
        hasty.show(REST)
        assert (hasty.quality.level, hasty.quality.scale) == (0, 1)
        for _ in range(300):
            hasty.show(REST)
            if hasty.quality.scale < 0.5:
                break
        assert hasty.quality.level == 1
        assert hasty.quality.scale < 0.5
        hasty.show(REST)
        rough = hasty.picture().astype(int)
    with FaceWindow(mesh(), RenderOptions(size=SIZE), vsync=False) as calm:
        calm.show(REST)
        assert str(calm.quality) == "every pixel, the finest head"
        assert 0.2 < np.abs(calm.picture() - rough).mean() < 10


def test_it_shows_what_the_renderer_draws(window: FaceWindow) -> None:
    window.show(REST)
    picture = window.picture()
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    with FaceRenderer(mesh(), RenderOptions(size=SIZE)) as renderer:
        drawn = renderer.draw(REST)
    np.testing.assert_allclose(picture.astype(int), drawn.astype(int), atol=1)
    assert set(window._program) - {"gl_VertexID"} == {"u_picture"}


def test_frames_differ_while_speaking_and_the_rate_is_told(window: FaceWindow) -> None:
    window.show(REST)
    assert window.rate_hz == 0.0
    before = window.picture()
    window.show(speaking())
    changed = np.abs(window.picture().astype(int) - before).max(axis=-1) > 24
    assert changed.sum() > 200
    assert not changed[: SIZE[1] // 3].any()  # the forehead does not speak
    assert window.rate_hz > 0
    assert 0 < window.busy_s < 5


def test_characters_come_out_and_escape_closes(window: FaceWindow) -> None:
    import glfw

    for character in "a S":
        window._on_character(window._window, ord(character))
    assert window.show(REST) == ["a", " ", "s"]
    assert window.show(REST) == []
    window._on_key(window._window, glfw.KEY_ESCAPE, 0, glfw.RELEASE, 0)
    assert window.is_open
    window._on_key(window._window, glfw.KEY_ESCAPE, 0, glfw.PRESS, 0)
    assert not window.is_open


@pytest.mark.parametrize("letter", "qQ")
def test_letters_are_those_of_the_layout_and_large_or_small(window: FaceWindow, letter: str) -> None:
    """Where a Q is, a French keyboard has an A."""
    import glfw

    window._on_key(window._window, glfw.KEY_Q, 0, glfw.PRESS, 0)
    window._on_character(window._window, ord("a"))
    assert window.is_open
    for character in "bB":
        window._on_character(window._window, ord(character))
    assert window.show(REST) == ["a", "b", "b"]
    window._on_character(window._window, ord("2"))
    window._on_character(window._window, ord("R"))
    assert window.camera == PRESETS["front"]
    window._on_character(window._window, ord(letter))
    assert not window.is_open


def test_the_window_listens(window: FaceWindow) -> None:
    """The other tests call what listens; here is who calls it."""
    import glfw

    for kind, mine in (
        ("key", window._on_key), ("char", window._on_character), ("mouse_button", window._on_button),
        ("cursor_pos", window._on_pointer), ("scroll", window._on_wheel),
    ):  # fmt: skip
        assert getattr(glfw, f"set_{kind}_callback")(window._window, None) == mine, kind


def test_the_camera_turns_by_pointer_and_keys(window: FaceWindow) -> None:
    import glfw

    window.show(REST)
    front = window.picture()
    glfw.set_cursor_pos(window._window, 100, 100)
    window._on_button(window._window, glfw.MOUSE_BUTTON_RIGHT, glfw.PRESS, 0)
    window._on_pointer(window._window, 10.0, 10.0)
    assert window.camera == PRESETS["front"]
    window._on_button(window._window, glfw.MOUSE_BUTTON_LEFT, glfw.PRESS, 0)
    window._on_pointer(window._window, 50.0, 110.0)
    window._on_button(window._window, glfw.MOUSE_BUTTON_LEFT, glfw.RELEASE, 0)
    assert window.camera.yaw_deg == pytest.approx(20.0, abs=1)
    assert window.camera.pitch_deg == pytest.approx(4.0, abs=1)
    window.show(REST)
    assert (np.abs(window.picture().astype(int) - front).max(axis=-1) > 24).mean() > 0.05
    window._on_wheel(window._window, 0.0, 3.0)
    assert window.camera.field_deg < PRESETS["front"].field_deg
    for _ in range(40):
        window._on_key(window._window, glfw.KEY_UP, 0, glfw.REPEAT, 0)
        window._on_key(window._window, glfw.KEY_LEFT, 0, glfw.REPEAT, 0)
        window._on_wheel(window._window, 0.0, -3.0)
    assert (window.camera.pitch_deg, window.camera.field_deg) == (75.0, 45.0)
    assert -180 <= window.camera.yaw_deg < 180
    window._on_character(window._window, ord("3"))
    assert window.camera == PRESETS["profile"]
    window._on_character(window._window, ord("r"))
    assert window.camera == PRESETS["front"]


def test_it_may_change_size(window: FaceWindow) -> None:
    import glfw

    window.show(REST)
    before = window._renderer
    glfw.set_window_size(window._window, 700, 400)
    while window._pixels() != (700, 400):
        window.show(REST)
    window.show(REST)
    if window._renderer is before:  # while it is pulled, the old picture is fitted in, not squeezed
        assert window._renderer.drawing.size == SIZE
        edge = window.picture()[200, 5]
        np.testing.assert_allclose(edge, [255 * part for part in BORDER], atol=1)
    while window._renderer is before:
        window.show(REST)
    assert window._renderer is not None
    assert window._renderer.drawing.size == (700, 400)
    assert window.picture().shape == (400, 700, 3)


def test_a_picture_keeps_its_proportions() -> None:
    assert _fitted((320, 320), (440, 400)) == (20, 0, 400, 400)
    assert _fitted((400, 200), (200, 200)) == (0, 50, 200, 100)
    assert _fitted((64, 64), (64, 64)) == (0, 0, 64, 64)


def test_other_renderers_may_draw_before_and_between(display: None) -> None:
    """X ends a process that makes a window's context current while EGL's is."""
    with FaceRenderer(mesh(), RenderOptions(size=(64, 64), samples=0)) as other:
        before = other.draw(REST)
        with FaceWindow(mesh(), RenderOptions(size=SIZE), vsync=False) as window:
            window.show(REST)
            seen = window.picture()
            np.testing.assert_array_equal(other.draw(REST), before)
            window.show(REST)
            np.testing.assert_array_equal(window.picture(), seen)
        assert try_window()
        np.testing.assert_array_equal(other.draw(REST), before)


def test_refuses(display: None) -> None:
    with pytest.raises(UsageError, match="size: got 50x50"):
        FaceWindow(mesh(), RenderOptions(size=(50, 50)))
    window = FaceWindow(mesh(), RenderOptions(size=SIZE))
    window.close()
    window.close()
    assert not window.is_open
    with pytest.raises(UsageError, match="window: is closed"):
        window.show(REST)


def test_glfw_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "glfw", None)
    with pytest.raises(ResourceError, match=r"install it with: pip install \"fapengine\[window\]\""):
        start_glfw()


def test_no_display_is_said_plainly() -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    code = "from fapengine.render.window import start_glfw\nstart_glfw()"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert "ResourceError: window: no display (X11: The DISPLAY environment variable is missing)" in done.stderr
    assert "`fapengine serve` shows the face in a browser" in done.stderr


def test_no_opengl_is_said_plainly(display: None, monkeypatch: pytest.MonkeyPatch) -> None:
    import glfw

    def refuse(*_: object) -> None:
        raise glfw.GLFWError("GLX: Failed to create context")

    monkeypatch.setattr(glfw, "create_window", refuse)
    with pytest.raises(ResourceError, match=r"no OpenGL 3\.3 on this display .*GLX"):
        FaceWindow(mesh(), RenderOptions(size=SIZE))
