"""A mesh as the GPU takes it: one buffer, index lists, two textures; and what a frame of FAPs sets.

Theory of operation
-------------------
Nothing here knows a graphics library: a desktop context and a browser upload the same bytes. A mesh is packed once. The
vertex buffer has one row of floats a vertex; :data:`fapengine.render.programs.FACE_ATTRIBUTES` says what they are, in
that order and without gaps. Each vertex owns a run of entries in two textures of equal size, ``moves`` and ``turns``
(an entry is a texel, counted along rows); ``a_entries`` holds where its run begins and how long it is. An entry moves
the vertex and turns its normal by so much per FAPU of one channel, whose number is in ``moves``' fourth component.
Triangles are sorted by the program that shades them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.mesh.deform import bone_transforms, channel_weights
from fapengine.mesh.face_mesh import FaceMesh, Material
from fapengine.mpeg4 import fap
from fapengine.render.programs import FACE_ATTRIBUTES, MAX_CHANNELS

SURFACES: dict[Material, tuple[float, float, float]] = {
    # specular strength, gloss, softness of the terminator
    Material.SKIN: (0.20, 18.0, 0.45),
    Material.LIP: (0.42, 42.0, 0.40),
    Material.EYE: (1.30, 420.0, 0.20),
    Material.TEETH: (0.50, 60.0, 0.30),
    Material.GUM: (0.50, 40.0, 0.40),
    Material.TONGUE: (0.35, 30.0, 0.45),
    Material.HAIR: (0.16, 14.0, 0.15),
    Material.LASH: (0.05, 10.0, 0.10),
    Material.MOUTH: (0.02, 10.0, 0.10),
    Material.CLOTH: (0.03, 6.0, 0.25),
}
EYEBALL_RADIUS_MM = 14.2
PUPIL_SHARE = 0.42
"""Pupil to iris in room light."""
PUPIL_RANGE = (0.15, 0.85)
TEXTURE_WIDTH = 1024
PROBE_FAPU = 300.0
"""How far a channel is moved to see how it turns normals."""
SAME_NORMAL = 1e-3
"""Vertices at one place whose normals agree to this are one point of the surface, split by a seam of the texture."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedMesh:
    """Arrays to upload as they are; read-only."""

    vertices: NDArray[np.float32]
    """(V, 18) float32: the attributes of ``FACE_ATTRIBUTES``, in order."""
    parts: Mapping[str, NDArray[np.uint32]]
    """Program of ``STAGES`` (``"face"``, ``"eye"``) to its (F, 3) uint32 triangles; none that has no triangle."""
    moves: NDArray[np.float32]
    """(R, 1024, 4) float32: mm per FAPU in x, y, z, and the channel's number."""
    turns: NDArray[np.float32]
    """(R, 1024, 4) float32: change of the normal per FAPU in x, y, z, and 0."""
    iris: float
    """Radius of the iris as a share of the eyeball's."""

    def __post_init__(self) -> None:
        width = sum(ATTRIBUTE_SIZES.values())
        object.__setattr__(self, "vertices", frozen(self.vertices, "vertices", ("V", width), np.float32))
        for name in ("moves", "turns"):
            object.__setattr__(self, name, frozen(getattr(self, name), name, ("R", TEXTURE_WIDTH, 4), np.float32))
        parts = {name: frozen(value, f"parts[{name}]", ("F", 3), np.uint32) for name, value in self.parts.items()}
        object.__setattr__(self, "parts", MappingProxyType(parts))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameUniforms:
    """What one frame sets, or many frames along the leading axes ``...``."""

    channels: NDArray[np.float32]
    """(..., 128) float32: ``u_channels``, FAPU."""
    bones: NDArray[np.float32]
    """(..., 5, 4, 4) float32: ``u_bones``, moved from rest, column by column as OpenGL wants it."""
    iris: NDArray[np.float32]
    """(..., 2) float32: ``u_iris``, radius of iris and pupil."""


ATTRIBUTE_SIZES: dict[str, int] = {name: int(form[0]) for name, form in FACE_ATTRIBUTES.items()}
"""Attribute to its number of floats, in the order of the vertex buffer."""


def pack(mesh: FaceMesh) -> PackedMesh:
    """Lay a mesh out for the GPU.

    Raises
    ------
    UsageError
        If the mesh has more than 128 channels.
    """
    basis = mesh.basis
    if len(basis.channels) > MAX_CHANNELS:
        raise UsageError(f"mesh: got {len(basis.channels)} channels, expected at most {MAX_CHANNELS}")
    columns: dict[str, ArrayLike] = {
        "a_position": mesh.vertices_mm,
        "a_normal": mesh.normals,
        "a_albedo": mesh.albedo,
        "a_surface": np.array([SURFACES[kind] for kind in Material])[mesh.material],
        "a_uv": mesh.uv,
        "a_occlusion": mesh.occlusion[:, None],
        "a_bones": np.stack([mesh.bone, mesh.bone_weight, mesh.head_weight], axis=-1),
        "a_entries": np.stack([basis.offsets[:-1], np.diff(basis.offsets)], axis=-1),
    }
    on_eye = mesh.material[mesh.triangles[:, 0]] == Material.EYE
    parts = {"face": mesh.triangles[~on_eye].astype("u4"), "eye": mesh.triangles[on_eye].astype("u4")}
    return PackedMesh(
        vertices=np.concatenate([np.asarray(columns[name], dtype="f4") for name in FACE_ATTRIBUTES], axis=1),
        parts={name: triangles for name, triangles in parts.items() if len(triangles)},
        moves=_in_rows(np.concatenate([basis.entry_mm, basis.entry_channels[:, None]], axis=1)),
        turns=_in_rows(normal_turns(mesh)),
        iris=iris_share(mesh),
    )


def iris_share(mesh: FaceMesh) -> float:
    """Radius of the iris as a share of the eyeball's."""
    return mesh.fapu.irisd0_mm / 2 / EYEBALL_RADIUS_MM


def frame_uniforms(mesh: FaceMesh, faps: ArrayLike) -> FrameUniforms:
    """Turn FAPs (..., 68), FAPU, into what the shaders of ``face.vert`` and ``eye.frag`` are told."""
    values = np.asarray(faps, dtype=np.float64)
    channels = np.zeros((*values.shape[:-1], MAX_CHANNELS), dtype="f4")
    channels[..., : len(mesh.basis.channels)] = channel_weights(mesh.basis, values)
    bones = np.ascontiguousarray(bone_transforms(mesh, values).swapaxes(-1, -2), dtype="f4")
    iris = np.full(values.shape[:-1], iris_share(mesh))
    dilation = values[..., fap.column(29)] + values[..., fap.column(30)]
    pupil = iris * np.clip(PUPIL_SHARE + dilation / 2 / 1024, *PUPIL_RANGE)
    return FrameUniforms(channels=channels, bones=bones, iris=np.stack([iris, pupil], axis=-1).astype("f4"))


def _in_rows(entries: NDArray[np.floating]) -> NDArray[np.float32]:
    """(R, 1024, 4): entries (N, 3 or 4) as texels, row by row; at least one row."""
    rows = max(1, -(-len(entries) // TEXTURE_WIDTH))
    padded = np.zeros((rows * TEXTURE_WIDTH, 4), dtype="f4")
    padded[: len(entries), : entries.shape[1]] = entries
    return padded.reshape(rows, TEXTURE_WIDTH, 4)


def normal_turns(mesh: FaceMesh) -> NDArray[np.float32]:
    """(N, 3) float32: how each entry of the basis turns its vertex's normal, per FAPU.

    Measured by moving one channel at a time by :data:`PROBE_FAPU`; the shader adds the turns up linearly. Vertices that
    a seam of the texture splits turn as one.
    """
    basis, points_of = mesh.basis, _surface_points(mesh)
    point = np.repeat(points_of, np.diff(basis.offsets))
    count = int(points_of.max(initial=-1)) + 1
    rest = np.zeros((count, 3))
    rest[points_of] = mesh.vertices_mm
    triangles = points_of[mesh.triangles]
    at_rest = _unit(_summed_normals(rest, triangles, count))
    turns = np.zeros((len(point), 3), dtype=np.float32)
    by_channel = np.argsort(basis.entry_channels, kind="stable")
    ends = np.searchsorted(basis.entry_channels[by_channel], np.arange(len(basis.channels) + 1))
    for first, end in pairwise(ends):
        mine = by_channel[first:end]
        moved = np.zeros(count, dtype=bool)
        moved[point[mine]] = True
        around = triangles[moved[triangles].any(axis=1)]
        points = rest.copy()
        points[point[mine]] = rest[point[mine]] + PROBE_FAPU * basis.entry_mm[mine]
        # Every triangle at a moved point is in ``around``, so its normal is whole; the others' are not asked for.
        normals = _unit(_summed_normals(points, around, count)[point[mine]])
        turns[mine] = (normals - at_rest[point[mine]]) / PROBE_FAPU
    return turns


def _surface_points(mesh: FaceMesh) -> NDArray[np.int64]:
    """(V,): a number for each vertex, the same for those at one place with one normal, 0 upwards."""
    if not len(mesh.vertices_mm):
        return np.zeros(0, dtype=np.int64)
    rounded = np.round(mesh.normals / SAME_NORMAL).astype("f4") + np.float32(0)  # -0 is 0
    keys = np.ascontiguousarray(np.concatenate([mesh.vertices_mm + np.float32(0), rounded], axis=1))
    _, numbers = np.unique(keys.view(np.dtype((np.void, keys.itemsize * 6))).ravel(), return_inverse=True)
    return np.asarray(numbers, dtype=np.int64)


def _summed_normals(points: NDArray[np.float64], triangles: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """(count, 3): the sum of each point's triangles' normals, weighted by area."""
    a, b, c = points[triangles].swapaxes(0, 1)
    faces = np.cross(b - a, c - a)
    corners = triangles.ravel()
    spread = np.repeat(faces, 3, axis=0)
    return np.stack([np.bincount(corners, spread[:, axis], count) for axis in range(3)], axis=-1)


def _unit(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: NDArray[np.float64] = np.divide(
        normals, length, out=np.tile([0.0, 0.0, 1.0], (len(normals), 1)), where=length > 1e-12
    )
    return unit
