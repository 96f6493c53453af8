"""The renderer against the numpy reference, and its pictures' invariants."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import ResourceError, UsageError
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.render import context as context_module
from fapengine.render import programs
from fapengine.render.camera import PRESETS, Camera, preset, turned
from fapengine.render.context import create_context
from fapengine.render.drawing import RenderOptions, Shading
from fapengine.render.packing import ATTRIBUTE_SIZES, frame_uniforms, normal_deltas
from fapengine.render.renderer import FaceRenderer
from tests.projection import project

SIZE = (192, 192)
WIDE_OPEN = {3: 500, 4: -150, 5: -520, 8: -110, 9: -110, 10: -420, 11: -420, 51: -140, 52: -520, 55: -100, 56: -100,
             57: -420, 58: -420}  # fmt: skip


def frame(values: dict[int, float]) -> NDArray[np.float64]:
    faps = np.zeros(68)
    for number, value in values.items():
        faps[fap.column(number)] = value
    return faps


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.fixture(scope="module")
def renderer(head: FaceMesh) -> Iterator[FaceRenderer]:
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=0)) as made:
        yield made


def _positions(renderer: FaceRenderer, capture: moderngl.Program, faps: NDArray[np.float64]) -> NDArray[np.float32]:
    """Where the vertex shader puts every vertex."""
    context, model, head = renderer._context, renderer._model, renderer.mesh
    uniforms = frame_uniforms(head, faps)
    values = {"u_channels": uniforms.channels, "u_bones": uniforms.bones}
    for name, value in values.items():
        capture[name].write(value)  # type: ignore[union-attr]
    model._displacements.use(0)
    used = [name for name in programs.FACE_ATTRIBUTES if name in capture]
    layout = " ".join(
        form if name in used else f"{4 * ATTRIBUTE_SIZES[name]}x" for name, form in programs.FACE_ATTRIBUTES.items()
    )
    array = context.vertex_array(capture, [(model._vertices, layout, *used)])
    out = context.buffer(reserve=head.vertices_mm.nbytes)
    array.transform(out, moderngl.POINTS, vertices=len(head.vertices_mm))
    return np.frombuffer(out.read(), dtype="f4").reshape(-1, 3)


def test_the_gpu_moves_vertices_as_the_reference_does(head: FaceMesh) -> None:
    """Run the vertex shader with transform feedback over frames that use every FAP."""
    rng = np.random.default_rng(8)
    with FaceRenderer(head, RenderOptions(size=(16, 16), samples=0)) as renderer:
        context = renderer._context
        source = programs.stage_source(("face.vert",))
        with context:
            capture = context.program(vertex_shader=source, varyings=["v_position"])
        for _ in range(3):
            faps = rng.normal(0, 120, 68)
            faps[fap.column(19) : fap.column(23)] = rng.uniform(0, 900, 4)
            for number in (23, 24, 25, 26, 48, 49, 50):
                faps[fap.column(number)] = rng.normal(0, 9000)
            renderer.draw(faps)  # without a target bound, nothing runs
            with context:
                got = _positions(renderer, capture, faps)
            assert np.abs(got - deform(head, faps)).max() < 0.01  # mm


def test_normals_turn_with_the_surface(head: FaceMesh) -> None:
    faps = frame({5: -300, 10: -250, 11: -250, 52: -300, 31: 150, 33: 150})
    basis = head.basis
    from fapengine.mesh.deform import channel_weights

    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    turned = head.normals.astype(float)
    np.add.at(turned, vertex, channel_weights(basis, faps)[basis.entry_channels, None] * normal_deltas(head))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    true = vertex_normals(deform(head, faps), head.triangles)
    moved = np.linalg.norm(deform(head, faps) - head.vertices_mm, axis=1) > 0.5
    error = np.degrees(np.arccos(np.clip((turned * true).sum(axis=1), -1, 1)))[moved]
    still = np.degrees(np.arccos(np.clip((head.normals * true).sum(axis=1), -1, 1)))[moved]
    assert moved.sum() > 200
    assert np.median(error) < 0.5 * np.median(still)


def test_the_face_fills_its_place(renderer: FaceRenderer, head: FaceMesh) -> None:
    picture = renderer.draw(np.zeros(68))
    assert picture.shape == (*SIZE[::-1], 3)
    x, y = project(renderer.drawing.camera, head.point_mm("9.3"), SIZE).astype(int)
    nose, corner = picture[y, x].astype(int), picture[3, 3].astype(int)
    assert nose[0] > nose[2] + 30  # skin is warm
    assert corner[2] > corner[0]  # the wall is cool
    shirt = picture[-3, SIZE[0] // 2].astype(int)
    assert shirt[2] > shirt[0] + 20


def mouth_inside(picture: NDArray[np.uint8], head: FaceMesh, camera: Camera) -> int:
    """Pixels between the outer lip contours that are darker than lips: little green comes out of a mouth."""
    left, right = (project(camera, head.point_mm(name), SIZE) for name in ("8.4", "8.3"))
    top, bottom = project(camera, head.point_mm("8.1"), SIZE)[1], project(camera, head.point_mm("2.10"), SIZE)[1]
    box = picture[int(top) : int(bottom), int(left[0]) : int(right[0])]
    return int((box[..., 1] < 85).sum())


def test_an_open_mouth_shows_its_inside(renderer: FaceRenderer, head: FaceMesh) -> None:
    closed, opened = (
        mouth_inside(renderer.draw(faps), head, renderer.drawing.camera) for faps in (np.zeros(68), frame(WIDE_OPEN))
    )
    assert opened > closed + 25  # nostrils are dark, too


def test_closed_lids_hide_the_iris(renderer: FaceRenderer, head: FaceMesh) -> None:
    x, y = project(renderer.drawing.camera, head.point_mm("3.5"), SIZE).astype(int)
    awake, asleep = (renderer.draw(frame(values))[y, x].astype(int) for values in ({}, {19: 1024, 20: 1024}))
    assert awake.max() < 110
    assert asleep[0] > 110


def test_gaze_moves_the_iris(renderer: FaceRenderer, head: FaceMesh) -> None:
    left = renderer.draw(frame({23: 40_000, 24: 40_000})).astype(int)
    right = renderer.draw(frame({23: -40_000, 24: -40_000})).astype(int)
    x, y = project(renderer.drawing.camera, head.point_mm("3.5"), SIZE).astype(int)
    row_left, row_right = left[y, x - 9 : x + 10].sum(axis=-1), right[y, x - 9 : x + 10].sum(axis=-1)
    assert row_left.argmin() > row_right.argmin()  # the subject's left is the viewer's right


def test_frames_equal_single_draws_in_order(renderer: FaceRenderer) -> None:
    values = [frame({3: value, 5: -value}) for value in (0, 150, 300, 450, 600)]
    streamed = [picture.copy() for picture in renderer.frames(values)]
    assert len(streamed) == 5
    for one, faps in zip(streamed, values, strict=True):
        assert np.array_equal(one, renderer.draw(faps))
    assert not np.array_equal(streamed[0], streamed[4])
    assert list(renderer.frames([])) == []


def test_transparent_pictures_have_alpha(head: FaceMesh) -> None:
    with FaceRenderer(head, RenderOptions(size=SIZE, background="transparent", samples=0)) as renderer:
        picture = renderer.draw(np.zeros(68))
    assert picture.shape[-1] == 4
    assert picture[2, 2, 3] == 0
    assert picture[SIZE[1] // 2, SIZE[0] // 2, 3] == 255


def test_multisampling_softens_edges_too(head: FaceMesh) -> None:
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=4)) as renderer:
        picture = renderer.draw(np.zeros(68))
    assert picture[SIZE[1] // 2, SIZE[0] // 2, 0] > 100


def painted(head: FaceMesh, picture: NDArray[np.uint8]) -> FaceMesh:
    """The head with a picture that lies on it as seen from the front: 300 mm wide, v upwards."""
    from_front = np.clip(head.vertices_mm[:, :2] / 300 + 0.5, 0.001, 0.999)
    return replace(head, uv=np.where(is_unpainted(head)[:, None], head.uv, from_front), texture=picture)


def is_unpainted(head: FaceMesh) -> NDArray[np.bool_]:
    return np.isin(head.material, (Material.EYE, Material.STRAND))


@pytest.mark.parametrize("shading", ["pixels", "vertices"])
def test_a_painting_lies_where_its_coordinates_say(head: FaceMesh, shading: Shading) -> None:
    """A picture of four colours; the cheeks and the temples, far from its borders, take theirs."""
    picture = np.full((256, 256, 3), 255, dtype=np.uint8)
    picture[:128, 128:, 1:] = 0  # below, the subject's left: red
    picture[128:, :128, :2] = 0  # above, the right: blue
    with FaceRenderer(painted(head, picture), RenderOptions(size=SIZE, shading=shading, samples=0)) as renderer:
        seen = renderer.draw(np.zeros(68)).astype(int)
        camera = renderer.drawing.camera

    def at(x_mm: float, y_mm: float) -> NDArray[np.int_]:
        x, y = project(camera, np.array([x_mm, y_mm, 60.0]), SIZE).astype(int)
        return np.asarray(seen[y, x])

    red, blue, plain = at(45, -25), at(-40, 60), at(-45, -25)
    assert red[0] > 150
    assert red[1:].max() < 75  # only what shines on top of the skin
    assert blue[:2].max() < 75
    assert blue[2] > blue[0] + 40
    assert plain.min() > 80


@pytest.mark.parametrize("grey", [255, 140])
def test_paint_tints_the_surface(head: FaceMesh, renderer: FaceRenderer, grey: int) -> None:
    """A grey all over is what a darker surface without paint is; white is nothing at all."""
    plain = replace(
        head, texture=None, albedo=np.where(is_unpainted(head)[:, None], 1, (grey / 255) ** 2) * head.albedo
    )
    pictures = []
    for mesh in (plain, painted(head, np.full((2, 2, 3), grey, dtype=np.uint8))):
        with FaceRenderer(mesh, RenderOptions(size=SIZE, samples=0), context=renderer._context) as other:
            pictures.append(other.draw(np.zeros(68)).astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 1


@pytest.mark.parametrize("shading", ["pixels", "vertices"])
def test_holes_in_the_painting_are_seen_through(shading: Shading) -> None:
    picture = np.full((128, 128, 4), 255, dtype=np.uint8)
    picture[100:, :, 3] = 0
    mesh = painted(build_head(HeadStyle(hair=False)), picture)
    with FaceRenderer(mesh, RenderOptions(size=SIZE, background="transparent", shading=shading, samples=0)) as renderer:
        assert set(renderer._model.packed.parts) == {"face", "cutout", "eye", "strand"}
        alpha = renderer.draw(np.zeros(68))[..., 3]
        y = int(project(renderer.drawing.camera, np.array([0.0, (100 / 128 - 0.5) * 300, 60.0]), SIZE)[1])
    # The back of the head is culled, so through the hole in its front nothing is seen.
    assert (alpha[: y - 6] == 0).all()
    assert (alpha[y + 6, SIZE[0] // 2 - 30 : SIZE[0] // 2 + 30] == 255).all()


def test_a_painting_is_taken_in_the_pictures_resolution(head: FaceMesh) -> None:
    """A chequered picture finer than the pixels: without a coarser level it would be noise."""
    squares = (255 * (np.indices((2048, 2048)).sum(axis=0) % 2)).astype(np.uint8)
    mesh = painted(head, np.repeat(squares[..., None], 3, axis=2))
    with FaceRenderer(mesh, RenderOptions(size=SIZE, samples=0)) as renderer:
        far = renderer.draw(np.zeros(68)).astype(int)
        assert list(renderer._model._skins) == [3]  # 2048 texels over 300 mm, 0.66 pixels a mm
        renderer.drawing = replace(renderer.drawing, camera=preset("mouth"))
        renderer.draw(np.zeros(68))
        assert sorted(renderer._model._skins) == [1, 3]
    cheek = far[105:112, 70:77]
    assert np.abs(np.diff(cheek, axis=0)).max() < 12


def test_light_at_vertices_is_nearly_light_at_pixels(head: FaceMesh) -> None:
    rng = np.random.default_rng(3)
    faps = rng.normal(0, 60, 68)
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=0)) as renderer:
        renderer.drawing = replace(renderer.drawing, shading="pixels")
        fine = renderer.draw(faps).astype(int)
        renderer.drawing = replace(renderer.drawing, shading="vertices")
        change = np.abs(renderer.draw(faps) - fine)
    assert change.mean() < 0.4
    assert np.quantile(change, 0.99) <= 5
    assert change.max() > 0


def test_auto_shading_goes_by_the_size_of_triangles(renderer: FaceRenderer) -> None:
    model = renderer._model

    def is_at_vertices(camera: str, side: int, shading: Shading) -> bool:
        return model.packed.is_lit_at_vertices(RenderOptions(camera=preset(camera), size=(side, side), shading=shading))

    assert is_at_vertices("front", 512, "auto")
    assert not is_at_vertices("front", 2048, "auto")
    assert not is_at_vertices("mouth", 512, "auto")
    assert is_at_vertices("mouth", 512, "vertices")
    assert not is_at_vertices("front", 128, "pixels")


def test_backgrounds(head: FaceMesh, renderer: FaceRenderer) -> None:
    context = renderer._context
    with FaceRenderer(head, RenderOptions(size=SIZE, background=(12, 200, 90), samples=0), context=context) as flat:
        picture = flat.draw(np.zeros(68)).astype(int)
    assert np.abs(picture[:8, :8] - (12, 200, 90)).max() <= 1
    behind = np.zeros((100, 400, 3), dtype=np.uint8)
    behind[:, 150:250] = (200, 30, 60)
    behind[:50, 150:250, 2] = 0
    with FaceRenderer(head, RenderOptions(size=SIZE, background=behind, samples=0), context=context) as framed:
        picture = framed.draw(np.zeros(68)).astype(int)
    assert np.abs(picture[2, [2, -3]] - (200, 30, 0)).max() <= 1  # its middle square, upright
    assert np.abs(picture[60, [2, -3], 2] - 0).max() <= 1
    assert np.abs(picture[110, [2, -3], 2] - 60).max() <= 1


def test_the_wire_mesh_lies_over_the_face(head: FaceMesh) -> None:
    with FaceRenderer(head, RenderOptions(size=(512, 512), camera=preset("mouth"), samples=0)) as renderer:
        bare = renderer.draw(np.zeros(68)).astype(int)
        renderer.drawing = replace(renderer.drawing, wire=True)
        wired = renderer.draw(np.zeros(68)).astype(int)
        renderer.drawing = replace(renderer.drawing, wire=False)
        assert np.array_equal(renderer.draw(np.zeros(68)), bare)
    darker = (wired.sum(axis=-1) < bare.sum(axis=-1) - 60).mean()
    assert 0.1 < darker < 0.6


def test_a_smaller_drawing_is_enlarged(head: FaceMesh) -> None:
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=0)) as renderer:
        full = renderer.draw(np.zeros(68)).astype(int)
        renderer.drawing = replace(renderer.drawing, scale=0.5)
        assert renderer._canvas.drawn == (SIZE[0] // 2, SIZE[1] // 2)
        half = renderer.draw(np.zeros(68)).astype(int)
        assert half.shape == full.shape
        change = np.abs(half - full)
        assert 0.1 < change.mean() < 4
        renderer.drawing = replace(renderer.drawing, scale=1.0)
        assert np.array_equal(renderer.draw(np.zeros(68)), full)
        with pytest.raises(UsageError, match=r"scale: got 1\.5, expected 0\.1 to 1"):
            renderer.drawing = replace(renderer.drawing, scale=1.5)


def test_stairs_may_stay(head: FaceMesh) -> None:
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=0)) as renderer:
        soft = renderer.draw(np.zeros(68)).astype(int)
        assert renderer.drawing.samples == 0
        renderer.drawing = replace(renderer.drawing, samples=1)
        hard = renderer.draw(np.zeros(68))
    with FaceRenderer(head, RenderOptions(size=SIZE, samples=1)) as renderer:
        assert np.array_equal(renderer.draw(np.zeros(68)), hard)
    assert np.abs(soft - hard).max() > 20


@pytest.mark.parametrize("samples", [0, 1, 4])
def test_hairs_thinner_than_pixels_are_drawn_by_their_share(head: FaceMesh, samples: int) -> None:
    """However edges are smoothed, brows and lashes are what a picture of four times the size shows, not dots."""
    view = Camera(target_mm=(32.0, 44.0, 80.0), distance_mm=600.0, field_deg=8.0)
    with FaceRenderer(head, RenderOptions(size=(768, 768), camera=view, shading="pixels", samples=4)) as renderer:
        large = renderer.draw(np.zeros(68)).astype(float)
    truth = large.reshape(192, 4, 192, 4, 3).mean(axis=(1, 3))
    with FaceRenderer(head, RenderOptions(size=(192, 192), camera=view, shading="pixels", samples=samples)) as renderer:
        hairs = renderer.draw(np.zeros(68))
    error = np.abs(hairs - truth).max(axis=-1)
    # 25 soft, 17 with stairs, 13 fine; 43 to 50 if a hair covered a pixel wholly or not at all.
    assert np.quantile(error, 0.99) < 30


def test_a_picture_may_stay_on_the_gpu(renderer: FaceRenderer) -> None:
    painted = renderer.paint(frame({3: 300}))
    with renderer._context:
        there = np.frombuffer(painted.read(), dtype=np.uint8).reshape(*SIZE[::-1], 4)
    assert np.array_equal(there[..., :3], renderer.draw(frame({3: 300})))


def test_softening_changes_edges_alone(renderer: FaceRenderer) -> None:
    """Edges by the shader's rule, from five pixels' brightness in numpy; the shader must touch no other pixel."""
    softened = renderer.draw(np.zeros(68)).astype(int)
    with renderer._context:
        raw = renderer._canvas._canvas.read(components=3, alignment=1)
    drawn = np.frombuffer(raw, dtype=np.uint8).reshape(softened.shape).astype(int)
    brightness = np.pad(drawn @ [0.299, 0.587, 0.114] / 255 + 0.25, 1, mode="edge")
    height, width = softened.shape[:2]
    five = [brightness[y : y + height, x : x + width] for y, x in ((1, 1), (0, 0), (0, 2), (2, 0), (2, 2))]
    low, high = np.min(five, axis=0), np.max(five, axis=0)
    is_edge = high - low > np.maximum(0.04, 0.11 * high) - 1e-4
    changed = (softened != drawn).any(axis=-1)
    assert 0.02 < is_edge.mean() < 0.2
    assert not changed[~is_edge].any()
    assert changed[is_edge].mean() > 0.7
    contrast = np.abs(np.diff(drawn, axis=1)).sum(axis=-1)[is_edge[:, 1:]].mean()
    assert np.abs(np.diff(softened, axis=1)).sum(axis=-1)[is_edge[:, 1:]].mean() < 0.85 * contrast


def test_every_preset_shows_the_head(renderer: FaceRenderer) -> None:
    assert len(PRESETS) >= 4
    before = renderer.drawing.camera
    seen = []
    for name in PRESETS:
        renderer.drawing = replace(renderer.drawing, camera=preset(name))
        seen.append(renderer.draw(np.zeros(68)).astype(int))
        warm = (seen[-1][..., 0] > seen[-1][..., 2] + 20).mean()
        assert warm > 0.1, name
    renderer.drawing = replace(renderer.drawing, camera=before)
    assert all(np.abs(seen[0] - other).max() > 50 for other in seen[1:])


def test_cameras_by_numbers() -> None:
    assert preset("-20,7.5") == Camera(yaw_deg=-20.0, pitch_deg=7.5)
    assert turned(preset("profile"), 0.25).position_mm == pytest.approx([0, 18, -870])
    assert preset("profile-right").position_mm[0] < -800  # the subject's right is -x


def test_projection_agrees_with_the_matrix() -> None:
    assert project(Camera(target_mm=(1.0, 2.0, 3.0)), np.array([1.0, 2.0, 3.0]), (100, 50)) == pytest.approx([50, 25])
    above = project(Camera(), np.array([0.0, 100.0, 30.0]), (100, 100))
    assert above[1] < 50


def test_no_context_is_a_resource_error_that_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise OSError("libEGL.so not loaded")

    monkeypatch.setattr(context_module.moderngl, "create_context", refuse)
    with pytest.raises(ResourceError, match=r"libEGL\.so not loaded.*apt-get install -y libegl1 libgl1"):
        create_context()


def test_refuses(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in ("behind", "1,2,3", "1,x"):
        with pytest.raises(UsageError, match=f"camera: got '{wrong}', expected one of front, .* or YAW,PITCH"):
            preset(wrong)
    for wrong in ("0,90", "400,0", "nan,0"):
        with pytest.raises(UsageError, match="a yaw of -360 to 360 and a pitch of -89 to 89"):
            preset(wrong)
    with pytest.raises(UsageError, match="distance"):
        Camera(distance_mm=5.0)
    monkeypatch.setattr("fapengine.render.packing.MAX_CHANNELS", 3)
    monkeypatch.setenv("FAPENGINE_CACHE", "off")
    with pytest.raises(UsageError, match="at most 3"):
        FaceRenderer(head)


@pytest.mark.parametrize("samples", [0, 4])
def test_i420_is_the_image_for_encoders(samples: int, head: FaceMesh, renderer: FaceRenderer) -> None:
    """In whole numbers, as fapengine-native computes them."""
    drawing = replace(renderer.drawing, size=(98, 126), samples=samples)
    poses = [frame(WIDE_OPEN), frame({})]
    with FaceRenderer(head, drawing, context=renderer._context) as small:
        colours = [picture.astype(int) for picture in small.frames(poses)]
        images = list(small.frames(poses, "i420"))
        assert (small.draw(poses[0]) == colours[0]).all()
    for picture, image in zip(colours, images, strict=True):
        four = picture.reshape(63, 2, 49, 2, 3).sum(axis=(1, 3))
        luma = (picture @ [66, 129, 25] + 4224) >> 8
        cb, cr = (four @ [-38, -74, 112] + 131584) >> 10, (four @ [112, -94, -18] + 131584) >> 10
        assert image.shape == (189, 98)
        assert image.ravel().tolist() == [*luma.ravel(), *cb.ravel(), *cr.ravel()]


@pytest.mark.parametrize("change", [{"background": "transparent"}, {"size": (97, 128)}, {"scale": 0.5}])
def test_what_is_no_i420_is_refused(change: dict[str, Any], head: FaceMesh, renderer: FaceRenderer) -> None:
    with FaceRenderer(head, replace(renderer.drawing, **change), context=renderer._context) as other:
        assert not other.drawing.takes_i420
        with pytest.raises(UsageError, match=r"i420: got .*, expected even sides, a background"):
            other.draw(frame({}), "i420")


def test_a_new_drawing_is_as_a_new_renderer(head: FaceMesh, renderer: FaceRenderer) -> None:
    """Size, background, edges, scale and camera, one after the other; and back to the first."""
    first, faps = renderer.drawing, np.zeros(68)
    before = renderer.draw(faps).copy()
    changes: list[dict[str, object]] = [
        {"size": (160, 120)}, {"background": (200, 30, 60)}, {"background": "transparent"}, {"samples": 4},
        {"scale": 0.5}, {"camera": preset("mouth"), "background": "studio", "shading": "pixels"},
    ]  # fmt: skip
    try:
        for change in changes:
            renderer.drawing = replace(renderer.drawing, **change)  # type: ignore[arg-type]
            with FaceRenderer(head, renderer.drawing, context=renderer._context) as fresh:
                assert np.array_equal(renderer.draw(faps), fresh.draw(faps)), change
    finally:
        renderer.drawing = first
    assert np.array_equal(renderer.draw(faps), before)
