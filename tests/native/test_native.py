"""The renderer in C draws what the shaders draw, whatever the instructions; and fapengine chooses between the two."""

import logging
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import av
import numpy as np
import pytest

import fapengine
from fapengine import FapTrack
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.files.moving import rgb_of, takes_planes, write_moving
from fapengine.render import native
from fapengine.render.camera import Camera
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import NativeCrowd, NativeRenderer, open_crowd_renderer, open_renderer
from fapengine.render.renderer import CrowdRenderer, FaceRenderer
from tests.conftest import NO_COMPILER
from tests.native import built
from tests.native.images import MIN_ALIKE, Image, alike, faps_of, head_of, images

CHEAP = 12
"""Of the images, those with the default head; the others build heads."""
SMALL = RenderOptions(size=(96, 128))


@pytest.fixture(scope="module")
def library() -> Iterator[ModuleType]:
    if not built.has_compiler():
        pytest.skip(NO_COMPILER)
    path = list(sys.path)
    module = built.imported()
    yield module
    sys.path[:] = path
    built.forget()
    for name in ("Face", "select", "resized"):
        native.fapengine_native.__dict__.pop(name, None)


@pytest.fixture
def without_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "1")
    monkeypatch.delenv(native.VARIABLE, raising=False)


ALL = [
    pytest.param(image, id=image.name, marks=[] if number < CHEAP or "imported" in image.name else pytest.mark.nightly)
    for number, image in enumerate(images())
]


def test_there_are_thirty_different_images() -> None:
    assert len({image.name for image in images()}) == 30


@pytest.mark.parametrize("image", ALL)
def test_images_are_those_of_opengl(library: ModuleType, image: Image) -> None:
    head = head_of(image.head, max(image.size))
    with FaceRenderer(head, image.drawing) as gl, NativeRenderer(head, image.drawing) as ours:
        pictures = [renderer.draw(faps_of(image.pose)) for renderer in (gl, ours)]
    assert alike(*pictures) >= MIN_ALIKE


@pytest.mark.parametrize("name", ["default", "imported textured, holes"])
def test_all_instructions_draw_the_same_bytes(library: ModuleType, name: str) -> None:
    drawn = set()
    chosen = []
    for instructions in ("x86-64", "x86-64-v3", "x86-64-v4"):
        try:
            chosen.append(library.select(instructions))
        except ValueError:
            continue
        with NativeRenderer(head_of(name, 200), RenderOptions(size=(200, 150))) as renderer:
            drawn.add(b"".join(picture.tobytes() for picture in renderer.frames(map(faps_of, ("rest", "random9")))))
    library.select()
    assert chosen
    assert len(drawn) == 1


def test_the_fastest_instructions_of_the_processor_are_chosen(library: ModuleType) -> None:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    flags = set(next((line for line in lines if line.startswith("flags")), "").split())
    name = platform.machine().replace("x86_64", "x86-64")
    if {"avx2", "bmi1", "bmi2", "fma", "f16c", "movbe", "abm"} <= flags:
        name = "x86-64-v3"
        if {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"} <= flags:
            name = "x86-64-v4"
    assert library.select() == name


def test_a_frame_does_not_depend_on_those_before(library: ModuleType) -> None:
    head = head_of("default", 128)
    poses = ["turned", "rest", "open", "rest", "turned"]
    with NativeRenderer(head, SMALL) as renderer:
        one, two, three, four, five = renderer.frames(map(faps_of, poses))
    assert (two == four).all()
    assert (one == five).all()
    assert (two != three).any()


def test_a_turned_camera_draws_the_still_parts_again(library: ModuleType) -> None:
    head = head_of("default", 128)
    side = Camera(yaw_deg=60.0)
    with (
        NativeCrowd([head, head], SMALL, columns=2) as crowd,
        NativeRenderer(head, replace(SMALL, camera=side)) as alone,
    ):
        crowd.cameras[1] = side
        both = crowd.draw(np.zeros((2, 68)))
        assert (both[:, 96:] == alone.draw(np.zeros(68))).all()
    with CrowdRenderer([head, head], SMALL, columns=2) as gl:
        gl.cameras[1] = side
        assert alike(gl.draw(np.zeros((2, 68))), both) >= MIN_ALIKE


def test_faces_of_a_crowd_are_the_faces_alone(library: ModuleType) -> None:
    """OpenGL's are not: it smooths across their borders, and odd sizes shift its pairs of pixels."""
    head, drawing = head_of("default", 128), RenderOptions(size=(97, 63))
    faps = np.stack([faps_of(pose) for pose in ("joy", "open", "aside", "blink")])
    with NativeCrowd([head] * 4, drawing, columns=2) as crowd:
        drawn = crowd.draw(faps)
    with NativeRenderer(head, drawing) as one, FaceRenderer(head, drawing) as gl:
        for number, values in enumerate(faps):
            left, top = crowd.corner(number)
            tile = drawn[top : top + 63, left : left + 97]
            assert (tile == one.draw(values)).all()
            assert alike(gl.draw(values), tile) >= MIN_ALIKE


def test_i420_is_the_picture(library: ModuleType) -> None:
    head = head_of("default", 128)
    with NativeRenderer(head, RenderOptions(size=(97, 63))) as renderer:
        picture = renderer.draw(faps_of("joy")).astype(float)
        face, uniforms = renderer._native._face, renderer._native
        values = uniforms.values(native.frame_uniforms(head, native.with_rest(faps_of("joy"), 1.0)))
        planes = face.draw(values, at_vertices=True, form="i420")
    luma = planes[: 97 * 63].reshape(63, 97)
    expected = 16 + picture @ (65.738 / 256, 129.057 / 256, 25.064 / 256)
    assert np.abs(luma - expected).max() < 1.5
    assert len(planes) == 97 * 63 + 2 * 49 * 32
    means = picture[:62, :96].reshape(31, 2, 48, 2, 3).mean(axis=(1, 3))
    for plane, row in (
        (planes[97 * 63 :][: 49 * 32], (-37.945, -74.494, 112.439)),
        (planes[-49 * 32 :], (112.439, -94.154, -18.285)),
    ):
        assert np.abs(plane.reshape(32, 49)[:31, :48] - (128 + means @ np.array(row) / 256)).max() < 1.5


def test_a_film_of_planes_is_the_film_of_colours(library: ModuleType, tmp_path: Path) -> None:
    head, drawing = head_of("default", 128), RenderOptions(size=(96, 128))
    poses = [faps_of(pose) for pose in ("rest", "open", "joy", "turned")]
    with NativeRenderer(head, drawing) as renderer:
        drawn = [renderer.draw(pose) for pose in poses]
        planes = list(renderer.frames(poses, "i420"))
    assert planes[0].shape == (192, 96)
    for path in (tmp_path / "a.mp4", tmp_path / "a.webm"):
        assert takes_planes(path)
        errors = []
        for pictures in (drawn, planes):
            write_moving(path, pictures, rate_hz=25.0)
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                shown = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
                about = stream.codec_context
                assert (about.width, about.height, about.pix_fmt, len(shown)) == (96, 128, "yuv420p", 4)
            errors.append(np.mean((np.array(shown, float) - drawn) ** 2))
        assert errors[1] < 1.05 * errors[0]  # of what the encoder leaves out of them
    assert np.abs(rgb_of(planes[1]).astype(int) - drawn[1]).mean() < 2
    assert rgb_of(drawn[1]) is drawn[1]
    assert not takes_planes(Path("a.webp"))  # whose sides may be odd


def test_a_mesh_with_numbers_that_index_nothing_is_refused(library: ModuleType) -> None:
    entries = np.zeros((1, 1024, 4), np.float32)
    vertices = np.zeros((3, 21), np.float32)
    for column, value in ((16, 5), (16, -1), (19, -1), (20, 2000), (20, np.nan)):
        wrong = vertices.copy()
        wrong[0, column] = value
        with pytest.raises(ValueError, match="does not exist"):
            library.Face(wrong, entries, entries, {})
    with pytest.raises(ValueError, match="does not exist"):
        library.Face(vertices, entries, entries, {"face": np.array([[0, 1, 3]])})
    with pytest.raises(ValueError, match="does not exist"):
        library.Face(vertices, entries + np.float32(128), entries, {})


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"parts": {"face": np.zeros(3)}}, r"face: got shape \(3,\), expected \(F, 3\)"),
        ({"parts": {"face": np.zeros((4, 2))}}, r"face: got shape \(4, 2\)"),
        ({"parts": {"nose": np.zeros((1, 3))}}, "got nose, expected of face"),
        ({"vertices": np.zeros((3, 20))}, r"vertices: got shape \(3, 20\)"),
        ({"normal_deltas": np.zeros((2, 1024, 4))}, "entries: got shapes"),
        ({"displacements": np.zeros((1, 1024, 3)), "normal_deltas": np.zeros((1, 1024, 3))}, "entries: got shapes"),
    ],
)
def test_arrays_of_another_shape_are_refused(library: ModuleType, arrays: dict[str, Any], message: str) -> None:
    entries = np.zeros((1, 1024, 4))
    right = {"vertices": np.zeros((3, 21)), "displacements": entries, "normal_deltas": entries, "parts": {}}
    with pytest.raises(ValueError, match=message):
        library.Face(**(right | arrays))


def test_what_a_face_cannot_do_is_an_error(library: ModuleType) -> None:
    entries, uniforms = np.zeros((1, 1024, 4)), np.zeros(library.UNIFORMS)
    face = library.Face(np.zeros((3, 21)), entries, entries, {})
    with pytest.raises(ValueError, match="expected a canvas first"):
        face.draw(uniforms, at_vertices=True)
    for size in ((0, 5), (5, 4097)):
        with pytest.raises(ValueError, match="expected a width and a height of 1 to 4096"):
            face.canvas(size)
    with pytest.raises(ValueError, match="of 1 to 32768 texels"):
        face.skin(np.zeros((0, 2, 4)))
    face.canvas((1, 1))
    assert face.draw(uniforms, at_vertices=True, form="i420").tolist() == [16, 128, 128]
    with pytest.raises(ValueError, match="got 'bgr', expected one of rgb, rgba, i420"):
        face.draw(uniforms, at_vertices=True, form="bgr")
    face.close()
    face.close()
    for use in (
        lambda: face.draw(uniforms, at_vertices=True),
        lambda: face.canvas((2, 2)),
        lambda: face.skin(np.zeros((1, 1, 4))),
    ):
        with pytest.raises(ValueError, match="closed"):
            use()


def test_a_clipped_triangle_of_huge_numbers_has_few_corners(library: ModuleType) -> None:
    """Differences of these overflow, so that planes cut the triangle more often than planes can."""
    clip = [
        (-8.33625745e-05, 2, 1.59999999e38, -1),
        (0, -4.02202181e-32, 9.92748496e-40, -1.3476801e-08),
        (3, 0, 2.64438372e15, 5.02279059e29),
    ]
    vertices, entries, uniforms = np.zeros((3, 21)), np.zeros((1, 1024, 4)), np.zeros(library.UNIFORMS)
    vertices[:, :3] = np.eye(3)
    uniforms[217:229] = np.ravel(clip)
    face = library.Face(vertices, entries, entries, {"face": [[0, 1, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]]})
    face.canvas((100, 100))
    assert face.draw(uniforms, at_vertices=True).shape == (100, 100, 3)


def test_faces_draw_in_several_threads(library: ModuleType) -> None:
    """One face in two threads, and closed in a third, is slower or an error; two faces are as alone."""
    head = head_of("default", 128)
    poses = [faps_of(name) for name in ("rest", "open", "turned", "joy")] * 5
    with NativeRenderer(head, SMALL) as one, NativeRenderer(head, SMALL) as two, ThreadPoolExecutor(4) as threads:
        alone = [one.draw(pose).tobytes() for pose in poses]
        for renderers in ([one, two], [one, one]):
            drawn = threads.map(lambda each: [each.draw(pose).tobytes() for pose in poses], renderers)
            assert list(drawn) == [alone, alone]
        late = threads.submit(lambda: [one.draw(pose).tobytes() for pose in poses])
        one.release()
        error = late.exception()
        assert isinstance(error, ValueError) or (error is None and late.result() == alone)


def test_auto_is_native_where_there_is_no_gpu(
    library: ModuleType, without_gpu: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = head_of("default", 128)
    with open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, NativeRenderer)
    with open_crowd_renderer([head], SMALL, columns=1) as crowd:
        assert isinstance(crowd, NativeCrowd)
    for drawing in (replace(SMALL, renderer="gl"), replace(SMALL, wire=True), replace(SMALL, samples=4)):
        with open_renderer(head, drawing) as renderer:
            assert isinstance(renderer, FaceRenderer)
    monkeypatch.setenv(native.VARIABLE, "gl")
    with open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, FaceRenderer)
    with open_renderer(head, replace(SMALL, renderer="native")) as renderer:
        assert isinstance(renderer, NativeRenderer)


def test_a_gpu_draws_by_opengl_unless_its_driver_is_missing(
    library: ModuleType, without_gpu: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(native, "has_gpu", lambda: True)
    head = head_of("default", 128)
    with open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, FaceRenderer)

    def no_driver(*_: object) -> None:
        raise ResourceError("OpenGL: no context")

    monkeypatch.setattr(native, "FaceRenderer", no_driver)
    with open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, NativeRenderer)
    with pytest.raises(ResourceError, match="no context"):
        open_renderer(head, replace(SMALL, renderer="gl"))


def test_auto_draws_by_opengl_where_the_library_cannot_be_loaded(
    library: ModuleType, without_gpu: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise ResourceError("renderer native: fapengine-native cannot be loaded")

    monkeypatch.setattr(native, "NativeRenderer", broken)
    head = head_of("default", 128)
    with caplog.at_level(logging.WARNING), open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, FaceRenderer)
    assert [record.getMessage() for record in caplog.records] == [
        "renderer native: fapengine-native cannot be loaded; OpenGL draws instead"
    ]
    with pytest.raises(ResourceError, match="cannot be loaded"):
        open_renderer(head, replace(SMALL, renderer="native"))


def test_what_native_cannot_draw_is_said(
    library: ModuleType, without_gpu: None, caplog: pytest.LogCaptureFixture
) -> None:
    head = head_of("default", 128)
    with caplog.at_level(logging.WARNING), open_renderer(head, replace(SMALL, wire=True)):
        pass
    assert [record.getMessage() for record in caplog.records] == [
        "renderer: OpenGL draws this image, because native does not draw the wireframe"
    ]
    with pytest.raises(UsageError, match="native does not draw multisampled edges"):
        open_renderer(head, replace(SMALL, renderer="native", samples=4))


def test_without_the_package_opengl_draws_and_native_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, without_gpu: None
) -> None:
    monkeypatch.setitem(sys.modules, "fapengine_native", None)
    monkeypatch.delitem(native.fapengine_native.__dict__, "Face", raising=False)  # kept when it was first used
    monkeypatch.setattr(native, "find_spec", lambda name: None)
    head = head_of("default", 128)
    with open_renderer(head, SMALL) as renderer:
        assert isinstance(renderer, FaceRenderer)
    with pytest.raises(ResourceError, match=r"pip install fapengine-native \(in a checkout: make native\)"):
        open_renderer(head, replace(SMALL, renderer="native"))


@pytest.mark.parametrize("name", ["cpu", ""])
def test_renderers_have_names(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FapEngineError, match="expected one of auto, native, gl"):
        RenderOptions(renderer=name)
    if name:
        monkeypatch.setenv(native.VARIABLE, name)
        with pytest.raises(UsageError, match="FAPENGINE_RENDERER: got 'cpu', expected one of auto, native, gl"):
            native.asked_renderer(RenderOptions())


WITHOUT_EGL = """
import ctypes.util, sys
import glcontext
def no_egl(*args, **settings):
    raise Exception("libEGL.so not loaded")
glcontext.get_backend_by_name = glcontext.default_backend = lambda *_: no_egl
from fapengine.cli import main
sys.argv = ["fapengine", *sys.argv[1:]]
main()
"""


def test_a_video_is_written_where_libegl_cannot_be_loaded(library: ModuleType, tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != native.VARIABLE} | {
        "PYTHONPATH": os.pathsep.join([str(built.built()), str(built.HERE)]), "LIBGL_ALWAYS_SOFTWARE": "1",
    }  # fmt: skip
    track = tmp_path / "a.fap"
    fapengine.save(FapTrack.from_values(np.zeros((3, 68)), rate_hz=25.0), track)
    command = [sys.executable, "-c", WITHOUT_EGL, "render", str(track), "-o", str(tmp_path / "a.mp4"), "--size", "96"]
    failed = subprocess.run([*command, "--renderer", "gl"], env=environment, capture_output=True, text=True)
    assert failed.returncode == 3, failed.stderr
    assert "libEGL.so not loaded" in failed.stderr
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.mp4").stat().st_size > 1000


@pytest.mark.parametrize(
    ("target", "tag"),
    [
        ("x86_64-linux-gnu.2.28", "manylinux_2_28_x86_64"),
        ("aarch64-linux-gnu.2.28", "manylinux_2_28_aarch64"),
        ("x86_64-windows-gnu", "win_amd64"),
        ("x86_64-macos.11.0", "macosx_11_0_x86_64"),
        ("aarch64-macos.11.0", "macosx_11_0_arm64"),
    ],
)
def test_wheels_for_other_systems_have_their_tags(target: str, tag: str) -> None:
    assert built.build_hook().tag(target) == f"py3-none-{tag}"
    assert target in (built.HERE / "Makefile").read_text()


@pytest.mark.parametrize("target", ["x86_64-linux-gnu", "aarch64-macos", "riscv64-windows-gnu", "x86_64-freebsd"])
def test_targets_that_name_no_wheel_are_refused(target: str) -> None:
    with pytest.raises(RuntimeError, match=f"{target}: expected MACHINE-linux-gnu.GLIBC"):
        built.build_hook().tag(target)


def test_the_package_has_the_version_and_the_licence_of_fapengine() -> None:
    ours, native_ = (tomllib.loads((built.HERE / folder / "pyproject.toml").read_text()) for folder in (".", "native"))
    assert native_["project"]["dynamic"] == ["version"]
    scheme = ours["tool"]["hatch"]["version"]["raw-options"]["version_scheme"]
    assert native_["tool"]["hatch"]["version"]["raw-options"]["version_scheme"] == scheme
    assert (built.SOURCE / "LICENSE").read_bytes() == (built.HERE / "LICENSE").read_bytes()
