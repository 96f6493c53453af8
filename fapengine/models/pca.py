"""Principal components of displacements, in a canonical order and sign.

Paper 001 (Kshirsagar, Molet, Magnenat-Thalmann), section 4.1: the eigenvectors of the covariance matrix.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Result of :func:`fit_components`. Arrays are read-only."""

    mean: NDArray[np.float64]
    """(D,)."""
    vectors: NDArray[np.float64]
    """(K, D), orthonormal rows, by falling variance; in each the entry of largest magnitude is positive."""
    variances: NDArray[np.float64]
    """(K,), in squared units of the data."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", frozen(self.mean, "mean", ("D",), np.float64))
        object.__setattr__(self, "vectors", frozen(self.vectors, "vectors", ("K", "D"), np.float64))
        object.__setattr__(self, "variances", frozen(self.variances, "variances", ("K",), np.float64))

    def share(self) -> NDArray[np.float64]:
        """(K,): variance carried by the first 1, 2, ... K components, as a share of the whole."""
        shares: NDArray[np.float64] = np.cumsum(self.variances) / self.variances.sum()
        return shares


def fit_components(frames: ArrayLike) -> Components:
    """All principal components of ``frames``.

    Parameters
    ----------
    frames : (T, D) array_like
        At least two frames.

    Raises
    ------
    UsageError
        For fewer than two frames, or numbers that are not finite.

    Examples
    --------
    >>> fit_components([[0.0, 0.0], [2.0, 2.0]]).vectors[0].round(3)
    array([0.707, 0.707])
    """
    data = frozen(frames, "frames", ("T", "D"), np.float64)
    if len(data) < 2:
        raise UsageError(f"frames: got {len(data)}, expected at least 2")
    mean = data.mean(axis=0)
    centred = data - mean
    variances, vectors = np.linalg.eigh(centred.T @ centred / len(data))
    rows = vectors.T[::-1]
    signs = np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)])
    return Components(mean, rows * signs[:, None], np.maximum(variances[::-1], 0.0))
