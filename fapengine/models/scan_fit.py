"""Laying a face model of few points onto a scan: motion and weights together; paper 003, section 4.2.

Theory of operation
-------------------
Wanted are the rigid motion and the weights ``z`` for which the model's points ``R (mean + sum z_k u_k) + t`` lie on the
scan. Each step pairs every point with its closest place on the scan and solves one linear system (Gauss-Newton) for all
unknowns at once, minimising

    sum_i w_i (n_i . off_i)^2 / noise^2  +  sum_landmarks |off|^2 / landmark_noise^2  +  |z|^2.

* Distances are taken along the scan's normal, so that points may slide while the motion is still wrong.
* Sliding leaves no trace in the surface residual: half a millimetre of it can hide seven along the skin. The landmarks
  stop it, and ``|z|^2``, the modes' own distribution, keeps faces plausible where the scan has holes.
* Points that pair with the rim of a hole, or lie far off, lose their weight (Tukey's, with a scale from the median).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from fapengine._arrays import frozen
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion, fit_rigid
from fapengine.geometry.surface import Surface
from fapengine.models.missing import GapModel

MIN_LANDMARKS = 3
"""Landmarks to start from; six or more hold the fit (see the theory of operation)."""
TUKEY = 4.685
SETTLED_MM = 1e-4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanFit:
    """Where a scan lies, and which face of the model it shows. Arrays are read-only."""

    scan_from_model: RigidMotion
    scores: NDArray[np.float64]
    """(K,): weights, in the modes' standard deviations."""
    points_mm: NDArray[np.float64]
    """(M, 3): the model's points, in the scan's space."""
    trust: NDArray[np.float64]
    """(M,): final weight of each pairing, 0..1."""
    surface_rms_mm: float
    """Root mean square of the trusted points' distances along the normal. Says nothing about sliding."""
    landmark_rms_mm: float
    """Root mean square of the distances to the landmarks: the one to look at."""
    steps: int
    settled: bool
    """The last step moved no point by more than 0.1 um; false: the limit of steps came first."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "scores", frozen(self.scores, "scores", ("K",), np.float64))
        object.__setattr__(self, "points_mm", frozen(self.points_mm, "points_mm", ("M", 3), np.float64))
        object.__setattr__(self, "trust", frozen(self.trust, "trust", (len(self.points_mm),), np.float64))


def fit_scan(
    model: GapModel,
    scan: Surface,
    landmarks: ArrayLike,
    landmarks_mm: ArrayLike,
    *,
    noise_mm: float = 0.5,
    landmark_noise_mm: float = 1.0,
    max_steps: int = 40,
) -> ScanFit:
    """Find motion and weights that lay ``model`` onto ``scan``.

    Parameters
    ----------
    model : GapModel
    scan : Surface
        In any pose.
    landmarks : (L,) array_like of int
        Points of the model that were found on the scan; at least 3, not on one line, better 6 and spread.
    landmarks_mm : (L, 3) array_like, mm
        Where they were found.
    noise_mm, landmark_noise_mm : float
        Standard deviations of the scan's surface (the model's own noise adds) and of the landmarks.
    max_steps : int

    Raises
    ------
    UsageError
        If there are too few landmarks, they lie on one line, one names no point, or a deviation is not positive.
    DataError
        If fewer points than unknowns find a trusted place: the scan does not show this face.
    """
    marks = np.asarray(landmarks, dtype=np.intp)
    mark_points = frozen(landmarks_mm, "landmarks_mm", (len(marks), 3), np.float64)
    count = len(model.mean_mm)
    if len(marks) < MIN_LANDMARKS or len(set(marks.tolist())) < len(marks) or marks.min() < 0 or marks.max() >= count:
        raise UsageError(
            f"landmarks: got {marks.tolist()}, expected at least {MIN_LANDMARKS} different points 0..{count - 1}"
        )
    if not (noise_mm > 0 and landmark_noise_mm > 0):
        raise UsageError(f"noise_mm, landmark_noise_mm: got {noise_mm}, {landmark_noise_mm}, expected positive lengths")
    noise = np.hypot(noise_mm, model.noise_mm)
    motion = fit_rigid(model.mean_mm[marks], mark_points)
    scores = np.zeros(len(model.modes_mm))
    points, steps, settled = motion.apply(model.mean_mm), 0, False
    while steps < max_steps and not settled:
        pairs = _pair(points, scan, noise)
        motion, scores = _step(model, motion, scores, pairs, marks, mark_points, noise, landmark_noise_mm)
        before, points = points, motion.apply(model.rebuild(scores))
        steps, settled = steps + 1, bool(np.abs(points - before).max() < SETTLED_MM)
    pairs = _pair(points, scan, noise)
    off = ((points - pairs.places) * pairs.normals).sum(-1)
    return ScanFit(
        scan_from_model=motion,
        scores=scores,
        points_mm=points,
        trust=pairs.trust,
        surface_rms_mm=float(np.sqrt((pairs.trust * off**2).sum() / pairs.trust.sum())),
        landmark_rms_mm=float(np.sqrt(((points[marks] - mark_points) ** 2).sum(-1).mean())),
        steps=steps,
        settled=settled,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    places: NDArray[np.float64]  # (M, 3)
    normals: NDArray[np.float64]  # (M, 3)
    trust: NDArray[np.float64]  # (M,)


def _pair(points: NDArray[np.float64], scan: Surface, noise: float) -> _Pairs:
    places, normals, on_rim = scan.closest(points)
    distance = np.linalg.norm(points - places, axis=1)
    scale = max(1.4826 * float(np.median(distance[~on_rim])) if (~on_rim).any() else 0.0, noise)
    trust = np.where(on_rim, 0.0, np.maximum(1.0 - (distance / (TUKEY * scale)) ** 2, 0.0) ** 2)
    return _Pairs(places, normals, trust)


def _step(
    model: GapModel,
    motion: RigidMotion,
    scores: NDArray[np.float64],
    pairs: _Pairs,
    marks: NDArray[np.intp],
    mark_points: NDArray[np.float64],
    noise: float,
    landmark_noise: float,
) -> tuple[RigidMotion, NDArray[np.float64]]:
    """One Gauss-Newton step in (turn about the centroid, shift, weights)."""
    unknowns = 6 + len(scores)
    if (pairs.trust > 0).sum() + 3 * len(marks) < unknowns:
        raise DataError(
            f"scan: got {(pairs.trust > 0).sum()} points that find it, expected at least {unknowns - 3 * len(marks)}"
        )
    points = motion.apply(model.rebuild(scores))
    centre = points.mean(axis=0)
    arms = points - centre
    modes = np.einsum("ab,kmb->mak", motion.rotation, model.modes_mm)  # (M, 3, K)
    turn = np.zeros((len(points), 3, 3))  # d point / d turn = -[arm]x
    turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = arms[:, 2], -arms[:, 1], arms[:, 0]
    turn -= np.swapaxes(turn, 1, 2)
    jacobian = np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape), modes], axis=2)
    weight = np.sqrt(pairs.trust) / noise
    rows = weight[:, None] * np.einsum("ma,mau->mu", pairs.normals, jacobian)
    left = weight * ((points - pairs.places) * pairs.normals).sum(-1)
    mark_rows = jacobian[marks].reshape(-1, unknowns) / landmark_noise
    mark_left = (points[marks] - mark_points).ravel() / landmark_noise
    normal = rows.T @ rows + mark_rows.T @ mark_rows
    right = rows.T @ left + mark_rows.T @ mark_left
    normal[range(6, unknowns), range(6, unknowns)] += 1.0
    right[6:] += scores
    change = -np.linalg.solve(normal, right)
    rotation = Rotation.from_rotvec(change[:3]).as_matrix()
    shift = rotation @ (motion.translation_mm - centre) + centre + change[3:6]
    return RigidMotion(rotation @ motion.rotation, shift), scores + change[6:]
