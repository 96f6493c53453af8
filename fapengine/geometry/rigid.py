"""Rigid motion between point sets: two closed forms, a robust one, and a template for a moving body.

Theory of operation
-------------------
With both sets moved to their (weighted) centroids, translation is gone and only ``target = R @ point`` is left.

* :func:`fit_rigid` maximises ``sum w target . (R @ point)`` over unit quaternions: the answer is the eigenvector of the
  largest eigenvalue of Horn's symmetric 4 x 4 matrix. A unit quaternion cannot be a reflection, whatever the noise and
  however flat the body. All frames are solved in one batched call.
* :func:`fit_rigid_linear` uses that ``R = (I + [g])^-1 (I - [g])`` of a Gibbs vector ``g`` turns the same equation into
  ``target - point = g x (target + point)``, which is linear in ``g``. It is a rotation by construction too. Near
  a half turn ``g`` grows without bound; so the equation is also solved with the points turned by half a turn about
  each axis, and the best of the four answers is kept.
* A rotation and its quaternion are one to two; :func:`continuous` chooses the sign so that a track never jumps.

Quaternions are ``(w, x, y, z)``. Batch axes lead everywhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.geometry.smooth import low_pass

MIN_POINTS = 3
UNDETERMINED = 1e-9
"""Gap of the two largest eigenvalues, relative to them, below which every turn about some axis fits equally well."""
HALF_TURNS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """``target = rotation @ point + translation``, one for each batch element. Arrays are read-only."""

    rotation: NDArray[np.float64]
    """(..., 3, 3), determinant +1."""
    translation_mm: NDArray[np.float64]
    """(..., 3)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, "rotation", ("...", 3, 3), np.float64))
        object.__setattr__(
            self, "translation_mm", frozen(self.translation_mm, "translation_mm", ("...", 3), np.float64)
        )
        if self.rotation.shape[:-2] != self.translation_mm.shape[:-1]:
            raise UsageError(
                f"translation_mm: got batch {self.translation_mm.shape[:-1]}, expected {self.rotation.shape[:-2]}"
            )

    def apply(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Carry (..., M, 3) points; NaN stays NaN."""
        points = np.asarray(points_mm, dtype=np.float64)
        moved: NDArray[np.float64] = points @ np.swapaxes(self.rotation, -1, -2) + self.translation_mm[..., None, :]
        return moved

    def inverse(self) -> "RigidMotion":
        """Return the motion back."""
        back = np.swapaxes(self.rotation, -1, -2)
        return RigidMotion(back, -(back @ self.translation_mm[..., None])[..., 0])

    def quaternions(self) -> NDArray[np.float64]:
        """(..., 4): unit quaternions (w, x, y, z) with ``w >= 0``; see :func:`continuous` for tracks."""
        return quaternions_from_rotations(self.rotation)


def fit_rigid(points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None = None) -> RigidMotion:
    """Find the rotation and translation that best carry points onto targets.

    Parameters
    ----------
    points_mm, target_mm : (..., M, 3) array_like, mm
        Corresponding points, batches broadcast; at least 3, not on one line.
    weights : (..., M) array_like, optional
        Not negative; 0 leaves a point out, and it may then be NaN.

    Returns
    -------
    RigidMotion
        Least squares, no scale, no reflection.

    Raises
    ------
    UsageError
        If shapes do not fit, fewer than 3 points have weight, or the rotation is not determined.

    Notes
    -----
    Horn 1987, doi:10.1364/JOSAA.4.000629: the quaternion method of paper 004, "Facial motion".
    """
    points, target, weight = _checked(points_mm, target_mm, weights)
    points, centre = _centred(points, weight)
    target, target_centre = _centred(target, weight)
    s = np.swapaxes(points * weight[..., None], -1, -2) @ target
    values, vectors = np.linalg.eigh(_horn_matrix(s))
    gap = values[..., 3] - values[..., 2]
    size = np.sqrt((weight[..., None] * points**2).sum((-1, -2)) * (weight[..., None] * target**2).sum((-1, -2)))
    if (gap <= UNDETERMINED * size).any():
        raise UsageError(
            f"points: got {_first(gap <= UNDETERMINED * size)} on one line, the rotation is not determined"
        )
    rotation = rotations_from_quaternions(vectors[..., :, 3])
    return _motion(rotation, centre, target_centre)


def fit_rigid_linear(points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None = None) -> RigidMotion:
    """Like :func:`fit_rigid`, by linear equations: exact on exact data, a little more sensitive to noise.

    The translation-invariant linear method (paper 001, section 3), in the form that cannot leave the rotations: an
    unconstrained 3 x 3 matrix would shear, and mirrors a flat head band half of the time. Parameters, result and errors
    are those of :func:`fit_rigid`.
    """
    points, target, weight = _checked(points_mm, target_mm, weights)
    points, centre = _centred(points, weight)
    target, target_centre = _centred(target, weight)
    turned = points[..., None, :, :] * HALF_TURNS[:, None, :]
    total, change = target[..., None, :, :] + turned, target[..., None, :, :] - turned
    w = weight[..., None, :, None]
    # change = g x total, so sum [total]^T [total] g = sum total x change
    square = np.swapaxes(total * w, -1, -2) @ total
    normal = np.trace(square, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - square
    right = (w * np.cross(total, change)).sum(-2)
    s = np.swapaxes(points * weight[..., None], -1, -2) @ target
    values = np.asarray(np.linalg.eigvalsh(_horn_matrix(s)), dtype=np.float64)
    _refuse_line(values, points, target, weight)
    solvable = np.linalg.eigvalsh(normal)[..., 0] > UNDETERMINED * np.trace(square, axis1=-2, axis2=-1)
    gibbs = np.linalg.solve(np.where(solvable[..., None, None], normal, np.eye(3)), right[..., None])[..., 0]
    quaternion = np.concatenate([np.ones((*gibbs.shape[:-1], 1)), gibbs], axis=-1)
    rotation = rotations_from_quaternions(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True))
    miss = (w * (turned @ np.swapaxes(rotation, -1, -2) - target[..., None, :, :]) ** 2).sum((-1, -2))
    best = np.where(solvable, miss, np.inf).argmin(-1)[..., None, None, None]
    chosen = np.take_along_axis(rotation * HALF_TURNS[:, None, :], best, axis=-3)[..., 0, :, :]
    return _motion(chosen, centre, target_centre)


def fit_rigid_robust(
    points_mm: ArrayLike,
    target_mm: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    noise_mm: float = 0.5,
    steps: int = 5,
) -> tuple[RigidMotion, NDArray[np.float64]]:
    """Like :func:`fit_rigid`, trusting a point less the farther it lies off: for a slipped band, a swapped marker.

    Parameters
    ----------
    points_mm, target_mm, weights
        As :func:`fit_rigid`; with 4 points or more there is something to distrust.
    noise_mm : float
        Distance at which a point still has half its weight.
    steps : int
        Reweighted fits behind the first (Cauchy weights ``1 / (1 + (r / noise)^2)``).

    Returns
    -------
    motion : RigidMotion
    trust : (..., M) float64
        Final share of its weight that each point kept, 0..1.

    Raises
    ------
    UsageError
        As :func:`fit_rigid`, or if ``noise_mm`` is not positive.
    """
    if not noise_mm > 0:
        raise UsageError(f"noise_mm: got {noise_mm}, expected a positive length")
    points, target, weight = _checked(points_mm, target_mm, weights)
    motion = fit_rigid(points, target, weight)
    trust = np.ones_like(weight)
    for _ in range(steps):
        off = np.linalg.norm(motion.apply(points) - target, axis=-1)
        # A common scale, falling to the noise: a gross outlier in the first fit must not condemn its neighbours.
        middle = np.median(off, axis=-1, keepdims=True)
        trust = 1.0 / (1.0 + (off / np.maximum(noise_mm, middle)) ** 2)
        motion = fit_rigid(points, target, weight * trust)
    return motion, trust


def fit_template(frames_mm: ArrayLike, weights: ArrayLike | None = None, *, steps: int = 10) -> NDArray[np.float64]:
    """Mean shape of a rigid body that moves: (T, M, 3) frames -> (M, 3), in the pose of its first usable frame.

    Frames and mean shape are fitted to each other in turn (generalised Procrustes, no scale).

    Parameters
    ----------
    frames_mm : (T, M, 3) array_like, mm
    weights : (T, M) array_like, optional
        0 where a marker is missing. Frames with fewer than 3 markers are left out.

    Raises
    ------
    UsageError
        If no frame has all markers, as a first template needs one, or shapes do not fit.
    """
    frames = np.asarray(frames_mm, dtype=np.float64)
    if frames.ndim != 3 or frames.shape[-1] != 3:
        raise UsageError(f"frames_mm: got shape {frames.shape}, expected (T, M, 3)")
    weight = np.ones(frames.shape[:2]) if weights is None else np.asarray(weights, dtype=np.float64)
    complete = np.flatnonzero((weight > 0).all(axis=1))
    if not len(complete):
        raise UsageError(f"frames_mm: got {len(frames)} frames, none with all {frames.shape[1]} markers")
    first = template = frames[complete[0]]
    usable = (weight > 0).sum(axis=1) >= MIN_POINTS
    frames, weight = np.where(weight[..., None] > 0, frames, 0.0)[usable], weight[usable]
    for _ in range(steps):
        moved = fit_rigid(frames, template, weight).apply(frames)
        template = (weight[..., None] * moved).sum(0) / weight.sum(0)[:, None]
    return fit_rigid(template, first).apply(template)


def quaternions_from_rotations(rotation: ArrayLike) -> NDArray[np.float64]:
    """(..., 3, 3) rotations -> (..., 4) unit quaternions with ``w >= 0``; stable at half turns."""
    values, vectors = np.linalg.eigh(_horn_matrix(np.swapaxes(np.asarray(rotation, dtype=np.float64), -1, -2)))
    del values
    q = vectors[..., :, 3]
    result: NDArray[np.float64] = np.where(q[..., :1] < 0, -q, q)
    return result


def rotations_from_quaternions(quaternions: ArrayLike) -> NDArray[np.float64]:
    """(..., 4) unit quaternions (w, x, y, z) -> (..., 3, 3) rotations."""
    w, x, y, z = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def continuous(quaternions: ArrayLike) -> NDArray[np.float64]:
    """(T, 4) with signs chosen so that each lies on its forerunner's side; the first keeps its sign."""
    q = np.asarray(quaternions, dtype=np.float64)
    flips = np.where((q[1:] * q[:-1]).sum(-1) < 0, -1.0, 1.0)
    signed: NDArray[np.float64] = q * np.concatenate([np.ones(min(1, len(q))), np.cumprod(flips)])[:, None]
    return signed


def smooth_motion(
    motion: RigidMotion, rate_hz: float, cutoff_hz: float, about_mm: ArrayLike = (0.0, 0.0, 0.0)
) -> RigidMotion:
    """Low-pass a track of motions without delay: quaternions (unflipped) and the path of one point.

    Parameters
    ----------
    motion : RigidMotion
        Batch shape (T,).
    rate_hz, cutoff_hz : float
        Frame rate, and the frequency from which motion is noise: 3 to 5 Hz for a head.
    about_mm : (3,) array_like, mm
        Point whose path is filtered; the body's centroid, so that noise in the turn does not move the body.

    Raises
    ------
    UsageError
        If the batch shape is not (T,), T is below 16, or ``cutoff_hz`` is not between 0 and half the rate.
    """
    if motion.rotation.ndim != 3 or len(motion.rotation) < 16:
        raise UsageError(f"motion: got batch shape {motion.rotation.shape[:-2]}, expected (T,) with T >= 16")
    about = frozen(about_mm, "about_mm", (3,), np.float64)
    q = low_pass(continuous(motion.quaternions()), rate_hz, cutoff_hz)
    rotation = rotations_from_quaternions(q / np.linalg.norm(q, axis=-1, keepdims=True))
    path = low_pass(motion.apply(about[None])[:, 0], rate_hz, cutoff_hz)
    return RigidMotion(rotation, path - rotation @ about)


def _checked(
    points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    points, target = np.asarray(points_mm, dtype=np.float64), np.asarray(target_mm, dtype=np.float64)
    weight = np.ones(points.shape[-2:-1]) if weights is None else np.asarray(weights, dtype=np.float64)
    try:
        shape = np.broadcast_shapes(points.shape, target.shape, (*weight.shape, 3))
    except ValueError as error:
        raise UsageError(
            f"points: got shapes {points.shape}, {target.shape}, weights {weight.shape}, expected (..., M, 3), (..., M)"
        ) from error
    if points.ndim < 2 or points.shape[-2:] != target.shape[-2:] or points.shape[-1] != 3:
        raise UsageError(f"points: got shapes {points.shape} and {target.shape}, expected (..., M, 3)")
    if not (weight >= 0).all():
        raise UsageError("weights: got a negative or undefined number, expected 0 or more")
    weight = np.broadcast_to(weight, shape[:-1])
    few = (weight > 0).sum(-1) < MIN_POINTS
    if few.any():
        raise UsageError(f"points: got fewer than {MIN_POINTS} with weight in {_first(few)}")
    points = np.where(weight[..., None] > 0, points, 0.0)
    target = np.where(weight[..., None] > 0, target, 0.0)
    bad = ~(np.isfinite(points) & np.isfinite(target)).all((-1, -2))
    if bad.any():
        raise UsageError(f"points: got a number that is not finite in {_first(bad)}, expected weight 0 for it")
    return points, target, weight


def _refuse_line(
    eigenvalues: NDArray[np.float64],
    points: NDArray[np.float64],
    target: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> None:
    """Refuse where the two largest eigenvalues of Horn's matrix are one: a whole circle of turns fits equally well."""
    size = np.sqrt((weight[..., None] * points**2).sum((-1, -2)) * (weight[..., None] * target**2).sum((-1, -2)))
    bad = eigenvalues[..., 3] - eigenvalues[..., 2] <= UNDETERMINED * size
    if bad.any():
        raise UsageError(f"points: got {_first(bad)} on one line, the rotation is not determined")


def _first(bad: ArrayLike) -> str:
    """Name the first bad batch element."""
    return "the points" if np.ndim(bad) == 0 else f"element {tuple(np.argwhere(bad)[0].tolist())}"


def _centred(
    points: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    centre = (weight[..., None, :] @ points)[..., 0, :] / weight.sum(-1)[..., None]
    return points - centre[..., None, :], centre


def _horn_matrix(s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Horn's symmetric matrix of ``s[..., a, b] = sum point[a] * target[b]``: (..., 3, 3) -> (..., 4, 4)."""
    n = np.empty((*s.shape[:-2], 4, 4))
    trace = np.trace(s, axis1=-2, axis2=-1)
    n[..., 0, 0] = trace
    for row, (a, b) in enumerate(((1, 2), (2, 0), (0, 1)), start=1):
        n[..., 0, row] = n[..., row, 0] = s[..., a, b] - s[..., b, a]
    n[..., 1:, 1:] = s + np.swapaxes(s, -1, -2)
    for axis in range(3):
        n[..., axis + 1, axis + 1] -= trace
    return n


def _motion(
    rotation: NDArray[np.float64], centre: NDArray[np.float64], target_centre: NDArray[np.float64]
) -> RigidMotion:
    return RigidMotion(rotation, target_centre - (rotation @ centre[..., None])[..., 0])
