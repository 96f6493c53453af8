"""The expression and viseme space: paper 001 (Kshirsagar, Molet, Magnenat-Thalmann), sections 4 and 5.

Theory of operation
-------------------
A frame of M = 14 markers is a 42-vector ``d`` of displacements from the speaker's rest face. The eigenvectors of the
covariance of all frames are the rows of ``T``; ``e = T d`` (equation 2) is the frame's point in the space and
``d = Tt e`` (equation 3) leads back. The origin is the rest face, because ``d`` is. The first K rows are kept.

Feature points that are not among the markers (the inner lips) follow by least squares from the markers' modes, so that
every mode moves them too. Phones and expressions are points in the space.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.models.pca import fit_components

MARKERS = (*(f"8.{n}" for n in range(1, 9)), "2.10", "2.1", *(f"5.{n}" for n in range(1, 5)))
"""The paper's 14 markers: eight on the outer lips, two on the chin, four on the cheeks (section 3, figure 2)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VisemeSpace:
    """K directions of face motion, and how each moves the feature points. Arrays are read-only."""

    points: tuple[str, ...]
    """Names of the P feature points: the markers first, then those that follow them."""
    marker_count: int
    """Number of ``points`` that are markers."""
    modes_mm: NDArray[np.float64]
    """(K, P, 3), mm per unit weight. Over the markers the rows are orthonormal."""

    def __post_init__(self) -> None:
        shape = ("K", len(self.points), 3)
        object.__setattr__(self, "modes_mm", frozen(self.modes_mm, "modes_mm", shape, np.float64))
        if not 0 < self.marker_count <= len(self.points):
            raise UsageError(f"marker_count: got {self.marker_count}, expected 1..{len(self.points)}")

    @property
    def mode_count(self) -> int:
        """K."""
        return len(self.modes_mm)

    def to_space(self, markers_mm: ArrayLike) -> NDArray[np.float64]:
        """Weights of marker displacements, equation 2: (..., markers, 3) mm -> (..., K)."""
        d = frozen(markers_mm, "markers_mm", ("...", self.marker_count, 3), np.float64)
        modes = self.modes_mm[:, : self.marker_count].reshape(self.mode_count, -1)
        weights: NDArray[np.float64] = d.reshape(*d.shape[:-2], -1) @ modes.T
        return weights

    def to_points_mm(self, weights: ArrayLike) -> NDArray[np.float64]:
        """Displacements of all points, equation 3: (..., K) -> (..., P, 3) mm."""
        e = frozen(weights, "weights", ("...", self.mode_count), np.float64)
        flat = e @ self.modes_mm.reshape(self.mode_count, -1)
        return flat.reshape(*e.shape[:-1], len(self.points), 3)


def fit_viseme_space(
    markers_mm: ArrayLike,
    markers: Sequence[str],
    followers_mm: ArrayLike,
    followers: Sequence[str],
    *,
    mode_count: int,
) -> tuple[VisemeSpace, NDArray[np.float64]]:
    """Learn the space from fluent speech.

    Parameters
    ----------
    markers_mm : (T, M, 3) array_like, mm
        Displacements from the rest face, head motion removed.
    markers : sequence of str
        M feature point names.
    followers_mm : (T, F, 3) array_like, mm
        Displacements of points that are to follow the markers; F may be 0.
    followers : sequence of str
        F feature point names.
    mode_count : int
        K.

    Returns
    -------
    space : VisemeSpace
    share : (3M,) float64
        Variance carried by the first 1, 2, ... components.

    Raises
    ------
    UsageError
        If shapes differ or ``mode_count`` is outside 1..3M.
    """
    data = frozen(markers_mm, "markers_mm", ("T", len(markers), 3), np.float64)
    following = frozen(followers_mm, "followers_mm", (len(data), len(followers), 3), np.float64)
    if not 1 <= mode_count <= 3 * len(markers):
        raise UsageError(f"mode_count: got {mode_count}, expected 1..{3 * len(markers)}")
    flat = data.reshape(len(data), -1)
    components = fit_components(flat)
    modes = components.vectors[:mode_count]
    weights = flat @ modes.T
    follow, *_ = np.linalg.lstsq(weights, following.reshape(len(data), -1), rcond=None)
    all_modes = np.concatenate([modes, follow], axis=1).reshape(mode_count, len(markers) + len(followers), 3)
    space = VisemeSpace(points=(*markers, *followers), marker_count=len(markers), modes_mm=all_modes)
    return space, components.share()


def sample_phones(
    weights: NDArray[np.float64], rate_hz: float, starts_s: ArrayLike, ends_s: ArrayLike, fraction: float
) -> NDArray[np.float64]:
    """Points of phones at a fraction of their duration, linearly between frames: (N, K).

    Section 5.1 places the keyframe at 30 % of the phone.
    """
    start = np.asarray(starts_s, dtype=np.float64)
    times = (start + fraction * (np.asarray(ends_s) - start)) * rate_hz
    grid = np.arange(len(weights))
    return np.stack([np.interp(times, grid, column) for column in weights.T], axis=-1)
