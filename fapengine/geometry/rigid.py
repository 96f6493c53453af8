"""Rigid motion between point sets: a closed form, a robust fit, and the mean shape of a moving body.

Theory of operation
-------------------
With both sets moved to their (weighted) centroids, translation is gone and only ``target = R @ point`` is left.
:func:`fit_rigid` maximises ``sum w target . (R @ point)`` over unit quaternions: the answer is the eigenvector of the
largest eigenvalue of Horn's symmetric 4 x 4 matrix. A unit quaternion cannot be a reflection, whatever the noise and
however flat the body. All frames are solved in one batched call.

Quaternions are ``(w, x, y, z)``. Batch axes lead everywhere.

And points in space from their images in calibrated cameras: the painted markers of paper 003, section 2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError

MIN_POINTS = 3
UNDETERMINED = 1e-9
"""Relative gap between the two largest eigenvalues below which the rotation is not unique."""
NOISE_MM = 0.5
"""Residual at which a point keeps half its weight in a robust fit."""
REWEIGHTED_FITS = 5
"""Fits after the first, with Cauchy weights ``1 / (1 + (r / noise)^2)``."""
TEMPLATE_FITS = 10
"""Fits of the frames to their mean shape, each to that of the fit before."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """Rotation and translation for each batch element: ``target = rotation @ point + translation``. Read-only."""

    rotation: Array
    """(..., 3, 3), determinant +1."""
    translation_mm: Array
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

    def apply(self, points_mm: ArrayLike) -> Array:
        """Transform (..., M, 3) points; NaN stays NaN."""
        points = np.asarray(points_mm, dtype=np.float64)
        return np.asarray(points @ np.swapaxes(self.rotation, -1, -2) + self.translation_mm[..., None, :])

    def inverse(self) -> "RigidMotion":
        """Return the inverse motion."""
        back = np.swapaxes(self.rotation, -1, -2)
        return RigidMotion(back, -(back @ self.translation_mm[..., None])[..., 0])

    def __matmul__(self, first: "RigidMotion") -> "RigidMotion":
        """Return the motion that does ``first``, then this one; batches broadcast."""
        shift = (self.rotation @ first.translation_mm[..., None])[..., 0] + self.translation_mm
        return RigidMotion(self.rotation @ first.rotation, shift)


def fit_rigid(points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None = None) -> RigidMotion:
    """Find the rotation and translation that best map points onto targets.

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
            f"points: {_first(gap <= UNDETERMINED * size)}: all on one line, so the rotation is not unique"
        )
    rotation = rotations_from_quaternions(vectors[..., :, 3])
    return RigidMotion(rotation, target_centre - (rotation @ centre[..., None])[..., 0])


def fit_rigid_robust(
    points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None = None
) -> tuple[RigidMotion, Array]:
    """Fit like :func:`fit_rigid`, but give outliers less weight: a slipped head band, a swapped marker.

    Parameters
    ----------
    points_mm, target_mm, weights
        As for :func:`fit_rigid`; outliers can be found among 4 points or more.

    Returns
    -------
    motion : RigidMotion
    trust : (..., M) float64
        Final fraction of its weight that each point kept, 0 to 1.

    Raises
    ------
    UsageError
        As :func:`fit_rigid`.
    """
    points, target, weight = _checked(points_mm, target_mm, weights)
    motion = fit_rigid(points, target, weight)
    trust = np.ones_like(weight)
    for _ in range(REWEIGHTED_FITS):
        off = np.linalg.norm(motion.apply(points) - target, axis=-1)
        # A common scale, falling to the noise: a gross outlier in the first fit must not condemn its neighbours.
        middle = np.median(off, axis=-1, keepdims=True)
        trust = 1.0 / (1.0 + (off / np.maximum(NOISE_MM, middle)) ** 2)
        motion = fit_rigid(points, target, weight * trust)
    return motion, trust


def fit_template(frames_mm: ArrayLike) -> Array:
    """Compute the mean shape of a moving rigid body, (M, 3), in the pose of its first frame.

    Frames and mean shape are fitted to each other alternately (generalised Procrustes, no scale).

    Parameters
    ----------
    frames_mm : (T, M, 3) array_like, mm
        T >= 1; every frame shows all markers.

    Raises
    ------
    UsageError
        If the shape does not fit.
    """
    frames = frozen(frames_mm, "frames_mm", ("T", "M", 3), np.float64)
    template = frames[0]
    for _ in range(TEMPLATE_FITS):
        template = fit_rigid(frames, template).apply(frames).mean(axis=0)
    return fit_rigid(template, frames[0]).apply(template)


def rotations_from_quaternions(quaternions: ArrayLike) -> Array:
    """(..., 4) unit quaternions (w, x, y, z) -> (..., 3, 3) rotations."""
    w, x, y, z = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_from_rotations(rotations: Array) -> Array:
    """(..., 3, 3) rotations -> (..., 4) unit quaternions (w, x, y, z), whose largest number is positive."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(rotations, (-2, -1), (0, 1))
    w_x, w_y, w_z, x_y, x_z, y_z = zy - yz, xz - zx, yx - xy, xy + yx, xz + zx, yz + zy
    products = [  # of the quaternion's numbers, times 4
        [1 + xx + yy + zz, w_x, w_y, w_z],
        [w_x, 1 + xx - yy - zz, x_y, x_z],
        [w_y, x_y, 1 - xx + yy - zz, y_z],
        [w_z, x_z, y_z, 1 - xx - yy + zz],
    ]
    rows = np.stack([np.stack(row, axis=-1) for row in products], axis=-2)
    largest = np.diagonal(rows, axis1=-2, axis2=-1).argmax(axis=-1)
    row = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(row / np.linalg.norm(row, axis=-1, keepdims=True))


def rotations_about(axes: str, angles_rad: ArrayLike) -> Array:
    """(..., N) rad about the N ``axes``, such as ``"YX"``, that move along -> (..., 3, 3) rotations.

    Examples
    --------
    >>> (rotations_about("YX", [np.pi / 2, 0.0]) @ [0.0, 0.0, 1.0]).round(4).tolist()
    [1.0, 0.0, 0.0]
    """
    turned = np.eye(3)
    for axis, angle in zip(axes, np.moveaxis(np.asarray(angles_rad, dtype=np.float64), -1, 0), strict=True):
        along = "XYZ".index(axis)
        first, second = (along + 1) % 3, (along + 2) % 3
        about = np.zeros((*angle.shape, 3, 3))
        about[..., along, along] = 1.0
        about[..., first, first] = about[..., second, second] = np.cos(angle)
        about[..., second, first] = np.sin(angle)
        about[..., first, second] = -np.sin(angle)
        turned = turned @ about
    return turned


def yaw_pitch_roll(rotations: Array) -> Array:
    """(..., 3, 3) rotations -> (..., 3) rad: about y, then x, then z, about axes that move along.

    Examples
    --------
    >>> yaw_pitch_roll(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])).round(4).tolist()
    [1.5708, -0.0, 0.0]
    """
    pitch = np.arcsin(np.clip(-rotations[..., 1, 2], -1.0, 1.0))
    yaw = np.arctan2(rotations[..., 0, 2], rotations[..., 2, 2])
    roll = np.arctan2(rotations[..., 1, 0], rotations[..., 1, 1])
    return np.stack([yaw, pitch, roll], axis=-1)


def _checked(points_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array, Array]:
    points, target = np.asarray(points_mm, dtype=np.float64), np.asarray(target_mm, dtype=np.float64)
    weight = np.ones(points.shape[-2:-1]) if weights is None else np.asarray(weights, dtype=np.float64)
    shapes = f"got shapes {points.shape}, {target.shape}, weights {weight.shape}, expected (..., M, 3), (..., M)"
    try:
        shape = np.broadcast_shapes(points.shape, target.shape, (*weight.shape, 3))
    except ValueError as error:
        raise UsageError(f"points: {shapes}") from error
    if points.ndim < 2 or points.shape[-2:] != target.shape[-2:] or points.shape[-1] != 3:
        raise UsageError(f"points: {shapes}")
    if not (weight >= 0).all():
        raise UsageError("weights: must be 0 or more")
    weight = np.broadcast_to(weight, shape[:-1])
    few = (weight > 0).sum(-1) < MIN_POINTS
    if few.any():
        raise UsageError(f"points: fewer than {MIN_POINTS} have weight in {_first(few)}")
    points = np.where(weight[..., None] > 0, points, 0.0)
    target = np.where(weight[..., None] > 0, target, 0.0)
    bad = ~(np.isfinite(points) & np.isfinite(target)).all((-1, -2))
    if bad.any():
        raise UsageError(f"points: must be finite where their weight is not 0; not so in {_first(bad)}")
    return points, target, weight


def _first(bad: ArrayLike) -> str:
    """Name the first bad batch element."""
    return "the points" if np.ndim(bad) == 0 else f"element {tuple(np.argwhere(bad)[0].tolist())}"


def _centred(points: Array, weight: Array) -> tuple[Array, Array]:
    centre = (weight[..., None, :] @ points)[..., 0, :] / weight.sum(-1)[..., None]
    return points - centre[..., None, :], centre


def _horn_matrix(s: Array) -> Array:
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


def triangulate(points_px: ArrayLike, cameras: ArrayLike) -> tuple[Array, Array]:
    """Find points by the linear method (DLT).

    Parameters
    ----------
    points_px : (C, T, M, 2) array_like, pixels
        Undistorted places in each of C cameras' images, NaN or infinite where one does not see a point.
    cameras : (C, 3, 4) array_like
        Projection matrices, world mm to homogeneous pixels.

    Returns
    -------
    positions_mm : (T, M, 3) float64
        NaN where fewer than two cameras see a point: a gap, as in any recording.
    residual_px : (T, M) float64
        Root mean square distance between a point's projections and its images, NaN where it has no position.

    Raises
    ------
    UsageError
        If there are fewer than two cameras, or shapes differ.

    Notes
    -----
    Hartley, Sturm: Triangulation, 1997, doi:10.1006/cviu.1997.0547, method "Linear-Eigen". Each image is first moved
    and scaled to mean 0 and deviation 1.
    """
    images = frozen(points_px, "points_px", ("C", "T", "M", 2), np.float64, finite=False)
    matrices = frozen(cameras, "cameras", (len(images), 3, 4), np.float64)
    if len(images) < 2:
        raise UsageError(f"cameras: got {len(images)}, expected at least 2")
    seen = np.isfinite(images).all(axis=-1)
    images = np.where(seen[..., None], images, np.nan)
    if not seen.any(axis=(1, 2)).all():
        raise UsageError(f"points_px: camera {int(seen.any(axis=(1, 2)).argmin())} sees no point")
    rows = []
    for image, matrix, there in zip(images, matrices, seen, strict=True):
        middle, size = image[there].mean(axis=0), max(float(image[there].std()), 1e-9)
        scaled = matrix[:2] - middle[:, None] * matrix[2]
        equations = ((image - middle) / size)[..., None] * matrix[2] - scaled / size  # (T, M, 2, 4)
        rows.append(np.where(there[..., None, None], equations, 0.0))
    system = np.concatenate(rows, axis=-2)
    system /= np.maximum(np.linalg.norm(system, axis=-1, keepdims=True), 1e-300)
    homogeneous = np.linalg.svd(system)[2][..., -1, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        positions = homogeneous[..., :3] / homogeneous[..., 3:]
        positions[seen.sum(axis=0) < 2] = np.nan
        shown = np.einsum("cij,tmj->ctmi", matrices[:, :, :3], positions) + matrices[:, None, None, :, 3]
        off = ((shown[..., :2] / shown[..., 2:] - images) ** 2).sum(axis=-1)
        residual = np.sqrt(np.where(seen, off, 0.0).sum(axis=0) / seen.sum(axis=0))
    return positions, residual
