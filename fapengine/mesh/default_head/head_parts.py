"""Which vertices of the head are what; what the deformation basis is built from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.mesh.default_head.eyes import Eye
from fapengine.mesh.default_head.rings import Rings

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class HeadParts:
    """Which vertices are what, for the deformation."""

    grid: Indices
    """(rows, columns) skin."""
    mouth: Rings
    eyes: tuple[Eye, Eye]
    brows: tuple[Indices, Indices]
    ears: tuple[Indices, Indices]
    upper_teeth: Indices
    lower_teeth: Indices
    tongue: Indices
    hair: Indices
    """Empty on a bald head."""
    crown: int
    """The vertex that closes the skin on top."""
    pivot: int
    """A vertex of no triangle: feature point 7.1, the top of the spine."""
