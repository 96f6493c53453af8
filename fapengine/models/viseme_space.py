"""The expression and viseme space: paper 001 (Kshirsagar, Molet, Magnenat-Thalmann), sections 4 and 5.

Theory of operation
-------------------
A frame of M = 14 markers is a 42-vector ``d`` of displacements from the speaker's rest face. The eigenvectors of the
covariance of all frames (section 4.1), in a canonical order and sign, are the rows of ``T``; ``e = T d`` (equation 2)
is the frame's point in the space and ``d = Tt e`` (equation 3) the way back. The origin is the rest face, from which
``d`` counts. The first K rows are kept.

Feature points that are not among the markers (the inner lips) follow by least squares from the markers' modes, so that
every mode moves them too. Phones and expressions are points in the space.

Components are named by what they move (section 4.2 and figure 3), by measurement instead of by eye. Each of
:data:`MOVES` is a displacement of feature points in articulation. A component gets the name of the move that it is most
parallel to, over the points that both have; below :data:`CLEAR` it is called mixed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, Rebuilt, freeze, frozen
from fapengine.errors import UsageError


def fit_components(frames: ArrayLike) -> tuple[Array, Array]:
    """All principal components of ``frames``.

    Parameters
    ----------
    frames : (T, D) array_like
        At least two frames.

    Returns
    -------
    vectors : (K, D) float64
        Orthonormal rows, by falling variance; in each the entry of largest magnitude is positive.
    variances : (K,) float64
        In squared units of the data.

    Examples
    --------
    >>> fit_components([[0.0, 0.0], [2.0, 2.0]])[0][0].round(3)
    array([0.707, 0.707])
    """
    data = frozen(frames, "frames", ("T", "D"), np.float64)
    if len(data) < 2:
        raise UsageError(f"frames: needs at least 2, got {len(data)}")
    centred = data - data.mean(axis=0)
    variances, vectors = np.linalg.eigh(centred.T @ centred / len(data))
    rows = vectors.T[::-1]
    return rows * signs(rows)[:, None], np.maximum(variances[::-1], 0.0)


def signs(rows: Array) -> Array:
    """(K,): 1 or -1 for each row, (K, D), so that its entry of largest magnitude becomes positive."""
    return np.where(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)] < 0, -1.0, 1.0)


MARKERS = (*(f"8.{n}" for n in range(1, 9)), "2.10", "2.1", *(f"5.{n}" for n in range(1, 5)))
"""The paper's 14 markers: eight on the outer lips, two on the chin, four on the cheeks (section 3, figure 2)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VisemeSpace(Rebuilt):
    """K directions of face motion, and how each moves the feature points. Arrays are read-only."""

    points: tuple[str, ...]
    """Names of the P feature points: the markers first, then those that follow them."""
    marker_count: int
    """Number of ``points`` that are markers."""
    modes_mm: Array
    """(K, P, 3), mm per unit weight. Over the markers the rows are orthonormal."""

    def __post_init__(self) -> None:
        freeze(self, modes_mm=("K", len(self.points), 3))
        if not 0 < self.marker_count <= len(self.points):
            raise UsageError(f"marker_count: must be 1 to {len(self.points)}, got {self.marker_count}")

    @property
    def mode_count(self) -> int:
        """K."""
        return len(self.modes_mm)

    @property
    def markers(self) -> tuple[str, ...]:
        """Those of ``points`` that are markers."""
        return self.points[: self.marker_count]

    def to_space(self, markers_mm: ArrayLike) -> Array:
        """Weights of marker displacements, equation 2: (..., markers, 3) mm -> (..., K)."""
        d = frozen(markers_mm, "markers_mm", ("...", self.marker_count, 3), np.float64)
        modes = self.modes_mm[:, : self.marker_count].reshape(self.mode_count, -1)
        return np.asarray(d.reshape(*d.shape[:-2], -1) @ modes.T)

    def to_points_mm(self, weights: ArrayLike) -> Array:
        """Displacements of all points, equation 3: (..., K) -> (..., P, 3) mm."""
        e = frozen(weights, "weights", ("...", self.mode_count), np.float64)
        flat = e @ self.modes_mm.reshape(self.mode_count, -1)
        return flat.reshape(*e.shape[:-1], len(self.points), 3)


def fit_viseme_space(
    markers_mm: ArrayLike, markers: Sequence[str], followers_mm: ArrayLike, followers: Sequence[str], *, mode_count: int
) -> tuple[VisemeSpace, Array]:
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
    """
    data = frozen(markers_mm, "markers_mm", ("T", len(markers), 3), np.float64)
    following = frozen(followers_mm, "followers_mm", (len(data), len(followers), 3), np.float64)
    if not 1 <= mode_count <= 3 * len(markers):
        raise UsageError(f"mode_count: must be 1 to {3 * len(markers)}, got {mode_count}")
    flat = data.reshape(len(data), -1)
    vectors, variances = fit_components(flat)
    modes = vectors[:mode_count]
    weights = flat @ modes.T
    follow, *_ = np.linalg.lstsq(weights, following.reshape(len(data), -1), rcond=None)
    all_modes = np.concatenate([modes, follow], axis=1).reshape(mode_count, len(markers) + len(followers), 3)
    space = VisemeSpace(points=(*markers, *followers), marker_count=len(markers), modes_mm=all_modes)
    return space, np.cumsum(variances) / variances.sum()


def sample_phones(weights: Array, rate_hz: float, starts_s: ArrayLike, ends_s: ArrayLike, fraction: float) -> Array:
    """Points of phones at a fraction of their duration, linearly between frames: (N, K).

    Section 5.1 places the keyframe at 30 % of the phone.
    """
    start = np.asarray(starts_s, dtype=np.float64)
    times = (start + fraction * (np.asarray(ends_s) - start)) * rate_hz
    grid = np.arange(len(weights))
    return np.stack([np.interp(times, grid, column) for column in weights.T], axis=-1)


CLEAR = 0.5
"""|cosine| from which a component is named after a move."""

UP, DOWN, LEFT, RIGHT, OUT = (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)
_LOWER_LIP, _UPPER_LIP = ("8.2", "8.7", "8.8", "2.3", "2.8", "2.9"), ("8.1", "8.5", "8.6", "2.2", "2.6", "2.7")
_CHIN = ("2.1", "2.10")
_LIPS = ("8.1", "8.2", "8.5", "8.6", "8.7", "8.8")
_ALL = (*_LOWER_LIP, *_UPPER_LIP, "8.3", "8.4")


def _all(points: Sequence[str], direction: Sequence[float]) -> dict[str, tuple[float, ...]]:
    return dict.fromkeys(points, tuple(map(float, direction)))


MOVES: Mapping[str, Mapping[str, tuple[float, ...]]] = MappingProxyType(
    {
        "jaw opening": _all((*_LOWER_LIP, *_CHIN), DOWN) | _all(("8.3", "8.4", "2.4", "2.5"), (0, -0.5, 0)),
        "lip spreading": _all(("8.3", "2.4"), LEFT) | _all(("8.4", "2.5"), RIGHT)
        | _all(("8.5", "8.7", "5.1", "5.3"), (0.4, 0, 0)) | _all(("8.6", "8.8", "5.2", "5.4"), (-0.4, 0, 0)),
        "lip protrusion": _all(_LIPS, OUT) | _all(("8.3", "8.4"), (0, 0, 0.6)),
        "lip opening": _all(_LOWER_LIP, DOWN) | _all(_UPPER_LIP, (0, 0.6, 0)),
        "upper lip raising": _all(_UPPER_LIP, UP),
        "lower lip lowering": _all(_LOWER_LIP, DOWN),
        "corner raising": _all(("8.3", "8.4", "2.4", "2.5"), UP) | _all(("5.1", "5.2"), (0, 0.5, 0)),
        "cheek puffing": _all(("5.1", "5.2", "5.3", "5.4"), OUT),
        "mouth to one side": _all((*_ALL, *_CHIN), LEFT),
        "jaw thrust": _all((*_CHIN, "8.2", "2.3"), OUT),
        "skew": _all(("8.3", "2.4"), UP) | _all(("8.4", "2.5"), DOWN),
    }
)  # fmt: skip
"""Directions of feature points in head axes (+x the subject's left, +y up, +z out); points not listed stay."""


@dataclass(frozen=True, slots=True)
class ComponentName:
    """Name of a component, and how clearly it fits."""

    name: str
    likeness: float
    """|cosine| with the move, 0..1."""
    busiest: tuple[str, ...]
    """The three points that it moves farthest."""


def name_components(modes_mm: ArrayLike, points: Sequence[str]) -> list[ComponentName]:
    """Propose a name for each component.

    Parameters
    ----------
    modes_mm : (K, P, 3) array_like
        Displacement of P points per unit of each component; sign and length do not matter.
    points : sequence of str
        P feature point names.

    Examples
    --------
    >>> name_components([[[0, 0, 0], [0, -2, 0], [0, -2, 0]]], ("8.1", "8.2", "2.1"))[0].name
    'jaw opening'
    """
    modes = frozen(modes_mm, "modes_mm", ("K", len(points), 3), np.float64)
    names = []
    for mode in modes:
        length = float(np.linalg.norm(mode))
        best, likeness = "nothing moves", 0.0
        for name, moves in MOVES.items():
            move = np.array([moves.get(point, (0.0, 0.0, 0.0)) for point in points])
            size = float(np.linalg.norm(move)) * length
            alike = abs(float((mode * move).sum())) / size if size > 0 else 0.0
            if alike > likeness:
                best, likeness = name, alike
        order = np.argsort(-np.linalg.norm(mode, axis=1), kind="stable")[:3]
        clear = best if likeness >= CLEAR else f"mixed, most like {best}"
        names.append(ComponentName(clear, likeness, tuple(points[index] for index in order)))
    return names
