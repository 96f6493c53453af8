"""Lids that slide over their eyeball: from the straight motion of a FAP to one around the ball."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.mesh.face_mesh import Channel
from fapengine.mesh.rig.parts import Eyes
from fapengine.mesh.rig.placed_mesh import PlacedMesh

PUPILS = {19: "3.5", 20: "3.6", 21: "3.5", 22: "3.6"}
"""Pupil of the eye of each lid's FAP."""
KNOTS = (0.0, 341.0, 683.0, 1024.0, 1100.0)
"""Values of the FAP, FAPU, between which vertices of a lid move in straight lines."""
SHUT, WIDE_OPEN = 1024.0, -600.0
"""Values of the FAP, FAPU, that close a lid and open it wide."""
SAMPLES, SAMPLED_SHARE = 240, 1.3
"""Number of samples of a lid's path, and the fraction of it that they cover."""
MIN_CLEARANCE_RATIO = 1.02
"""Distance from the centre of the eye, in radii, that a closing lid keeps."""
MAX_RISE_RATIO = 1.03
"""Distance from the centre of the eye, relative to rest, that a closing lid does not exceed."""
USUAL_RADIUS_MM = 12.0
"""Radius of an eye without a ball."""
SLIDING_RADII, STRAIGHT_RADII = 1.35, 1.9
"""Distance from the centre of the eye, in radii, up to which skin slides over the ball, and from which it moves
straight.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Lid:
    """One lid and its FAP."""

    number: int
    vertex: int
    """Vertex of its feature point."""
    axis: Array
    """(3,): unit direction of the FAP."""
    step_mm: float
    """Motion of the feature point for one FAPU."""


def slides(number: int, eyes: Eyes) -> bool:
    """Whether a FAP moves a lid of a known eye."""
    return number in PUPILS and PUPILS[number] in eyes


def bend(mesh: PlacedMesh, eyes: Eyes, lid: Lid, motion: Array) -> Iterator[tuple[Channel, Indices, Array]]:
    """Lead a lid around its eyeball, piece by piece, its point moving up or down by exactly the FAP's steps.

    ``motion`` is the straight motion for one FAPU, (V, 3) mm, which exists already. Yields a channel, its vertices,
    (N,), and the displacement over the whole piece from the straight path to the one around the ball, (N, 3) mm.
    """
    ball, centre = eyes[PUPILS[lid.number]]
    arm = mesh.vertices_mm - centre
    radius = float(np.median(np.linalg.norm(arm[ball], axis=1))) if len(ball) else USUAL_RADIUS_MM
    inside = np.linalg.norm(arm, axis=1) < STRAIGHT_RADII * radius
    near = np.flatnonzero(inside & (np.abs(motion).max(axis=1) > 0))
    arm, way = arm[near], motion[near] * SHUT
    own = np.flatnonzero(near == lid.vertex)
    if not len(own):
        return
    shares = np.linspace(0.0, SAMPLED_SHARE, SAMPLES)
    path = np.stack([_round_ball(arm[own], way[own], share, radius)[0] for share in shares])
    reached = (path - path[0]) @ lid.axis
    top = int(reached.argmax()) + 1
    bent = []
    for knot in KNOTS:
        share = float(np.interp(knot * lid.step_mm, reached[:top], shares[:top]))
        bent.append(_round_ball(arm, way, share, radius) - arm - way * (knot / SHUT))
    for (start, before), (stop, after) in pairwise(zip(KNOTS, bent, strict=True)):
        yield Channel(lid.number, start, stop), near, after - before


def _round_ball(arm: Array, way: Array, share: float, radius: float) -> Array:
    """(N, 3): vertices after a fraction of their path, at a distance from the eye's centre between its ends."""
    straight = arm + share * way
    first, last, now = (np.linalg.norm(end, axis=1) for end in (arm, arm + way, straight))
    last = np.clip(last, np.minimum(first, MIN_CLEARANCE_RATIO * radius), MAX_RISE_RATIO * first)
    wanted = first + min(share, 1.0) * (last - first)
    slides_by = (STRAIGHT_RADII - first / radius) / (STRAIGHT_RADII - SLIDING_RADII)
    stretch = 1.0 + np.clip(slides_by, 0.0, 1.0) * (wanted / np.maximum(now, 1e-9) - 1.0)
    return straight * stretch[:, None]
