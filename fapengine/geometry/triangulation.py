"""Points in space from their images in two or more calibrated cameras: the painted markers of paper 003, section 2."""

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError


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
