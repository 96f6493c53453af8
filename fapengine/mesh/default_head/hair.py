"""Hair: a cap on the scalp, hair over it (:mod:`.clumps`), and single hairs along the hairline."""

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.clumps import build_clumps
from fapengine.mesh.default_head.faces import Scalp, hairline, normal, position
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, resampled, strand_uv
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.face_mesh import Material

CAP_ROWS = (-0.03, 0.0, 0.03, 0.09, 0.155, 0.22, 0.32, 0.42, 0.525, 0.63, 0.72, 0.82, 0.89, 0.95)
CAP_SHADE, UNDER_CLUMPS_SHADE = 0.85, 0.6
CAP_TOP_MM, RISES, USUAL_RISE = 144.0, {"short": 0.24}, 0.22
"""Height of the crown of the cap, and fraction of the way there over which the cap gains its thickness, by haircut."""
LEAN_RAD, RELIEF_MM = 0.55, 0.5
"""Angle by which strands of the cap lean back on their way down the sides, and height of their waves."""
EDGE_HAIRS, EDGE_POINTS = 244, 3
"""Single hairs along the hairline, and points of each."""
SWEPT = np.array([-0.4, 0.9, -0.1])
"""Direction of those over the forehead."""
THICK, UNDER_LOCKS = {"short": 0.55, "cropped": 0.22}, 0.1
"""Thickness of the cap by haircut, relative to short hair; under long hair."""
UNDER_CLUMPS = 0.6
"""Detail of a cap that clumps cover, relative to one that shows."""


def _thickness(y: Array) -> Array:
    """Distance of the cap from the scalp, mm, by height."""
    return 4.2 + 6.3 * smoothstep((y - 45.0) / 75.0)


def build_hair(builder: MeshBuilder, style: HeadStyle, detail: float) -> Indices:
    """Add cap and locks; returns their indices, (N,), those of the cap first."""
    palette = palette_of(style)
    cap = _build_cap(builder, style, palette, detail)
    if style.haircut == "cropped":
        return cap
    edge = _build_edge(builder, style, palette, detail)
    return np.concatenate([cap, edge, build_clumps(builder, style, palette, detail)])


def _build_edge(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add single hairs that begin before and behind the hairline, so that hair has no edge; (N,) indices."""
    number = np.arange(round(EDGE_HAIRS * min(detail, 1.4) ** 1.5))
    place, wild, other = (2 * golden(number, factor) - 1 for factor in (1.0, 5.77, 3.1))
    angle = np.pi * np.sign(place) * np.abs(place) ** 1.3  # most are over the face
    clear = (np.abs(np.rad2deg(np.abs(angle)) - 104.0) > 24.0) | (number % 4 == 0)  # few beside the ears
    if style.haircut != "short":  # hair that hangs begins over its line on the forehead
        clear &= np.abs(np.rad2deg(angle)) > 50.0
    angle, wild, other = angle[clear], wild[clear], other[clear]
    degrees = np.rad2deg(np.abs(angle))
    # On the forehead few begin far before the line; at the nape they hang over it.
    before = np.where(degrees > 117.0, 3.0 + 3.0 * wild, 1.0 - 5.0 * wild**2 * np.sign(wild + 0.3))
    length = 8.0 + 3.0 * other + np.interp(degrees, (65.0, 75.0), (5.0, 0.0))
    length *= np.where((degrees > 70.0) & (degrees < 112.0), 0.55, 1.0)
    scalp, spine = Scalp(style), []
    at = position(angle, hairline(angle) + before, style)
    for step in range(EDGE_POINTS):
        foot, out = scalp.under(at)
        combed = _combed(foot, out)
        along = np.where((degrees < 60.0)[:, None], unit_vectors(SWEPT - (out @ SWEPT)[:, None] * out), combed)
        along = unit_vectors(along + (0.3 * other)[:, None] * np.cross(along, out))
        spine.append(foot + (_over(foot, style.haircut) + 0.2 + 0.17 * step)[:, None] * out)
        at = foot + (length / (EDGE_POINTS - 1))[:, None] * along
    aside = unit_vectors(np.cross(along, out))
    tint = CAP_SHADE * palette.hair * (0.95 + 0.35 * wild)[:, None]
    half_width = np.linspace(0.15, 0.04, EDGE_POINTS)
    return builder.strands(np.stack(spine, axis=1), half_width, aside, albedo=tint).ravel()


def _cap_height(y: Array, angle: Array, haircut: str) -> Array:
    """Distance of the cap from the scalp, mm, by height and angle."""
    line = hairline(angle)
    inside = smoothstep(((y - line) / (CAP_TOP_MM - line) + 0.02) / RISES.get(haircut, USUAL_RISE))
    return 0.6 + THICK.get(haircut, UNDER_LOCKS) * _thickness(y) * inside


def _over(points: Array, haircut: str) -> Array:
    """(N,) mm: distance of the cap from points of the scalp, (N, 3)."""
    return _cap_height(points[:, 1], np.arctan2(points[:, 0], points[:, 2] - AXIS_Z_MM), haircut)


def _strips(columns: int) -> Array:
    """(C,): place across the painted strands of each column, to and fro in uneven steps."""
    place, places = 0.5, []
    for number in range(columns):
        places.append(place)
        wild = float(golden(number))
        back = place > 0.62 or (place > 0.38 and wild > 0.5)
        place += (0.22 + 0.14 * wild) * (-1 if back else 1)
    return np.array(places)


def _build_cap(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    detail *= 1.0 if style.haircut == "cropped" else UNDER_CLUMPS
    angle = np.linspace(-np.pi, np.pi, 2 * round(22 * detail) + 1)[:-1]
    share = resampled(CAP_ROWS, detail)
    line = hairline(angle)
    y = line + np.clip(share, -1, 1)[:, None] * (CAP_TOP_MM - line)
    combed = style.haircut == "short"
    # Columns lean back on their way down.
    wide = angle - combed * LEAN_RAD * np.sin(angle) * np.clip(share, 0, 1)[:, None]
    base, out = position(wide, y, style), normal(wide, y, style)
    thick = np.where(share[:, None] < 0, -2.0, _cap_height(y, wide, style.haircut))
    thick = thick + combed * RELIEF_MM * np.clip(4 * share, 0, 1)[:, None] * np.sin(2.4 * np.arange(len(angle)))
    points = base + thick[..., None] * out
    # Skin shows between cropped hairs, most where they begin.
    root = (style.haircut == "cropped") * (0.12 + 0.6 * (1 - smoothstep((share + 0.01) / 0.22)))
    bundles = 1 + 0.16 * np.sin(17.0 * angle + 2.0 * np.sin(5.0 * angle)) + 0.07 * np.sin(43.0 * angle)
    dark = (CAP_SHADE if style.haircut == "cropped" else UNDER_CLUMPS_SHADE) * palette.hair * bundles[:, None]
    albedo = dark + root[:, None, None] * (palette.skin(base) - dark)
    strips = _strips(len(angle)) if combed else np.where(np.arange(len(angle)) % 2, 0.15, 0.85)
    uv = strand_uv(strips, 0.05 + 0.9 * share[:, None])
    grid = builder.add(points, albedo=albedo, material=Material.HAIR, uv=uv)
    builder.quads(grid, closed=True)
    top = points[-1].mean(axis=0)
    crown = builder.add(top, albedo=dark.mean(axis=0), material=Material.HAIR, uv=strand_uv(0.5, 0.99))
    builder.fan(grid[-1], int(crown))
    return np.append(grid.ravel(), crown)


def _combed(points: Array, normals: Array) -> Array:
    """(N, 3): unit direction of the hair."""
    x, y, z = points.T
    parting = np.interp(z, (-40.0, 60.0), (8.0, 24.0))
    away = np.tanh((parting - x) / 6.0)
    top = smoothstep((y - 62.0) / 55.0)
    front = smoothstep((z - 45.0) / 40.0)
    back = smoothstep((-z - 10.0) / 50.0)
    falling = np.clip(away, 0, 1)  # over the forehead on one side, swept away from it on the other
    direction = np.stack(
        [
            -away * (0.25 + 0.75 * top) * (1 - 0.8 * back),
            -(1 - top) * (1 - 1.3 * front * (1 - falling)) - 0.3 * front * falling,
            top * front * (0.5 * falling - 0.6 * (1 - falling)) - 0.9 * top * back - (1 - top) * (0.32 - 0.32 * back),
        ],
        axis=-1,
    )
    return unit_vectors(direction - (direction * normals).sum(axis=1, keepdims=True) * normals, 1e-6)
