"""Texture for details finer than vertices: mottled skin, freckles, lip creases, brows, lash roots, strands of hair.

The texture multiplies the colours of the vertices, so it is neutral where there is no detail. Nothing is random: its
grain comes from a hash of the texel numbers.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from fapengine._arrays import Array, Mask
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.colours import BLOOD, HAIR_COLOURS, brow_colour
from fapengine.mesh.default_head import eyes, mouth, parts
from fapengine.mesh.default_head.faces import above_hairline
from fapengine.mesh.default_head.mesh_builder import BOTTOM_MM, HAIR_U, SPAN_RAD, TEXTURE_SIZE, skin_places
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import nostril, radius

PIGMENT = np.array([0.55, 0.9, 1.2])
CORNER_SHADE, CORNER_ENDS = 0.25, 0.06
"""Shade around the corners of the mouth; how far the mouth line reaches beyond them, of half the mouth's width."""
WING_CREASE = 0.2
"""Shade in the crease around a wing of the nose."""
FADE_MM = 13.0
"""Height over which skin at the hairline takes on the hair's colour."""
ROOTS_FROM_MM = 0.0
"""Height below which no skin of the texture is at the hairline or a brow."""
LARGE = 20.0
"""Size of spots in texels from which filtering by Fourier transforms takes less time."""
CUT = 2.5
"""Where the Gaussian of a filter ends, in standard deviations."""
COARSE = 4
"""Texel step at which the shape of the head is evaluated."""


def grain(shape: tuple[int, int], seed: int) -> NDArray[np.float32]:
    """(H, W): white noise, -1..1, from a hash of the position."""
    rows, columns = (np.arange(size, dtype=np.uint64) for size in shape)
    along = columns * np.uint64(0x85EBCA77) + np.uint64(seed * 0xC2B2AE3D + 1)
    value = (rows * np.uint64(0x9E3779B1))[:, None] + along
    value ^= value >> np.uint64(15)
    short = value.astype(np.uint32)  # the rest of the hash is modulo 2 ** 32
    short *= np.uint32(0x2C1B3C6D)
    short ^= short >> np.uint32(12)
    short *= np.uint32(0x297A2D39)
    short ^= short >> np.uint32(15)
    short ^= np.uint32(1 << 31)
    return short.view(np.int32).astype(np.float32) * np.float32(2.0**-31)


def _cloud(shape: tuple[int, int], seed: int, size: float | tuple[float, float]) -> Array:
    """Noise with spots of about ``size`` texels (rows, columns) and a standard deviation of 1."""
    noise = grain(shape, seed)
    if np.max(size) < LARGE:
        cloud: Array = gaussian_filter(noise, size, mode="wrap", truncate=CUT)
    else:
        down, along = (_spectrum(*each) for each in zip(shape, np.broadcast_to(size, 2), strict=True))
        cloud = np.fft.irfft2(np.fft.rfft2(noise) * down[:, None] * along[: shape[1] // 2 + 1], shape)
    return cloud / cloud.std()


def _spectrum(count: int, sigma: float) -> Array:
    """(count,): Fourier transform of the Gaussian of a filter, which wraps around."""
    reach = int(CUT * sigma + 0.5)
    at = np.arange(-reach, reach + 1)
    weight = np.bincount(at % count, np.exp(-0.5 * (at / sigma) ** 2), count)
    return np.fft.fft(weight / weight.sum()).real


def _mirrored(cloud: Array) -> Array:
    """The left half, (H, W'), on both sides of the face."""
    half = cloud.shape[1] // 2
    return np.concatenate([cloud[:, ::-1][:, : cloud.shape[1] - half], cloud[:, -half:]], axis=1)


@lru_cache(maxsize=4)
def paint(style: HeadStyle) -> NDArray[np.uint8]:
    """Paint the texture of a head.

    Returns
    -------
    (768, 1024, 3) uint8
        sRGB; see :attr:`fapengine.mesh.face_mesh.FaceMesh.texture`. Read-only.
    """
    height, width = TEXTURE_SIZE
    image = np.full((height, width, 3), 255, dtype=np.uint8)
    for channel, light in enumerate(_skin(style)):
        image[:, : light.shape[1], channel] = _developed(light)
    first, last = (round(u * width) for u in HAIR_U)
    strands = _strands((height, last - first + 8), style)
    image[:, first - 4 : last + 4] = _developed(strands)[..., None]
    image.flags.writeable = False
    return image


def _developed(light: Array) -> Array:
    """(...): light, 0 to 1, as the texture's numbers; the shader squares them (developed() in lights.glsl)."""
    return np.round(255 * np.sqrt(np.clip(light, 0, 1)))


def _remove(light: Array, share: Array, colour: Array) -> None:
    """Multiply ``light``, (3, H, W), by what a share, (H, W), of a colour, (3,), leaves of it.

    Plane by plane: new memory for all three costs as much as their values.
    """
    for plane, part in zip(light, colour, strict=True):
        plane *= 1 - share * part


def _strands(shape: tuple[int, int], style: HeadStyle) -> Array:
    """Close-up of hair: fine strands along the rows, in bundles. Light hair has less contrast: it looked like wood."""
    fine, bundle, wide = (_cloud(shape, *how) for how in ((31, (60.0, 0.7)), (32, (90.0, 2.2)), (33, (110.0, 6.0))))
    contrast = 1 - min(1.6 * float(np.mean(HAIR_COLOURS[style.hair_colour])), 0.5)
    # It begins below the parting, where strands of either side meet at an angle.
    from_parting = (0.25 + 0.75 * smoothstep((np.arange(shape[0]) / shape[0] - 0.05) / 0.14))[:, None]
    shine = 0.07 * fine + 0.06 * bundle + 0.05 * wide
    # Light strands stand out; dark ones are shallow: they looked like the grain of wood.
    return np.clip(0.70 + contrast * from_parting * np.where(shine < 0, 0.6, 1.0) * shine, 0.5, 1.0)


def where(x: Array, y: Array, low: float, high: float, reach: float) -> tuple[slice, slice]:
    """Rows and columns of the texels, (H, W), between two heights, and up to a distance from the middle, mm."""
    rows = np.flatnonzero((y[:, 0] > low) & (y[:, 0] < high))
    columns = np.flatnonzero(np.abs(x[rows]).min(axis=0) < reach)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def painted_radius(angle: Array, y: Array, style: HeadStyle, step: int) -> Array:
    """(H, W) mm: distance of the skin from the axis at texels, from every ``step``-th one, softened."""
    coarse = radius(angle[::step, ::step], y[::step, ::step], style)
    distance = np.repeat(np.repeat(coarse, step, axis=0), step, axis=1)[: y.shape[0], : y.shape[1]]
    return gaussian_filter(distance, step / 2)


def _skin(style: HeadStyle) -> Array:
    """(3, H, W') light of the skin's texels."""
    angle, y = skin_places()
    shape = (y.shape[0], y.shape[1])
    distance, angle = painted_radius(angle, y, style, COARSE), angle[:1]  # all rows have the same angles
    x, front = distance * np.sin(angle), np.broadcast_to(np.cos(angle) > 0.2, shape)
    light = np.ones((3, *shape))
    mottle = 0.014 * _cloud(shape, 1, 2.2) + 0.014 * _cloud(shape, 2, 8.0) + 0.018 * _cloud(shape, 3, 28.0)
    # At the borders the texture continues as one colour, and a closing lid would draw spots out to streaks.
    within = smoothstep((y[:, :1] - BOTTOM_MM) / 12.0) * smoothstep((SPAN_RAD - np.abs(angle)) / 0.15)
    eyes_here = where(x, y, 18.0, 60.0, 60.0)
    within[eyes_here] *= 1 - _lids(x[eyes_here], y[eyes_here], front[eyes_here], style)
    mottle = 0.03 + within * mottle
    fine = 0.022 * within * np.clip(_cloud(shape, 4, 0.7), -2, 2)
    freckles = _freckles(x, y, style)
    for plane, blood, pigment in zip(light, BLOOD, PIGMENT, strict=True):
        plane -= mottle * blood
        plane -= fine
        plane -= freckles * pigment
    for part, low_mm, high_mm, half_rad in ((_lips, -54.0, -18.0, 0.5), (_round_eyes, 18.0, 56.0, 0.9)):
        rows = np.flatnonzero((y[:, 0] > low_mm) & (y[:, 0] < high_mm))
        columns = np.flatnonzero(np.abs(angle[0]) < half_rad)
        here = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        light[:, *here] *= np.moveaxis(part(x[here], y[here], front[here], style), -1, 0)
    _hairs(light, x, y, angle, front, style)
    nose = where(x, y, -50.0, 54.0, 35.0)  # beyond, what follows is 0
    x, y = x[nose], y[nose]
    hole = nostril(x, y, style.nose_width) * front[nose]
    across = np.abs(x) / style.nose_width
    wing = np.hypot((across - 12.4) / 6.6, (y - 2.0) / 9.0)
    crease = np.exp(-(((wing - 1.0) / 0.16) ** 2)) * smoothstep((across - 13.5) / 4.0) * front[nose]
    _remove(light[:, *nose], WING_CREASE * crease, BLOOD)
    light[:, *nose] *= 1 - 0.5 * hole
    return light


def _lids(x: Array, y: Array, front: Mask, style: HeadStyle) -> Array:
    """(H, W'): share of the upper lids' skin, which a closing lid stretches."""
    inner, outer = eyes.INNER_CORNER[0], eyes.OUTER_CORNER[0]
    t = (2 * np.abs(x) - inner - outer) / (outer - inner)
    row = np.linspace(-1, 1, 101)
    up = y - np.interp(t, row, eyes.margin(row, np.ones(101, dtype=bool), style)[:, 1])
    return smoothstep((1.24 - np.abs(t)) / 0.24) * smoothstep((11.0 - up) / 5.0) * smoothstep((up + 3.0) / 2.0) * front


def _freckles(x: Array, y: Array, style: HeadStyle) -> Array:
    """Dark spots on nose and cheeks."""
    shape = (y.shape[0], y.shape[1])
    where = np.exp(-(((np.abs(x) - 26) / 30) ** 2) - ((y - 6) / 22) ** 2)
    seeds = np.where(grain(shape, 7) > 1.0 - 0.0022 * style.freckles, 0.6 + 0.4 * grain(shape, 8), 0.0)
    spots = gaussian_filter(seeds, 1.5) / 0.07
    return 0.16 * np.clip(spots, 0, 1) * where


def _lips(x: Array, y: Array, front: Mask, style: HeadStyle) -> Array:
    """Creases across the lips, and a paler seam around the red."""
    t = x / (mouth.OUTER_HALF_WIDTH * style.mouth_width)
    inside_t = np.clip(t, -0.999, 0.999)
    upper = y > mouth.LINE_Y
    edge = mouth.outer_contour(inside_t, upper, style.lip_fullness) - mouth.LINE_Y
    share = (y - mouth.LINE_Y) / np.where(np.abs(edge) < 0.3, np.where(upper, 0.3, -0.3), edge)
    on_lip = smoothstep((1.1 - share) / 0.25) * (np.abs(t) < 1) * front
    shape = (y.shape[0], y.shape[1])
    creases = np.clip(_cloud(shape, 11, (9.0, 1.1)), -2, 2) * smoothstep(share / 0.3)
    beyond = np.clip(np.abs(t) - 1, 0, None) / CORNER_ENDS
    above = y - mouth.LINE_Y
    half = np.where(upper, edge, -edge)
    seam = 0.22 * np.exp(-((above / np.maximum(0.1 * half, 0.35)) ** 2) - beyond**2) * front
    # Corners lie in the shadow of the cheeks.
    corner = np.exp(-(((np.abs(t) - 1.0) / 0.13) ** 2) - ((above + 1.5) / 4.0) ** 2) * front
    light = 1 - on_lip[..., None] * (0.02 * creases[..., None] + np.array([0.02, 0.03, 0.03]))
    light *= 1 - seam[..., None] * np.array([0.8, 1.0, 1.0])
    return light * (1 - CORNER_SHADE * corner[..., None] * np.array([0.7, 1.0, 1.0]))


def _round_eyes(x: Array, y: Array, front: Mask, style: HeadStyle) -> Array:
    """A dark line of lashes along the margins, thicker outside, and slight shading on the lids."""
    across = np.abs(x)
    inner, outer = eyes.INNER_CORNER[0], eyes.OUTER_CORNER[0]
    middle_x, half_x = (inner + outer) / 2, 0.5 * (outer - inner)
    t = np.clip((across - middle_x) / half_x, -1, 1)
    row = np.linspace(-1, 1, 201)
    above = np.interp(t, row, eyes.margin(row, np.ones(201, dtype=bool), style)[:, 1])
    below = np.interp(t, row, eyes.margin(row, np.zeros(201, dtype=bool), style)[:, 1])
    near = smoothstep((1.12 - np.abs((across - middle_x) / half_x)) / 0.16) * front
    thick = 0.5 + 0.75 * smoothstep((t + 0.6) / 1.3)
    upper = smoothstep((thick + 0.5 - (y - above)) / 0.9) * (y > above - 1.5)
    lower = np.exp(-np.clip(below - y, 0, None) / 0.8) * (y < below + 1.5)
    line = near * (0.93 * upper * (y > (above + below) / 2) + 0.30 * lower * (y <= (above + below) / 2))
    up = y - above
    lid = near * smoothstep(up / 1.5) * np.exp(-np.clip(up - 1.0, 0, None) / 2.6)
    return (1 - line[..., None]) * (1 - lid[..., None] * np.array([0.22, 0.30, 0.31]))


def _bearded(x: Array, y: Array, angle: Array, style: HeadStyle) -> Array:
    """(H, W') share of the skin that a full beard covers: moustache, chin, jaw and the sides up to the hair."""
    across, shape = np.abs(x), (y.shape[0], y.shape[1])
    ragged = 2.0 * _mirrored(_cloud(shape, 25, (2.0, 1.2)))
    at_deg = (0, 10, 17, 27, 45, 62, 74, 96)
    upper, lower = (
        np.interp(np.abs(angle), np.deg2rad(at_deg), heights_mm)
        for heights_mm in ((-14, -16, -21, -38, -36, -12, 30, 30), (-94, -94, -92, -90, -86, -76, -62, 0))
    )
    below = smoothstep((upper + ragged - y) / 7.0) * smoothstep((y - lower) / 22.0)
    beside = smoothstep((np.deg2rad(94) - np.abs(angle)) / 0.1)
    t = np.clip(across / (1.08 * mouth.OUTER_HALF_WIDTH * style.mouth_width), -0.999, 0.999)
    top, bottom = (mouth.outer_contour(t, np.full(shape, side), style.lip_fullness) for side in (True, False))
    lips = smoothstep((top + 1.5 - y) / 2.0) * smoothstep((y - bottom + 2.0) / 2.0) * (t < 0.998)
    return np.asarray(below * beside * (1 - lips))


def _hairs(light: Array, x: Array, y: Array, angle: Array, front: Mask, style: HeadStyle) -> None:
    """Darken ``light``, (3, H, W'), of the skin under the brows and beards, and of hair roots along the hairline."""
    light_skin = np.array([0.70, 0.435, 0.315])
    hair_tint = np.clip(np.array(HAIR_COLOURS[style.hair_colour]) / light_skin, 0, 1)
    brow_tint = np.clip(brow_colour(style.hair_colour) / light_skin, 0, 1)
    shape = (y.shape[0], y.shape[1])
    # Below, only a beard has hairs.
    rows = slice(0 if style.beard else int(np.searchsorted(y[:, 0], ROOTS_FROM_MM)), None)
    x, y, front = x[rows], y[rows], front[rows]
    middle, half = parts.brow_line(np.linspace(0, 1, 101), style)
    reach = 2.0 * max(half.max(), 0.5)  # beyond, a brow has no hairs
    near = (y[:, 0] > middle[:, 1].min() - reach) & (y[:, 0] < middle[:, 1].max() + reach)
    across = np.abs(x[near])
    share = np.interp(across, middle[:, 0], np.linspace(0, 1, 101))
    off = y[near] - np.interp(across, middle[:, 0], middle[:, 1])
    off /= np.maximum(np.interp(across, middle[:, 0], half), 0.5)
    ends = smoothstep((across - middle[0, 0] + 1.5) / 9.5) * smoothstep((middle[-1, 0] + 0.5 - across) / 10.0)
    ragged = off + 0.05 * _mirrored(_cloud(shape, 21, (2.0, 0.9))[rows][near])
    brow = smoothstep((1.25 - np.abs(ragged)) / 0.85) * ends * front[near]
    brow *= np.interp(share, (0, 0.25, 1), (0.70, 0.94, 0.90))
    brow *= np.clip(0.96 + 0.05 * _mirrored(_cloud(shape, 22, (1.0, 0.8))[rows][near]), 0, 1)
    bearded = root = np.zeros(())
    if style.beard:
        bearded = (
            style.beard * _bearded(x, y, angle, style) * (0.86 + 0.14 * np.clip(_cloud(shape, 24, (2.2, 0.7)), -2, 1))
        )
    if style.hair:
        depth = above_hairline(angle, y) / FADE_MM + 0.06 * _cloud(shape, 23, (5.0, 0.9))[rows]
        root = 0.93 * smoothstep((depth + 0.25) / 1.3)
    for plane, of_brow, of_hair in zip(light[:, rows], 1 - brow_tint, 1 - hair_tint, strict=True):
        left = np.ones(y.shape)
        left[near] -= brow * of_brow
        left *= 1 - bearded * of_brow
        plane *= np.minimum(left, 1 - root * of_hair)
