"""What is uploaded: the bytes' layout, runs of entries, changes of normals, and a frame's uniforms."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import bone_transforms, channel_weights, deform
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh, Material, iris_share
from fapengine.mpeg4 import fap
from fapengine.render import packing
from fapengine.render.packing import (
    ATTRIBUTE_SIZES,
    PackedMesh,
    frame_uniforms,
    halved,
    normal_deltas,
    pack,
    wire_edges,
)


@pytest.fixture(scope="module")
def head() -> FaceMesh:
    return build_head()


@pytest.fixture(scope="module")
def packed(head: FaceMesh) -> PackedMesh:
    return pack(head)


def attribute(packed: PackedMesh, name: str) -> np.ndarray:
    ends = np.cumsum(list(ATTRIBUTE_SIZES.values()))
    at = list(ATTRIBUTE_SIZES).index(name)
    return packed.vertices[:, ends[at] - ATTRIBUTE_SIZES[name] : ends[at]]


def only(head: FaceMesh, triangles: np.ndarray) -> FaceMesh:
    return replace(head, triangles=triangles)


def test_each_attribute_lies_where_the_table_says(head: FaceMesh, packed: PackedMesh) -> None:
    assert packed.vertices.dtype == np.float32
    assert packed.vertices.flags.c_contiguous
    assert (attribute(packed, "a_position") == head.vertices_mm).all()
    assert (attribute(packed, "a_normal") == head.normals).all()
    assert (attribute(packed, "a_albedo") == head.albedo).all()
    assert (attribute(packed, "a_uv") == head.uv).all()
    assert (attribute(packed, "a_occlusion")[:, 0] == head.occlusion).all()
    assert (attribute(packed, "a_bones") == np.stack([head.bone, head.bone_weight, head.head_weight], axis=-1)).all()
    lips = head.material == Material.LIP
    assert attribute(packed, "a_surface")[lips] == pytest.approx(
        np.tile(packing.SURFACES[Material.LIP], (lips.sum(), 1))
    )


def test_every_triangle_is_in_one_part(head: FaceMesh, packed: PackedMesh) -> None:
    assert set(packed.parts) == {"face", "eye", "strand"}
    together = np.concatenate(list(packed.parts.values()))
    assert np.array_equal(np.unique(together, axis=0), np.unique(head.triangles, axis=0))
    assert (head.material[packed.parts["eye"]] == Material.EYE).all()
    assert (head.material[packed.parts["strand"]] == Material.STRAND).all()
    assert not np.isin(head.material[packed.parts["face"][:, 0]], (Material.EYE, Material.STRAND)).any()


def test_a_mesh_without_eyeballs_has_no_such_part(head: FaceMesh) -> None:
    skin = head.triangles[head.material[head.triangles[:, 0]] != Material.EYE]
    assert set(pack(only(head, skin)).parts) == {"face", "strand"}


def test_a_vertex_finds_its_own_entries(head: FaceMesh, packed: PackedMesh) -> None:
    """Follow the runs as the shader does, for one frame, against the reference."""
    faps = np.zeros(68)
    for number, value in {4: -100, 5: 300, 19: 700, 31: 150, 53: 120}.items():
        faps[fap.column(number)] = value
    weights = frame_uniforms(head, faps).channels
    displacements = packed.displacements.reshape(-1, 4)
    expected = deform(head, faps)  # no bone turns in this frame
    for vertex in range(0, len(head.vertices_mm), 37):
        first, count = attribute(packed, "a_entries")[vertex].astype(int)
        run = displacements[first : first + count]
        moved = head.vertices_mm[vertex] + weights[run[:, 3].astype(int)] @ run[:, :3]
        assert moved == pytest.approx(expected[vertex], abs=1e-3)  # mm; a thousandth cannot be seen
    assert packed.normal_deltas.shape == packed.displacements.shape
    assert np.array_equal(packed.normal_deltas.reshape(-1, 4)[: len(head.basis.entry_mm), :3], normal_deltas(head))


def test_a_mesh_that_does_not_move_has_one_row_of_nothing(head: FaceMesh) -> None:
    still = DeformationBasis(
        channels=(),
        offsets=np.zeros(len(head.vertices_mm) + 1, dtype=np.int32),
        entry_channels=np.zeros(0, dtype=np.int32),
        entry_mm=np.zeros((0, 3), dtype=np.float32),
    )
    packed = pack(replace(head, basis=still, folds=None))
    assert packed.displacements.shape == (1, packing.TEXTURE_WIDTH, 4)
    assert not packed.displacements.any()
    assert not attribute(packed, "a_entries").any()


def test_a_seam_turns_as_one(head: FaceMesh) -> None:
    """Split every vertex of some triangles, as a texture's seam does: each copy turns as the whole point did."""
    basis, count = head.basis, len(head.vertices_mm)
    entries = np.diff(basis.offsets)
    split = np.flatnonzero(entries > 0)[::3]
    copies = np.arange(count)
    copies[split] = count + np.arange(len(split))
    triangles = head.triangles.copy()
    triangles[::2] = copies[triangles[::2]]
    runs = [np.arange(basis.offsets[vertex], basis.offsets[vertex + 1]) for vertex in split]
    names = np.concatenate([np.arange(len(basis.entry_mm)), *runs])
    spread = {
        name: np.concatenate([getattr(head, name), getattr(head, name)[split]])
        for name in (
            "vertices_mm", "normals", "uv", "albedo", "material", "occlusion", "bone", "bone_weight", "head_weight"
        )
    }  # fmt: skip
    seamed = replace(
        head,
        **spread,
        triangles=triangles,
        folds=None,
        basis=replace(
            basis,
            offsets=np.concatenate([[0], np.cumsum(np.concatenate([entries, entries[split]]))]).astype(np.int32),
            entry_channels=basis.entry_channels[names],
            entry_mm=basis.entry_mm[names],
        ),
    )
    whole = normal_deltas(head)
    assert np.abs(whole).max() > 1e-4
    assert normal_deltas(seamed) == pytest.approx(whole[names], abs=1e-9)


def test_uniforms_of_one_frame_and_of_many(head: FaceMesh) -> None:
    rng = np.random.default_rng(4)
    faps = rng.normal(0, 200, (3, 2, 68))
    many = frame_uniforms(head, faps)
    assert many.channels.shape == (3, 2, 128)
    assert many.bones.shape == (3, 2, 5, 4, 4)
    assert many.iris.shape == (3, 2, 2)
    one = frame_uniforms(head, faps[2, 1])
    for name in ("channels", "bones", "iris"):
        assert np.array_equal(getattr(one, name), getattr(many, name)[2, 1])
    used = len(head.basis.channels)
    assert one.channels[:used] == pytest.approx(channel_weights(head.basis, faps[2, 1]), rel=1e-6)
    assert not one.channels[used:].any()
    assert one.bones.swapaxes(-1, -2) == pytest.approx(bone_transforms(head, faps[2, 1]), rel=1e-6, abs=1e-5)


def test_pupils_widen_within_the_iris(head: FaceMesh) -> None:
    faps = np.zeros((4, 68))
    faps[:, fap.column(29)] = faps[:, fap.column(30)] = (0, 200, 9000, -9000)
    shares = frame_uniforms(head, faps).iris[:, 1] / iris_share(head)
    assert shares == pytest.approx([0.42, 0.42 + 200 / 1024, 0.85, 0.15], rel=1e-5)
    assert pack(head).iris == pytest.approx(frame_uniforms(head, faps[0]).iris[0])


def test_a_painting_gets_alpha_and_keeps_its_own(head: FaceMesh) -> None:
    rng = np.random.default_rng(2)
    picture = rng.integers(0, 255, (3, 5, 4), dtype=np.uint8)
    packed = pack(replace(head, texture=picture[..., :3]))
    assert packed.skin is not None
    assert np.array_equal(packed.skin[..., :3], picture[..., :3])
    assert (packed.skin[..., 3] == 255).all()
    assert np.array_equal(pack(replace(head, texture=picture)).skin, picture)  # type: ignore[arg-type]
    assert pack(replace(head, texture=None)).skin is None


def test_texels_on_the_skin(head: FaceMesh) -> None:
    """A picture of 300 x 600 texels over 300 x 300 mm as seen from the front, on what faces it: a root of two a mm."""
    towards = head.normals[head.triangles].mean(axis=1)[:, 2] > 0.97
    flat = replace(
        head,
        triangles=head.triangles[towards & (head.material[head.triangles[:, 0]] == Material.SKIN)],
        uv=head.vertices_mm[:, :2] / 300 + 0.5,
        texture=np.zeros((600, 300, 3), dtype=np.uint8),
    )
    assert pack(flat).texels_per_mm == pytest.approx(2**0.5, rel=0.03)
    assert pack(replace(head, texture=None)).texels_per_mm == 0


def test_median_edge(head: FaceMesh) -> None:
    corners = head.vertices_mm[head.triangles]
    lengths = [np.linalg.norm(corners[:, a] - corners[:, b], axis=1) for a, b in ((0, 1), (1, 2), (2, 0))]
    assert pack(head).edge_mm == pytest.approx(np.median(lengths), rel=1e-5)
    assert pack(only(head, head.triangles[:0])).edge_mm == 0


def test_triangles_over_holes_are_cutouts(head: FaceMesh) -> None:
    picture = np.full((64, 64, 4), 255, dtype=np.uint8)
    picture[10, 20, 3] = 127
    uv = np.clip(head.vertices_mm[:, :2] / 300 + 0.5, 0.02, 0.98)
    parts = pack(replace(head, uv=uv, texture=picture)).parts
    assert len(np.concatenate(list(parts.values()))) == len(head.triangles)
    boxes = uv[parts["cutout"]] * 64
    low, high = boxes.min(axis=1), boxes.max(axis=1)
    # Half a texel further on each side is where a bilinear filter still reads the hole.
    assert len(low) > 0
    assert ((low[:, 0] < 21.6) & (high[:, 0] > 19.4) & (low[:, 1] < 11.6) & (high[:, 1] > 9.4)).all()
    boxes = uv[parts["face"]] * 64
    middle = boxes.mean(axis=1)
    assert not ((np.abs(middle[:, 0] - 20.5) < 0.5) & (np.abs(middle[:, 1] - 10.5) < 0.5)).any()


def test_layers_of_an_eye_with_holes_are_cutouts(head: FaceMesh) -> None:
    """As VRoid's highlights, which covered the iris with the colour that they have where they are transparent."""
    eye = head.material == Material.EYE
    picture = np.full((64, 64, 4), 255, dtype=np.uint8)
    ball = replace(head, material=np.where(eye, Material.BALL, head.material), texture=picture)
    assert set(pack(ball).parts) == {"face", "eyeball", "strand"}
    picture[..., 3] = 0
    assert set(pack(replace(ball, texture=picture)).parts) == {"cutout", "strand"}


def test_a_painting_that_repeats_over_holes(head: FaceMesh) -> None:
    """Outside 0..1 nothing is known of where the hole is: a triangle there may have it."""
    picture = np.full((64, 64, 4), 255, dtype=np.uint8)
    picture[:, 0, 3] = 0
    parts = pack(replace(head, uv=head.uv * 0.1 + 3.5, texture=picture)).parts
    assert set(parts) == {"cutout", "eye", "strand"}


def test_halving() -> None:
    rows = np.zeros((3, 2, 4), dtype=np.uint8)
    rows[0, 0] = (200, 100, 0, 255)
    half = halved(rows)
    assert half.shape == (2, 1, 4)
    assert half[0, 0].tolist() == [100, 50, 0, 64]  # the root of a quarter is a half; alpha is a mean
    assert not half[1].any()
    assert halved(half).shape == (1, 1, 4)
    assert np.array_equal(halved(halved(half)), halved(half))


def test_wire_has_every_edge_once(packed: PackedMesh, head: FaceMesh) -> None:
    edges = wire_edges(packed)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert (edges[:, 0] < edges[:, 1]).all()
    wanted = {tuple(sorted(pair)) for a, b, c in head.triangles[:50].tolist() for pair in ((a, b), (b, c), (c, a))}
    assert wanted <= {tuple(edge) for edge in edges.tolist()}


def test_packing_needs_no_graphics_library() -> None:
    code = "import sys, fapengine.render.packing; sys.exit('moderngl' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=300).returncode == 0


def test_too_many_channels(head: FaceMesh) -> None:
    basis = replace(head.basis, channels=(head.basis.channels * 2)[:129])
    with pytest.raises(UsageError, match="got 129 channels, expected at most 128"):
        pack(replace(head, basis=basis))
