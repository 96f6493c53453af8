"""Brows: hairs that lie on the skin; what lies under them is painted (:mod:`fapengine.mesh.default_head.painting`)."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from fapengine.mesh.default_head.mesh_builder import MeshBuilder
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.default_head.surface import angle_of, normal, position

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MIDDLE = np.array([[10.5, 54.6], [20.0, 57.4], [32.0, 60.2], [43.0, 59.2], [53.5, 53.4]])
"""Middle line of the left brow, (x, y) mm, from the nose outwards (feature points 4.1, 4.3, 4.5)."""
HALF_WIDTH = np.array([3.0, 3.7, 3.2, 2.2, 0.5])
HAIRS = 140
GOLDEN = 0.6180339887498949


def line(share: Array, thickness: float) -> tuple[Array, Array]:
    """(N, 2) middle line and (N,) half width, mm, of the left brow."""
    knots = np.linspace(0, 1, len(MIDDLE))
    middle = np.stack([PchipInterpolator(knots, MIDDLE[:, axis])(share) for axis in range(2)], axis=-1)
    return middle, thickness * PchipInterpolator(knots, HALF_WIDTH)(share)


def build_brow(builder: MeshBuilder, style: HeadStyle, side: float, detail: float) -> Indices:
    """Add one brow; returns all its indices, (N,)."""
    palette = palette_of(style)
    dark = 0.75 * palette.brows

    number = np.arange(round(HAIRS * np.clip(detail, 0.5, 1.6)))
    at = (number + 0.5) / len(number)
    spread = 2 * ((number * GOLDEN) % 1) - 1
    wild = 2 * ((number * GOLDEN * 7.31) % 1) - 1
    middle, half = line(at, style.brow_thickness)
    root = middle + (0.85 * spread * half)[:, None] * np.array([0.15, 1.0])
    # Hairs rise near the nose, then lie along the brow; those above its middle turn down, those below up.
    slope = np.interp(at, (0.0, 0.12, 0.35, 0.6, 1.0), (80.0, 55.0, 24.0, 0.0, -28.0)) - 16.0 * spread + 10.0 * wild
    along = np.stack([np.cos(np.deg2rad(slope)), np.sin(np.deg2rad(slope))], axis=-1)
    length = (5.4 + 1.2 * wild) * np.interp(at, (0.0, 0.1, 0.8, 1.0), (0.65, 1.0, 1.0, 0.6))
    half_width = 0.5 * np.interp(at, (0.0, 0.15, 1.0), (0.3, 0.42, 0.36))[:, None] * [1.0, 0.1]
    tip = root + length[:, None] * along
    flat = np.stack([root, tip], axis=1)
    angle, y = angle_of(flat[..., 0], flat[..., 1], style), flat[..., 1]
    spine = (position(angle, y, style) + np.array([0.30, 0.80])[:, None] * normal(angle, y, style)) * [side, 1, 1]
    aside = side * np.stack([side * along[:, 1], -along[:, 0], 0 * at], axis=-1)
    tint = dark * (0.85 + 0.35 * ((number * GOLDEN * 3.7) % 1))[:, None]
    place = np.stack([side * angle, y], axis=-1)
    return builder.strands(spine, half_width, aside, albedo=tint, place=place).ravel()
