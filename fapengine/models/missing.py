"""Principal components of markers that are not always seen: paper 003 (Berger, Ponroy, Wrobel-Dautcourt), section 3.

Theory of operation
-------------------
Model: ``x_t = mean + sum_k z_tk u_k + noise``, ``z ~ N(0, I)``; of frame ``t`` only some markers are seen.

1. Start (equations 1 and 2). The PCA of the markers seen in every frame gives ``z``; each other marker's mean and modes
   follow by least squares over the frames that show it. Where too few markers are always seen, the start is the
   eigenvectors of the covariance of all pairs that are seen together.
2. EM. E: ``z_t`` from the markers seen at ``t``, ``(G_t + s^2 I) z = W^T (x - mean)`` with ``G_t`` the sum of their
   ``W_j^T W_j``; the prior keeps a frame with two markers finite. M: each marker's mean *and* modes from the frames
   that show it. A mean frozen at "seen only" is wrong wherever a marker hides because of the pose (closed lips).

All frames are solved at once: ``G_t`` is a matrix product of the masks with the ``W_j^T W_j``, the markers' normal
matrices are products of masks with the ``z z^T``. No loop over frames or patterns.

Filling gaps and animating need different ranks: fill at the rank that predicts hidden entries best
(:func:`choose_rank`), then reduce the filled frames by an ordinary PCA.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, Mask, freeze, frozen
from fapengine.errors import DataError, UsageError
from fapengine.models.viseme_space import signs

FEW_ALWAYS_SEEN = 0.4
"""Fraction of always-seen markers below which their PCA is a bad start."""
CHUNK = 4096
"""Frames solved in one call; bounds the memory."""
HIDDEN, RUN_FRAMES, TRIAL_STEPS = 0.1, 10, 3
"""Fraction of sightings that are hidden to choose a rank, frames of a hidden run, and EM steps of each trial."""
MIN_NOISE = 1e-10
"""Noise variance relative to the data's, at least: keeps exact low-rank data solvable."""


@dataclass(frozen=True, slots=True, eq=False)
class GapModel:
    """Mean, modes and noise learned from frames with gaps. Arrays are read-only."""

    mean_mm: Array
    """(M, 3)."""
    modes_mm: Array
    """(K, M, 3), mm per standard deviation, orthogonal, longest first; the entry of largest magnitude is positive."""
    noise_mm: float
    """Standard deviation of the residual of the modes, per coordinate."""

    def __post_init__(self) -> None:
        freeze(self, mean_mm=("M", 3), modes_mm=("K", "M", 3))

    def scores(self, frames_mm: ArrayLike, seen: ArrayLike | None = None) -> Array:
        """(T, K): most probable weights of each frame, in standard deviations; 0 where nothing is seen.

        Without ``seen``, (T, M) bool, everything is.
        """
        return self._scores(*_checked(frames_mm, np.ones(np.shape(frames_mm)[:2]) if seen is None else seen))

    def rebuild(self, scores: ArrayLike) -> Array:
        """Faces of weights: (..., K) -> (..., M, 3), mm."""
        z = frozen(scores, "scores", ("...", len(self.modes_mm)), np.float64)
        return self.mean_mm + np.tensordot(z, self.modes_mm, axes=1)

    def fill(self, frames_mm: ArrayLike, seen: ArrayLike) -> Array:
        """(T, M, 3): the frames with their gaps filled; what was seen comes back bit by bit."""
        data, mask = _checked(frames_mm, seen)
        gaps = ~mask.all(axis=0)  # only these markers need to be rebuilt
        flat = self.modes_mm[:, gaps].reshape(len(self.modes_mm), -1)
        rebuilt = (self._scores(data, mask) @ flat).reshape(len(data), -1, 3) + self.mean_mm[gaps]
        data[:, gaps] = np.where(mask[:, gaps, None], data[:, gaps], rebuilt)
        return data

    def _scores(self, data: Array, mask: Mask) -> Array:
        state = _State(np.zeros_like(self.mean_mm), self.modes_mm, self.noise_mm**2)
        z = np.empty((len(data), len(self.modes_mm)))
        for start in range(0, len(data), CHUNK):
            rows = slice(start, start + CHUNK)
            off = np.where(mask[rows, :, None], data[rows] - self.mean_mm, 0.0)
            right = _project(off, mask[rows], state)[..., None]
            z[rows] = np.linalg.solve(_normal(mask[rows], state), right)[..., 0]
        return z


def fit_gaps(
    frames_mm: ArrayLike, seen: ArrayLike, rank: int, *, tolerance_mm: float = 0.001, max_steps: int = 50
) -> GapModel:
    """Learn mean and modes from frames with gaps.

    Parameters
    ----------
    frames_mm : (T, M, 3) array_like, mm
        Values where ``seen`` is false are ignored, NaN too.
    seen : (T, M) array_like of bool
    rank : int
        K modes.
    tolerance_mm : float
        EM stops when the filled entries change by less (root mean square per coordinate).
    max_steps : int
        0 for the start alone.
    """
    data, mask = _checked(frames_mm, seen)
    if not 1 <= rank < min(len(data), 3 * data.shape[1]):
        raise UsageError(f"rank: must be 1 to {min(len(data), 3 * data.shape[1]) - 1}, got {rank}")
    sightings = mask.sum(axis=0)
    if sightings.min() < rank + 2:
        marker = int(sightings.argmin())
        raise DataError(
            f"marker: needs at least {rank + 2} sightings in {len(data)} frames for {rank} modes,"
            f" got {sightings[marker]}",
            where=f"marker {marker}",
        )
    if not np.isfinite(tolerance_mm) or tolerance_mm <= 0:
        raise UsageError(f"tolerance_mm: must be a positive length, got {tolerance_mm}")
    centre = data.sum(axis=0) / sightings[:, None]
    data -= centre
    data[~mask] = 0.0
    state = _start(data, mask, rank)
    gaps = ~mask.all(axis=0)
    before = None
    for _ in range(max_steps if gaps.any() else 0):
        expected = _expect(data, mask, state)
        filled = (state.mean[gaps] + np.tensordot(expected.z, state.modes[:, gaps], axes=1))[~mask[:, gaps]]
        if before is not None and np.sqrt(((filled - before) ** 2).mean()) < tolerance_mm:
            break
        before = filled
        state = _maximise(data, mask, expected)
    _, lengths, directions = np.linalg.svd(state.modes.reshape(rank, -1), full_matrices=False)
    modes = (lengths * signs(directions))[:, None] * directions
    return GapModel(centre + state.mean, modes.reshape(state.modes.shape), float(np.sqrt(state.noise)))


def choose_rank(
    frames_mm: ArrayLike, seen: ArrayLike, ranks: Sequence[int], *, rng: np.random.Generator
) -> tuple[int, Array]:
    """Rank that best predicts entries that were seen but are hidden from the fit.

    The residual of the fit itself falls with every rank; this one rises again when modes learn noise.

    Parameters
    ----------
    frames_mm, seen : (T, M, 3) float64, mm, and (T, M) bool
        As :func:`fit_gaps`.
    ranks : sequence of int
        Ranks to try, rising.
    rng : numpy.random.Generator
        Chooses what to hide: :data:`HIDDEN` of the sightings, in runs of one marker, as occlusion does.

    Returns
    -------
    rank : int
        Smallest one within 1 % of the least error.
    error_mm : (len(ranks),) float64
        Root mean square distance of the hidden entries.
    """
    data, mask = _checked(frames_mm, seen)
    if not len(ranks):
        raise UsageError("ranks: empty; needs at least one")
    runs = -(-len(data) // RUN_FRAMES)
    hidden = np.repeat(rng.random((runs, data.shape[1])) < HIDDEN, RUN_FRAMES, axis=0)[: len(data)] & mask
    errors = np.empty(len(ranks))
    for index, rank in enumerate(ranks):
        model = fit_gaps(data, mask & ~hidden, rank, max_steps=TRIAL_STEPS)
        off = model.rebuild(model.scores(data, mask & ~hidden))[hidden] - data[hidden]
        errors[index] = np.sqrt((off**2).sum(axis=-1).mean())
    good = errors <= 1.01 * errors.min()
    return int(ranks[int(good.argmax())]), errors


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Parameters between EM steps, relative to the centre."""

    mean: Array  # (M, 3)
    modes: Array  # (K, M, 3), prior of the weights N(0, I)
    noise: float  # mm^2 per coordinate


@dataclass(frozen=True, slots=True, eq=False)
class _Expected:
    """Posterior of the weights: means, and the sums over frames that the M step needs."""

    z: Array  # (T, K)
    normal: Array  # (M, K + 1, K + 1): sum over the frames that show j of [z 1]^T [z 1], spread included
    spread: Array  # (K, K): mean posterior covariance


def _normal(mask: Mask, state: _State) -> Array:
    """(T, K, K): ``G_t + s^2 I``."""
    by_marker = np.moveaxis(state.modes, 0, 1)
    squares, rank = by_marker @ np.swapaxes(by_marker, 1, 2), len(state.modes)  # (M, K, K): ``W_j^T W_j``
    upper = np.triu_indices(rank)
    gaps = ~mask.all(axis=0)  # only these markers differ between frames
    packed = squares[~gaps][:, *upper].sum(axis=0) + mask[:, gaps].astype(np.float64) @ squares[gaps][:, *upper]
    full = np.empty((len(mask), rank, rank))
    full[:, upper[0], upper[1]] = full[:, upper[1], upper[0]] = packed
    full[:, np.arange(rank), np.arange(rank)] += state.noise
    return full


def _project(data: Array, mask: Mask, state: _State) -> Array:
    """(T, K): ``W^T (x - mean)`` over the markers seen; ``data`` is 0 in the gaps."""
    shift = np.einsum("kja,ja->jk", state.modes, state.mean)
    flat = state.modes.reshape(len(state.modes), -1)
    return np.asarray(data.reshape(len(data), -1) @ flat.T - mask.astype(np.float64) @ shift)


def _expect(data: Array, mask: Mask, state: _State) -> _Expected:
    count, markers = mask.shape
    rank = len(state.modes)
    gaps = ~mask.all(axis=0)
    upper = np.triu_indices(rank + 1)
    z, packed, spread = np.empty((count, rank)), np.zeros((markers, len(upper[0]))), np.zeros((rank, rank))
    for start in range(0, count, CHUNK):
        rows = slice(start, start + CHUNK)
        shown = mask[rows].astype(np.float64)
        right = _project(data[rows], mask[rows], state)
        inverse = np.linalg.inv(_normal(mask[rows], state))
        z[rows] = (inverse @ right[..., None])[..., 0]
        spread += state.noise * inverse.sum(axis=0)
        moments = np.ones((len(shown), rank + 1, rank + 1))
        moments[:, :rank, :rank] = z[rows, :, None] * z[rows, None, :] + state.noise * inverse
        moments[:, :rank, rank] = z[rows]
        product = moments[:, *upper]
        packed[~gaps] += product.sum(axis=0)
        packed[gaps] += shown[:, gaps].T @ product
    normal = np.empty((markers, rank + 1, rank + 1))
    normal[:, upper[0], upper[1]] = normal[:, upper[1], upper[0]] = packed
    return _Expected(z, normal, spread / count)


def _maximise(data: Array, mask: Mask, expected: _Expected) -> _State:
    """Each marker's modes and mean from the frames that show it; weights back to N(0, I)."""
    count = len(mask)
    right = np.concatenate([np.tensordot(expected.z, data, axes=(0, 0)), data.sum(axis=0)[None]])
    right = np.moveaxis(right, 0, 1)  # (M, K + 1, 3)
    normal = expected.normal.copy()
    small = 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None]
    normal[:, np.arange(normal.shape[1]), np.arange(normal.shape[1])] += small
    solved = np.linalg.solve(normal, right)
    power = float(np.vdot(data, data))
    noise = max((power - float(np.vdot(solved, right))) / (3 * mask.sum()), MIN_NOISE * power / (3 * mask.sum()))
    modes, mean = np.moveaxis(solved[:, :-1], 1, 0), solved[:, -1]
    centre = expected.z.mean(axis=0)
    off = expected.z - centre
    covariance = off.T @ off / count + expected.spread
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return _State(mean + np.tensordot(centre, modes, axes=1), np.tensordot(root.T, modes, axes=1), noise)


def _start(data: Array, mask: Mask, rank: int) -> _State:
    """Step 1 of the theory of operation."""
    always, flat = mask.all(axis=0), data.reshape(len(data), -1)
    if always.mean() >= FEW_ALWAYS_SEEN and 3 * always.sum() >= 2 * rank:
        shown = np.repeat(always, 3)
        vectors = np.zeros((len(shown), rank))
        vectors[shown] = _largest((flat.T @ flat / len(data))[np.ix_(shown, shown)], rank)[1]
        z = flat @ vectors
        z /= np.maximum(z.std(axis=0), np.finfo(float).tiny)
        ones = np.concatenate([z, np.ones((len(z), 1))], axis=1)
        gaps = np.flatnonzero(~always)
        normal = np.broadcast_to(ones.T @ ones, (mask.shape[1], rank + 1, rank + 1)).copy()
        for marker in gaps:
            seen = ones[mask[:, marker]]
            normal[marker] = seen.T @ seen
        return _maximise(data, mask, _Expected(z, normal, np.zeros((rank, rank))))
    together = mask.astype(np.float64).T @ mask
    pairs = np.maximum(np.repeat(np.repeat(together, 3, axis=0), 3, axis=1), 1.0)
    covariance = flat.T @ flat / pairs
    values, vectors = _largest(covariance, rank)
    noise = max(float(np.trace(covariance) - values.sum()) / len(covariance), MIN_NOISE * float(np.trace(covariance)))
    modes = (vectors * np.sqrt(np.maximum(values, 0.0))).T.reshape(rank, -1, 3)
    return _State(np.zeros(data.shape[1:]), modes, noise)


def _largest(matrix: Array, count: int) -> tuple[Array, Array]:
    """Largest eigenvalues, falling, and their vectors as columns."""
    values, vectors = np.linalg.eigh(matrix)
    return values[::-1][:count], vectors[:, ::-1][:, :count]


def _checked(frames_mm: ArrayLike, seen: ArrayLike) -> tuple[Array, Mask]:
    """Copy of the frames with zeros in their gaps, and the mask."""
    frames = np.asarray(frames_mm, dtype=np.float64)
    mask = np.asarray(seen, dtype=bool)
    if frames.ndim != 3 or frames.shape[2] != 3 or mask.shape != frames.shape[:2]:
        raise UsageError(f"frames_mm: got shapes {frames.shape} and {mask.shape}, expected (T, M, 3) and (T, M)")
    data = frames.copy()
    data[~mask] = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        total = data.sum()  # quicker than asking each number
    if not np.isfinite(total) and not np.isfinite(data).all():
        frame, marker, _ = np.argwhere(~np.isfinite(data))[0].tolist()
        raise DataError("marker: seen, but got a number that is not finite", where=f"frame {frame}, marker {marker}")
    return data, mask
