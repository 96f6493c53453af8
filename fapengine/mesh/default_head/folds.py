"""Skin folds that follow FAPs: their position, their effect on the light, and the FAPs that cause them.

Theory of operation
-------------------
Folds are furrows in a height map over the texture (:func:`fold_map`): lines of the forehead, between the brows, crow's
feet, on the sides of the nose, beside the nose, under the lower lid and on the chin. The map stores not the height but
the effect of its slope, a small rotation of the normal, on the light of the key lamp, so that the shader need not
compute normals per pixel. Every vertex has a fold depth: a neutral fraction, which grows with age, and a fraction for
each FAP that causes folds (:func:`fold_shares`). Outside of folds the map has pores, which break up highlights.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.mesh_builder import TEXTURE_SIZE, skin_places
from fapengine.mesh.default_head.painting import grain, painted_radius, where
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

KEY_FROM = np.array([-0.47, 0.53, 0.706])
"""Direction of the key lamp, as in ``lights.glsl``."""
RANGE = 0.9
"""Relative change of the light for one unit of the map beyond its pores; ``FOLDS`` in ``face.frag``."""
PORES = 0.25
"""Distance from the middle of the map, of 1, that pores stay within; folds are beyond it. Also in ``face.frag``."""
LIT_SIDE = 0.5
"""Fraction of the light on the lit side of a furrow; light scatters in skin, shadow does not."""
AT_REST, SMOOTH, OLD = 0.035, 0.01, 0.42
"""Fraction of the folds in the neutral pose: outside of them, where it is that of pores; within them on a young face,
which shows none; and on an old one.
"""
SMOOTH_UNTIL = 0.3
"""Age up to which a face is young."""
YOUNG = 0.45
"""Fraction of the folds of an old face that FAPs cause in the youngest, except round the eyes, where they have none."""

FOREHEAD, BETWEEN_BROWS, CROWS_FEET, NOSE, BESIDE_NOSE, UNDER_EYE, CHIN = range(7)

Drive = tuple[int, float, float]
"""FAP of the left half or of the middle; largest fraction of the fold; displacement for it, mm, signed."""
DRIVES: dict[int, tuple[Drive, ...]] = {
    FOREHEAD: ((31, 0.5, 5.0), (33, 0.6, 6.0)),
    BETWEEN_BROWS: ((37, 0.75, 4.0), (31, 0.4, -6.0)),
    CROWS_FEET: ((41, 1.0, 6.0),),
    UNDER_EYE: ((41, 0.6, 6.0),),
    NOSE: ((63, 0.6, 3.0), (55, 0.5, -9.0)),
    BESIDE_NOSE: ((59, 0.45, 6.5), (55, 0.5, -9.0)),
    CHIN: ((18, 0.6, 1.2), (59, 0.5, -5.0)),
}
"""FAPs that cause each fold; the right half has the FAPs of the right."""
MIDDLE = (18, 63)
NEGLIGIBLE = 0.3
"""Fractions below this at 1000 FAPU are dropped: each costs time in the vertex shader."""


def _wave(x: Array, number: int) -> Array:
    """(...) mm: deviation of a line of the skin."""
    return 0.8 * np.sin(0.13 * x + 1.7 * number) + 0.45 * np.sin(0.31 * x + 2.9 * number)


Furrow = tuple[Array, Array, float, float]
"""Distance from it, mm; its strength here, 0..1; its half width and its depth, mm."""


def _forehead(x: Array, y: Array) -> Iterator[Furrow]:
    for number, (height, reach, depth) in enumerate(
        ((69.0, 38.0, 0.5), (77.5, 42.0, 0.62), (86.0, 38.0, 0.5), (94.0, 28.0, 0.36))
    ):
        middle = height + _wave(x, number) - 2.2 * np.exp(-((x / 13.0) ** 2)) + 0.0022 * x**2
        here = smoothstep((reach - np.abs(x)) / 16.0) * (0.8 + 0.2 * np.cos(0.21 * x + number))
        yield y - middle, here, 1.25, depth


def _between_brows(x: Array, y: Array) -> Iterator[Furrow]:
    for number, (foot, top, depth) in enumerate(((6.2, 8.6, 0.75), (11.5, 15.0, 0.35))):
        middle = foot + (top - foot) * (y - 46.0) / 18.0 + 0.4 * np.sin(0.3 * y + np.sign(x) + number)
        yield np.abs(x) - middle, smoothstep((y - 43.0) / 6.0) * smoothstep((66.0 - y) / 9.0), 1.15, depth


def _crows_feet(x: Array, y: Array) -> Iterator[Furrow]:
    across = np.abs(x)
    from_corner = np.hypot(across - 43.0, y - 34.5)
    towards = np.rad2deg(np.arctan2(y - 34.5, across - 43.0))
    for number, (angle, reach, depth) in enumerate(
        ((27.0, 17.0, 0.26), (4.0, 20.0, 0.34), (-17.0, 20.0, 0.34), (-38.0, 17.0, 0.24))
    ):
        away = from_corner * np.deg2rad(towards - angle - 0.5 * (from_corner - 8.0) * (-1 if number > 1 else 1))
        here = smoothstep((from_corner - 5.5) / 4.0) * smoothstep((reach - from_corner) / 8.0) * (across > 43.0)
        yield away, here, 1.2, depth


def _under_eye(x: Array, y: Array) -> Iterator[Furrow]:
    across = np.abs(x)
    t = (across - 31.0) / 15.0
    for number, (drop, depth) in enumerate(((9.5, 0.26), (13.0, 0.16))):
        middle = 35.0 - drop + 3.2 * t**2 - 1.0 * t + 0.4 * np.sin(0.4 * across + number)
        yield y - middle, smoothstep((1.0 - np.abs(t)) / 0.35) * (t < 1.0), 1.6, depth


def _on_nose(x: Array, y: Array) -> Iterator[Furrow]:
    across = np.abs(x)
    for number, at in enumerate((17.5, 22.0, 26.5)):
        middle = at + 0.75 * (across - 9.0) + 0.3 * np.sin(0.7 * across + number)
        yield (y - middle) * 0.8, smoothstep((across - 3.5) / 3.0) * smoothstep((14.5 - across) / 4.5), 0.9, 0.42


def _beside_nose(x: Array, y: Array) -> Iterator[Furrow]:
    middle = 17.0 + 0.42 * (-4.0 - y) + 1.0 * np.sin((y + 22.0) / 12.0)
    yield (np.abs(x) - middle) * 0.9, smoothstep((3.0 - y) / 14.0) * smoothstep((y + 50.0) / 20.0), 3.0, 1.35


def _on_chin(x: Array, y: Array) -> Iterator[Furrow]:
    yield y + 53.0 + 0.009 * x**2, smoothstep((17.0 - np.abs(x)) / 9.0), 1.8, 0.6


FURROWS: tuple[tuple[float, float, float, Callable[[Array, Array], Iterator[Furrow]]], ...] = (
    (52.0, 114.0, 43.0, _forehead), (42.0, 67.0, 35.0, _between_brows), (13.0, 56.0, 64.0, _crows_feet),
    (8.0, 48.0, 47.0, _under_eye), (2.0, 42.0, 16.0, _on_nose), (-51.0, 4.0, 75.0, _beside_nose),
    (-73.0, -36.0, 18.0, _on_chin),
)  # fmt: skip
"""Height range of the furrows of a region, mm, their greatest distance from the middle of the face, mm, and they."""


def _dimples(x: Array, y: Array) -> Array:
    """(...) mm: the skin of a raised chin, like orange peel."""
    peel = gaussian_filter(grain(x.shape, 41), (4.2, 2.9), mode="nearest")
    spread, dimples = peel.std(), np.zeros(x.shape)
    at = where(x, y, -112.0, -16.0, 69.0)  # beyond, there is none
    peel = np.clip(peel[at] / spread, -1.5, 2.0)
    # Squared twice: NumPy takes a hundred times as long for the fourth power of a negative number.
    here: Array = np.exp(-(((x[at] / 13.0) ** 2) ** 2) - (((y[at] + 64.0) / 9.0) ** 2) ** 2)
    dimples[at] = 0.15 * peel * here
    return dimples


@lru_cache(maxsize=1)
def fold_map() -> NDArray[np.uint8]:
    """Compute the effect of full folds and pores on the light, over the texture; the same for every head.

    Returns
    -------
    (768, 1024) uint8
        127.5 changes nothing, 255 is the brightest. Read-only.
    """
    angle, y = skin_places()
    away, angle = painted_radius(angle, y, HeadStyle(), 8), angle[:1]  # all rows have the same angles
    x, front = away * np.sin(angle), np.broadcast_to(np.cos(angle) > 0.2, y.shape)
    height, region = np.zeros(y.shape), np.zeros(y.shape)
    for low, high, reach, furrows in FURROWS:
        at = where(x, y, low, high, reach)
        for distance, here, half, depth in furrows(x[at], y[at]):
            near = (distance / half) ** 2
            height[at] += depth * here * front[at] * (0.35 * np.exp(-near / 6.0) - np.exp(-near))
            region[at] = np.maximum(region[at], here * front[at] * np.exp(-near / 8.0))
    dimples = _dimples(x, y) * front
    height += dimples
    per_row, per_column = y[1, 0] - y[0, 0], away * np.diff(angle[0]).max()
    upwards = np.gradient(height, axis=0) / per_row
    around = np.gradient(height, axis=1) / per_column
    key_around = KEY_FROM[0] * np.cos(angle) - KEY_FROM[2] * np.sin(angle)
    key_facing = KEY_FROM[0] * np.sin(angle) + KEY_FROM[2] * np.cos(angle)
    change = -(around * key_around + upwards * KEY_FROM[1]) / np.clip(key_facing, 0.45, 1.0)
    change = 0.9 * np.where(change > 0, LIT_SIDE * change, change) + 0.28 * np.minimum(height, 0.0)
    region = np.maximum(region, np.abs(dimples) > 0.02)
    pores = gaussian_filter(grain(y.shape, 42), 0.75)
    pores = np.clip(pores / pores.std(), -2.0, 1.2) * 0.5 * PORES * (1 - region)
    changed = smoothstep(np.abs(change) / 0.02)  # faint folds stay within the range of the pores
    light = change / RANGE + np.sign(change) * PORES * changed + pores * (1 - changed)
    image = np.full(TEXTURE_SIZE, 127.5)
    image[:, : y.shape[1]] += 127.5 * np.clip(light, -1, 1)
    drawn = np.round(image).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


def _share(region: int, x: Array, y: Array) -> Array:
    """(N,): membership of a vertex in a region, either half."""
    across = np.abs(x)
    return {
        FOREHEAD: smoothstep((y - 60.0) / 7.0) * smoothstep((106.0 - y) / 8.0) * smoothstep((58.0 - across) / 14.0),
        BETWEEN_BROWS: smoothstep((y - 38.0) / 7.0) * smoothstep((68.0 - y) / 6.0) * smoothstep((22.0 - across) / 7.0),
        CROWS_FEET: smoothstep((across - 43.0) / 5.0) * smoothstep((54.0 - y) / 8.0) * smoothstep((y - 12.0) / 8.0),
        UNDER_EYE: smoothstep((y - 12.0) / 5.0) * smoothstep((34.0 - y) / 6.0) * smoothstep((across - 13.0) / 5.0)
        * (1 - smoothstep((across - 43.0) / 5.0)),
        NOSE: smoothstep((y - 10.0) / 5.0) * smoothstep((36.0 - y) / 5.0) * smoothstep((17.0 - across) / 4.0),
        BESIDE_NOSE: smoothstep((9.0 - y) / 7.0) * smoothstep((y + 54.0) / 10.0) * smoothstep((across - 11.0) / 5.0)
        * smoothstep((52.0 - across) / 10.0),
        CHIN: smoothstep((-46.0 - y) / 5.0) * smoothstep((y + 82.0) / 8.0) * smoothstep((30.0 - across) / 10.0),
    }[region]  # fmt: skip


def resting_folds(points: Array, age: float) -> Array:
    """(N,): neutral fraction of the folds of skin at positions on the template, (N, 3) mm; 0 at the back."""
    x, y, z = points.T
    lined = max(age - SMOOTH_UNTIL, 0.0) / (1 - SMOOTH_UNTIL)
    most = SMOOTH + (OLD - SMOOTH) * lined**1.5
    rest = np.full(len(points), AT_REST)
    for region in (FOREHEAD, BETWEEN_BROWS, CROWS_FEET, UNDER_EYE, BESIDE_NOSE):
        share = _share(region, x, y)
        rest += share * (most - rest)
    return np.where(z > 10.0, rest, 0.0)


def fold_shares(points: Array, fapu: Fapu, age: float) -> Iterator[tuple[int, Indices, Array]]:
    """Yield for each FAP that causes folds its number, the indices of the places, and the fraction per FAPU there.

    ``points`` is (N, 3) mm on the template; ``age`` 0..1: firm skin folds less.
    """
    x, y, z = points.T
    left = smoothstep(x / 8.0 + 0.5)
    shares: dict[int, Array] = {}
    for region, drives in DRIVES.items():
        here = _share(region, x, y) * (z > 10.0)
        firm = age if region in (CROWS_FEET, UNDER_EYE) else YOUNG + (1 - YOUNG) * age
        for number, most, full_mm in drives:
            per_fapu = firm * most / full_mm * fapu.unit(fap.spec(number).unit)
            for mine, half in ((number, left), (number + 1, 1 - left)) if number not in MIDDLE else ((number, 1.0),):
                shares[mine] = shares.get(mine, np.zeros(len(points))) + per_fapu * here * half
    for number, share in shares.items():
        chosen = np.flatnonzero(np.abs(share) * 1000 > NEGLIGIBLE)
        yield number, chosen, share[chosen]
