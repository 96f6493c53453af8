"""Building a mesh part by part: grids, rings around the openings of mouth and eyes, strands of hair; its texture.

An opening replaces a block of cells of the skin grid. The border of the block is the outermost ring, the rim of the
opening the innermost, and each border vertex has one vertex in every ring. A ring starts at the corner with the larger
x and runs counter-clockwise as seen from the front: first along the upper side, then back along the lower.

The texture has the skin on the left, strands of hair next to it, and plain white at the edge.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, Indices, Mask
from fapengine.mesh.face_mesh import Bone, Material

TEXTURE_SIZE = (768, 1024)
"""Height and width in texels."""
SKIN_U, HAIR_U = (0.002, 0.78), (0.80, 0.98)
PLAIN_UV = (0.993, 0.5)
SPAN_RAD = np.deg2rad(100.0)
"""Half the angle around the head that is painted; beyond it, under the hair, the edge colour continues."""
BOTTOM_MM, TOP_MM = -104.0, 116.0


def skin_uv(angle: ArrayLike, y: ArrayLike) -> Array:
    """(..., 2): texture coordinates, from the angle around the bare head, rad, and height, mm."""
    share = np.clip(np.asarray(angle, dtype=np.float64) / SPAN_RAD, -1, 1) / 2 + 0.5
    height = (np.asarray(y, dtype=np.float64) - BOTTOM_MM) / (TOP_MM - BOTTOM_MM)
    u, v = np.broadcast_arrays(SKIN_U[0] + share * (SKIN_U[1] - SKIN_U[0]), np.clip(height, 0.003, 0.997))
    return np.stack([u, v], axis=-1)


def skin_places() -> tuple[Array, Array]:
    """Angle, rad, and height, mm, of every texel of the skin area: (H, W') each."""
    rows, columns = TEXTURE_SIZE
    used = round(SKIN_U[1] * columns)
    u, v = (np.arange(used) + 0.5) / columns, (np.arange(rows) + 0.5) / rows
    angle = (np.clip((u - SKIN_U[0]) / (SKIN_U[1] - SKIN_U[0]), 0, 1) * 2 - 1) * SPAN_RAD
    height = BOTTOM_MM + v * (TOP_MM - BOTTOM_MM)
    grid = np.meshgrid(angle, height)
    return grid[0], grid[1]


def strand_uv(across: ArrayLike, along: ArrayLike) -> Array:
    """(..., 2): texture coordinates among the strands; ``across`` and ``along`` are 0..1."""
    u = HAIR_U[0] + np.asarray(across, dtype=np.float64) * (HAIR_U[1] - HAIR_U[0])
    return np.stack(np.broadcast_arrays(u, np.clip(np.asarray(along, dtype=np.float64), 0.004, 0.996)), axis=-1)


STRAND_MARGIN_MM = 0.6
"""Margin of a strand's ribbon on either side of its hair, so that edge pixels are on the ribbon down to about 2 pixels
per mm.
"""
GOLDEN = 0.6180339887498949
NOWHERE = (np.nan, np.nan)
"""Place of a vertex that is not on the skin."""
NOT_GIVEN = (np.nan, np.nan, np.nan)
"""Normal of a vertex that is lit by its triangles alone."""


@dataclass(slots=True)
class MeshBuilder:
    """Collects parts; vertex indices are those of the finished mesh.

    Stateful.
    """

    count: int = 0
    _fields: dict[str, list[NDArray[np.generic]]] = field(default_factory=dict)
    _triangles: list[Indices] = field(default_factory=list)

    def add(
        self,
        points_mm: Array,
        *,
        albedo: ArrayLike,
        material: ArrayLike = Material.SKIN,
        bone: ArrayLike = Bone.NONE,
        bone_weight: ArrayLike = 0.0,
        head_weight: ArrayLike = 1.0,
        uv: ArrayLike = PLAIN_UV,
        place: ArrayLike = NOWHERE,
        normal: ArrayLike = NOT_GIVEN,
    ) -> Indices:
        """Add vertices, (..., 3) mm; all other arguments broadcast. Returns their indices, (...).

        ``place`` is angle, rad, and height, mm, on the bare head, at which the measured face moves a skin vertex
        (:mod:`.faces`). Vertices with a ``normal``, a unit vector, are lit more by it than by their triangles.
        """
        shape = points_mm.shape[:-1]
        size = int(np.prod(shape))
        for name, value, tail in (
            ("points_mm", points_mm, (3,)),
            ("albedo", albedo, (3,)),
            ("material", material, ()),
            ("bone", bone, ()),
            ("bone_weight", bone_weight, ()),
            ("head_weight", head_weight, ()),
            ("uv", uv, (2,)),
            ("place", place, (2,)),
            ("normal", normal, (3,)),
        ):
            spread = np.array(np.broadcast_to(value, (*shape, *tail)).reshape(size, *tail))
            self._fields.setdefault(name, []).append(spread)
        indices = self.count + np.arange(size).reshape(shape)
        self.count += size
        return indices

    def quads(self, grid: Indices, *, closed: bool = False, keep: Mask | None = None) -> None:
        """Join a (rows, columns) grid of vertices; ``closed`` joins the last column to the first.

        The outside is where rows run up and columns to the right. ``keep`` selects cells: (rows - 1, columns or columns
        - 1) bool.
        """
        if closed:
            grid = np.concatenate([grid, grid[:, :1]], axis=1)
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        cells = np.stack([a, b, c, a, c, d], axis=-1)
        first, second, third = (cells if keep is None else cells[keep]).reshape(-1, 3).T
        is_whole = (first != second) & (second != third) & (first != third)
        self.loose(np.stack([first, second, third], axis=-1)[is_whole])

    def strands(
        self,
        spine_mm: Array,
        half_width_mm: ArrayLike,
        aside: Array,
        *,
        albedo: ArrayLike,
        head_weight: ArrayLike = 1.0,
        place: ArrayLike = NOWHERE,
        normal: ArrayLike = NOT_GIVEN,
    ) -> Indices:
        """Add single hairs, each a ribbon along its spine; returns their indices, (L, 2 P), from root to tip.

        Parameters
        ----------
        spine_mm : (L, P, 3)
            Points along each hair, root first.
        half_width_mm, head_weight : broadcast to (L, P)
            Half the width of the hair; see :class:`fapengine.mesh.face_mesh.FaceMesh`.
        aside : broadcasts to (L, P, 3)
            Unit direction across the ribbon: its outside is where ``aside`` points right and the hair up.
        albedo, normal : broadcast to (L, P, 3)
            Linear RGB; see :meth:`add`.
        place : broadcasts to (L, P, 2)
            See :meth:`add`.
        """
        shape = spine_mm.shape[:2]
        half, weight = (np.broadcast_to(value, shape)[..., None] for value in (half_width_mm, head_weight))
        across = np.array([-1.0, 1.0]) * (half + STRAND_MARGIN_MM)
        of_edges = (np.broadcast_to(value, (*shape, 3))[:, :, None] for value in (aside, albedo, normal))
        aside, colour, lit_from = of_edges
        grid = self.add(
            spine_mm[:, :, None] + across[..., None] * aside,
            albedo=colour,
            material=Material.STRAND,
            head_weight=weight,
            uv=np.stack([across, np.broadcast_to(half, across.shape)], axis=-1),
            place=np.broadcast_to(place, (*shape, 2))[:, :, None],
            normal=lit_from,
        )
        left, right = grid[..., 0], grid[..., 1]
        self.loose(np.stack([left[:, :-1], right[:, :-1], right[:, 1:]], axis=-1))
        self.loose(np.stack([left[:, :-1], right[:, 1:], left[:, 1:]], axis=-1))
        return grid.reshape(len(grid), -1)

    def fan(self, ring: Indices, centre: int) -> None:
        """Close a ring, (N,) indices, with a centre vertex; the outside is where the ring runs counter-clockwise."""
        self.loose(np.stack([ring, np.roll(ring, -1), np.full(len(ring), centre)], axis=-1))

    def loose(self, triangles: Indices) -> None:
        """Add triangles, (..., 3), counter-clockwise from outside."""
        self._triangles.append(triangles.reshape(-1, 3))

    def column(self, name: str) -> NDArray[Any]:
        """Values of one field so far, (V, ...)."""
        return np.concatenate(self._fields[name])

    def triangles(self) -> Indices:
        """(F, 3), counter-clockwise from outside."""
        return np.concatenate(self._triangles)


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Cells of the skin grid that an opening replaces."""

    bottom: int
    top: int
    """Rows of the grid."""
    corner: int
    """Row with the corners of the opening."""
    left: int
    right: int
    """Columns of the grid, rising with x."""

    def border(self, grid: Indices) -> Indices:
        """(N,): vertices of a grid, (rows, columns), at the border, in ring order."""
        bottom, top, left, right = self.bottom, self.top, self.left, self.right
        sides = [
            grid[self.corner : top, right],
            grid[top, right:left:-1],
            grid[top:bottom:-1, left],
            grid[bottom, left:right],
            grid[bottom : self.corner, right],
        ]
        return np.concatenate(sides)

    def along(self) -> tuple[Array, Mask]:
        """(N,) position along the opening, 1 at the first corner to -1 at the other; (N,) upper side or corner."""
        upper, lower = (
            2 * height + (self.right - self.left) for height in (self.top - self.corner, self.corner - self.bottom)
        )
        t = np.concatenate([_spread(np.arange(upper + 1) / upper), -_spread(np.arange(1, lower) / lower)])
        return t, np.arange(len(t)) <= upper


def _spread(share: Array) -> Array:
    """From 1 to -1, somewhat denser at the ends."""
    return 0.45 * np.cos(np.pi * share) + 0.55 * (1 - 2 * share)


def golden(number: ArrayLike, factor: float = 1.0) -> Array:
    """(N,): fractions 0..1 of multiples of the golden ratio, which vary numbered things evenly without randomness."""
    return (np.asarray(number) * GOLDEN * factor) % 1


def resampled(table: ArrayLike, detail: float) -> Array:
    """(M, ...) from (N, ...): about ``detail`` times as many rows; the first and the last are kept."""
    rows = np.asarray(table, dtype=np.float64)
    places = np.linspace(0, len(rows) - 1, max(2, round((len(rows) - 1) * detail) + 1))
    columns = [np.interp(places, np.arange(len(rows)), column) for column in rows.reshape(len(rows), -1).T]
    return np.stack(columns, axis=-1).reshape(len(places), *rows.shape[1:])


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Vertices around an opening."""

    indices: Indices
    """(levels, N), outermost first."""
    level: Array
    """(levels,): 2 at the border of the block, 1 at the outer edge of lip or lid, 0 at the rim, negative inside."""
    t: Array
    """(N,): 1 to -1 from corner to corner."""
    upper: Mask
    """(N,): upper side or corner."""
