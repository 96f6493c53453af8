"""A mesh for the GPU: one buffer, index lists, two textures; and the uniforms of a frame of FAPs.

Theory of operation
-------------------
No graphics library is used here: a desktop context and a browser upload the same bytes. A mesh is packed once. The
vertex buffer has one row of floats per vertex, the attributes of :data:`fapengine.render.programs.FACE_ATTRIBUTES` in
that order and without gaps. Each vertex owns a run of entries in two textures of equal size, ``displacements`` and
``normal_deltas`` (an entry is a texel, counted along rows); ``a_entries`` holds the start and the length of its run. An
entry holds the displacement of the vertex and the change of its normal per FAPU of one channel; the channel's number is
the fourth component in ``displacements``. Triangles are sorted by shading: ``face``; ``eye``, eyes with iris and pupil
drawn by the shader; ``eyeball``, eyes with a texture, whose highlight is too small for light at vertices; ``cutout``,
with holes in the texture; and ``strand``, single hairs, which are drawn last.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, Indices, Mask, freeze, frozen
from fapengine.errors import UsageError
from fapengine.geometry.surface import edges_of, summed_normals, unit_normals, vertex_normals
from fapengine.mesh.deform import Pose, bone_transforms, channel_weights
from fapengine.mesh.face_mesh import (
    PUPIL_SHARE,
    Bone,
    Channel,
    DeformationBasis,
    FaceMesh,
    Material,
    iris_share,
    lid_share,
)
from fapengine.mpeg4 import fap
from fapengine.render.drawing import RenderOptions
from fapengine.render.programs import FACE_ATTRIBUTES, MAX_CHANNELS, MAX_FINE_EDGE_PX, SKIN_LEVEL_BIAS

SURFACES: dict[Material, tuple[float, float, float]] = {
    # specular strength, gloss, softness of the terminator
    Material.SKIN: (0.08, 40.0, 0.52),
    Material.LIP: (0.32, 36.0, 0.50),
    Material.EYE: (1.30, 420.0, 0.20),
    Material.TEETH: (0.50, 60.0, 0.30),
    Material.GUM: (0.50, 40.0, 0.40),
    Material.TONGUE: (0.16, 30.0, 0.45),
    Material.HAIR: (0.06, 22.0, 0.15),
    Material.LASH: (0.05, 10.0, 0.10),
    Material.MOUTH: (0.02, 10.0, 0.10),
    Material.CLOTH: (0.03, 6.0, 0.25),
    Material.BALL: (1.30, 420.0, 0.20),
    Material.STRAND: (0.05, 10.0, 0.10),
}
PUPIL_RANGE = (0.15, 0.85)
LID_COLUMNS = fap.columns(19, 21, 20, 22)
LID_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
"""FAPs of the lids, and the side of the iris that each lid touches in the neutral face; 1024 FAPU are its diameter."""
TEXTURE_WIDTH = 1024
PROBE_FAPU = 1.0
"""Step of a channel for measuring its change of normals.

It is small, so that changes of several channels add up as their displacements do: in speech the error of the normals is
0.7 degrees; with a step of 300 it is 2.8.
"""
JAW_FAP = 3
"""FAP whose bone rotates normals; the entries of its channels add the effect of changes of the bone's weight."""
SAME_NORMAL = 1e-3
"""Vertices at one position whose normals differ by less are one point of the surface, split by a texture seam."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedMesh:
    """Arrays ready for upload; read-only."""

    vertices: NDArray[np.float32]
    """(V, 21) float32: the attributes of ``FACE_ATTRIBUTES``, in order."""
    parts: Mapping[str, NDArray[np.uint32]]
    """Name to (F, 3) uint32 triangles: ``"face"``, ``"cutout"``, ``"eyeball"``, ``"eye"``, ``"strand"``, without empty
    ones. :data:`fapengine.render.programs.PARTS` defines how each is drawn.
    """
    displacements: NDArray[np.float32]
    """(R, 1024, 4) float32: mm per FAPU in x, y, z, and the channel's number."""
    normal_deltas: NDArray[np.float32]
    """(R, 1024, 4) float32: change per FAPU of the normal in x, y, z, and of the folds or a lid's occlusion."""
    skin: NDArray[np.uint8] | None
    """(H, W, 4) uint8, sRGB and coverage, or for the part ``"face"`` of a head with folds their light: ``u_skin``. Row
    0 at v = 0; it repeats. None without a texture.
    """
    texels_per_mm: float
    """Resolution of the texture on the face; 0 without one."""
    edge_mm: float
    """Median length of the triangle edges."""
    iris: float
    """Radius of the iris relative to the eyeball."""
    iris_albedo: NDArray[np.float32]
    """(3,) float32, linear RGB: ``u_iris_albedo``."""

    def __post_init__(self) -> None:
        width = sum(ATTRIBUTE_SIZES.values())
        texels = ("R", TEXTURE_WIDTH, 4)
        freeze(self, np.float32, vertices=("V", width), displacements=texels, normal_deltas=texels)
        if self.skin is not None:
            freeze(self, np.uint8, skin=("H", "W", 4))
        parts = {name: frozen(value, f"parts[{name}]", ("F", 3), np.uint32) for name, value in self.parts.items()}
        object.__setattr__(self, "parts", MappingProxyType(parts))

    def is_lit_at_vertices(self, drawing: RenderOptions) -> bool:
        """Whether :attr:`RenderOptions.shading` results in light at vertices."""
        if drawing.shading == "auto":
            return self.edge_mm * drawing.camera.pixels_per_mm(drawing.drawn_size[1]) <= MAX_FINE_EDGE_PX
        return drawing.shading == "vertices"

    def skin_level(self, pixels_per_mm: float) -> int:
        """Choose one texture level for the whole image: choosing per pixel costs llvmpipe a tenth of its time."""
        assert self.skin is not None
        finest = max(self.skin.shape[:2]).bit_length() - 1
        wanted = np.log2(max(self.texels_per_mm, 1e-9) / pixels_per_mm) + SKIN_LEVEL_BIAS
        return int(np.clip(np.floor(wanted), 0, finest))

    def skin_at(self, level: int) -> NDArray[np.uint8]:
        """(H, W, 4) uint8: the texture, its sides halved ``level`` times."""
        assert self.skin is not None
        picture = self.skin
        for _ in range(level):
            picture = halved(picture)
        return np.ascontiguousarray(picture)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameUniforms:
    """Uniforms of one frame, or of many frames along the leading axes ``...``."""

    channels: NDArray[np.float32]
    """(..., 128) float32: ``u_channels``, FAPU."""
    bones: NDArray[np.float32]
    """(..., 5, 4, 4) float32: ``u_bones``, from neutral to current pose, in OpenGL's column order."""
    iris: NDArray[np.float32]
    """(..., 2) float32: ``u_iris``, radius of iris and pupil, relative to the eyeball."""
    lids: NDArray[np.float32]
    """(..., 4) float32: ``u_lids``, height of the lids' margins above the eyeball's centre, relative to its radius:
    upper and lower of the left eye, then of the right.
    """


ATTRIBUTE_SIZES: dict[str, int] = {name: int(form[0]) for name, form in FACE_ATTRIBUTES.items()}
"""Number of floats of each attribute, in the order of the vertex buffer."""


def pack(mesh: FaceMesh) -> PackedMesh:
    """Arrange a mesh for the GPU.

    Raises
    ------
    UsageError
        If the mesh has more than 128 channels.
    """
    basis = mesh.basis
    if basis.width > MAX_CHANNELS:
        raise UsageError(f"mesh: got {basis.width} channels, expected at most {MAX_CHANNELS}")
    columns: dict[str, ArrayLike] = {
        "a_position": mesh.vertices_mm,
        "a_normal": mesh.normals,
        "a_albedo": mesh.albedo,
        "a_surface": np.array([SURFACES[kind] for kind in Material])[mesh.material],
        "a_uv": mesh.uv,
        "a_occlusion": mesh.occlusion[:, None],
        "a_fold": _resting_folds(mesh)[:, None],
        "a_bones": np.stack([mesh.bone, mesh.bone_weight, mesh.head_weight], axis=-1),
        "a_entries": np.stack([basis.offsets[:-1], np.diff(basis.offsets)], axis=-1),
    }
    skin = _with_alpha(mesh.texture)
    material = mesh.material[mesh.triangles[:, 0]]
    special = {"eye": material == Material.EYE, "strand": material == Material.STRAND}
    holed = ~np.any(list(special.values()), axis=0) & _has_hole(mesh, skin)
    special["eyeball"] = (material == Material.BALL) & ~holed
    other = ~np.any(list(special.values()), axis=0)
    sorts = {"face": other & ~holed, "cutout": holed, **special}
    deltas = normal_deltas(mesh)
    if mesh.folds is not None:
        deltas = np.concatenate([deltas, mesh.folds.entries[:, None]], axis=1)
    return PackedMesh(
        vertices=np.concatenate([np.asarray(columns[name], dtype="f4") for name in FACE_ATTRIBUTES], axis=1),
        parts={name: mesh.triangles[mine].astype("u4") for name, mine in sorts.items() if mine.any()},
        displacements=_in_rows(np.concatenate([basis.entry_mm, basis.entry_channels[:, None]], axis=1)),
        normal_deltas=_in_rows(deltas),
        skin=skin_of(mesh),
        texels_per_mm=_texels_per_mm(mesh, skin),
        edge_mm=_edge_mm(mesh),
        iris=iris_share(mesh),
        iris_albedo=mesh.iris_albedo,
    )


def skin_of(mesh: FaceMesh) -> NDArray[np.uint8] | None:
    """Texture of a mesh as :attr:`PackedMesh.skin`."""
    if mesh.folds is not None and _is_folded(mesh):
        return np.concatenate([np.asarray(mesh.texture), mesh.folds.map[..., None]], axis=2)
    return _with_alpha(mesh.texture)


def frame_uniforms(mesh: FaceMesh, faps: ArrayLike) -> FrameUniforms:
    """Convert FAPs (..., 68), FAPU, to the uniforms of ``face.vert`` and ``eye.frag``."""
    values = np.asarray(faps, dtype=np.float64)
    return _uniforms(mesh, Pose(channel_weights(mesh.basis, values), bone_transforms(mesh, values)), values)


def _uniforms(mesh: FaceMesh, pose: Pose, values: Array) -> FrameUniforms:
    """Uniforms of poses (...), with irises and lids from FAPs (..., 68)."""
    channels = np.zeros((*values.shape[:-1], MAX_CHANNELS), dtype="f4")
    channels[..., : mesh.basis.width] = pose.weights
    iris = np.full(values.shape[:-1], iris_share(mesh))
    dilation = values[..., fap.column(29)] + values[..., fap.column(30)]
    pupil = iris * np.clip(PUPIL_SHARE + dilation / 2 / 1024, *PUPIL_RANGE)
    return FrameUniforms(
        channels=channels,
        bones=np.ascontiguousarray(pose.bones.swapaxes(-1, -2), dtype="f4"),
        iris=np.stack([iris, pupil], axis=-1).astype("f4"),
        lids=np.ascontiguousarray(LID_SIGNS * lid_share(mesh) * (1 - 2 * values[..., LID_COLUMNS] / 1024), dtype="f4"),
    )


def pose_uniforms(mesh: FaceMesh, pose: Pose) -> FrameUniforms:
    """Convert a pose without FAPs, (W,) weights, to uniforms; eyes look ahead.

    Raises
    ------
    UsageError
        If the number of weights is wrong.
    """
    if pose.weights.shape != (mesh.basis.width,):
        raise UsageError(f"weights: got shape {pose.weights.shape}, expected ({mesh.basis.width},)")
    return _uniforms(mesh, pose, np.zeros(fap.FAP_COUNT))


def halved(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Scale an image, (H, W, 4) uint8, to half its sides, at least 1: means of four, of squares as in the shader."""
    height, width = picture.shape[:2]
    padded = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    power = np.array([2.0, 2.0, 2.0, 1.0])
    light = padded.astype(np.float32) ** power
    mean = (light[0::2, 0::2] + light[1::2, 0::2] + light[0::2, 1::2] + light[1::2, 1::2]) / 4
    return np.asarray(np.round(mean ** (1 / power)), dtype=np.uint8)


def wire_edges(packed: PackedMesh) -> NDArray[np.uint32]:
    """(E, 2) uint32: every edge of every triangle, once."""
    edges = edges_of(np.concatenate(list(packed.parts.values())))
    return np.unique(np.sort(edges, axis=1), axis=0)


def _with_alpha(texture: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
    if texture is None or texture.shape[2] == 4:
        return texture
    return np.concatenate([texture, np.full((*texture.shape[:2], 1), 255, dtype=np.uint8)], axis=2)


def _is_folded(mesh: FaceMesh) -> bool:
    """Whether the light of the folds fits into the texture's fourth component."""
    return mesh.folds is not None and mesh.texture is not None and mesh.texture.shape == (*mesh.folds.map.shape, 3)


def _resting_folds(mesh: FaceMesh) -> NDArray[np.float32]:
    """(V,): as :attr:`~fapengine.mesh.face_mesh.Folds.rest`; at most 0 if the texture has no room for folds."""
    if mesh.folds is None:
        return np.zeros(len(mesh.vertices_mm), dtype=np.float32)
    return mesh.folds.rest if _is_folded(mesh) else np.minimum(mesh.folds.rest, 0.0)


def _has_hole(mesh: FaceMesh, skin: NDArray[np.uint8] | None) -> Mask:
    """(F,): whether the texture has a hole in the box around a triangle."""
    if skin is None or (skin[..., 3] >= 128).all():
        return np.zeros(len(mesh.triangles), dtype=bool)
    height, width = skin.shape[:2]
    count = np.zeros((height + 1, width + 1), dtype=np.int64)
    count[1:, 1:] = (skin[..., 3] < 128).cumsum(axis=0).cumsum(axis=1)
    at = mesh.uv[mesh.triangles].astype(np.float64) * (width, height)
    left, low = np.floor(at.min(axis=1) - 0.5).astype(int).T
    right, high = np.ceil(at.max(axis=1) + 0.5).astype(int).T
    repeats = (left < 0) | (low < 0) | (right > width) | (high > height)
    left, right = np.clip(left, 0, width), np.clip(right, 0, width)
    low, high = np.clip(low, 0, height), np.clip(high, 0, height)
    inside = count[high, right] - count[low, right] - count[high, left] + count[low, left]
    return (inside > 0) | repeats


def _texels_per_mm(mesh: FaceMesh, skin: NDArray[np.uint8] | None) -> float:
    """Root of the ratio of the skin's area in the texture, in texels, to its area in square mm."""
    if skin is None:
        return 0.0
    on_skin = np.isin(mesh.material[mesh.triangles[:, 0]], (Material.SKIN, Material.LIP))
    triangles = mesh.triangles[on_skin] if on_skin.any() else mesh.triangles
    a, b, c = mesh.vertices_mm[triangles].astype(np.float64).swapaxes(0, 1)
    area_mm2 = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    p, q, s = (mesh.uv[triangles].astype(np.float64) * skin.shape[1::-1]).swapaxes(0, 1)
    first, second = q - p, s - p
    area_texels = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum()
    return float(np.sqrt(area_texels / max(area_mm2, 1e-9)))


def _edge_mm(mesh: FaceMesh) -> float:
    if not len(mesh.triangles):
        return 0.0
    corners = mesh.vertices_mm[mesh.triangles].astype(np.float64)
    return float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)))


def _in_rows(entries: NDArray[np.floating]) -> NDArray[np.float32]:
    """(R, 1024, 4): entries (N, 3 or 4) as texels, row by row; at least one row."""
    rows = max(1, -(-len(entries) // TEXTURE_WIDTH))
    padded = np.zeros((rows * TEXTURE_WIDTH, 4), dtype="f4")
    padded[: len(entries), : entries.shape[1]] = entries
    return padded.reshape(rows, TEXTURE_WIDTH, 4)


def normal_deltas(mesh: FaceMesh) -> NDArray[np.float32]:
    """(N, 3) float32: change of a vertex's normal per FAPU, for each entry of the basis.

    Measured by moving one channel at a time by :data:`PROBE_FAPU`, or from its start to its end if it ends, which for a
    lid is a large rotation; the shader adds the changes linearly. Vertices that a texture seam splits change as one.
    """
    basis, points_of = mesh.basis, _surface_points(mesh)
    vertex = basis.entry_vertices
    point = points_of[vertex]
    count = int(points_of.max(initial=-1)) + 1
    rest = np.zeros((count, 3))
    rest[points_of] = mesh.vertices_mm
    triangles = points_of[mesh.triangles]
    first_corner, second_corner, third_corner = np.ascontiguousarray(triangles.T)
    at_rest = vertex_normals(rest, triangles)
    deltas = np.zeros((len(point), 3), dtype=np.float32)
    by_channel = np.argsort(basis.entry_channels, kind="stable")
    ends = np.searchsorted(basis.entry_channels[by_channel], np.arange(basis.width + 1))
    for number, (first, end) in enumerate(pairwise(ends)):
        mine = by_channel[first:end]
        moved = np.zeros(count, dtype=bool)
        moved[point[mine]] = True
        around = triangles[moved[first_corner] | moved[second_corner] | moved[third_corner]]
        points, step, before = rest.copy(), PROBE_FAPU, at_rest[point[mine]]
        for earlier in _earlier_pieces(basis, number):
            its = by_channel[ends[earlier] : ends[earlier + 1]]
            points[point[its]] += _length(basis.channels[earlier]) * basis.entry_mm[its]
        if basis.mix is None and np.isfinite(_length(basis.channels[number])):
            step = _length(basis.channels[number])
            before = unit_normals(summed_normals(points, around)[point[mine]])
        points[point[mine]] += step * basis.entry_mm[mine]
        with_bone: NDArray[np.floating] | float = 0.0
        if basis.mix is None and basis.channels[number].fap == JAW_FAP:
            points[points_of], with_bone = _with_jaw(mesh, at_rest[point[mine]], vertex[mine])
        # ``around`` has every triangle at a moved point, so the normals of these points are complete.
        deltas[mine] = (unit_normals(summed_normals(points, around)[point[mine]]) - before - with_bone) / step
    return deltas


def _length(channel: Channel) -> float:
    return abs(channel.stop - channel.start)


def _earlier_pieces(basis: DeformationBasis, number: int) -> list[int]:
    """Channels of the same FAP that have reached their ends when this one starts; none if the basis has a mix."""
    if basis.mix is not None:
        return []
    mine = basis.channels[number]
    return [
        other
        for other, channel in enumerate(basis.channels)
        if channel.fap == mine.fap
        and other != number
        and 0 < channel.stop * np.sign(mine.stop) <= mine.start * np.sign(mine.stop)
    ]


def _with_jaw(mesh: FaceMesh, normals: Array, vertices: Indices) -> tuple[Array, Array]:
    """(V, 3) positions with the jaw opened by a probe, and (N, 3) changes of some normals by the bone alone."""
    faps = np.zeros(fap.FAP_COUNT)
    faps[fap.column(JAW_FAP)] = PROBE_FAPU
    jaw = bone_transforms(mesh, faps)[Bone.JAW]
    weight = np.where(mesh.bone == Bone.JAW, mesh.bone_weight, 0.0)[:, None]
    rest = mesh.vertices_mm.astype(np.float64)
    moved: Array = rest + weight * (rest @ jaw[:3, :3].T + jaw[:3, 3] - rest)
    turned: Array = weight[vertices] * (normals @ jaw[:3, :3].T - normals)
    return moved, turned


def _surface_points(mesh: FaceMesh) -> Indices:
    """(V,): a number from 0 for each vertex, the same for vertices at one position with one normal."""
    if not len(mesh.vertices_mm):
        return np.zeros(0, dtype=np.int64)
    rounded = np.round(mesh.normals / SAME_NORMAL).astype("f4") + np.float32(0)  # -0 is 0
    keys = np.ascontiguousarray(np.concatenate([mesh.vertices_mm + np.float32(0), rounded], axis=1))
    _, numbers = np.unique(keys.view(np.dtype((np.void, keys.itemsize * 6))).ravel(), return_inverse=True)
    return np.asarray(numbers, dtype=np.int64)
