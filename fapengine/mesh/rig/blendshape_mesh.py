"""A mesh with named blendshapes (glTF's morph targets) and bones, as read from a file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices, Mask, freeze
from fapengine.errors import UsageError

BONE_NAMES = ("head", "jaw", "left eye", "right eye")
"""Bones of a rig that an imported head uses."""


@dataclass(frozen=True, slots=True, eq=False)
class Blendshape:
    """Displacements of some vertices at full weight. Arrays are read-only."""

    vertices: Indices
    """(N,) int64, no vertex twice."""
    moves: Array
    """(N, 3) float64: displacements, in the mesh's unit and axes."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, vertices=("N",))
        freeze(self, moves=(len(self.vertices), 3))


@dataclass(frozen=True, slots=True, eq=False)
class RigBone:
    """A bone: the weights of its vertices, and its joint."""

    weight: Array
    """(V,) float64, 0..1: weight of each vertex on the bone and its children."""
    joint: Array
    """(3,) float64, in the mesh's unit and axes."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BlendshapeMesh:
    """A neutral mesh and its blendshapes, in any unit and axes. Arrays are read-only.

    Raises
    ------
    UsageError
        If an array has another shape, a vertex index is out of range, or a bone has an unknown name.
    """

    vertices: Array
    """(V, 3) float64."""
    triangles: Indices
    """(F, 3) int64, counter-clockwise from outside."""
    blendshapes: Mapping[str, Blendshape]
    """Blendshapes by the names in the file, in its order."""
    uv: Array | None = None
    """(V, 2) float64: texture coordinates, (0, 0) the top left corner; None without a texture."""
    texture: NDArray[np.uint8] | None = None
    """(H, W, 4) uint8: base colour of the whole mesh, sRGB and straight alpha."""
    albedo: Array | None = None
    """(V, 3) float64, linear RGB, 0..1: multiplies the texture, if there is one; None if the file has none."""
    surfaces: tuple[str, ...] = ()
    """Names of the mesh's surfaces, such as ``"Teeth"``, ``"Hair / HairMaterial"``."""
    surface: Indices | None = None
    """(V,) int64: index in ``surfaces`` of each vertex."""
    bones: Mapping[str, RigBone] = field(default_factory=dict)
    """Bones by :data:`BONE_NAMES`."""
    faces_back: bool = False
    """Whether a face without eye bones looks along -z, as of VRM 0.x."""
    notes: tuple[str, ...] = ()
    """Sentences about parts of the file that were left out."""

    def __post_init__(self) -> None:
        freeze(self, vertices=("V", 3))
        freeze(self, np.int64, triangles=("F", 3))
        count = len(self.vertices)
        if len(self.triangles) and not 0 <= self.triangles.min() <= self.triangles.max() < count:
            raise UsageError(f"triangles: vertices must be 0 to {count - 1}")
        for name, shape, dtype in (
            ("uv", (count, 2), np.float64),
            ("albedo", (count, 3), np.float64),
            ("surface", (count,), np.int64),
            ("texture", ("H", "W", 4), np.uint8),
        ):
            if getattr(self, name) is not None:
                freeze(self, dtype, **{name: shape})
        for name, blendshape in self.blendshapes.items():
            moved = blendshape.vertices
            if len(moved) and not 0 <= moved.min() <= moved.max() < count:
                raise UsageError(f"blendshape {name}: vertices must be 0 to {count - 1}")
        if unknown := set(self.bones) - set(BONE_NAMES):
            raise UsageError(f"bones: got {sorted(unknown)}, expected some of {', '.join(BONE_NAMES)}")
        object.__setattr__(self, "blendshapes", MappingProxyType(dict(self.blendshapes)))
        object.__setattr__(self, "bones", MappingProxyType(dict(self.bones)))

    def dense(self, name: str) -> Array:
        """(V, 3) float64: displacement of every vertex by one blendshape at full weight.

        Raises
        ------
        UsageError
            If there is no blendshape of that name.
        """
        if name not in self.blendshapes:
            raise UsageError(f"blendshape: got {name!r}, this mesh has {', '.join(list(self.blendshapes)[:12])}")
        moves = np.zeros_like(self.vertices)
        moves[self.blendshapes[name].vertices] = self.blendshapes[name].moves
        return moves

    def on_surfaces(self, words: Sequence[str]) -> Mask:
        """(V,) bool: vertices of surfaces with one of these words in their names."""
        if self.surface is None:
            return np.zeros(len(self.vertices), bool)
        chosen = [number for number, name in enumerate(self.surfaces) if any(word in name.lower() for word in words)]
        return np.isin(self.surface, chosen)
