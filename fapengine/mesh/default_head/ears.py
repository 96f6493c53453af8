"""Ears: a shell over an egg-shaped outline, its relief a sum of ridges and hollows with anatomical names.

Local axes are *up* along the ear, *back* across it and *out* of the head. ``share`` runs from the middle (0) to the
outline (1); beyond, rings roll over the edge and back to the head. Proportions: Farkas 1994, adults: 62 mm long,
35 mm wide.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.colours import BLOOD
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.mesh_builder import MeshBuilder
from fapengine.mesh.default_head.style import HeadStyle, palette_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MIDDLE = np.array([82.0, 16.5, -4.0])
UP_AXIS, BACK_AXIS = np.array([0.05, 0.975, -0.215]), np.array([0.21, -0.170, -0.963])
ROOT = (np.deg2rad(93.0), 10.0)
"""Place on the bare head with which an ear goes."""
HALF_LENGTH, HALF_WIDTH = 29.5, 16.5
JOIN_MM = 9.5
"""Depth by which the front of an ear lies in the head."""
INSIDE = (0.06, 0.22, 0.36, 0.48, 0.58, 0.67, 0.75, 0.83, 0.9, 0.96)
EDGE = ((1.0, -1.2), (0.98, -3.2), (0.9, -5.5), (0.72, -10.0))
"""Round the edge: share, height."""


def _ridge(share: Array, at: float, width: float) -> Array:
    ridge: Array = np.exp(-(((share - at) / width) ** 2))
    return ridge


def _relief(share: Array, up: Array, back: Array) -> Array:
    """Height above the shell, mm, by direction (``up``, ``back``: sine and cosine) and share."""
    u, v = share * back, share * up
    helix = smoothstep((up + 0.62 + 0.35 * back) / 0.45) * (1 - 0.75 * smoothstep((-back - 0.82) / 0.2) * (up < 0.3))
    antihelix = smoothstep((back + 0.35 + 0.9 * np.clip(up, 0, 1)) / 0.6) * smoothstep((0.99 - up) / 0.25)
    antihelix *= smoothstep((up + 0.92) / 0.3)
    relief = 3.9 * helix * _ridge(share, 0.91, 0.075) - 3.0 * helix * _ridge(share, 0.755, 0.075)
    relief += 2.6 * antihelix * _ridge(share, 0.58, 0.10)
    relief -= 6.5 * np.exp(-((((u + 0.16) / 0.36) ** 2 + ((v + 0.14) / 0.36) ** 2) ** 1.6))  # concha
    relief -= 2.0 * np.exp(-(((u + 0.02) / 0.24) ** 2) - ((v - 0.40) / 0.14) ** 2)  # triangular fossa
    relief += 4.6 * np.exp(-(((u + 0.70) / 0.17) ** 2) - ((v + 0.16) / 0.15) ** 2)  # tragus
    relief += 2.4 * np.exp(-(((u - 0.12) / 0.18) ** 2) - ((v + 0.52) / 0.10) ** 2)  # antitragus
    relief += 2.6 * np.exp(-(((u + 0.42) / 0.22) ** 2) - ((v - 0.10) / 0.085) ** 2)  # root of the helix
    relief += 2.0 * np.exp(-(((u + 0.05) / 0.4) ** 2) - ((v + 0.80) / 0.16) ** 2)  # lobe
    return relief


def build_ear(builder: MeshBuilder, style: HeadStyle, side: float, detail: float) -> Indices:
    """Add one ear; returns its indices, (R, S): rings by segments."""
    around = np.linspace(0, 2 * np.pi, max(20, round(28 * detail)), endpoint=False)
    up, back = np.cos(around), np.sin(around)
    inside = np.array(INSIDE) if detail >= 1 else np.array(INSIDE)[[0, 2, 3, 4, 6, 8, 9]]
    if detail > 1:
        places = np.linspace(0, len(inside) - 1, round((len(inside) - 1) * detail) + 1)
        inside = np.interp(places, np.arange(len(inside)), inside)
    outline = 1 + 0.08 * up * np.abs(up) + 0.10 * back * up - 0.05 * smoothstep((-up - 0.35) / 0.6) * np.abs(back)
    share = np.concatenate([inside, [edge for edge, _ in EDGE]])[:, None]
    height = _relief(share, up, back)
    height[len(inside) :] = height[len(inside) - 1] * np.array([0.7, 0.3, 0.0, 0.0])[:, None]
    height[len(inside) :] += np.array([drop for _, drop in EDGE])[:, None]
    shell = 3.4 + 1.2 * back * share - 1.6 * (share**2)  # gently domed, and open at the back
    # Its front grows out of the cheek: no rim stands off there, from the root of the helix to the lobe.
    joined = smoothstep((-back - 0.25) / 0.6) * smoothstep((up + 0.95) / 0.3) * smoothstep((0.8 - up) / 0.5)
    shell = shell - JOIN_MM * joined * smoothstep((share - 0.45) / 0.45)
    narrow = 1 - 0.20 * smoothstep((-up * share - 0.05) / 0.75)
    full = 1 + 0.07 * smoothstep((up - 0.2) / 0.5) * np.clip(back, 0, 1)
    local = np.stack(
        [HALF_LENGTH * outline * up * share, HALF_WIDTH * outline * narrow * full * back * share, height + shell],
        axis=-1,
    )
    points = MIDDLE + local @ np.stack([UP_AXIS, BACK_AXIS, np.cross(BACK_AXIS, UP_AXIS)])
    points = (points + faces.displacement(ROOT, style.weights)) * [side, 1, 1]
    palette = palette_of(style)
    albedo = palette.skin(points)
    deep = np.clip(-height / 7.0, 0, 1)[..., None]
    albedo = (albedo + 0.22 * (palette.blush - albedo)) * (1 - 0.45 * deep)
    albedo = albedo * (1 - 0.05 * BLOOD)  # as the painting does to the skin beside
    grid = builder.add(points, albedo=albedo)
    builder.quads(grid if side > 0 else grid[:, ::-1], closed=True)
    middle = int(builder.add(points[0].mean(axis=0), albedo=albedo[0].mean(axis=0)))
    builder.fan(grid[0, ::-1] if side > 0 else grid[0], middle)
    return grid
