"""Long hair: locks side by side that run from a centre parting over the head to the sides, and hang.

Theory of operation
-------------------
Each half of the hair is one smooth sheet over the head, (u, v): u runs along the parting from the forehead to the
crown, and below from the temple to the nape; v runs from the parting to the tips. Locks divide it lengthwise, so that
none intersects another: each is a rounded strip of five columns with edges tucked under its neighbours and a narrow
tip. More hair hangs under them to fill the gaps. Nothing is random: locks vary by fractions of multiples of the golden
ratio.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.colours import Palette
from fapengine.mesh.default_head.faces import Scalp, hairline, normal, position
from fapengine.mesh.default_head.mesh_builder import MeshBuilder, golden, strand_uv
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import AXIS_Z_MM
from fapengine.mesh.face_mesh import Material

ENDS_MM = {"long": -124.0, "bob": -70.0}
RAGGED = {"long": 1.0, "bob": 0.45}
"""Height of the ends of long hair, by haircut, and how much locks narrow there and differ in length."""
CENTRE = np.array([0.0, 50.0, 0.0])
"""Point of the skull from which directions over it are measured."""
FOREHEAD_DEG, CROWN_DEG = 28.0, 128.0
"""Ends of the parting, as angles up from the front."""
CROWN_U = 0.72
"""Position along the sheet from which all hair begins at the crown."""
TEMPLE_DEG, NAPE_DEG, HANGS_BELOW_MM = 64.0, 183.0, 34.0
"""Angles of the foremost and the hindmost hair, which reaches under the other half's; height below which hair hangs."""
FRONT_U = 0.12
"""Position along the sheet up to which hair follows the hairline."""
PARTING_V = 0.007
"""Position down the sheet to which the skin of the parting shows."""
OVER_HEAD = 0.5
"""Fraction of the rows on the head."""
ACROSS = np.array([0.0, 0.16, 0.5, 0.84, 1.0])
"""Columns of a lock."""
ROUND_MM = np.array([-2.6, -0.5, 0.5, -0.5, -2.6])
"""Height of each above the sheet."""
SHADE = np.array([0.60, 0.90, 1.06, 0.90, 0.60])
OVERLAP = 0.14
"""Fraction of a lock's width that is under its neighbours."""
EAR_MM = 9.0
"""Additional distance of hair over an ear."""
HAIRS_A_LOCK = 2


def _ways(u: Array, over: Array, style: HeadStyle) -> tuple[Array, Array]:
    """(R, U, 3) each: points of the head under the left half, and their normals; ``over`` runs from 0 to 1."""
    begins = np.deg2rad(np.interp(u, (0.0, CROWN_U), (FOREHEAD_DEG, CROWN_DEG)))
    start = np.stack([0.02 + 0 * u, np.sin(begins), np.cos(begins)], axis=-1)
    round_about = np.deg2rad(TEMPLE_DEG + (NAPE_DEG - TEMPLE_DEG) * u)
    end = unit_vectors(position(round_about, HANGS_BELOW_MM, style) - CENTRE)
    bend = np.stack(
        [end[:, 0], start[:, 1] + 0.28 * (1 - u) ** 3, 0.5 * (start[:, 2] + end[:, 2]) + 0.14 * (1 - u) ** 3], -1
    )
    s = over[:, None, None]
    towards = unit_vectors((1 - s) ** 2 * start + 2 * s * (1 - s) * bend + s**2 * end)
    points, normals = Scalp(style).under((CENTRE + 90.0 * towards).reshape(-1, 3))
    points, normals = points.reshape(towards.shape), normals.reshape(towards.shape)
    points[2:] = gaussian_filter1d(points, 1.0, axis=0, mode="nearest")[2:]
    normals = gaussian_filter1d(normals, 1.5, axis=0, mode="nearest")
    # The foremost hair begins along the hairline.
    angle = np.arctan2(points[..., 0], points[..., 2] - AXIS_Z_MM)
    low = hairline(angle) + 1.5
    front = (1 - smoothstep(u / FRONT_U)) * smoothstep((np.deg2rad(TEMPLE_DEG) - angle) / 0.15)
    front = np.where(points[..., 1] < low, np.ceil(front), front)
    height = points[..., 1] + front * (low - points[..., 1])
    points, normals = np.where(
        front[..., None] > 0, (position(angle, height, style), normal(angle, height, style)), (points, normals)
    )
    return points, normals


def _sheet(style: HeadStyle, u: Array, v: Array) -> tuple[Array, Array]:
    """(R, U, 3) each: the left half, and its outward direction; ``v`` runs from 0 at the parting to 1 at the ends."""
    over = np.clip(v / OVER_HEAD, 0, 1)
    points, out = _ways(u, over, style)
    drop = np.clip((v - OVER_HEAD) / (1 - OVER_HEAD), 0, 1)[:, None]
    end = ENDS_MM[style.haircut]
    hung = points[..., 1] + drop * (end - HANGS_BELOW_MM)
    below = smoothstep((HANGS_BELOW_MM + 26.0 - hung) / 40.0)[..., None]
    out = unit_vectors(out + below * (unit_vectors(out * [1.0, 0.0, 1.0]) - out))
    edge = smoothstep((u + 0.02) / 0.10)
    rise = 2.6 + (1.0 + 6.6 * smoothstep((v + 0.02) / 0.30))[:, None] * edge
    degrees = TEMPLE_DEG + (NAPE_DEG - TEMPLE_DEG) * u
    ear = smoothstep((degrees - 58.0) / 18.0) * smoothstep((140.0 - degrees) / 26.0)
    rise = rise + EAR_MM * ear * smoothstep((74.0 - hung) / 34.0) + 1.5 * smoothstep((62.0 - hung) / 30.0) * (1 - edge)
    inwards = 9.0 * smoothstep((-10.0 - hung) / 70.0)
    if style.haircut == "bob":
        inwards = 11.0 * smoothstep((end + 34.0 - hung) / 36.0) - 3.0 * np.exp(-(((hung - end - 40.0) / 26.0) ** 2))
    points = points + (rise - inwards)[..., None] * out
    points[0] = points[0] * [0.0, 1.0, 1.0] - 1.8 * out[0]  # both halves meet at the parting
    points[..., 1] += np.where(drop > 0, drop * (end - HANGS_BELOW_MM), 0.0)
    points[2:-1] = gaussian_filter1d(points, 1.0, axis=0, mode="nearest")[2:-1]
    return points, out


@dataclass(frozen=True, slots=True, eq=False)
class _Half:
    """One half of the hair."""

    u: Array
    v: Array
    """(U,), (R,): positions along and down the sheet."""
    sheet: Array
    out: Array
    """(R, U, 3) each: points, mm, and outward directions."""
    side: float
    """1 left, -1 right."""
    ragged: float
    palette: Palette

    def at(self, field: Array, u: Array) -> Array:
        """(R, L, C, 3): interpolate a field, (R, U, 3), at positions along the sheet, (R, L, C)."""
        where = u * (len(self.u) - 1)
        low = np.minimum(where.astype(np.int64), len(self.u) - 2)
        row = np.arange(len(field))[:, None, None]
        return field[row, low] + (where - low)[..., None] * (field[row, low + 1] - field[row, low])

    def add(self, builder: MeshBuilder, grid: Array, albedo: Array, uv: Array, *, inside: bool = False) -> Indices:
        """Add a surface, (R, C, 3) mm, the row of the parting first, seen from outside or from inside."""
        vertices = builder.add(grid, albedo=albedo, material=Material.HAIR, uv=uv)
        builder.quads(vertices[::-1] if (self.side > 0) != inside else vertices[::-1, ::-1])
        return vertices.ravel()


def build_tresses(builder: MeshBuilder, style: HeadStyle, palette: Palette, detail: float) -> Indices:
    """Add both halves of long hair; returns their indices, (N,)."""
    u, v = np.linspace(0, 1, 90), np.append(0.0, np.linspace(PARTING_V, 1, round(21 * np.sqrt(detail))))
    sheet, out = _sheet(style, u, v)
    added = []
    for side in (1.0, -1.0):
        mirror = np.array([side, 1.0, 1.0])
        half = _Half(u, v, sheet * mirror, out * mirror, side, RAGGED[style.haircut], palette)
        added += [_build_locks(builder, half, round(13 * np.sqrt(detail))), *_build_under(builder, half)]
    return np.concatenate(added)


def _build_locks(builder: MeshBuilder, half: _Half, locks: int) -> Indices:
    side, ragged = half.side, half.ragged
    number = np.arange(locks) + (0.0 if side > 0 else 0.37)
    vary, other = 2 * golden(number) - 1, 2 * golden(number, 5.77) - 1
    width = 1.0 + 0.40 * vary
    edges = np.concatenate([[0.0], np.cumsum(width)]) / width.sum()
    wide, middle = np.diff(edges)[:, None], 0.5 * (edges[:-1] + edges[1:])[:, None]
    shares = half.v[:, None, None]
    narrow = 1 - (0.1 + 0.78 * ragged) * smoothstep((shares - 0.84 - 0.06 * ragged * vary[:, None]) / 0.18)
    wave = 0.016 * np.sin(11.0 * shares + 5.0 * middle + 2.0 * side) + 0.008 * np.sin(15.0 * shares + 40.0 * middle)
    across = (1 + 2 * OVERLAP * smoothstep(shares / 0.22)) * (ACROSS - 0.5)
    at = np.clip(middle + wide * across * narrow + wave * smoothstep((shares - 0.3) / 0.3), 0.0, 1.0)  # (R, L, 5)
    points, outwards = half.at(half.sheet, at), half.at(half.out, at)
    off = smoothstep(shares / 0.22) * (ROUND_MM + 1.0 * other[:, None])
    points = points + off[..., None] * outwards
    points[..., 1] += ragged * (5.0 + 8.0 * vary)[:, None] * smoothstep((shares - 0.6) / 0.4)
    points[..., 1] += 28.0 * (ACROSS - 0.5) ** 2 * smoothstep((shares - 0.9) / 0.1)  # ends are round
    tint = 0.70 + 0.30 * smoothstep(shares / 0.14) + 0.30 * np.exp(-(((shares - 0.27) / 0.12) ** 2))
    tint = tint * SHADE * (1 + 0.10 * other[:, None])
    strip = 0.09 + 0.82 * golden(number, 3.1)[:, None] + 0.17 * (ACROSS - 0.5)
    uv = strand_uv(strip, 0.05 + 0.9 * shares)
    albedo = half.palette.hair * tint[..., None]
    albedo[0] += 0.5 * (0.6 * half.palette.base - albedo[0])
    added = [half.add(builder, points[:, lock], albedo[:, lock], uv[:, lock]) for lock in range(locks)]
    return np.concatenate([*added, _build_hairs(builder, half, points, outwards)])


def _build_hairs(builder: MeshBuilder, half: _Half, points: Array, outwards: Array) -> Indices:
    """Add single hairs on the locks, (R, L, 5, 3) mm, that extend beyond their tips."""
    rows = np.round(np.array([0.86, 0.94, 1.0]) * (len(points) - 1)).astype(int)
    locks = np.arange(points.shape[1])
    spines, asides, tints = [], [], []
    for number, across in enumerate(np.linspace(0.35, 0.6, HAIRS_A_LOCK) * (len(ACROSS) - 1)):
        wild = np.sin(7.1 * number + 3.7 * locks)
        low, share = int(across), across - int(across)
        spine = (1 - share) * points[rows, :, low] + share * points[rows, :, min(low + 1, 4)]
        spine = spine + 0.5 * outwards[rows, :, 2]
        beyond = spine[-1] + (spine[-1] - spine[-2]) * (0.6 + 0.45 * wild)[:, None]
        spines.append(np.concatenate([spine, beyond[None]]).transpose(1, 0, 2))
        asides.append(half.side * (points[rows[0], :, 0] - points[rows[0], :, 4]))
        tints.append((0.74 + 0.15 * wild)[:, None] * half.palette.hair)
    half_width, aside = np.array([0.3, 0.5, 0.45, 0.1]), unit_vectors(np.concatenate(asides))
    return builder.strands(np.concatenate(spines), half_width, aside, albedo=np.concatenate(tints)).ravel()


def _build_under(builder: MeshBuilder, half: _Half) -> tuple[Indices, Indices]:
    """Add the hair under the locks, seen from outside between them and from inside next to the neck."""
    shares, at = np.linspace(0.32, 1.0 - 0.05 * half.ragged, 10), np.linspace(0.0, 1.0, 25) ** 1.15
    rows, columns = (np.round(a * (len(b) - 1)).astype(int) for a, b in ((shares, half.v), (at, half.u)))
    points = half.sheet[rows][:, columns] - np.where(at > 0, 3.5, 1.5)[:, None] * half.out[rows][:, columns]
    points[-1, :, 1] += 5.0 * np.sin(70.0 * at)
    uv = strand_uv(0.5 + 0.4 * np.sin(9.0 * at), 0.05 + 0.9 * shares[:, None])
    dark = half.palette.hair * np.linspace(0.55, 0.8, len(rows))[:, None, None]
    return half.add(builder, points, dark, uv), half.add(builder, points, 0.55 * dark, uv, inside=True)
