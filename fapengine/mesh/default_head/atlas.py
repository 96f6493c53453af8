"""Layout of the head's texture: skin on the left, strands of hair next to it, plain white at the edge."""

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array

SIZE = (768, 1024)
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
    rows, columns = SIZE
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
