"""Hair: a dark cap on the scalp, locks over it that frame the face, and single hairs along the hairline.

Theory of operation
-------------------
A lock is a tapered blade of three vertices across (the middle is higher than the edges) that follows a field of
directions over the scalp: away from the parting on top, down and back at the sides, down the back. Each step of the
path is projected back to its height above the scalp. Roots are evenly spaced on the scalp behind the hairline; higher
ones cover lower ones, like shingles. Nothing is random: locks vary by fractions of multiples of the golden ratio.
"""

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.faces import Scalp, hairline, normal, position
from fapengine.mesh.default_head.mesh_builder import GOLDEN, MeshBuilder, golden, resampled, strand_uv
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.default_head.tresses import ENDS_MM, build_tresses
from fapengine.mesh.face_mesh import Material

CAP_ROWS = (-0.03, 0.0, 0.03, 0.09, 0.155, 0.22, 0.32, 0.42, 0.525, 0.63, 0.72, 0.82, 0.89, 0.95)
CAP_SHADE, LIKE_CAP = 0.85, 0.75
"""Shade of the cap, and how closely locks match it where they touch it."""
EVEN_LIGHT_HAIR = 2.4
"""Fraction of the range of shades that hair loses per unit of its mean linear RGB: grey hair looked dyed in two tones.
"""
CAP_TOP_MM, RISES, USUAL_RISE = 144.0, {"short": 0.24}, 0.22
"""Height of the crown of the cap, and fraction of the way there over which the cap gains its thickness, by haircut."""
ROOT, HARD_ROOT = 0.3, 0.55
"""Fraction of skin colour where the cap begins: with single hairs along its edge, and without."""
LEAN_RAD, RELIEF_MM = 0.55, 0.5
"""Angle by which strands of the cap lean back on their way down the sides, and height of their waves."""
EDGE_HAIRS, EDGE_POINTS = 260, 3
"""Single hairs along the hairline, and points of each."""
LOCKS_FROM_MM, SWEPT_MM = 78.0, (18.0, 86.0)
"""Height from which locks frame the face; position left of which and above which the hair is swept off it."""
LOCKS = 128
TAPER = (0.35, 0.9, 1.0, 0.82, 0.45)
"""Width of a lock from the root towards the tip, which is a point."""
THICK, UNDER_LOCKS = {"short": 1.0, "cropped": 0.22}, 0.1
"""Thickness of the cap by haircut, relative to short hair; under long hair."""
HAIRS_A_LOCK, HAIR_POINTS = 4, 3
SPLIT_FROM = 0.3
"""Position along a lock next to the face from which it splits into single hairs."""
OPAQUE_TO = 0.75
"""Position along such a lock after which only single hairs continue."""
FACE_Z_MM = 60.0
"""Locks that end before this depth frame the face."""
CROWN_MM = 132.0
"""Height above which no lock begins: it would stand up."""


def _thickness(y: Array) -> Array:
    """Distance of the cap from the scalp, mm, by height."""
    return 4.2 + 6.3 * smoothstep((y - 45.0) / 75.0)


def build_hair(builder: MeshBuilder, style: HeadStyle, detail: float) -> Indices:
    """Add cap and locks; returns their indices, (N,), those of the cap first."""
    palette = palette_of(style)
    cap = _build_cap(builder, style, palette, detail)
    if style.haircut == "cropped":
        return cap
    if style.haircut in ENDS_MM:
        return np.concatenate([cap, build_tresses(builder, style, palette, detail)])
    edge = _build_edge(builder, style, palette, detail)
    return np.concatenate([cap, edge, _build_locks(builder, style, palette, detail)])


def _build_edge(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add single hairs that begin before and behind the hairline, so that hair has no edge; (N,) indices."""
    number = np.arange(round(EDGE_HAIRS * min(detail, 1.4) ** 1.5))
    place, wild, other = (2 * golden(number, factor) - 1 for factor in (1.0, 5.77, 3.1))
    angle = np.pi * np.sign(place) * np.abs(place) ** 1.3  # most are over the face
    degrees = np.rad2deg(np.abs(angle))
    # On the forehead few begin far before the line; at the nape they hang over it.
    before = np.where(degrees > 117.0, 3.0 + 3.0 * wild, 1.0 - 5.0 * wild**2 * np.sign(wild + 0.3))
    length = 8.0 + 3.0 * other + np.interp(degrees, (65.0, 75.0), (5.0, 0.0))
    length *= np.where((degrees > 70.0) & (degrees < 112.0), 0.55, 1.0)
    scalp, spine = Scalp(style), []
    at = position(angle, hairline(angle) + before, style)
    for step in range(EDGE_POINTS):
        foot, out = scalp.under(at)
        along = _combed(foot, out)
        along = unit_vectors(along + (0.45 * other)[:, None] * np.cross(along, out))
        spine.append(foot + (_over(foot, style.haircut) + 0.2 + 0.17 * step)[:, None] * out)
        at = foot + (length / (EDGE_POINTS - 1))[:, None] * along
    aside = unit_vectors(np.cross(along, out))
    tint = CAP_SHADE * palette.hair * (0.95 + 0.35 * wild)[:, None]
    half_width = np.linspace(0.17, 0.04, EDGE_POINTS)
    return builder.strands(np.stack(spine, axis=1), half_width, aside, albedo=tint).ravel()


def _cap_height(y: Array, angle: Array, haircut: str) -> Array:
    """Distance of the cap from the scalp, mm, by height and angle."""
    line = hairline(angle)
    inside = smoothstep(((y - line) / (CAP_TOP_MM - line) + 0.02) / RISES.get(haircut, USUAL_RISE))
    return 0.3 + THICK.get(haircut, UNDER_LOCKS) * _thickness(y) * inside


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
    root = (ROOT if combed else HARD_ROOT) * (1 - smoothstep((share - 0.005) / 0.045))
    if style.haircut == "cropped":  # skin shows between short hairs, most where they begin
        root = 0.12 + 0.6 * (1 - smoothstep((share + 0.01) / 0.22))
    bundles = 1 + 0.16 * np.sin(17.0 * angle + 2.0 * np.sin(5.0 * angle)) + 0.07 * np.sin(43.0 * angle)
    dark = CAP_SHADE * palette.hair * bundles[:, None]
    albedo = dark + root[:, None, None] * (palette.skin(base) - dark)
    strips = _strips(len(angle)) if combed else np.where(np.arange(len(angle)) % 2, 0.15, 0.85)
    uv = strand_uv(strips, 0.05 + 0.9 * share[:, None])
    grid = builder.add(points, albedo=albedo, material=Material.HAIR, uv=uv)
    builder.quads(grid, closed=True)
    top = points[-1].mean(axis=0) + np.array([0, 3.0, 0])
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


def _roots(scalp: Scalp, count: int) -> Array:
    """(about ``count``, 3): even over the scalp behind the hairline."""
    number = np.arange(round(1.55 * count)) + 0.5
    high = 1 - 2 * number / len(number)
    round_about = 2 * np.pi * GOLDEN * number
    across = np.sqrt(1 - high**2)
    towards = np.stack([across * np.sin(round_about), high, across * np.cos(round_about)], axis=-1)
    points, _ = scalp.under(np.array([0.0, 52.0, 2.0]) + 92.0 * towards)
    behind = points[:, 1] > hairline(np.arctan2(points[:, 0], points[:, 2] - 10.0)) + 3.0
    over_ear = (np.abs(points[:, 2] + 4) < 26) & (points[:, 1] < 72)
    return points[behind & (points[:, 1] > -28) & (points[:, 1] < CROWN_MM) & ~over_ear]


def _clear_of_ears(points: Array) -> Array:
    """(N,): 1 where a lock may continue, 0 above an ear, through which it would hang."""
    return 1 - smoothstep((66.0 - points[:, 1]) / 12.0) * smoothstep((44.0 - np.abs(points[:, 2] + 4.0)) / 10.0)


def _front_roots(style: HeadStyle) -> Array:
    """(20, 3): along the hairline over the forehead, so that no edge of the cap shows."""
    angle = np.deg2rad(np.linspace(-36.0, 20.0, 20))
    return position(angle, hairline(angle) + 1.5 + 6.0 * np.abs(np.sin(9.0 * np.arange(20))), style)


def _build_locks(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    scalp = Scalp(style)
    at = np.concatenate([_roots(scalp, round(LOCKS * np.clip(detail, 0.6, 1.6))), _front_roots(style)])
    at = at[_clear_of_ears(at) > 0.5]  # above an ear they could not continue
    number = np.arange(len(at))
    vary, other = 2 * golden(number) - 1, 2 * golden(number, 5.77) - 1
    top = smoothstep((at[:, 1] - 70.0) / 45.0)
    length = (44.0 + 36.0 * top) * (1 + 0.2 * vary)
    front = smoothstep((at[:, 2] - 58.0) / 22.0) * (1 - smoothstep((at[:, 1] - 104.0) / 22.0))
    nape = smoothstep((30.0 - at[:, 1]) / 40.0) * smoothstep((-at[:, 2] - 10.0) / 30.0)
    temple = smoothstep((80.0 - at[:, 1]) / 20.0) * smoothstep((at[:, 2] + 30.0) / 20.0)
    length = length * (1 - 0.52 * front) * (1 - 0.5 * nape) * (1 - 0.35 * temple)
    half = (4.4 + 1.9 * top) * (1 + 0.25 * other) / np.sqrt(np.clip(detail, 0.6, 1.6))
    layer = 1.2 + 1.0 * vary
    taper = resampled([*TAPER, 0.0], min(detail, 1.6))
    shares = np.linspace(0, 1, len(taper))
    rows, tints = [], []
    for share, wide in zip(shares, taper, strict=True):
        foot, out = scalp.under(at)
        along = _combed(foot, out)
        aside = np.cross(along, out)
        along = along + (0.16 * other)[:, None] * aside
        out_of = smoothstep((share + 0.02) / 0.3)
        # Edges touch the cap: one above it would show as a row of dots against the light.
        on_cap = smoothstep((foot[:, 1] - hairline(np.arctan2(foot[:, 0], foot[:, 2])) - 4.0) / 10.0)
        over = (_thickness(foot[:, 1]) + layer) * (0.45 + 0.55 * out_of) * (1 - 0.35 * smoothstep((share - 0.5) / 0.5))
        grown = smoothstep((share + 0.02) / 0.4)
        high = np.minimum(over, _over(foot, style.haircut) - 1.0 + grown * 16.0)
        middle = foot + high[:, None] * out
        edge = (wide * half)[:, None] * aside
        sunk = (0.24 * wide * half + on_cap * (high - _thickness(foot[:, 1])).clip(0))[:, None] * out
        tilt = ((0.2 - 0.17 * on_cap) * vary * wide * half)[:, None] * out
        rows.append(np.stack([middle - edge - sunk - tilt, middle, middle + edge - sunk + tilt], axis=1))
        shine = 0.85 + 0.65 * np.sin(np.pi * min(share * 1.05, 1.0)) ** 1.5
        tint = np.stack([0.62 * shine + 0 * vary, shine * (1 + 0.18 * other), 0.70 * shine + 0 * vary], axis=1)
        # Locks on the cap are nearly as dark, or patches of them would stand out.
        tints.append(tint + LIKE_CAP * on_cap[:, None] * (CAP_SHADE - tint))
        step = length / (len(taper) - 1) * _clear_of_ears(foot)
        at = foot + step[:, None] * along
    points = np.stack(rows, axis=1)  # (locks, rows, 3, xyz)
    # Locks that end on the cap would look like leaves on it: there its texture shows the direction of the hair.
    foot, tip = points[:, 0, 1], points[:, -1, 1]
    seen = (on_cap < 0.95) & (tip[:, 2] > 0) & (foot[:, 1] > LOCKS_FROM_MM)
    seen &= (foot[:, 0] < SWEPT_MM[0]) | (foot[:, 1] < SWEPT_MM[1])
    points, tints, number = points[seen], [tint[seen] for tint in tints], number[seen]
    even = min(EVEN_LIGHT_HAIR * float(palette.hair.mean()), 0.9)
    shades = np.stack(tints, axis=1)
    albedo = palette.hair * (shades + even * (CAP_SHADE - shades))[..., None]
    points[:, -1] = points[:, -1, 1:2]
    whole, framing = points.copy(), np.flatnonzero(points[:, -1, 1, 2] > FACE_Z_MM)
    slender = np.interp(shares, (SPLIT_FROM, 1.0), (1.0, 0.12))[:, None, None]
    # The opaque part ends before the tips, where only hairs continue: a tip narrower than a pixel would flicker.
    middle = _shortened(points[framing, :, 1], OPAQUE_TO)
    points[framing] = middle[:, :, None] + slender * (points[framing] - points[framing, :, 1:2])
    strip = 0.09 + 0.82 * golden(number, 3.1)[:, None, None] + np.array([-0.085, 0.0, 0.085])
    uv = strand_uv(strip, 0.05 + 0.5 * shares[:, None] + 0.4 * golden(number, 1.7)[:, None, None])
    body = builder.add(points[:, :-1], albedo=albedo[:, :-1], material=Material.HAIR, uv=uv[:, :-1])
    tips = builder.add(points[:, -1, 1], albedo=albedo[:, -1, 1], material=Material.HAIR, uv=uv[:, -1, 1])
    for left in (0, 1):
        a, b = body[:, :-1, left], body[:, :-1, left + 1]
        c, d = body[:, 1:, left + 1], body[:, 1:, left]
        builder.loose(np.stack([a, b, c], axis=-1))
        builder.loose(np.stack([a, c, d], axis=-1))
        builder.loose(np.stack([body[:, -1, left], body[:, -1, left + 1], tips], axis=-1))
    hairs = _build_hairs(builder, whole, framing, palette)
    return np.concatenate([body.ravel(), tips, hairs])


def _shortened(paths: Array, share: float) -> Array:
    """(N, R, 3): paths, (N, R, 3), cut after a fraction of their rows, resampled to as many rows."""
    at = share * np.arange(paths.shape[1])
    low = np.minimum(at.astype(np.int64), paths.shape[1] - 2)
    return np.asarray(paths[:, low] + (at - low)[:, None] * (paths[:, low + 1] - paths[:, low]))


def _build_hairs(builder: MeshBuilder, locks: Array, chosen: Indices, palette: Palette) -> Indices:
    """Add single hairs over the locks next to the face, so that these have no hard edges; (N,) indices.

    ``locks`` is (locks, rows, 3, xyz) mm: points of each from edge to edge.
    """
    last = locks.shape[1] - 1
    rows = np.unique(np.linspace(1, last - 1, HAIR_POINTS - 1).round().astype(int))
    across = np.linspace(-0.98, 0.98, HAIRS_A_LOCK)
    spines, asides, tints = [], [], []
    for lock in chosen:
        left, middle, right = (locks[lock, rows, side] for side in (0, 1, 2))
        out = unit_vectors(np.cross(right[0] - left[0], middle[-1] - middle[0]))
        for number, share in enumerate(across):
            wild = np.sin(7.1 * number + 3.7 * lock)
            edge = right if share > 0 else left
            spine = middle + abs(share) * (1.0 + 0.15 * wild) * (edge - middle) + 0.35 * out
            tip = spine[-1] + (0.9 + 0.4 * wild) * (locks[lock, last, 1] - middle[-1])
            tip += 0.35 * share * (edge[-1] - middle[-1]) * np.sign(share)
            spine = np.concatenate([spine, tip[None]])
            spines.append(spine)
            asides.append(unit_vectors(np.cross(spine[-1] - spine[0], [0.0, 0.0, 1.0]), 1e-6))
            tints.append((0.75 + 0.5 * abs(wild)) * palette.hair)
    if not spines:
        return np.zeros(0, dtype=np.int64)
    half = np.linspace(0.75, 0.12, len(rows) + 1)
    return builder.strands(np.array(spines), half, np.array(asides), albedo=np.array(tints)).ravel()
