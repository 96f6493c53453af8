"""Parts added to the bare head: teeth, tongue, brows, ears and glasses.

An ear is a shell over an egg-shaped outline, its relief a sum of ridges and hollows with anatomical names. Its local
axes are *up* along the ear, *back* across it and *out* of the head; ``share`` runs from the middle (0) to the outline
(1), and further rings roll over the edge back to the head. Proportions: Farkas 1994, adults: 62 mm long, 35 mm wide.
Brows are hairs on the skin; the skin below is in the texture (:mod:`.painting`). Glasses are tubes
in front of the face, clear of brows, lashes and cheeks; their lenses are clear and not drawn.
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep, spot
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh import colours
from fapengine.mesh.colours import BLOOD
from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, resampled
from fapengine.mesh.default_head.style import HeadStyle, palette_of
from fapengine.mesh.default_head.surface import angle_of, normal, position
from fapengine.mesh.face_mesh import Bone, Material


def _arch(along: Array, half_width: float, front_z: float, depth: float) -> tuple[Array, Array]:
    """Dental arch, half an ellipse: (N, 2) x and z at distances from its middle along it, mm, and outward normals."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 400)
    ellipse = np.stack([half_width * np.sin(turn), front_z - depth * (1 - np.cos(turn))], axis=-1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ellipse, axis=0), axis=1))])
    at = np.interp(along, length - length[-1] / 2, turn)
    outward = np.stack([depth * np.sin(at), half_width * np.cos(at)], axis=-1)
    on_arch = np.stack([half_width * np.sin(at), front_z - depth * (1 - np.cos(at))], axis=-1)
    return on_arch, unit_vectors(outward)


CROWNS = slice(3, 10)
"""Rows of teeth without the gum."""
FRONTS = slice(4, 9)
"""Those of their fronts and of the cutting edges."""
UPPER_WIDTHS_MM = (8.5, 6.5, 7.5, 7.0, 7.0, 10.0)
LOWER_WIDTHS_MM = (5.0, 5.5, 7.0, 7.0, 7.0, 11.0)
"""Crown widths from the middle to the back, from tables of dental anatomy."""
UPPER_LENGTHS = np.array([1.0, 0.94, 0.97, 0.90, 0.86, 0.80])
"""Lengths of upper crowns, relative: an edge with short laterals between centrals and canines, not a straight one."""
UPPER_TINTS = np.array([0.98, 0.95, 0.85, 0.91, 0.90, 0.88])
"""Light of upper crowns, relative: canines are darker."""
SEAM, NOTCH = (0.56, 0.76), (0.12, 0.08)
"""Light in the gaps of upper and lower teeth, and by what share of a crown its corners are shorter there."""
IN_TOOTH = (0.0, 0.09, 0.5, 0.91)
"""Columns of a tooth: a gap is a line, and a tooth is round only beside it."""
ROUND_TOOTH = 0.16
"""Slope of the light on a tooth beside its gaps."""
IN_SHADE = np.array([1.0, 1.1, 1.3])
"""Powers of the shade of teeth in red, green and blue: what light is left there has been reflected by lips."""
DARK_UPPER, DARK_LOWER = ((6.0, 25.0), np.array([0.66, 0.73, 0.76])), ((6.0, 17.0), np.array([0.88, 0.92, 0.92]))
"""Distances along the arch over which teeth become darker, away from the opening, mm, and by what fraction of red,
green and blue: the light there comes from gums and cheeks. Lower teeth soon lie in the dark.
"""
LOWER_FALL = 0.12
"""Slope of lower teeth downwards to the back: turned with an open jaw, they would stand up there as a stub."""
UPPER_ARCH_MM, LOWER_ARCH_MM = (30.0, 105.4, 32.0), (27.5, 102.0, 30.0)
"""Half width, front and depth of a dental arch: broad, so that teeth fill a smile from corner to corner."""


def build_teeth(builder: MeshBuilder, detail: float, *, upper: bool) -> Indices:
    """Add one row of teeth with its gum; returns indices, (R, C): rows by columns, the end of the gum first."""
    half_width, front_z, depth = UPPER_ARCH_MM if upper else LOWER_ARCH_MM
    edge_y, gum_y = (-35.2, -25.5) if upper else (-32.7, -42.2)
    dark_mm, dark = DARK_UPPER if upper else DARK_LOWER
    inside = np.array(IN_TOOTH) if detail >= 1 else np.array(IN_TOOTH)[[0, 1, 3]]
    edges = np.cumsum([0.0, *(UPPER_WIDTHS_MM if upper else LOWER_WIDTHS_MM)])
    teeth = len(edges) - 1
    number = np.append((np.arange(teeth)[:, None] + inside).ravel(), teeth)
    number = np.concatenate([-number[:0:-1], number])
    in_tooth, number = np.mod(number, 1.0), np.abs(number)
    along = np.interp(number, np.arange(teeth + 1), edges)
    along[: len(along) // 2] *= -1
    arch, outward = _arch(along, half_width, front_z, depth)
    round_off = np.abs(np.sin(np.pi * in_tooth)) ** 0.4
    tooth = np.minimum(number.astype(int), teeth - 1)
    length, tint = (UPPER_LENGTHS[tooth], UPPER_TINTS[tooth]) if upper else (np.ones_like(number),) * 2
    seam, notch = (both[0 if upper else 1] for both in (SEAM, NOTCH))
    direction = np.sign(edge_y - gum_y)
    rows, looks = [], []
    for height, out, is_gum in (
        (-0.9, -1.0, True), (-0.45, 0.6, True), (-0.05, 0.9, True), (0.0, 0.55, False), (0.3, 0.9, False),
        (0.7, 0.75, False), (0.94, 0.35, False), (1.0, -0.5, False), (0.92, -1.6, False), (0.2, -3.2, False),
        (-0.4, -4.0, True),
    ):  # fmt: skip
        stands_out = out - 0.9 * (1 - round_off) * (not is_gum)
        xz = arch + stands_out[:, None] * outward
        tip = length * (1 - notch * (1 - round_off) ** 1.5)
        scallop = 0.14 * (1 - round_off) * (abs(height) < 0.1)
        y = gum_y + direction * abs(edge_y - gum_y) * (np.where(height > 0, height * tip, height) + scallop)
        y = y - LOWER_FALL * np.clip(np.abs(along) - dark_mm[0], 0, None) * (not upper)
        rows.append(np.stack([xz[:, 0], y, xz[:, 1]], axis=-1))
        gap = tint * (seam + (1 - seam) * round_off)
        far = 1 - smoothstep((np.abs(along) - dark_mm[0]) / np.ptp(dark_mm))[:, None] * dark
        # A smile shows the light half above the upper edges; the edges of lower teeth are in their shadow.
        shade = np.interp(height, (0.0, 0.3, 0.7, 1.0), (1.17, 1.0, 0.76, 0.70) if upper else (0.78, 0.78, 0.72, 0.58))
        colour = colours.GUM if is_gum else colours.TEETH * (shade * gap)[:, None] ** IN_SHADE
        looks.append(np.broadcast_to(colour, rows[-1].shape) * far)
    points, albedo = np.stack(rows), np.stack(looks)
    kinds = np.full((len(rows), 1), Material.GUM)
    kinds[CROWNS] = Material.TEETH
    bone = Bone.NONE if upper else Bone.JAW
    # Cutting edges are lit as the front is; by their own normals they were a dark jagged line.
    front = np.full(points.shape, np.nan)
    side = ROUND_TOOTH * np.where(in_tooth > 0, 2 * in_tooth - 1, 0.0)
    lit = outward + side[:, None] * np.stack([outward[:, 1], -outward[:, 0]], axis=-1)
    front[FRONTS] = unit_vectors(np.stack([lit[:, 0], 0.2 + 0 * number, lit[:, 1]], axis=-1))
    grid = builder.add(points, albedo=albedo, material=kinds, bone=bone, bone_weight=float(not upper), normal=front)
    builder.quads(grid if not upper else grid[:, ::-1])
    return grid


TONGUE_TIP = np.array([0.0, -36.0, 98.5])
"""Neutral position of the tip: behind the edge between upper and lower teeth, as in the standard's neutral face."""


TONGUE_RISE_MM = 4.5
"""Height of the back of the tongue above its tip."""
BACK_ON_JAW = 0.5
"""Fraction of the jaw's rotation that the back of the tongue follows; the tip follows it fully."""


def build_tongue(builder: MeshBuilder, detail: float) -> Indices:
    """Add a flattened tube from root to tip; returns its indices, (N,), the tip last."""
    share = 1 - (1 - np.linspace(0, 1, max(9, round(13 * detail)))) ** 1.5  # rings are closer at the tip
    around = np.linspace(0, 2 * np.pi, 4 * max(3, round(4 * detail)), endpoint=False)
    half_width = 18.5 * (1 - 0.35 * share**2) * np.sqrt(np.clip(1 - share**9, 0, 1)) + 0.4
    half_height = 7.5 * (1 - 0.45 * share) * np.sqrt(np.clip(1 - share**9, 0, 1)) + 0.3
    y = TONGUE_TIP[1] + TONGUE_RISE_MM * np.sin(np.pi * np.clip(1.12 * (1 - share), 0, 1) ** 0.8) - 2.0 * (1 - share)
    z = 52.0 + (TONGUE_TIP[2] - 52.0) * share
    height = np.sin(around) * half_height[:, None]
    groove = -1.2 * np.exp(-((np.cos(around) / 0.35) ** 2)) * (np.sin(around) > 0) * (1 - share[:, None] ** 3)
    points = np.stack(
        [np.cos(around) * half_width[:, None], y[:, None] + height + groove, np.broadcast_to(z[:, None], height.shape)],
        axis=-1,
    )
    # Darker towards its root and its sides, so that it has no hard outline.
    grooved = 0.22 * np.exp(-((np.cos(around) / 0.22) ** 2)) * (1 - share[:, None] ** 4)
    shade = ((0.15 + 0.85 * share**1.6)[:, None] * (1 - 0.35 * np.abs(np.cos(around)) ** 2) * (1 - grooved))[..., None]

    def add(where: Array, albedo: Array) -> Indices:
        weight = 1 - (1 - BACK_ON_JAW) * smoothstep((TONGUE_TIP[2] - where[..., 2] - 3.0) / 22.0)
        return builder.add(where, albedo=albedo, material=Material.TONGUE, bone=Bone.JAW, bone_weight=weight)

    grid = add(points, colours.TONGUE * shade)
    tip = add(points[-1].mean(axis=0) + np.array([0, 0, 0.6]), colours.TONGUE)
    builder.quads(grid, closed=True)
    builder.fan(grid[-1], int(tip))
    return np.append(grid.ravel(), tip)


BROWS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "soft": ((52.2, 53.0, 54.3, 54.5, 51.8), (2.9, 3.6, 3.4, 2.6, 0.7)),
    "straight": ((53.0, 53.5, 54.4, 54.4, 52.2), (2.8, 3.4, 3.2, 2.5, 0.8)),
    "arched": ((51.2, 52.6, 54.7, 55.2, 51.6), (2.6, 3.3, 3.0, 2.1, 0.5)),
}
"""Height of the centre line and half width at five places, mm, from the nose outwards, by shape."""
BROW_X = (11.0, 20.5, 32.0, 43.0, 53.5)
"""Places of these; feature points 4.1, 4.3 and 4.5 are near the first, third and last."""
BROW_HAIRS = 140


def brow_line(share: Array, style: HeadStyle) -> tuple[Array, Array]:
    """(N, 2) centre line and (N,) half width, mm, of the left brow."""
    knots, (heights, half_widths) = np.linspace(0, 1, len(BROW_X)), BROWS[style.brow_shape]
    x, y, half = (PchipInterpolator(knots, values)(share) for values in (BROW_X, heights, half_widths))
    return np.stack([x, y], axis=-1), style.brow_thickness * half


def build_brow(builder: MeshBuilder, style: HeadStyle, side: float, detail: float) -> Indices:
    """Add one brow; returns its indices, (N,)."""
    palette = palette_of(style)
    number = np.arange(round(BROW_HAIRS * np.clip(detail, 0.5, 1.6)))
    at = (number + 0.5) / len(number)
    spread, wild = 2 * golden(number) - 1, 2 * golden(number, 7.31) - 1
    middle, half = brow_line(at, style)
    root = middle + (0.8 * spread * half)[:, None] * np.array([0.15, 1.0])
    line = np.gradient(middle, axis=0)
    # Hairs rise near the nose, then follow the brow; those above its middle turn down to it, those below up.
    slope = np.rad2deg(np.arctan2(line[:, 1], line[:, 0])) + np.interp(
        at, (0.0, 0.12, 0.35, 1.0), (52.0, 32.0, 9.0, 0.0)
    )
    slope -= np.interp(at, (0.0, 0.2, 1.0), (4.0, 15.0, 17.0)) * spread - 11.0 * wild
    along = np.stack([np.cos(np.deg2rad(slope)), np.sin(np.deg2rad(slope))], axis=-1)
    length = (4.0 + 0.8 * wild) * np.interp(at, (0.0, 0.1, 0.7, 1.0), (0.6, 1.0, 1.0, 0.5))
    half_width = np.interp(at, (0.0, 0.2, 0.7, 1.0), (0.07, 0.12, 0.115, 0.08))[:, None] * [1.0, 0.1]
    tip = root + length[:, None] * along
    flat = np.stack([root, tip], axis=1)
    angle, y = angle_of(flat[..., 0], flat[..., 1], style), flat[..., 1]
    spine = (position(angle, y, style) + np.array([0.30, 0.60])[:, None] * normal(angle, y, style)) * [side, 1, 1]
    aside = side * np.stack([side * along[:, 1], -along[:, 0], 0 * at], axis=-1)
    tint = palette.brows * (0.8 + 0.5 * golden(number, 3.7))[:, None]
    # Single hairs at the inner end are fine, and let the skin shine through.
    tint += 0.35 * (1 - smoothstep(at / 0.14))[:, None] * (palette.base - tint)
    place = np.stack([side * angle, y], axis=-1)
    return builder.strands(spine, half_width, aside[:, None], albedo=tint[:, None], place=place).ravel()


EAR_MIDDLE = np.array([82.0, 19.0, -4.0])
EAR_UP, EAR_BACK = np.array([0.12, 0.970, -0.212]), np.array([0.21, -0.235, -0.949])
EAR_ROOT = (np.deg2rad(93.0), 10.0)
"""Place on the bare head that an ear follows."""
EAR_HALF_LENGTH, EAR_HALF_WIDTH = 27.0, 16.5
EAR_JOIN_MM = 9.5
"""Depth of the front of an ear inside the head."""
EAR_FORWARD = 0.25
"""How far its front reaches over the cheek there, as a share of half of its width: it rises gently."""
EAR_INSIDE = (0.06, 0.22, 0.36, 0.48, 0.58, 0.67, 0.75, 0.83, 0.9, 0.96)
EAR_EDGE = np.array([(1.0, -1.2), (0.98, -3.2), (0.9, -5.5), (0.72, -10.0)])
"""Around the edge: share, height."""
EAR_BUMPS = (
    (-2.0, (-0.02, 0.40), (0.24, 0.14)),  # triangular fossa
    (5.2, (-0.50, -0.14), (0.17, 0.23)),  # tragus
    (2.4, (0.16, -0.50), (0.18, 0.12)),  # antitragus
    (2.6, (-0.05, -0.78), (0.45, 0.2)),  # lobe
)
"""Height, mm, centre and size, relative to the ear's, back and up."""


def _ridge(share: Array, at: float, width: float) -> Array:
    return np.exp(-(((share - at) / width) ** 2))


def _relief(share: Array, up: Array, back: Array) -> Array:
    """Height above the shell, mm, by direction (``up``, ``back``: cosine and sine) and ``share``."""
    u, v = share * back, share * up
    helix = smoothstep((up + 0.62 + 0.35 * back) / 0.45) * (1 - 0.75 * smoothstep((-back - 0.82) / 0.2) * (up < 0.3))
    antihelix = smoothstep((back + 0.35 + 0.9 * np.clip(up, 0, 1)) / 0.6) * smoothstep((0.99 - up) / 0.25)
    antihelix *= smoothstep((up + 0.92) / 0.3)
    relief = 3.9 * helix * _ridge(share, 0.91, 0.075) - 3.0 * helix * _ridge(share, 0.755, 0.075)
    relief += 2.6 * antihelix * _ridge(share, 0.58, 0.10)
    relief -= 6.0 * np.exp(-((((u - 0.02) / 0.30) ** 2 + ((v + 0.12) / 0.36) ** 2) ** 1.6))  # concha
    for bulge_mm, centre, size in EAR_BUMPS:
        relief += bulge_mm * spot(u, v, centre, size)
    return relief


def build_ear(builder: MeshBuilder, style: HeadStyle, side: float, detail: float) -> Indices:
    """Add one ear; returns its indices, (R, S): rings by segments."""
    around = np.linspace(0, 2 * np.pi, max(20, round(32 * detail)), endpoint=False)
    up, back = np.cos(around), np.sin(around)
    inside = resampled(EAR_INSIDE, detail) if detail >= 1 else np.array(EAR_INSIDE)[[0, 2, 3, 4, 6, 8, 9]]
    outline = 1 + 0.08 * up * np.abs(up) + 0.10 * back * up + 0.06 * smoothstep((-up - 0.35) / 0.6) * np.abs(back)
    share = np.concatenate([inside, EAR_EDGE[:, 0]])[:, None]
    height = _relief(share, up, back)
    height[len(inside) :] = height[len(inside) - 1] * np.array([0.7, 0.3, 0.0, 0.0])[:, None] + EAR_EDGE[:, 1:]
    shell = 3.4 + 1.2 * back * share - 1.6 * (share**2)  # gently domed, and open at the back
    # Its front grows out of the cheek: no rim stands off there, from the root of the helix to the lobe.
    lobe = 0.6 * smoothstep((-up - 0.4) / 0.5)
    joined = smoothstep((lobe - back - 0.25) / 0.6) * smoothstep((0.8 - up) / 0.5) * smoothstep((share - 0.56) / 0.38)
    shell = shell - EAR_JOIN_MM * joined
    narrow = 1 - 0.06 * smoothstep((-up * share - 0.05) / 0.75)
    full = 1 + 0.07 * smoothstep((up - 0.2) / 0.5) * np.clip(back, 0, 1)
    forward = 1 + EAR_FORWARD * joined * smoothstep((0.3 - up) / 0.5)
    long = EAR_HALF_LENGTH * outline * up * share
    wide = EAR_HALF_WIDTH * outline * narrow * full * forward * back * share
    axes = np.stack([EAR_UP, EAR_BACK, np.cross(EAR_BACK, EAR_UP)])
    points = EAR_MIDDLE + np.stack([long, wide, height + shell], axis=-1) @ axes
    points = (points + faces.displacement(EAR_ROOT, style.weights)) * [side, 1, 1]
    palette = palette_of(style)
    albedo = palette.skin(points)
    deep = np.clip(-height / 4.5, 0, 1)[..., None]
    albedo = (albedo + 0.22 * (1 - joined)[..., None] * (palette.blush - albedo)) * (1 - 0.55 * deep)
    albedo = albedo * (1 - 0.03 * BLOOD)  # as the texture does to the skin next to it
    grid = builder.add(points, albedo=albedo)
    builder.quads(grid if side > 0 else grid[:, ::-1], closed=True)
    middle = int(builder.add(points[0].mean(axis=0), albedo=albedo[0].mean(axis=0)))
    builder.fan(grid[0, ::-1] if side > 0 else grid[0], middle)
    return grid


FRAME = np.array([0.016, 0.012, 0.011])
"""Linear RGB: dark horn."""
RIM_MIDDLE, RIM_HALF = np.array([32.0, 32.5]), np.array([24.0, 19.0])
RIM_SQUARENESS = 2.7
WRAP_PER_MM = 0.0042
"""Curvature of the front around the face."""
CLEAR_MM, SIDE_CLEAR_MM = 3.6, 3.0
EAR_Z_MM, EAR_Y_MM = 2.0, 36.0
"""Place where a temple rests on the ear and bends."""


def build_glasses(builder: MeshBuilder, style: HeadStyle, detail: float) -> None:
    """Add glasses, which follow only the head."""
    around = np.linspace(0, 2 * np.pi, max(24, round(36 * detail)), endpoint=False)
    cosine, sine = np.cos(around), np.sin(around)
    length = (np.abs(cosine) ** RIM_SQUARENESS + np.abs(sine) ** RIM_SQUARENESS) ** (-1 / RIM_SQUARENESS)
    flat = RIM_MIDDLE + np.stack([cosine, sine], axis=-1) * length[:, None] * RIM_HALF
    flat[:, 0] -= 0.06 * (flat[:, 1] - RIM_MIDDLE[1]) * (flat[:, 0] < RIM_MIDDLE[0])  # wider apart below, for the nose
    depth = faces.position(angle_of(flat[:, 0], flat[:, 1], style), flat[:, 1], style)[:, 2]
    front = float(np.max(depth + WRAP_PER_MM * flat[:, 0] ** 2)) + CLEAR_MM

    def before(where: Array) -> Array:
        return np.concatenate([where, (front - WRAP_PER_MM * where[:, :1] ** 2)], axis=1)

    rim = before(flat)
    inner = np.array([flat[:, 0].min(), RIM_MIDDLE[1] + 5.0])
    across = np.linspace(-1, 1, max(5, round(7 * detail)))
    bridge = before(np.stack([inner[0] * across, inner[1] + 2.2 * (1 - across**2)], axis=-1))
    temple = _temple(rim[np.abs(around - 0.3).argmin()], style, max(8, round(10 * detail)))
    mirror = np.array([-1.0, 1.0, 1.0])
    _tube(builder, rim, 1.15, closed=True)
    _tube(builder, (rim * mirror)[::-1], 1.15, closed=True)
    _tube(builder, bridge, 1.15)
    _tube(builder, temple, 1.2)
    _tube(builder, temple * mirror, 1.2)


def _temple(start: Array, style: HeadStyle, count: int) -> Array:
    """(count, 3) mm: from the rim past the temple to the ear and down behind it."""
    share = np.linspace(0, 1, count)
    z = start[2] + (EAR_Z_MM - 20.0 - start[2]) * share
    y = start[1] + (EAR_Y_MM - start[1]) * np.clip(share / 0.7, 0, 1) - 16.0 * smoothstep((EAR_Z_MM + 2.0 - z) / 24.0)
    cheek = faces.position(np.arctan2(80.0, z - 10.0), np.full(count, EAR_Y_MM), style)[:, 0] + SIDE_CLEAR_MM
    x = start[0] + np.clip(cheek - start[0], 0, None) * smoothstep(share / 0.4)
    return np.stack([x, y, z], axis=-1)


def _tube(builder: MeshBuilder, path: Array, radius_mm: float, *, closed: bool = False) -> None:
    """Add a six-sided tube around a path, (N, 3) mm."""
    along = unit_vectors(np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0) if closed else np.gradient(path, axis=0))
    aside = unit_vectors(np.cross(along, np.where(np.abs(along[:, 2:]) > 0.8, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])))
    over = np.cross(aside, along)
    turn = np.linspace(0, 2 * np.pi, 6, endpoint=False)[:, None, None]
    rings = path + radius_mm * (np.cos(turn) * aside + np.sin(turn) * over)
    grid = builder.add(rings, albedo=FRAME, material=Material.CLOTH)
    builder.quads(np.concatenate([grid, grid[:1]]), closed=closed)
