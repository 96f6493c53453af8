"""The measured face that the template is fitted to, and how faces differ from person to person.

Theory of operation
-------------------
The template (:mod:`.surface` with lips, lids and nose) is a surface over two coordinates, its *places*: the angle
around the head and the height. ``design/learn_faces.py`` fits it to the mean of scanned faces and stores, on a grid of
places, the displacement of the mean face and of :data:`.style.MODES` principal components (weight 1 is one standard
deviation). Faces are made symmetric. The eyes stay in place, so lids slide over their balls on every face; everything
else follows the person, and parts on or under the skin follow the skin.

The table, ``faces.npz``, comes from the mean and the identity modes of ICT-FaceKit (MIT licence, University of Southern
California, Institute for Creative Technologies), which come from scans of people; NOTICE has its licence.
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from fapengine._arrays import Array, read_table
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.default_head.surface import NAPE_MM
from fapengine.mesh.default_head.surface import position as template_position

STEP_MM = 0.01
"""Unit of the displacements in a table, which are int16."""


class FaceTable(NamedTuple):
    """The measured face at the knots of a grid: angles, (A,) rad, by heights, (Y,) mm."""

    angles: Array
    heights: Array
    mean: Array
    """(A, Y, 3) mm."""
    modes: Array
    """(M, A', Y', 3) mm, at every second angle and height."""


@cache
def face_table() -> FaceTable:
    """Read ``faces.npz``."""
    table = read_table(__package__, "faces.npz")
    angles = np.deg2rad(table["angles_deg"])
    return FaceTable(angles, table["heights_mm"], STEP_MM * table["mean"], STEP_MM * table["modes"])


def _both_sides(angles: Array, table: Array) -> tuple[Array, Array]:
    """Extend a table beyond front and back with its mirror image."""
    mirrored = table * [-1.0, 1.0, 1.0]
    whole = np.concatenate([-angles[4:0:-1], angles, 2 * np.pi - angles[-2:-5:-1]])
    return whole, np.concatenate([mirrored[4:0:-1], table, mirrored[-2:-5:-1]])


@lru_cache(maxsize=4)
def _splines(identity: tuple[float, ...]) -> tuple[RectBivariateSpline, ...]:
    angles, heights, mean, modes = face_table()
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
    """(..., 3) mm: displacement of a face from the template.

    Parameters
    ----------
    place : (..., 2) array_like
        Angle, rad, and height, mm, on the template.
    identity : tuple of float
        Weights of the modes; missing ones are 0.
    """
    angle, height = np.moveaxis(np.asarray(place, dtype=np.float64), -1, 0)
    heights = face_table().heights
    lowest = heights[0] + NAPE_MM * smoothstep((np.abs(angle) - np.pi / 4) / (np.pi / 4))
    known = np.clip(height, lowest, heights[-1])
    move: Array = np.stack([spline.ev(np.abs(angle), known) for spline in _splines(identity)], axis=-1)
    move[..., 0] *= np.sign(angle)
    return move


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: skin of a person at a place of the template, without lips and lids."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    return template_position(a, h, style) + displacement(np.stack([a, h], axis=-1), style.weights)


def normal(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3): outward unit normal of :func:`position`."""
    a, h = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), np.asarray(y, dtype=np.float64))
    across = position(a + 1e-3, h, style) - position(a - 1e-3, h, style)
    along = position(a, h + 0.5, style) - position(a, h - 0.5, style)
    n = np.cross(across, along)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)
