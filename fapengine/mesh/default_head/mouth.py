"""Lips and the inside of the mouth: rings from the skin over the lips into the oral cavity.

The neutral lips touch along a horizontal line (the standard's neutral face). Numbers are millimetres; the lip contours
follow the proportions of the measured head (feature points 8.1-8.10, 2.2-2.9).
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

from fapengine._arrays import Array, Indices, Mask
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh import colours
from fapengine.mesh.default_head.mesh_builder import Block, MeshBuilder, Rings, resampled, skin_uv
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.default_head.surface import angle_of, normal, position
from fapengine.mesh.face_mesh import Material

LINE_Y = -34.0
MIDDLE = (0.0, LINE_Y)
"""Place between the lips, on the bare head."""
INNER_HALF_WIDTH, OUTER_HALF_WIDTH = 22.0, 25.3
HALF_WAY = 0.55
"""Position along the lip, 0 middle to 1 corner, of the feature points half way (2.6, 8.5, ...)."""
APART = 0.004
"""Fraction by which those of the lower lip are closer to the middle: no two neutral feature points coincide."""
OUTSIDE = (1.78, 1.58, 1.4, 1.25, 1.12, 1.0)
LIP = (1.0, 0.88, 0.74, 0.58, 0.42, 0.26, 0.12, 0.0)
BOW_MM = PchipInterpolator((0.0, 0.06, 0.21, 0.34, 0.55, 0.8, 0.93, 1.0), (8.3, 8.5, 9.9, 9.2, 6.2, 2.8, 1.4, 0.0))
"""Height of the upper lip's edge above the mouth line, by position along it: a bow that tapers to the corners."""
INSIDE = (  # level, away from the mouth line, backwards, share of the width, light
    (-0.08, 0.5, 1.2, 1.0, 1.0),
    (-0.2, 1.6, 3.2, 1.03, 1.0),
    (-0.4, 9.0, 5.0, 1.14, 0.9),
    (-0.7, 13.0, 22.0, 1.36, 0.5),
    (-1.0, 13.0, 42.0, 1.3, 0.22),
)
"""The oral cavity. It widens behind the lips, so that the dental arch is in front of its wall."""


def with_half_way(t: Array, upper: Mask) -> Array:
    """(N,): positions along the lips, shifted slightly so that each lip has one at :data:`HALF_WAY` on each side.

    Otherwise the feature points there would be next to it, and differ between upper and lower lip.
    """
    moved = t.copy()
    for lip, place in ((upper, HALF_WAY), (~upper, HALF_WAY * (1 - APART))):
        across = np.abs(t[lip])
        nearest = across[np.abs(across - HALF_WAY).argmin()]
        moved[lip] = np.sign(t[lip]) * np.interp(across, (0.0, nearest, 1.0), (0.0, place, 1.0))
    return moved


def outer_contour(t: Array, upper: Mask, fullness: float) -> Array:
    """(N,) height of the outer edge of the lips."""
    bow = BOW_MM(np.abs(t))
    lower = (1 - np.abs(t) ** 1.9) ** 1.15
    return LINE_Y + fullness * np.where(upper, bow, -10.0 * lower)


def line(t: Array) -> Array:
    """(N,) height of the line between the lips: equal in the middle and at the corners, slightly wavy between."""
    return LINE_Y - 0.12 * np.exp(-((t / 0.2) ** 2)) + 0.2 * np.exp(-(((np.abs(t) - 0.45) / 0.25) ** 2))


def bulge(share: Array, t: Array, upper: Mask, fullness: float) -> Array:
    """Height of the lips above the bare face, (...) mm.

    ``share`` is 0 at the mouth line, 1 at the outer edge, 2 beyond; ``t`` runs from -1 to 1 along the line.
    """
    middle = 1 - np.abs(t) ** 3
    lip = np.clip(share, 0, 1)
    body_upper = 0.2 + 1.9 * np.sin(np.pi * lip**0.8) * (1 - 0.25 * lip) - 0.1 * lip
    tubercle = 0.5 * np.exp(-((t / 0.2) ** 2)) * np.sin(np.pi * lip)
    body_lower = 0.2 + 2.9 * np.sin(np.pi * lip**0.85) * (1 - 0.2 * lip) - 0.4 * lip
    beyond = 1 - smoothstep((share - 1) / 0.45)
    groove = -1.3 * np.exp(-(((share - 1.3) / 0.2) ** 2)) * (~upper)
    philtrum = -1.0 * np.exp(-((t / 0.11) ** 2)) * smoothstep((share - 1) / 0.2) * smoothstep((2 - share) / 0.4) * upper
    columns = 0.6 * np.exp(-(((np.abs(t) - 0.24) / 0.09) ** 2)) * smoothstep((share - 0.9) / 0.2)
    columns = columns * smoothstep((1.9 - share) / 0.5) * upper
    body = np.where(upper, body_upper + tubercle, body_lower) * beyond
    return fullness * middle * (body + groove) + philtrum + columns - 0.8 * (1 - middle) * beyond


def build_mouth(builder: MeshBuilder, border: Indices, block: Block, style: HeadStyle, detail: float) -> Rings:
    """Add lips and oral cavity inside a block with existing border vertices, (N,) indices."""
    t, upper = block.along()
    t = with_half_way(t, upper)
    at_border = builder.column("points_mm")[border]
    palette = palette_of(style)
    outer = np.stack([style.mouth_width * OUTER_HALF_WIDTH * t, outer_contour(t, upper, style.lip_fullness)], axis=-1)
    inner = np.stack([style.mouth_width * INNER_HALF_WIDTH * t, line(t)], axis=-1)

    grids, levels = [border], [2.0]
    across = (*resampled(OUTSIDE, detail), *resampled(LIP, detail)[1:])
    flats = np.stack(
        [
            outer + (level - 1.0) * (at_border[:, :2] - outer) if level >= 1 else inner + level * (outer - inner)
            for level in across
        ]
    )
    angles = angle_of(flats[..., 0], flats[..., 1], style)
    above = bulge(np.array(across)[:, None], t, upper, style.lip_fullness)
    laid = position(angles, flats[..., 1], style) + above[..., None] * normal(angles, flats[..., 1], style)
    for level, flat, angle, points in zip(across, flats, angles, laid, strict=True):
        # Lips have no edge at their corners.
        on_lip = smoothstep((1.08 - level) / 0.14) * (1 - 0.2 * level * smoothstep((np.abs(t) - 0.86) / 0.14))
        albedo = palette.skin(points) + on_lip[:, None] * (palette.lip(points, t, level) - palette.skin(points))
        kind, uv = Material.LIP if level <= 1 else Material.SKIN, skin_uv(angle, flat[:, 1])
        place = np.stack([angle, flat[:, 1]], axis=-1)
        grids.append(builder.add(points, albedo=albedo, material=kind, uv=uv, place=place))
        levels.append(level)
    rim = points
    middle = 1 - np.abs(t) ** 3
    for level, away, back, width, light in resampled(INSIDE, detail):
        deep = smoothstep((-level - 0.2) / 0.5)  # lips meet in a corner, the cheeks behind them do not
        fall = 1 - np.abs(t) ** (3 + 5 * deep)
        to_back = 0.4 + 0.6 * np.maximum(middle, deep)
        points = rim * [width, 1, 1] + np.stack([0 * t, np.where(upper, away, -away) * fall, -back * to_back], axis=-1)
        dark = smoothstep((-level - 0.05) / 0.5)
        albedo = palette.lip(rim, t, 0.0) * (1 - dark) + light * colours.MOUTH * dark
        material = Material.LIP if level > -0.15 else Material.MOUTH
        grids.append(builder.add(points, albedo=albedo, material=material, place=place))
        levels.append(level)
    rings = np.stack(grids)
    builder.quads(rings, closed=True)
    end = builder.add(
        points.mean(axis=0) - [0, 0, 14.0], albedo=0.15 * colours.MOUTH, material=Material.MOUTH, place=MIDDLE
    )
    builder.fan(rings[-1], int(end))
    return Rings(rings, np.array(levels), t, upper)
