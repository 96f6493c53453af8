"""From a few markers to a dense face, linearly: paper 004 (Kuratate, Yehia, Vatikiotis-Bateson), equations 1 to 15.

Theory of operation
-------------------
``F`` holds S faces as columns, ``P`` their markers, both without their means. The left singular vectors ``U`` of
``F`` are the modes; ``a = U^T F`` are the faces' coefficients (equation 7). ``a = A P`` is solved for ``A`` by least
squares and a new face is ``mean + U A (p - mean p)`` (equation 15).

Equation 12, ``A = a P^T (P P^T)^-1``, cannot be computed from eight scans: ``P P^T`` is 54 x 54 and of rank 7
(computed all the same, it answers 53 mm off, without an exception). Of all ``A`` that satisfy ``A P = a`` the pseudo-
inverse is the shortest: marker motion that no scan has shown moves nothing. Markers that carry noise, or come from
another instrument than the scans, want more: with ``noise_mm`` the estimator is ``A = a P^T (P P^T + S noise^2
I)^-1``, the minimum of the expected error, which trusts a direction by how far the scans moved in it.

Where many frames have markers and a dense face both (a rig's weights, a scanner's video),
:func:`fit_estimator_to_motion` learns from them all; ``P P^T`` then has full rank.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, UsageError

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest are rounding."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinearEstimator:
    """Markers to modes to faces. Arrays are read-only."""

    mean_markers_mm: NDArray[np.float64]
    """(M, 3); of the neutral scan if the modes run through that."""
    mean_face_mm: NDArray[np.float64]
    """(V, 3)."""
    modes: NDArray[np.float64]
    """(K, V, 3): orthonormal rows ``U^T``; in each the entry of largest magnitude is positive."""
    variances: NDArray[np.float64]
    """(K,), mm^2: of the training faces along each mode, falling."""
    matrix: NDArray[np.float64]
    """(K, 3M): ``A``, mm of a mode for each mm of a marker coordinate."""

    def __post_init__(self) -> None:
        for field, shape in (("mean_markers_mm", ("M", 3)), ("mean_face_mm", ("V", 3)), ("variances", ("K",))):
            object.__setattr__(self, field, frozen(getattr(self, field), field, shape, np.float64))
        count = len(self.variances)
        object.__setattr__(self, "modes", frozen(self.modes, "modes", (count, len(self.mean_face_mm), 3), np.float64))
        size = self.mean_markers_mm.size
        object.__setattr__(self, "matrix", frozen(self.matrix, "matrix", (count, size), np.float64))

    def coefficients(self, markers_mm: ArrayLike) -> NDArray[np.float64]:
        """Equation 11: (..., M, 3) mm -> (..., K) mm."""
        markers = frozen(markers_mm, "markers_mm", ("...", len(self.mean_markers_mm), 3), np.float64)
        off = (markers - self.mean_markers_mm).reshape(*markers.shape[:-2], -1)
        displacement: NDArray[np.float64] = off @ self.matrix.T
        return displacement

    def faces_mm(self, markers_mm: ArrayLike) -> NDArray[np.float64]:
        """Equation 15: (..., M, 3) mm -> (..., V, 3) mm."""
        return self.mean_face_mm + np.tensordot(self.coefficients(markers_mm), self.modes, axes=1)


def fit_estimator(
    scans_mm: ArrayLike,
    markers_mm: ArrayLike,
    *,
    mode_count: int | None = None,
    noise_mm: float = 0.0,
    about: int | None = None,
) -> LinearEstimator:
    """Learn from a few scans, as the paper does.

    Parameters
    ----------
    scans_mm : (S, V, 3) array_like, mm
        At least 2 faces, vertices in correspondence, head motion removed.
    markers_mm : (S, M, 3) array_like, mm
        Marker places in the same postures: vertices of the scans, or better the recording's own markers.
    mode_count : int, optional
        K; without it all that the scans span, at most S - 1.
    noise_mm : float
        Standard deviation of a marker coordinate against the scans; see the theory of operation.
    about : int, optional
        A scan, such as the neutral one, through which the modes shall run; without it they run through the mean, as in
        the paper.

    Raises
    ------
    DataError
        If all scans are the same face.
    UsageError
        If shapes differ, there are fewer than 2 scans, K exceeds what they span, or the noise is negative.
    """
    scans = frozen(scans_mm, "scans_mm", ("S", "V", 3), np.float64)
    markers = frozen(markers_mm, "markers_mm", (len(scans), "M", 3), np.float64)
    if len(scans) < 2:
        raise UsageError(f"scans_mm: got {len(scans)} scan, expected at least 2")
    if about is None:
        mean_face, mean_markers = scans.mean(axis=0), markers.mean(axis=0)
    else:
        mean_face, mean_markers = scans[about], markers[about]
    left, lengths, rows = np.linalg.svd((scans - mean_face).reshape(len(scans), -1), full_matrices=False)
    count = _spanned(lengths, mode_count)
    coefficients = (left * lengths)[:, :count]
    matrix = _solve((markers - mean_markers).reshape(len(scans), -1), coefficients, noise_mm)
    modes, signs = _signed(rows[:count])
    return LinearEstimator(
        mean_markers_mm=mean_markers,
        mean_face_mm=mean_face,
        modes=modes.reshape(count, -1, 3),
        variances=lengths[:count] ** 2 / len(scans),
        matrix=signs[:, None] * matrix,
    )


def fit_estimator_to_motion(
    markers_mm: ArrayLike,
    weights: ArrayLike,
    fields_mm: ArrayLike,
    rest_mm: ArrayLike,
    *,
    mode_count: int,
    noise_mm: float = 0.0,
) -> LinearEstimator:
    """Learn from all frames of a recording whose dense faces are ``rest + weights @ fields``.

    The faces themselves are never formed: with ``fields = R^T Q``, ``Q`` orthonormal, their PCA is that of
    ``weights @ R^T``.

    Parameters
    ----------
    markers_mm : (T, M, 3) array_like, mm
    weights : (T, B) array_like
    fields_mm : (B, V, 3) array_like, mm
    rest_mm : (V, 3) array_like, mm
    mode_count : int
        K.
    noise_mm : float
        As in :func:`fit_estimator`.

    Raises
    ------
    DataError, UsageError
        As :func:`fit_estimator`.
    """
    values = frozen(weights, "weights", ("T", "B"), np.float64)
    fields = frozen(fields_mm, "fields_mm", (values.shape[1], "V", 3), np.float64)
    markers = frozen(markers_mm, "markers_mm", (len(values), "M", 3), np.float64)
    rest = frozen(rest_mm, "rest_mm", (fields.shape[1], 3), np.float64)
    if len(values) < 2:
        raise UsageError(f"weights: got {len(values)} frame, expected at least 2")
    q, r = np.linalg.qr(fields.reshape(len(fields), -1).T)
    mean_weights, mean_markers = values.mean(axis=0), markers.mean(axis=0)
    inner = (values - mean_weights) @ r.T
    left, lengths, rows = np.linalg.svd(inner, full_matrices=False)
    count = _spanned(lengths, mode_count)
    matrix = _solve((markers - mean_markers).reshape(len(values), -1), (left * lengths)[:, :count], noise_mm)
    modes, signs = _signed(rows[:count] @ q.T)
    return LinearEstimator(
        mean_markers_mm=mean_markers,
        mean_face_mm=rest + np.tensordot(mean_weights, fields, axes=1),
        modes=modes.reshape(count, -1, 3),
        variances=lengths[:count] ** 2 / len(values),
        matrix=signs[:, None] * matrix,
    )


def _spanned(lengths: NDArray[np.float64], mode_count: int | None) -> int:
    """Check the wanted number of modes against the singular values."""
    if not lengths[0] > 0:
        raise DataError("scans: got the same face in all, expected different postures")
    rank = int((lengths > RANK_TOLERANCE * lengths[0]).sum())
    if mode_count is None:
        return rank
    if not 1 <= mode_count <= rank:
        raise UsageError(f"mode_count: got {mode_count}, expected 1..{rank}, as many as the faces span")
    return mode_count


def _solve(p: NDArray[np.float64], a: NDArray[np.float64], noise_mm: float) -> NDArray[np.float64]:
    """(S, 3M) markers and (S, K) coefficients, both centred -> (K, 3M)."""
    if not noise_mm >= 0:
        raise UsageError(f"noise_mm: got {noise_mm}, expected 0 or more")
    left, lengths, right = np.linalg.svd(p, full_matrices=False)
    kept = lengths > RANK_TOLERANCE * max(lengths[0], np.finfo(float).tiny)
    gain = lengths[kept] / (lengths[kept] ** 2 + len(p) * noise_mm**2)
    return np.asarray((a.T @ left[:, kept] * gain) @ right[kept], dtype=np.float64)


def _signed(rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    signs = np.where(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)] < 0, -1.0, 1.0)
    return rows * signs[:, None], signs
