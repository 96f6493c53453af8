"""A mesh with named shapes (morph targets, blend shapes), as a file or a program has it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LIMBS = ("head", "jaw", "left eye", "right eye")
"""Bones of a rig that mean something here."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """What one shape moves at full weight. Arrays are read-only."""

    vertices: Indices
    """(N,) int64, no vertex twice."""
    moves: Array
    """(N, 3) float64, in the mesh's unit and axes."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, "vertices", ("N",), np.int64))
        object.__setattr__(self, "moves", frozen(self.moves, "moves", (len(self.vertices), 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """A bone: what hangs on it, and the joint that it turns about."""

    weight: Array
    """(V,) float64, 0..1: how much of each vertex goes with it and its children."""
    joint: Array
    """(3,) float64, in the mesh's unit and axes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MorphMesh:
    """A neutral mesh and its shapes, in any unit and axes. Arrays are read-only."""

    vertices: Array
    """(V, 3) float64."""
    triangles: Indices
    """(F, 3) int64, counter-clockwise from outside."""
    shapes: Mapping[str, Shape]
    """By the name that the file gives, in its order."""
    uv: Array | None = None
    """(V, 2) float64: place in ``texture``, (0, 0) its top left corner; None without one."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 4) uint8: base colour of the whole mesh, sRGB and straight alpha."""
    albedo: Array | None = None
    """(V, 3) float64, linear RGB, 0..1: multiplies the texture, or stands alone; None where nothing is said."""
    surfaces: tuple[str, ...] = ()
    """Names of the parts, such as ``"Teeth"``, ``"Hair / HairMaterial"``."""
    surface: NDArray[np.int64] | None = None
    """(V,) int64: which of ``surfaces`` a vertex belongs to."""
    limbs: Mapping[str, Limb] = field(default_factory=dict)
    """By :data:`LIMBS`."""
    notes: tuple[str, ...] = ()
    """What was left out of the file, in words."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, "vertices", ("V", 3), np.float64))
        object.__setattr__(self, "triangles", frozen(self.triangles, "triangles", ("F", 3), np.int64))
        count = len(self.vertices)
        if len(self.triangles) and not 0 <= self.triangles.min() <= self.triangles.max() < count:
            raise UsageError(f"triangles: expected vertices 0..{count - 1}")
        for name, shape, kind in (
            ("uv", (count, 2), np.float64),
            ("albedo", (count, 3), np.float64),
            ("surface", (count,), np.int64),
            ("texture", ("H", "W", 4), np.uint8),
        ):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen(value, name, shape, kind))
        for name, one in self.shapes.items():
            if len(one.vertices) and not 0 <= one.vertices.min() <= one.vertices.max() < count:
                raise UsageError(f"shape {name}: expected vertices 0..{count - 1}")
        if unknown := set(self.limbs) - set(LIMBS):
            raise UsageError(f"limbs: got {sorted(unknown)}, expected some of {', '.join(LIMBS)}")
        object.__setattr__(self, "shapes", MappingProxyType(dict(self.shapes)))
        object.__setattr__(self, "limbs", MappingProxyType(dict(self.limbs)))

    def dense(self, name: str) -> Array:
        """(V, 3): what a shape moves each vertex by, at full weight."""
        if name not in self.shapes:
            raise UsageError(f"shape: got {name!r}, this mesh has {', '.join(list(self.shapes)[:12])}")
        moves = np.zeros_like(self.vertices)
        moves[self.shapes[name].vertices] = self.shapes[name].moves
        return moves

    def named(self, words: tuple[str, ...]) -> NDArray[np.bool_]:
        """(V,) bool: vertices of surfaces with one of these words in their names."""
        if self.surface is None:
            return np.zeros(len(self.vertices), bool)
        chosen = [number for number, name in enumerate(self.surfaces) if any(word in name.lower() for word in words)]
        return np.isin(self.surface, chosen)
