"""The measured face that the template is fitted to, how faces differ from person to person, and the scalp under hair.

Theory of operation
-------------------
The template (:mod:`.surface` with lips and lids) is a surface over two coordinates, its *places*: the angle around the
head and the height. ``design/learn_faces.py`` fits it to the mean of scanned faces and stores, on a grid of places, the
displacement of the mean face and of :data:`.style.MODES` principal components (weight 1 is one standard deviation).
Faces are made symmetric. The eyes stay in place, so lids slide over their balls on every face; everything else follows
the person, and parts on or under the skin follow the skin.

The table, ``faces.npz``, comes from the mean and the identity modes of ICT-FaceKit (MIT licence, University of Southern
California, Institute for Creative Technologies), which come from scans of people; NOTICE has its licence.
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import NdBSpline, PchipInterpolator, make_interp_spline
from scipy.spatial import cKDTree

from fapengine._arrays import Array, read_table
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.default_head import surface
from fapengine.mesh.default_head.style import HeadStyle

STEP_MM = 0.01
"""Unit of the displacements in a table, which are int16."""
HAIRLINE_MM = PchipInterpolator(
    (0, 14, 28, 40, 52, 62, 69, 75, 81, 88, 98, 108, 118, 132, 150, 180),
    (94, 95, 91, 81, 65, 50, 34, 25, 26, 38, 43, 22, -16, -36, -47, -51),
)
"""Height of the hairline, by angle from the front."""
HAIRLINE_RADIUS_MM = 78.0
"""Radius of the head at the hairline."""


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


def cubic_surface(angles: Array, heights: Array, table: Array) -> NdBSpline:
    """Cubic spline through a table, (A, Y, C), over angles, (A,), and heights, (Y,), for all its values at once."""
    across = make_interp_spline(angles, table)
    along = make_interp_spline(heights, across.c, axis=1)
    return NdBSpline((across.t, along.t), np.swapaxes(along.c, 0, 1), 3)


def _spline(angles: Array, heights: Array, table: Array) -> NdBSpline:
    """Spline through a table, (A, Y, 3), continued beyond front and back by its mirror image."""
    mirrored = table * [-1.0, 1.0, 1.0]
    around = np.concatenate([-angles[4:0:-1], angles, 2 * np.pi - angles[-2:-5:-1]])
    whole = np.concatenate([mirrored[4:0:-1], table, mirrored[-2:-5:-1]])
    return cubic_surface(around, heights, whole)


@lru_cache(maxsize=4)
def _person(identity: tuple[float, ...]) -> NdBSpline:
    angles, heights, mean, modes = face_table()
    if identity:
        person = np.tensordot(identity, modes[: len(identity)], axes=1)
        mean = mean + _spline(angles[::2], heights[::2], person)(
            np.stack(np.meshgrid(angles, heights, indexing="ij"), -1)
        )
    return _spline(angles, heights, mean)


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
    known = np.minimum(surface.above_nape(angle, height, heights[0]), heights[-1])
    move = _person(identity)(np.stack(np.broadcast_arrays(np.abs(angle), known), axis=-1))
    move[..., 0] *= np.sign(angle)
    return move


def position(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3) mm: skin of a person at a place of the template, without lips and lids."""
    place = np.stack(np.broadcast_arrays(angle, y), axis=-1)
    return surface.position(angle, y, style) + displacement(place, style.weights)


def normal(angle: ArrayLike, y: ArrayLike, style: HeadStyle) -> Array:
    """(..., 3): outward unit normal of :func:`position`."""
    return surface.normal(angle, y, style, position)


def hairline(angle: Array) -> Array:
    """Height of the hairline, (...) mm, by angle from the front, (...) rad."""
    return HAIRLINE_MM(np.rad2deg(np.abs(angle)))


def above_hairline(angle: Array, y: Array) -> Array:
    """(...) mm: distance from the hairline at places, (...) rad and mm, positive above it."""
    line, step = hairline(angle), 0.01
    steep = (hairline(angle + step) - hairline(angle - step)) / (2 * step * HAIRLINE_RADIUS_MM)
    return np.asarray((y - line) / np.hypot(1.0, steep))


def under_hair(points: Array, style: HeadStyle) -> tuple[Array, Array]:
    """Project points, (..., 3) mm, onto the bare head of a person: the feet and their normals, (..., 3) each."""
    angle, y = (
        grid.ravel() for grid in np.meshgrid(np.linspace(-np.pi, np.pi, 181)[:-1], np.linspace(-60.0, 142.0, 90))
    )
    scalp = position(angle, y, style)
    distance, near = (np.asarray(result) for result in cKDTree(scalp).query(points, k=6))
    weight = (1 / (distance + 0.5) ** 2)[..., None]
    used, outs = np.zeros(len(scalp), dtype=bool), np.empty_like(scalp)
    used[near] = True
    outs[used] = normal(angle[used], y[used], style)
    normals = unit_vectors((outs[near] * weight).sum(axis=-2))
    foot = (scalp[near] * weight).sum(axis=-2) / weight.sum(axis=-2)
    return points - ((points - foot) * normals).sum(axis=-1, keepdims=True) * normals, normals
