"""FAPs to vertices in NumPy: the reference for the theory of operation in :mod:`fapengine.mesh.face_mesh`.

The renderer uses :func:`channel_weights` and :func:`bone_transforms` and does the rest on the GPU.

The pose at rest, for display only (:func:`with_rest`): lids over the iris and a slight smile; and limits of what is
drawn. The standard's neutral face shows the whole iris and a level mouth, which looks like a stare. This pose is added
to FAPs before they are drawn, on any head, and never sent or written. Each value fades where the face does something
itself: lids as they move, the smile as the mouth or the brows show an expression. Eyes smile with raised lip corners,
and lips that smile part farther.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep
from fapengine.mesh.face_mesh import DeformationBasis, FaceMesh
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD

BONE_COUNT = 5
"""Number of transforms of a frame: those of :class:`fapengine.mesh.face_mesh.Bone`, then the head."""
HEAD = 4
PITCH, YAW, ROLL = (1, 2), (2, 0), (0, 1)
"""Axes from and to which a positive rotation turns: face down, to the subject's left, head tilted to the right."""
POSE_FAPU, POSE_AU = 350, 25_000
"""Values to which :func:`single_fap` sets a FAP: lengths in FAPU, angles in AU."""
SEEN_MM = 0.05
"""Smallest displacement of a vertex that counts as motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose of a mesh without FAPs: weights of its basis and transforms of its bones."""

    weights: Array
    """(W,)."""
    bones: Array
    """(5, 4, 4): rest pose to current pose."""


def channel_weights(basis: DeformationBasis, faps: ArrayLike) -> Array:
    """(..., W): weight of each channel, mixed if the basis has a mix, from FAPs (..., 68) in FAPU."""
    values = np.asarray(faps, dtype=np.float64)
    columns = [fap.column(channel.fap) for channel in basis.channels]
    start = np.array([channel.start for channel in basis.channels])
    stop = np.array([channel.stop for channel in basis.channels])
    two_sided = np.isneginf(start)
    start = np.where(two_sided, 0.0, start)
    sign, length = np.sign(np.where(two_sided, 1.0, stop - start)), np.abs(stop - start)
    distance = (values[..., columns] - start) * sign
    weights: Array = np.where(two_sided, distance, np.clip(distance, 0.0, length))
    return weights if basis.mix is None else np.asarray(weights @ basis.mix.T)


def bone_transforms(mesh: FaceMesh, faps: ArrayLike) -> Array:
    """(..., 5, 4, 4): rest-to-current transform of every bone, from FAPs (..., 68) in FAPU.

    The jaw turns about the axis through its joints until feature point 2.1 has moved down by FAP 3, then shifts
    forwards and sideways by FAP 14 and 15. Eyeballs turn by FAP 23-26 and move forwards by FAP 27 and 28. The head
    turns about feature point 7.1: roll first, then pitch, then yaw (FAP 50, 48, 49).
    """
    values = np.asarray(faps, dtype=np.float64)

    def column(number: int) -> Array:
        return values[..., fap.column(number)]

    transforms = np.zeros((*values.shape[:-1], BONE_COUNT, 4, 4))
    transforms[..., :, :, :] = np.eye(4)
    _turn_about(transforms[..., 1, :, :], mesh.jaw_pivot_mm, _rotation(_jaw_angle(mesh, column(3)), *PITCH))
    transforms[..., 1, 2, 3] += column(14) * mesh.fapu.unit(fap.FapUnit.MNS)
    transforms[..., 1, 0, 3] -= column(15) * mesh.fapu.unit(fap.FapUnit.MW)
    for bone, yaw, pitch, thrust in ((2, 23, 25, 27), (3, 24, 26, 28)):
        turn = _rotation(column(yaw) * AU_RAD, *YAW) @ _rotation(column(pitch) * AU_RAD, *PITCH)
        _turn_about(transforms[..., bone, :, :], mesh.eye_pivots_mm[bone - 2], turn)
        transforms[..., bone, 2, 3] += column(thrust) * mesh.fapu.unit(fap.FapUnit.ES)
    yaw_turn, pitch_turn, roll_turn = (
        _rotation(column(number) * AU_RAD, *axes) for number, axes in ((49, YAW), (48, PITCH), (50, ROLL))
    )
    turn = yaw_turn @ pitch_turn @ roll_turn
    _turn_about(transforms[..., HEAD, :, :], mesh.head_pivot_mm, turn)
    return transforms


def _jaw_angle(mesh: FaceMesh, open_jaw: Array) -> Array:
    """Angle that lowers feature point 2.1 by FAP 3: y cos - z sin = y - drop."""
    _, y, z = mesh.point_mm("2.1") - mesh.jaw_pivot_mm
    drop = open_jaw * mesh.fapu.unit(fap.FapUnit.MNS)
    reach = np.hypot(y, z)
    return np.arccos(np.clip((y - drop) / reach, -1.0, 1.0)) - np.arctan2(z, y)


def _turn_about(transform: Array, pivot: Array, rotation: Array) -> None:
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = pivot - rotation @ pivot


def _rotation(angle: Array, first: int, second: int) -> Array:
    rotation = np.zeros((*np.shape(angle), 3, 3))
    rotation[..., :, :] = np.eye(3)
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation[..., first, first] = rotation[..., second, second] = cosine
    rotation[..., first, second], rotation[..., second, first] = -sine, sine
    return rotation


def deform(mesh: FaceMesh, faps: ArrayLike) -> Array:
    """(..., V, 3) mm: position of every vertex, from FAPs (..., 68) in FAPU."""
    basis = mesh.basis
    weights = channel_weights(basis, faps)
    transforms = bone_transforms(mesh, faps)
    frames = weights.shape[:-1]
    moves = [basis.displacement(weights[frame]) for frame in np.ndindex(frames)]
    moved = mesh.vertices_mm.astype(np.float64) + np.reshape(moves, (*frames, *mesh.vertices_mm.shape))
    moved = _follow(moved, transforms[..., mesh.bone, :, :], mesh.bone_weight)
    return _follow(moved, transforms[..., None, HEAD, :, :], mesh.head_weight)


def _follow(points: Array, transforms: Array, weight: NDArray[np.float32]) -> Array:
    transformed = np.einsum("...ij,...j->...i", transforms[..., :3, :3], points) + transforms[..., :3, 3]
    return points + weight[:, None] * (transformed - points)


def single_fap(number: int) -> Array:
    """(68,): one FAP at a clearly visible value, :data:`POSE_FAPU` or :data:`POSE_AU`."""
    frame = np.zeros(fap.FAP_COUNT)
    frame[fap.column(number)] = POSE_AU if fap.spec(number).unit is fap.FapUnit.AU else POSE_FAPU
    return frame


def still_faps(mesh: FaceMesh) -> tuple[int, ...]:
    """Return the numbers of low-level FAPs that move no vertex."""
    return tuple(
        number
        for number in range(3, fap.FAP_COUNT + 1)
        if np.abs(deform(mesh, single_fap(number)) - mesh.vertices_mm).max() < SEEN_MM
    )


class Resting(NamedTuple):
    """Values of a few FAPs at rest, and the FAPs to which they yield."""

    values: dict[int, float]
    """FAP number to FAPU."""
    yields_to: tuple[int, ...]
    limit: float
    """FAPU of any of these at which nothing of the values is left."""


BROWS, CORNERS = (31, 32, 33, 34, 35, 36), (12, 13, 59, 60, 6, 7, 53, 54)
RESTING = (
    *(Resting({number: 80.0}, (number,), 350.0) for number in (19, 20)),
    *(Resting({number: 55.0}, (number,), 350.0) for number in (21, 22)),
    Resting(
        {12: 85.0, 13: 85.0, 59: 110.0, 60: 110.0, 6: 20.0, 7: 20.0, 53: 35.0, 54: 35.0}, (*CORNERS, *BROWS), 250.0
    ),
    Resting({41: 60.0, 42: 60.0}, (41, 42, *CORNERS, *BROWS), 250.0),
)
SMILE_FAPU = (60.0, 380.0)
"""FAPU of a lip corner over which its eye smiles, too."""
SMILING = ((12, {19: -60.0, 21: 85.0}), (13, {20: -60.0, 22: 85.0}))
"""FAP of each lip corner, and what a whole smile adds to FAPs of its eye: the lower lid rises, and the upper lid yields
a little. A smile of mouth and cheeks alone left the eyes cold; one that raised the brows wrinkled the forehead.
"""
LIPS = ((4, 5, 51, 52), (8, 10, 55, 57), (9, 11, 56, 58))
"""FAPs of upper and lower lip, of their inner and then their outer contour: middle, and left and right of it."""
PARTED, PARTED_FAPU, UPPER_SHARE = 0.7, 700.0, 0.4
"""How much farther a whole smile parts lips, as a fraction of the opening between them; the opening to which that
falls to 0, FAPU; and the upper lip's share: the upper teeth are seen up to their necks. Shut lips stay shut.
"""
LIMITS = dict.fromkeys((27, 28), 20.0) | dict.fromkeys((39, 40, 65, 66), 200.0) | dict.fromkeys((67, 68), 150.0)
LIMITS |= dict.fromkeys((61, 62), 120.0) | dict.fromkeys((63, 64), 100.0) | dict.fromkeys((21, 22), 400.0)
"""FAP number to the largest magnitude that is drawn, FAPU: beyond it an eyeball leaves its socket, a lower lid covers
the pupil, a cheek or a nose becomes a cone, and an ear comes off.
"""
LIDS = ((19, 21, 1024.0), (20, 22, 1024.0))
"""FAPs of an eye's upper and lower lid, and their sum at which they meet, FAPU (IRISD, the opening at rest): the
lower lid that a smile raises yields to a blink, or the upper one would go through it, with its lashes.
"""


def with_rest(faps: ArrayLike, share: float) -> Array:
    """Add the pose at rest to FAPs, and keep them within :data:`LIMITS` and :data:`LIDS`.

    Parameters
    ----------
    faps : (..., 68) array_like, FAPU
    share : float
        1 adds all of it, 0 nothing.
    """
    given = np.asarray(faps, dtype=np.float64)
    rested = given.copy()
    limits = np.array([*LIMITS.values()])
    limited = fap.columns(*LIMITS)
    rested[..., limited] = np.clip(given[..., limited], -limits, limits)
    for values, yields_to, limit in RESTING if share else ():
        moved = np.abs(given[..., fap.columns(*yields_to)]).max(axis=-1)
        columns = fap.columns(*values)
        left = share * (1 - smoothstep(moved / limit))
        rested[..., columns] += left[..., None] * np.array([*values.values()])
    for corner, values in SMILING if share else ():
        rested[..., fap.columns(*values)] += share * _smile(given, corner) * np.array([*values.values()])
    smile = _smile(given, *(corner for corner, _ in SMILING)).mean(axis=-1)
    for upper, lower, upper_outer, lower_outer in LIPS if share else ():
        opening = np.clip(-given[..., fap.columns(upper, lower)].sum(axis=-1), 0.0, PARTED_FAPU)
        added = (share * PARTED * smile * opening * (1 - opening / PARTED_FAPU))[..., None]
        rested[..., fap.columns(upper, upper_outer)] -= UPPER_SHARE * added
        rested[..., fap.columns(lower, lower_outer)] -= (1 - UPPER_SHARE) * added
    for upper, lower, shut in LIDS:
        room = np.maximum(shut - rested[..., fap.column(upper)], 0.0)
        rested[..., fap.column(lower)] = np.minimum(rested[..., fap.column(lower)], room)
    return rested


def _smile(faps: Array, *corners: int) -> Array:
    """(..., N): fraction, 0..1, of a whole smile that the FAPs of lip corners show."""
    start, stop = SMILE_FAPU
    return np.clip((faps[..., fap.columns(*corners)] - start) / (stop - start), 0.0, 1.0)
