"""Clothes at the end of the neck: a jumper, a shirt, or a jumper with a high neck.

A garment is a grid of rings around the neck: from inside the collar up over its edge, and down over the shoulders.
Collars fit around each neck and follow it as far as the skin below them does. On a shirt lie the leaves of its collar
and the strip with the buttons: grids whose places are coordinates on the grid of rings.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d, map_coordinates, maximum_filter1d

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import CLOTH_COLOURS
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, resampled
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.face_mesh import Material

HARMONICS = 5
"""Harmonics of the outline of a neck that a collar follows."""
# fmt: off
SHOULDERS = (  # as below
    (-124, 80, 74, 19, 9.0, 0.55, 1), (-131, 100, 78, 19, 12.0, 1, 1), (-142, 132, 81, 18, 0, 1, 1),
    (-160, 168, 86, 16, 0, 1, 1), (-195, 186, 95, 10, 0, 1, 1), (-300, 192, 102, 0, 0, 1, 1),
)
COLLARS = {  # height, half width, half depth, drop at the front; distance from the neck, share of the ellipse of the
    # shoulders; light
    "crew_neck": (
        (-111, 0, 0, 16, 0.6, 0, 0.4), (-106, 0, 0, 17, 1.7, 0, 0.6), (-105.2, 0, 0, 17, 2.8, 0, 0.78),
        (-106.5, 0, 0, 17, 4.4, 0, 0.82),
        (-112, 60, 66, 17.5, 6.9, 0.02, 0.78), (-119.5, 66, 70, 18.5, 8.6, 0.08, 0.78),
        (-120.3, 67, 70, 18.5, 7.7, 0.11, 0.45),
    ),
    "shirt": (
        (-108, 0, 0, 16, 0.5, 0, 0.6), (-101, 0, 0, 16, 1.4, 0, 0.9), (-100, 0, 0, 16, 2.4, 0, 1),
        (-101, 0, 0, 16, 3.2, 0, 0.9), (-108, 0, 0, 17, 3.6, 0, 0.7), (-114, 62, 66, 18, 5.0, 0.03, 0.8),
        (-119.5, 66, 70, 18.5, 8.0, 0.1, 1),
    ),
    "high_neck": (
        (-97, 0, 0, 12, 0.4, 0, 0.6), (-92, 0, 0, 12, 1.6, 0, 0.9), (-91, 0, 0, 12, 2.6, 0, 1),
        (-92.5, 0, 0, 12, 4.0, 0, 1), (-100, 0, 0, 13.5, 5.0, 0, 1), (-108.5, 0, 0, 15, 4.8, 0, 0.95),
        (-110.5, 0, 0, 15.5, 3.6, 0, 0.5), (-111, 0, 0, 16, 3.0, 0, 0.6), (-115, 62, 66, 17, 4.6, 0.02, 0.9),
        (-119.5, 66, 70, 18.5, 7.4, 0.09, 1),
    ),
}
"""Rings from the top inside."""
FOLD_MM = 2.0
"""Half the depth of folds."""
FOLD = 2
"""Ring of a shirt at which the leaves of its collar begin."""
LEAF = (  # from the fold to the edge: place, height above the shirt, mm, and light
    (0, 0.4, 1.2), (0.15, 1.3, 1.25), (0.4, 2.6, 1.25), (0.7, 3.0, 1.22), (0.93, 2.6, 1.2), (0.95, 2.4, 0.9),
    (1, 0.4, 0.6),
)
LEAF_RINGS, POINT_RINGS, POINT_REACH, LEAF_SPREAD = 4.1, 2.6, 1.7, 0.34
"""Length of a leaf, and what its point adds, in rings; angle over which it does; angle by which the front edge slants.
"""
STRIP = ((-8, 0.5, 0.6), (-7, 1, 0.95), (7, 1, 0.95), (8, 0.5, 0.6))
"""The strip with the buttons, across: x and height above the shirt, mm, and light."""
SEAM = ((-2.0, 0.2, 1.0), (-0.8, 1.6, 1.05), (0.6, 1.2, 0.6), (2.0, 0.2, 0.97))
"""A seam, across: place and height above the garment, mm, and light."""
SEAMS_RAD = (0.55, 1.05), (-0.55, -1.05), (2.3, 2.0), (-2.3, -2.0)
"""Angles where seams begin at the collar, and where they end."""
# fmt: on


def neck_weight(y: ArrayLike, z: ArrayLike) -> Array:
    """Share of the head's rotation, (...), that the neck follows at heights and depths, (...) mm."""
    y, z = np.asarray(y), np.asarray(z)
    return np.maximum(smoothstep((y + 126.0) / 56.0), smoothstep((z - 55.0) / 25.0))


def _around_neck(angle: Array, y: Array, style: HeadStyle) -> Array:
    """(R, C) mm: distance from the axis of a smooth outline that contains the neck, at angles and heights, (R, C)."""
    place_angle, place_y = angle, y
    for _ in range(8):  # the measured face moves places of the template around and up
        x, height, z = np.moveaxis(faces.position(place_angle, place_y, style) - [0.0, 0.0, AXIS_Z_MM], -1, 0)
        turned = np.arctan2(x, z) - angle
        place_angle = place_angle - np.arctan2(np.sin(turned), np.cos(turned))
        place_y = place_y - (height - y)
    away = np.hypot(x, z)
    # It spans the hollows between the muscles of the neck.
    columns = angle.shape[1]
    smooth = np.fft.irfft(np.fft.rfft(away, axis=1)[:, :HARMONICS], columns, axis=1)
    lacking = maximum_filter1d(np.maximum(away - smooth, 0.0), 5, axis=1, mode="wrap")
    return smooth + gaussian_filter1d(lacking, columns / 44, axis=1, mode="wrap")


def build_clothes(builder: MeshBuilder, style: HeadStyle, detail: float) -> None:
    """Add the garment of a style."""
    around = np.linspace(-np.pi, np.pi, max(32, round(44 * detail)) + 1)[:-1]
    table = resampled(COLLARS[style.garment] + SHOULDERS, max(1.0, detail))[:, :, None]
    height, half_width, half_depth, drop, from_neck, share, light = np.moveaxis(table, 1, 0)
    from_neck[0] -= 6.0 * max(0.0, 1.0 - detail)  # a coarse neck is narrower between its columns
    front = np.cos(around)
    y = height - drop * (front + np.sqrt(front**2 + 0.06)) / 2
    x, z = half_width * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.9, -8.0 + half_depth * np.cos(around)
    shoulders = np.stack([x, y, z], axis=-1)
    angle = np.broadcast_to(around, y.shape)
    away = _around_neck(angle, y, style) + from_neck
    collar = np.stack([away * np.sin(angle), y, AXIS_Z_MM + away * np.cos(angle)], axis=-1)
    points = collar + share[..., None] * (shoulders - collar)
    # Folds fall from the collar.
    fold = np.sin(8 * around + 1.2 * np.sin(3 * around) + 0.04 * height) * smoothstep((-118.0 - height) / 30.0)
    points[..., 1] += FOLD_MM * fold
    albedo = CLOTH_COLOURS[style.cloth_colour] * ((1 + 0.08 * fold) * light)[..., None]
    weight = (1 - share) * neck_weight(y, points[..., 2])
    grid = builder.add(points, albedo=albedo, material=Material.CLOTH, head_weight=weight)
    builder.quads(grid[::-1], closed=True)
    _add_sewn(builder, style, points, weight, max(1.0, detail))


def _add_sewn(builder: MeshBuilder, style: HeadStyle, rings: Array, weight: Array, detail: float) -> None:
    """Add to a grid of rings, (R, C, 3) mm, weights (R, C), a shirt's leaves and strip with buttons, or seams."""
    columns = rings.shape[1]
    outwards = unit_vectors(np.cross(np.gradient(rings, axis=0), np.gradient(rings, axis=1)), 1e-6)
    fields = np.concatenate([rings, outwards, weight[..., None]], axis=-1)

    def at(ring: Array, angle: Array, up_mm: Array) -> tuple[Array, Array]:
        """Points above the shirt, (M, N, 3) mm, and their weights, at places that broadcast to (M, N)."""
        where = np.stack(np.broadcast_arrays(ring * detail, (angle / (2 * np.pi) + 0.5) % 1 * columns))
        laid = [map_coordinates(field, where, order=1, mode="grid-wrap") for field in np.moveaxis(fields, -1, 0)]
        return np.stack(laid[:3], axis=-1) + up_mm[..., None] * np.stack(laid[3:6], axis=-1), laid[6]

    def add(points: Array, weight: Array, light: Array) -> None:
        albedo = np.array(CLOTH_COLOURS[style.cloth_colour]) * np.broadcast_to(light, weight.shape)[..., None]
        builder.quads(builder.add(points, albedo=albedo, material=Material.CLOTH, head_weight=weight)[::-1])

    last = (len(rings) - 0.99) / detail
    if style.garment != "shirt":
        across, up_mm, light = np.array(SEAM).T
        for start, end in SEAMS_RAD:
            share = np.linspace(0, 1, 13)[:, None]
            ring = len(COLLARS[style.garment]) + share * ((len(rings) - 1) / detail - len(COLLARS[style.garment]))
            add(
                *at(ring, start + share**0.7 * (end - start) + across / np.interp(share, (0, 1), (70, 130)), up_mm),
                light,
            )
        return
    around = np.linspace(0.04, 2 * np.pi - 0.04, columns + 1)
    pointed = np.clip(1 - np.minimum(around, 2 * np.pi - around) / POINT_REACH, 0, 1)
    place, up_mm, light = resampled(LEAF, detail).T[..., None]
    slant = LEAF_SPREAD * pointed * np.sign(np.pi - around)
    add(*at(FOLD + place * (LEAF_RINGS + POINT_RINGS * pointed), around + place * slant, up_mm), light)
    x, up_mm, light = np.array(STRIP).T
    points, weight = at(np.arange(FOLD + 1, last)[:, None], 0 * x, up_mm)
    points[..., 0] = x
    add(points, weight, light)
