"""``FaceMesh``: the neutral surface of a head with its feature points, and how FAPs deform it.

Theory of operation
-------------------
A frame of FAPs becomes ``C`` *channel* weights (piecewise-linear functions of single FAPs, the idea of the standard's
FaceDefTables) and ``B`` *bone* transforms (jaw, two eyes, head). Each vertex then moves in this order:

1. add its channel displacements: ``p = rest + sum_c weight[c] * displacement[c]`` (sparse: few channels per vertex);
2. blend towards its own bone (jaw or an eye): ``p += w_bone * (bone @ p - p)``;
3. blend towards the head: ``p += w_head * (head @ p - p)``.

Channels are linear, so the renderer evaluates 1 in the vertex shader from a sparse list; 2 and 3 are two matrices.
A mesh with blendshapes mixes its channels into the weights of the blendshapes first (``mix``).
Head space: +x the subject's left, +y up, +z out of the face, mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices, Rebuilt, freeze, frozen
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.mpeg4.fapu import Fapu

BROWN_IRIS = (0.175, 0.080, 0.036)
"""Linear RGB near the pupil."""
EYEBALL_RADIUS_MM = 14.2
"""Radius that positions on an eyeball are relative to."""
PUPIL_SHARE = 0.42
"""Pupil to iris in room light."""


class Material(IntEnum):
    """Material of a vertex; selects the shading."""

    SKIN = 0
    LIP = 1
    EYE = 2
    TEETH = 3
    GUM = 4
    TONGUE = 5
    HAIR = 6
    LASH = 7
    MOUTH = 8
    CLOTH = 9
    BALL = 10
    """An eyeball with its iris in the texture, not drawn by the shader."""
    STRAND = 11
    """A single hair on a ribbon wider than itself; ``uv`` is the position across the hair and its half width, mm."""


class Bone(IntEnum):
    """Bone that a vertex turns with before the head turns it."""

    NONE = 0
    JAW = 1
    LEFT_EYE = 2
    RIGHT_EYE = 3


@dataclass(frozen=True, slots=True)
class Channel:
    """One piecewise-linear function of one FAP.

    Its weight is the distance of the FAP from ``start`` towards ``stop``, in FAPU, never negative: for a FAP value v,
    ``clip((v - start) * sign, 0, abs(stop - start))`` with ``sign`` that of ``stop - start``.
    """

    fap: int
    """FAP number, 3 to 68."""
    start: float
    stop: float
    """FAPU; ``inf`` or ``-inf`` for an open end."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DeformationBasis(Rebuilt):
    """Channels and their sparse displacements."""

    channels: tuple[Channel, ...]
    offsets: NDArray[np.int32]
    """(V + 1,) int32: vertex ``v`` owns entries ``offsets[v]:offsets[v + 1]``."""
    entry_channels: NDArray[np.int32]
    """(N,) int32: channel of each entry, or row of ``mix`` if there is one."""
    entry_mm: NDArray[np.float32]
    """(N, 3) float32: displacement in mm per unit of channel weight (one FAPU)."""
    mix: NDArray[np.float32] | None = None
    """(W, C) float32: weights of the entries as sums of the channels; None if they are the channels' weights."""

    def __post_init__(self) -> None:
        freeze(self, np.int32, offsets=("V+1",), entry_channels=("N",))
        count = len(self.entry_channels)
        freeze(self, np.float32, entry_mm=(count, 3))
        if self.offsets[0] != 0 or self.offsets[-1] != count or (np.diff(self.offsets) < 0).any():
            raise UsageError(f"offsets: expected 0 rising to {count}, the number of entries")
        if self.mix is not None:
            freeze(self, np.float32, mix=("W", len(self.channels)))
        if not all(fap.FAPS[0].number <= channel.fap <= fap.FAPS[-1].number for channel in self.channels):
            raise UsageError(f"channels: must be of FAP {fap.FAPS[0].number} to {fap.FAPS[-1].number}")
        if count and not (self.entry_channels.min() >= 0 and self.entry_channels.max() < self.width):
            raise UsageError(f"entry_channels: must be 0 to {self.width - 1}")

    @property
    def width(self) -> int:
        """Number of weights of a frame."""
        return len(self.channels) if self.mix is None else len(self.mix)

    @property
    def entry_vertices(self) -> Indices:
        """(N,): vertex of each entry."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))

    def displacement(self, weights: Array) -> Array:
        """(V, 3) mm: displacement of every vertex for weights (W,)."""
        moves, count = weights[self.entry_channels, None] * self.entry_mm, len(self.offsets) - 1
        return np.stack([np.bincount(self.entry_vertices, column, count) for column in moves.T], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Folds(Rebuilt):
    """Shading that follows FAPs: furrows that appear, and lids and tongue that move into the light.

    A vertex with ``rest`` of 0 or more has furrows: its fraction is ``rest`` plus the change of each basis entry per
    unit of its channel, clipped to 0..1. With -1, on a lid or the tongue, entries change the occlusion instead.
    """

    map: NDArray[np.uint8]
    """(H, W) uint8: brightness of full furrows at ``uv``, 127.5 unchanged, 255 brightest. Used with a texture of the
    same size and three components; with any other texture there are no furrows.
    """
    rest: NDArray[np.float32]
    """(V,) float32: -1, or 0..1."""
    entries: NDArray[np.float32]
    """(N,) float32: change for one FAPU of each entry of the basis."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "map", frozen(self.map, "folds.map", ("H", "W"), np.uint8))
        for name in ("rest", "entries"):
            object.__setattr__(self, name, frozen(getattr(self, name), f"folds.{name}", ("N",), np.float32))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FaceMesh(Rebuilt):
    """A head in its neutral pose. Arrays are read-only."""

    vertices_mm: NDArray[np.float32]
    """(V, 3) float32, head space."""
    normals: NDArray[np.float32]
    """(V, 3) float32, unit length."""
    uv: NDArray[np.float32]
    """(V, 2) float32, 0..1. On eyes: the iris pattern's plane; on strands: see :attr:`Material.STRAND`."""
    albedo: NDArray[np.float32]
    """(V, 3) float32, linear RGB, 0..1."""
    material: NDArray[np.uint8]
    """(V,) uint8, :class:`Material`."""
    occlusion: NDArray[np.float32]
    """(V,) float32, fraction of ambient light that arrives, 0..1."""
    bone: NDArray[np.uint8]
    """(V,) uint8, :class:`Bone`."""
    bone_weight: NDArray[np.float32]
    """(V,) float32, 0..1."""
    head_weight: NDArray[np.float32]
    """(V,) float32, 0..1: 1 on the head, falling to 0 down the neck."""
    triangles: NDArray[np.int32]
    """(F, 3) int32, counter-clockwise seen from outside."""
    feature_points: Mapping[str, int]
    """Vertex index by feature point name."""
    jaw_pivot_mm: NDArray[np.float64]
    """(3,) float64: midpoint of the axis through both jaw joints; the axis is x."""
    head_pivot_mm: NDArray[np.float64]
    """(3,) float64: feature point 7.1."""
    eye_pivots_mm: NDArray[np.float64]
    """(2, 3) float64: centres of the left and the right eyeball."""
    fapu: Fapu
    basis: DeformationBasis
    iris_albedo: NDArray[np.float32] = field(default_factory=lambda: np.array(BROWN_IRIS, np.float32))
    """(3,) float32, linear RGB: the iris near the pupil, for eyes that the shader draws."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 3 or 4) uint8, sRGB: multiplied with ``albedo`` at ``uv``; None is white everywhere.

    Row 0 is at v = 0, column 0 at u = 0. The fourth component, if any, is coverage: less than half of 255 is a hole (a
    hair card, a lash). Eyes (:attr:`Material.EYE`) are drawn without it.
    """

    folds: Folds | None = None
    """Shading that follows FAPs, if any."""

    def __post_init__(self) -> None:
        freeze(
            self, np.float32, vertices_mm=("V", 3), normals=("V", 3), uv=("V", 2), albedo=("V", 3), occlusion=("V",),
            bone_weight=("V",), head_weight=("V",), iris_albedo=(3,),
        )  # fmt: skip
        count = len(self.vertices_mm)
        freeze(self, np.uint8, material=(count,), bone=(count,))
        freeze(self, np.int32, triangles=("F", 3))
        freeze(self, np.float64, jaw_pivot_mm=(3,), head_pivot_mm=(3,), eye_pivots_mm=(2, 3))
        if self.texture is not None:
            freeze(self, np.uint8, texture=("H", "W", "C"))
            if self.texture.size == 0 or self.texture.shape[2] not in (3, 4):
                raise UsageError(f"texture: got shape {self.texture.shape}, expected (H, W, 3) or (H, W, 4)")
        if self.folds is not None:
            sizes, expected = (len(self.folds.rest), len(self.folds.entries)), (count, len(self.basis.entry_mm))
            if sizes != expected:
                raise UsageError(f"folds: got {sizes} vertices and entries, expected {expected}")
        object.__setattr__(self, "feature_points", MappingProxyType(dict(self.feature_points)))
        unknown = set(self.feature_points) - set(FEATURE_POINT_NAMES)
        if unknown:
            raise UsageError(f"feature_points: got unknown names {sorted(unknown)}")
        if len(self.basis.offsets) != count + 1:
            raise UsageError(f"basis.offsets: got {len(self.basis.offsets)} numbers, expected {count + 1}")
        for name, indices, limit in (
            ("triangles", self.triangles, count),
            ("feature_points", np.array([*self.feature_points.values()], int), count),
            ("material", self.material, len(Material)),
            ("bone", self.bone, len(Bone)),
        ):
            if indices.size and not 0 <= indices.min() <= indices.max() < limit:
                raise UsageError(f"{name}: must be 0 to {limit - 1}")

    def point_mm(self, name: str) -> NDArray[np.float32]:
        """(3,) float32, mm: position of a feature point in the neutral face.

        Raises
        ------
        UsageError
            If the mesh does not have it.
        """
        if name not in self.feature_points:
            raise UsageError(f"feature point: got {name!r}, this mesh has {sorted(self.feature_points)}")
        return self.vertices_mm[self.feature_points[name]]


def iris_share(mesh: FaceMesh) -> float:
    """Radius of the iris relative to the eyeball."""
    return mesh.fapu.irisd0_mm / 2 / EYEBALL_RADIUS_MM


@lru_cache(maxsize=8)
def lid_share(mesh: FaceMesh) -> float:
    """Height of the neutral lids' margins above the middle of the eyeball, relative to its radius.

    The radius is that of the eyes drawn by the shader; without any, :data:`EYEBALL_RADIUS_MM`.
    """
    drawn = mesh.vertices_mm[mesh.material == Material.EYE]
    if not len(drawn):
        return mesh.fapu.irisd0_mm / 2 / EYEBALL_RADIUS_MM
    off_mm = np.sort(np.linalg.norm(drawn[:, None] - mesh.eye_pivots_mm, axis=-1).min(axis=1))
    median_mm = off_mm[(len(off_mm) - 1) // 2 : len(off_mm) // 2 + 1].mean()  # np.median imports numpy.ma
    return mesh.fapu.irisd0_mm / 2 / float(median_mm)


NEGLIGIBLE_MM = 0.08
"""Displacements below this at 1000 FAPU are dropped."""


class BasisCollector:
    """Collects channels and their displacements into a basis.

    Stateful.
    """

    def __init__(self, vertex_count: int) -> None:
        self._count = vertex_count
        self._channels: dict[Channel, int] = {}
        self._entries: list[tuple[Indices, int, Array]] = []

    def add(self, channel: Channel, vertices: Indices, displacement_mm: Array) -> None:
        """Add displacements, (N, 3) mm per FAPU, of vertices (N,) to a channel."""
        kept = np.abs(displacement_mm).max(axis=1) * 1000 > NEGLIGIBLE_MM
        self._add(channel, vertices[kept], np.pad(displacement_mm[kept], ((0, 0), (0, 1))))

    def add_shade(self, channel: Channel, vertices: Indices, shade: Array | float = 0.0) -> None:
        """Add entries without displacement for vertices (N,): the change of the shade per FAPU, (N,) or one for all.

        With 0 they are for vertices whose normals turn by more than their bone's rotation.
        """
        rows = np.zeros((len(vertices), 4))
        rows[:, 3] = shade
        self._add(channel, vertices, rows)

    def _add(self, channel: Channel, vertices: Indices, rows: Array) -> None:
        column = self._channels.setdefault(channel, len(self._channels))
        self._entries.append((vertices, column, rows + 0.0))  # -0 becomes 0

    def gathered(self) -> tuple[DeformationBasis, Array]:
        """Return the basis, and the change of the shade of each entry, (N,)."""
        basis, rows = gather(self._count, tuple(self._channels), self._entries)
        return basis, rows[:, 3]


def gather(
    vertex_count: int,
    channels: Sequence[Channel],
    entries: Sequence[tuple[Indices, int, Array]],
    mix: NDArray[np.float32] | None = None,
) -> tuple[DeformationBasis, Array]:
    """Make a basis, sorted by vertex, from vertices (N,), their channel or row of ``mix``, and rows (N, 3 or more).

    A row is a displacement, mm, and further values. Rows of the same vertex and channel are added up. Returns the
    basis, and the row of each of its entries.
    """
    width = len(channels) if mix is None else len(mix)
    columns = np.repeat([column for _, column, _ in entries], [len(vertices) for vertices, _, _ in entries])
    keys = width * np.concatenate([vertices for vertices, _, _ in entries]) + columns
    order = np.argsort(keys, kind="stable")
    keys, first = np.unique(keys[order], return_index=True)
    rows = np.add.reduceat(np.concatenate([rows for _, _, rows in entries])[order], first, axis=0)
    basis = DeformationBasis(
        channels=tuple(channels),
        offsets=np.concatenate([[0], np.cumsum(np.bincount(keys // width, minlength=vertex_count))]),
        entry_channels=keys % width,
        entry_mm=rows[:, :3].astype(np.float32),
        mix=mix,
    )
    return basis, rows
