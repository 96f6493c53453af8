"""The renderer against the numpy reference, its shaders against the table of names, and its pictures' invariants."""

from collections.abc import Iterator

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.errors import ResourceError, UsageError
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.head import build_head
from fapengine.mesh.patch import vertex_normals
from fapengine.mpeg4 import fap
from fapengine.render import context as context_module
from fapengine.render import programs
from fapengine.render.camera import PRESETS, Camera, preset
from fapengine.render.context import create_context
from fapengine.render.packing import normal_turns
from fapengine.render.renderer import FaceRenderer

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
    with FaceRenderer(head, size=SIZE) as made:
        yield made


def test_shaders_have_the_names_of_the_table() -> None:
    uniforms = {
        "face": programs.FACE_UNIFORMS,
        "eye": programs.EYE_UNIFORMS,
        "backdrop": programs.BACKDROP_UNIFORMS,
        "edges": programs.EDGES_UNIFORMS,
        "smooth": programs.SMOOTH_UNIFORMS,
    }
    assert uniforms.keys() == programs.STAGES.keys()
    seen: set[str] = set()
    with create_context() as context:
        for name, expected in uniforms.items():
            program = programs.build_program(context, name)
            assert {key for key in program if isinstance(program[key], moderngl.Uniform)} == set(expected)
            seen |= {key for key in program if key.startswith("a_")}
        face = programs.build_program(context, "face")
        assert face["u_channels"].array_length * 4 == programs.MAX_CHANNELS  # type: ignore[union-attr]
    assert seen == set(programs.FACE_ATTRIBUTES)


def test_shaders_are_glsl_es_too() -> None:
    """Mesa's desktop context compiles ES 3.00 sources (ARB_ES3_compatibility), with only the header changed."""
    with create_context() as context:
        assert len(programs.STAGES) == 5
        for stages in programs.STAGES.values():
            vertex, fragment = (programs.stage_source(files, programs.ES_HEADER) for files in stages)
            context.program(vertex_shader=vertex, fragment_shader=fragment).release()


def _positions(renderer: FaceRenderer, capture: moderngl.Program, head: FaceMesh) -> NDArray[np.float32]:
    """Where the vertex shader puts every vertex, with the uniforms of the last draw."""
    context = renderer._context
    names = [name for name in programs.FACE_ATTRIBUTES if name in capture]
    for name in capture:
        if isinstance(capture[name], moderngl.Uniform):
            capture[name].value = renderer._parts[0][0][name].value  # type: ignore[union-attr]
    renderer._moves.use(0)
    vertices = context.buffer(head.vertices_mm.astype("f4"))
    columns = {
        "a_position": vertices,
        "a_bones": context.buffer(np.stack([head.bone, head.bone_weight, head.head_weight], axis=-1).astype("f4")),
        "a_entries": context.buffer(
            np.stack([head.basis.offsets[:-1], np.diff(head.basis.offsets)], axis=-1).astype("f4")
        ),
    }
    content = [(columns[name], programs.FACE_ATTRIBUTES[name], name) for name in names if name in columns]
    array = context.vertex_array(capture, content)
    out = context.buffer(reserve=head.vertices_mm.nbytes)
    array.transform(out, moderngl.POINTS, vertices=len(head.vertices_mm))
    return np.frombuffer(out.read(), dtype="f4").reshape(-1, 3)


def test_the_gpu_moves_vertices_as_the_reference_does(head: FaceMesh) -> None:
    """Run the vertex shader with transform feedback over frames that use every FAP."""
    rng = np.random.default_rng(8)
    with FaceRenderer(head, size=(16, 16)) as renderer:
        context = renderer._context
        source = programs.stage_source(("face.vert",))
        with context:
            capture = context.program(vertex_shader=source, varyings=["v_position"])
        for _ in range(3):
            faps = rng.normal(0, 120, 68)
            faps[fap.column(19) : fap.column(23)] = rng.uniform(0, 900, 4)
            for number in (23, 24, 25, 26, 48, 49, 50):
                faps[fap.column(number)] = rng.normal(0, 9000)
            renderer.draw(faps)
            with context:
                got = _positions(renderer, capture, head)
            assert np.abs(got - deform(head, faps)).max() < 0.01  # mm


def test_normals_turn_with_the_surface(head: FaceMesh) -> None:
    faps = frame({5: -300, 10: -250, 11: -250, 52: -300, 31: 150, 33: 150})
    basis = head.basis
    from fapengine.mesh.deform import channel_weights

    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    turned = head.normals.astype(float)
    np.add.at(turned, vertex, channel_weights(basis, faps)[basis.entry_channels, None] * normal_turns(head))
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
    x, y = renderer.camera.project(head.point_mm("9.3"), SIZE).astype(int)
    nose, corner = picture[y, x].astype(int), picture[3, 3].astype(int)
    assert nose[0] > nose[2] + 30  # skin is warm
    assert corner[2] > corner[0]  # the wall is cool
    shirt = picture[-3, SIZE[0] // 2].astype(int)
    assert shirt[2] > shirt[0] + 20


def mouth_darkness(picture: NDArray[np.uint8], head: FaceMesh, camera: Camera) -> int:
    """Dark pixels between the outer lip contours."""
    left, right = (camera.project(head.point_mm(name), SIZE) for name in ("8.4", "8.3"))
    top, bottom = camera.project(head.point_mm("8.1"), SIZE)[1], camera.project(head.point_mm("2.10"), SIZE)[1]
    box = picture[int(top) : int(bottom), int(left[0]) : int(right[0])]
    return int((box.max(axis=-1) < 90).sum())


def test_an_open_mouth_shows_its_inside(renderer: FaceRenderer, head: FaceMesh) -> None:
    closed, opened = renderer.draw(np.zeros(68)), renderer.draw(frame(WIDE_OPEN))
    assert mouth_darkness(closed, head, renderer.camera) <= 8
    assert mouth_darkness(opened, head, renderer.camera) > 100


def test_closed_lids_hide_the_iris(renderer: FaceRenderer, head: FaceMesh) -> None:
    x, y = renderer.camera.project(head.point_mm("3.5"), SIZE).astype(int)
    awake, asleep = (renderer.draw(frame(values))[y, x].astype(int) for values in ({}, {19: 1024, 20: 1024}))
    assert awake.max() < 110
    assert asleep[0] > 110


def test_gaze_moves_the_iris(renderer: FaceRenderer, head: FaceMesh) -> None:
    left = renderer.draw(frame({23: 40_000, 24: 40_000})).astype(int)
    right = renderer.draw(frame({23: -40_000, 24: -40_000})).astype(int)
    x, y = renderer.camera.project(head.point_mm("3.5"), SIZE).astype(int)
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
    with FaceRenderer(head, size=SIZE, transparent=True) as renderer:
        picture = renderer.draw(np.zeros(68))
    assert picture.shape[-1] == 4
    assert picture[2, 2, 3] == 0
    assert picture[SIZE[1] // 2, SIZE[0] // 2, 3] == 255


def test_multisampling_softens_edges_too(head: FaceMesh) -> None:
    with FaceRenderer(head, size=SIZE, samples=4) as renderer:
        picture = renderer.draw(np.zeros(68))
    assert picture[SIZE[1] // 2, SIZE[0] // 2, 0] > 100


def test_softening_changes_edges_alone(renderer: FaceRenderer) -> None:
    """Edges by the shader's rule, from five pixels' brightness in numpy; the shader must touch no other pixel."""
    softened = renderer.draw(np.zeros(68)).astype(int)
    with renderer._context:
        raw = renderer._canvas.read(components=3, alignment=1)
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
    before = renderer.camera
    seen = []
    for name in PRESETS:
        renderer.camera = preset(name)
        seen.append(renderer.draw(np.zeros(68)).astype(int))
        warm = (seen[-1][..., 0] > seen[-1][..., 2] + 20).mean()
        assert warm > 0.1, name
    renderer.camera = before
    assert all(np.abs(seen[0] - other).max() > 50 for other in seen[1:])


def test_projection_agrees_with_the_matrix() -> None:
    assert Camera(target_mm=(1.0, 2.0, 3.0)).project(np.array([1.0, 2.0, 3.0]), (100, 50)) == pytest.approx([50, 25])
    above = Camera().project(np.array([0.0, 100.0, 30.0]), (100, 100))
    assert above[1] < 50


def test_no_context_is_a_resource_error_that_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise OSError("libEGL.so not loaded")

    monkeypatch.setattr(context_module.moderngl, "create_context", refuse)
    with pytest.raises(ResourceError, match=r"libEGL\.so not loaded.*apt-get install -y libegl1 libgl1"):
        create_context()


def test_refuses(head: FaceMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="8x192"):
        FaceRenderer(head, size=(8, 192))
    with pytest.raises(UsageError, match="front"):
        preset("behind")
    with pytest.raises(UsageError, match="distance"):
        Camera(distance_mm=5.0)
    monkeypatch.setattr("fapengine.render.packing.MAX_CHANNELS", 3)
    with pytest.raises(UsageError, match="at most 3"):
        FaceRenderer(head)
