"""Charm: the same head with larger eyes, a short skull, a small nose and chin, and a thin neck, as in animated films.

Its outline from the front and the side was fitted to a head of Ready Player Me, both scaled by eyes to chin.
A child's head is warped in the same way: its face is low and short below a large skull, on a thin neck.

A smooth warp of space, so hair, teeth and glasses go with the skin. Each eye with its lid margins and lashes is
enlarged about the middle of its ball, so that lids still slide over it. FAPU and deformation are measured on the
result, so FAPs move their feature points as exactly as before.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.default_head.eyes import RADIUS, Eye, moved_eye
from fapengine.mesh.default_head.points import HeadParts
from fapengine.mesh.default_head.style import OVER_EARS, HeadStyle

LARGER_EYES, APART_MM = 0.60, 3.8
"""Growth of the eyes, and how far each moves outwards, at charm 1."""
MAX_CHARM = 0.7
"""Charm beyond which eyes, their rim, nose and throat stay as they are: skin between larger eyes would fold."""
DEEPER = 0.6
"""Fraction of a ball's growth by which it moves back into the head."""
NEAR_MM, FAR_MM = 24.0, 70.0
"""Distance from an eye up to which skin moves with it fully, and from which not at all."""
LEVEL_MM = 25.0
"""Distance from which skin moves no farther, so that it is not pushed together into a crease."""
TEMPLE_MM, STEEPEST = 46.0, 3.0
"""Distance from the middle of the face from which skin slides down no slope steeper than this, or it would fold."""
NEAR_LIDS_MM, FAR_LIDS_MM = 15.0, 31.0
"""The same for the way back."""
EAR_GROWTH, COVERED_EAR_GROWTH = np.array([0.0, -0.04, 0.0]), np.array([-0.22, 0.08, 0.06])
"""Growth of an ear about its root, at charm 1, and of one that lies close to the head, below hair."""
EAR_REACH_MM = 3.0
EDGE_Z_MM, EDGE_Y_MM = (-20.0, 8.0, 28.0, 45.0, 69.0, 104.0), (-4.0, -20.0, -37.0, -48.0, -60.0, -78.0)
"""Height of the lower edge of the jaw by depth, from the ear to the chin."""


def _faded(value: Array, low: float, high: float) -> Array:
    return np.asarray(1 - smoothstep((value - low) / (high - low)))


def stylise(points: Array, head: HeadParts, style: HeadStyle) -> tuple[Array, HeadParts]:
    """Warp a head, (V, 3) mm.

    Returns
    -------
    (V, 3) mm, HeadParts
        Vertices, and parts with matching eyes.
    """
    charm, childlike = style.charm, style.childlike
    moved = _as_child(_with_face(points, charm, childlike), childlike)
    skin = points[head.grid].reshape(-1, 3)
    skin = skin[(skin[:, 2] > 15.0) & (np.abs(skin[:, 0]) < 82.0) & (skin[:, 1] > -60.0)]
    depth = LinearNDInterpolator(skin[:, :2], skin[:, 2])
    left, right = (_enlarge(eye, points, moved, depth, charm) for eye in head.eyes)
    growth = COVERED_EAR_GROWTH if style.haircut in OVER_EARS else EAR_GROWTH
    for side, ear in zip((1.0, -1.0), head.ears, strict=True):
        mine = _of_ear(points, ear, head)
        root = points[mine][np.argsort(side * points[mine, 0])[: max(1, len(mine) // 5)]].mean(axis=0)
        moved[mine] += (points[mine] - root) * charm * growth
    return moved, replace(head, eyes=(left, right))


def _of_ear(points: Array, ear: Indices, head: HeadParts) -> Indices:
    """(N,): vertices of an ear and of what fills it."""
    near = np.isfinite(cKDTree(points[ear.ravel()]).query(points, distance_upper_bound=EAR_REACH_MM)[0])
    near[head.grid] = near[head.hair] = False
    return np.flatnonzero(near)


def _enlarge(eye: Eye, points: Array, moved: Array, depth: LinearNDInterpolator, charm: float) -> Eye:
    """Enlarge an eye in ``moved``, (V, 3) mm, with the skin around it; ``depth`` is z of the face at x and y."""
    charm = min(charm, MAX_CHARM)
    growth, apart = LARGER_EYES * charm, np.array([eye.side * APART_MM * charm, 0.0])
    back = -DEEPER * RADIUS * growth
    off = points - eye.centre
    centre = eye.centre + np.append(apart, back)
    distance = np.linalg.norm(off[:, :2] * [1.4, 1.0], axis=1)
    ahead = smoothstep((points[:, 2] - 25.0) / 25.0)
    ahead *= smoothstep((off[:, 0] * eye.side + 31.4) / 16.0)  # the nose stays
    beside = _faded(distance, NEAR_MM, FAR_MM) * _faded(np.abs(points[:, 0]), 46.0, 84.0) * ahead  # nor the temples
    beside *= 1 - np.exp(-((points[:, 0] / 30.0) ** 4) - ((points[:, 1] + 5.0) / 26.0) ** 4)  # but not the nose's wings
    with_lids = _faded(distance, NEAR_LIDS_MM, FAR_LIDS_MM) * ahead
    level_off = (1 + (distance / LEVEL_MM) ** 8) ** -0.125
    shift = beside[:, None] * (growth * level_off[:, None] * off[:, :2] + apart)
    moved[:, :2] += shift
    # Skin slides over the face; only the lids follow the ball.
    slid, near = np.zeros(len(points)), shift.any(axis=1)
    slid[near] = np.nan_to_num(depth(points[near, :2] + shift[near]) - depth(points[near, :2]))
    temple = np.abs(points[:, 0]) > TEMPLE_MM
    steepest = STEEPEST * np.linalg.norm(shift[temple], axis=1)
    slid[temple] = np.clip(slid[temple], -steepest, steepest)
    moved[:, 2] += (1 - with_lids) * slid + with_lids * (growth * off[:, 2] + back)
    lids = eye.lids
    rigid = np.concatenate([eye.ball.ravel(), eye.lashes.ravel(), lids.indices[lids.level <= 1.0].ravel()])
    moved[rigid] = centre + (1 + growth) * off[rigid]
    margin = lids.indices[np.flatnonzero(lids.level == 1.0)[0]]
    return moved_eye(eye, centre, points[margin], moved[margin])


def _with_face(points: Array, charm: float, childlike: float) -> Array:
    """(V, 3) mm: the warp of everything but eyes and ears; millimetres and fractions are those of charm 1."""
    x, y, z = points.T
    moved = points.copy()
    front = smoothstep((z - 70.0) / 15.0)
    nose = np.exp(-((x / 19.0) ** 4) - (y / 26.0) ** 4) * front
    smaller = min(charm, MAX_CHARM) * nose
    moved[:, 0] -= 0.20 * smaller * x * smoothstep((np.abs(x) - 4.0) / 8.0)  # its bridge stays round
    moved[:, 2] -= 0.32 * smaller * np.clip(z - 103.0, 0, None)
    moved[:, 2] += charm * 4.5 * np.exp(-((x / 20.0) ** 2) - ((y + 70.0) / 12.0) ** 2) * front  # the chin
    jaw = smoothstep((2.0 - y) / 72.0) * smoothstep((y + 112.0) / 40.0)
    to_chin = smoothstep((z - 20.0) / 40.0) * (1 + smoothstep((-36.0 - y) / 30.0))
    moved[:, 0] *= 1 - charm * (0.08 + 0.10 * to_chin) * (1 - 0.3 * childlike) * jaw
    brows = np.exp(-(((y - 59.0) / np.where(y > 59.0, 17.0, 11.0)) ** 2) - ((np.abs(x) - 26.0) / 36.0) ** 4) * front
    moved[:, 1] -= charm * 2.8 * brows  # the larger eyes have moved them up
    cheeks = np.exp(-(((y - 2.0) / 20.0) ** 2) - ((np.abs(x) - 46.0) / 18.0) ** 2) * smoothstep((z - 50.0) / 30.0)
    moved[:, 2] += charm * (1.5 - 1.0 * childlike) * cheeks
    # The rim of the orbit: in three-quarter view there is skin between the far eye and the contour.
    rim = smoothstep((np.abs(x) - 42.0) / 12.0) * _faded(np.abs(x), 50.0, 80.0) * smoothstep((z - 15.0) / 60.0)
    rim *= min(charm, MAX_CHARM) * np.exp(-(((y - 38.0) / np.where(y > 38.0, 28.0, 22.0)) ** 2))
    moved[:, 0] += 2.5 * rim * np.sign(x)
    moved[:, 2] += 10.5 * rim
    # Full cheeks beside the mouth, down to a round jaw.
    full = np.exp(-(((y + 58.0) / 28.0) ** 2) - ((z - 68.0) / 32.0) ** 2) * smoothstep((np.abs(x) - 18.0) / 30.0)
    moved[:, 0] += charm * (5.0 - 2.0 * childlike) * full * np.sign(x)
    hollow = np.exp(-(((y + 22.0) / 20.0) ** 2) - ((z - 44.0) / 20.0) ** 2) * smoothstep((np.abs(x) - 40.0) / 20.0)
    moved[:, 0] -= charm * 1.5 * hollow * np.sign(x)
    # Ears and the sides of the head come forward, so that the cheek is not flat in three-quarter view.
    side = smoothstep((np.abs(x) - 30.0) / 30.0) * smoothstep((y + 95.0) / 40.0) * smoothstep((95.0 - y) / 50.0)
    side *= np.exp(-((np.clip(z + 8.0, -20.0, None) / 46.0) ** 2)) * smoothstep((z + 90.0) / 70.0)
    moved[:, 2] += charm * 15.0 * side
    slim = smoothstep((58.0 - z) / 50.0) * smoothstep((y + 70.0) / 50.0) * smoothstep((62.0 - y) / 45.0)
    moved[:, 0] *= 1 - charm * 0.07 * slim
    moved[:, 0] += charm * 0.12 * x * np.exp(-((x / 36.0) ** 4) - ((y + 34.0) / 24.0) ** 2) * front  # the mouth
    # Below the jaw's edge the skin turns inwards, to a slim neck.
    edge = np.interp(z, EDGE_Z_MM, EDGE_Y_MM)
    under = smoothstep((edge - y) / 26.0) * smoothstep((y + 122.0) / 40.0) * smoothstep((z + 25.0) / 40.0)
    moved[:, 0] *= 1 - charm * 0.26 * under
    # The underside of the chin is level, not a slope down to the neck.
    level = smoothstep((-73.0 - y) / 20.0) * smoothstep((y + 135.0) / 40.0) * _faded(z, 72.0, 104.0)
    moved[:, 1] += min(charm, MAX_CHARM) * 12.0 * (1 - 0.7 * childlike) * level * smoothstep((z - 5.0) / 40.0)
    short = charm * 3.0 * (1 - 0.7 * childlike)  # a child's face is short already
    moved[:, 1] += short * smoothstep((28.0 - y) / 62.0) * smoothstep((y + 240.0) / 60.0)
    lower = smoothstep((-14.0 - y) / 64.0) * smoothstep((y + 240.0) / 60.0)
    moved[:, 1] += charm * 8.5 * (1 - 0.5 * childlike) * lower
    skull = smoothstep((y - 38.0) / 60.0)
    moved[:, 0] *= 1 + charm * 0.04 * skull
    moved[:, 1] += charm * 5.0 * skull
    back = smoothstep((15.0 - z) / 100.0) * smoothstep((y + 210.0) / 70.0)
    moved[:, 2] += charm * 22.0 * back  # the skull and the nape
    neck = smoothstep((-44.0 - y) / 50.0) * smoothstep((70.0 - z) / 50.0) * smoothstep((y + 180.0) / 70.0)
    neck *= _faded(np.abs(x), 70.0, 110.0) * (1 - 0.5 * childlike)
    moved[:, 0] *= 1 - charm * 0.32 * neck
    moved[:, 2] = -8.0 + (moved[:, 2] + 8.0) * (1 - charm * 0.56 * neck)
    moved[:, 2] -= charm * 10.0 * smoothstep((-52.0 - y) / 80.0) * smoothstep((y + 210.0) / 70.0)  # it leans forwards
    return moved


def _as_child(points: Array, childlike: float) -> Array:
    """(V, 3) mm: the warp to a child's head."""
    moved = points.copy()
    x, y, z = points.T
    # Below the eyes all is nearer to them, the neck and what is below it as much as the chin.
    below = np.clip(18.0 - y, 0, 98.0)
    moved[:, 1] += childlike * 0.20 * (below - 8.0 * (1 - np.exp(-below / 8.0)))
    # Full below the height of the mouth as well, or so short a cheek would overhang and show a ridge.
    full = np.exp(-(((y + 35.0) / 34.0) ** 2)) * smoothstep((np.abs(x) - 24.0) / 18.0) * smoothstep((z - 30.0) / 40.0)
    moved[:, 0] += childlike * 1.6 * full * np.sign(x)
    moved[:, 2] += childlike * 3.2 * full
    skull = smoothstep((y - 30.0) / 60.0)
    moved[:, :3:2] *= 1 + childlike * 0.035 * skull[:, None]
    moved[:, 2] -= childlike * 6.0 * smoothstep((-60.0 - y) / 20.0) * smoothstep((z - 40.0) / 30.0)
    lower = smoothstep((-72.0 - y) / 30.0)
    moved[:, 0] *= 1 - childlike * 0.20 * lower
    moved[:, 2] = -8.0 + (moved[:, 2] + 8.0) * (1 - childlike * 0.16 * lower)
    return moved
