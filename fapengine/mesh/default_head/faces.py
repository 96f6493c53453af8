"""The measured face that our template is laid on, and how faces differ from person to person.

Theory of operation
-------------------
The template (:mod:`.surface` with lips, lids and nose) is a surface over two coordinates, its *places*: the angle
round the head and the height. ``design/learn_faces.py`` lays it over the mean of scanned faces and keeps, at a grid of
places, where each one goes: the mean, and :data:`.faces_table.MODES` ways in which people differ from it (principal
components; at weight 1 one standard deviation). Faces are made symmetric. The eyes stay where they are, so lids slide
on their balls for everybody; all else follows the person, and what lies on the skin or behind it follows the skin.
"""

import base64
import zlib
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head import faces_table
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import NAPE_MM
from fapengine.mesh.default_head.surface import position as template_position

Array = NDArray[np.float64]

STEP_MM = 0.01
"""One unit of the table."""


def unpacked(text: str) -> Array:
    """(N,): numbers of a table: base64 of zlib of int16, in units of :data:`STEP_MM`."""
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype="<i2") * STEP_MM


@cache
def _tables() -> tuple[Array, Array]:
    """Unpack the mean (A, Y, 3), and the modes (M, A', Y', 3), mm, over every second knot."""
    whole = unpacked(faces_table.MOVES)
    angles, heights = len(faces_table.ANGLES_DEG), len(faces_table.HEIGHTS_MM)
    mean, modes = np.split(whole, [angles * heights * 3])
    coarse = -(-angles // 2), -(-heights // 2)
    return mean.reshape(angles, heights, 3), modes.reshape(faces_table.MODES, *coarse, 3)


def _both_sides(angles: Array, table: Array) -> tuple[Array, Array]:
    """Add what lies beyond front and back: the mirror image."""
    mirrored = table * [-1.0, 1.0, 1.0]
    whole = np.concatenate([-angles[4:0:-1], angles, 2 * np.pi - angles[-2:-5:-1]])
    return whole, np.concatenate([mirrored[4:0:-1], table, mirrored[-2:-5:-1]])


@lru_cache(maxsize=4)
def _splines(identity: tuple[float, ...]) -> tuple[RectBivariateSpline, ...]:
    angles, heights = np.deg2rad(faces_table.ANGLES_DEG), np.array(faces_table.HEIGHTS_MM)
    mean, modes = _tables()
    total = mean
    if identity:
        person = np.tensordot(identity, modes[: len(identity)], axes=1)
        around, person = _both_sides(angles[::2], person)
        total = mean + np.stack(
            [RectBivariateSpline(around, heights[::2], person[..., axis])(angles, heights) for axis in range(3)],
            axis=-1,
        )
    around, total = _both_sides(angles, total)
    return tuple(RectBivariateSpline(around, heights, total[..., axis]) for axis in range(3))


def displacement(place: ArrayLike, identity: tuple[float, ...] = ()) -> Array:
    """(..., 3) mm: how far a face stands from the template.

    Parameters
    ----------
    place : (..., 2) array_like
        Angle, rad, and height, mm, on the template.
    identity : tuple of float
        Weights of the modes; those left out are 0.
    """
    angle, height = np.moveaxis(np.asarray(place, dtype=np.float64), -1, 0)
    lowest = faces_table.HEIGHTS_MM[0] + NAPE_MM * smoothstep((np.abs(angle) - np.pi / 4) / (np.pi / 4))
    known = np.clip(height, lowest, faces_table.HEIGHTS_MM[-1])
    move: Array = np.stack([spline.ev(np.abs(angle), known) for spline in _splines(identity)], axis=-1)
    move[..., 0] *= np.sign(angle)
    return move


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: the skin at a place of the template without lips and lids."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    where: Array = template_position(a, h, style) + displacement(np.stack([a, h], axis=-1), style.weights)
    return where


def normal(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3): unit normal of :func:`position`, outwards."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    across = position(a + 1e-3, h, style) - position(a - 1e-3, h, style)
    along = position(a, h + 0.5, style) - position(a, h - 0.5, style)
    n = np.cross(across, along)
    unit: Array = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return unit
