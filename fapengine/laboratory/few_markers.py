"""A face moved by a few of its markers: paper 000, section 5.

The k markers, chosen by QR with column pivoting or by the laboratory, drive all others by one weight each, and any
other point of the face by cubic interpolation of the weights. Displacements count from the rest position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices, Mask
from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import fit_rigid
from fapengine.laboratory.marker_driver import HeadReference
from fapengine.models.missing import fit_gaps
from fapengine.models.subset import MarkerSubset, factorise_gram, fit_weights, gram, search_swaps, select
from fapengine.models.subset_study import error_curve, interpolate_flat, interpolate_regions

MAX_K = 15
PIECES, FOLDS = 12, 6
"""Largest number of parts of a recording that are left out for the error curve, and number of folds."""
MAX_CANDIDATES = 300
"""Largest number of points to choose markers from, spread over the face; a mesh has thousands."""
GAP_RANK = 8
MIN_NAMED = 4
"""Feature points among the markers that give the pose of the face."""


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The driving markers, and the reason for their number."""

    subset: MarkerSubset
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class FaceGrid:
    """A surface that the markers move. Arrays are read-only by convention of their makers."""

    rest_mm: Array
    """(N, 3)."""
    triangles: Indices
    """(F, 3), counter-clockwise seen from outside."""
    weights: Array
    """(k, N): of each driving marker."""


def displacements(track: MarkerTrack, labels: Sequence[str], reference: HeadReference) -> tuple[Array, Array]:
    """Rest position, (M, 3), and displacements from it, (T, M, 3) mm, without head motion, gaps filled.

    The rest position is the first, as in the paper: that in the first frame that shows the marker.
    """
    still, _ = reference.hold(track, track.select(labels))
    seen: Mask = np.logical_not(np.isnan(still[..., 0]))
    never = [labels[int(index)] for index in np.flatnonzero(~seen.any(axis=0))]
    if never:
        raise DataError(f"markers: no frame shows {', '.join(never[:6])}")
    if not seen.all():
        rank = min(GAP_RANK, 3 * len(labels) - 1, int(seen.sum(axis=0).min()) - 2, len(still) - 1)
        if rank < 1:
            raise DataError("markers: too few frames to fill gaps, requires each marker in three or more")
        still = fit_gaps(still, seen, rank).fill(still, seen)
    first = seen.argmax(axis=0)
    rest = still[first, np.arange(len(first))]
    return rest, still - rest


def choose_markers(
    takes_mm: Sequence[Array],
    rest_mm: Array,
    wanted: int | Sequence[int] | None,
    *,
    tolerance_mm: float,
    rng: np.random.Generator,
) -> Choice:
    """Choose the driving markers, and fit their weights.

    Parameters
    ----------
    takes_mm : sequence of (T, M, 3) mm
        Displacements of the takes to learn from.
    rest_mm : (M, 3) mm
    wanted : int or sequence of int, optional
        Their number (QR with swaps chooses them), or themselves; by default the cross-validated error sets the number.
    tolerance_mm : float
        Mean error that the choice of their number may leave.
    """
    count = len(rest_mm)
    spread = spread_out(rest_mm, MAX_CANDIDATES, [0]) if count > MAX_CANDIDATES else np.arange(count)
    candidates = [take[:, spread] for take in takes_mm]
    square = np.sum([gram(take) for take in candidates], axis=0)
    if isinstance(wanted, Sequence):
        chosen, reason = np.array(wanted, np.intp), "asked for"
    else:
        factor = factorise_gram(square)
        k, reason = wanted, "asked for"
        if k is None:
            parts = candidates
            if len(parts) == 1:
                parts = np.array_split(parts[0], min(PIECES, max(2, len(parts[0]) // PIECES)))
            sizes = range(1, min(MAX_K, len(spread) - 1, factor.rank()) + 1)
            k, reason = error_curve(parts, sizes, folds=min(FOLDS, len(parts)), rng=rng).choose_within(tolerance_mm)
        if not 1 <= k < len(spread):
            raise UsageError(f"markers: must be 1 to {len(spread) - 1} (fewer than the face has), got {k}")
        chosen = spread[search_swaps(square, select(factor, k)).primary]
    return Choice(fit_weights(square, chosen) if len(spread) == count else _weights_of_all(takes_mm, chosen), reason)


def edit(
    driving_mm: Array,
    names: Sequence[str],
    rate_hz: float,
    *,
    scale: Mapping[str, float] | None = None,
    delay_s: Mapping[str, float] | None = None,
) -> Array:
    """Scale or delay single driving markers, as experiments on perception do.

    Raises UsageError if a marker does not drive the face.

    Parameters
    ----------
    driving_mm : (T, k, 3) mm
        Displacements from rest.
    names : sequence of str
        (k,).
    scale : mapping of str to float, optional
        Factor of a marker's displacement; 0 removes its motion.
    delay_s : mapping of str to float, optional
        A marker repeats its motion so much later, negative: earlier; its first or last position fills the rest.
    """
    edited, frames = driving_mm.copy(), np.arange(len(driving_mm), dtype=np.float64)
    for option, values in (("scale", scale or {}), ("delay", delay_s or {})):
        for name, value in values.items():
            if name not in names:
                raise UsageError(f"{option}: {name!r} does not drive the face; use one of {', '.join(names)}")
            column = edited[:, names.index(name)]
            if option == "scale":
                column *= value
            else:
                at = frames - value * rate_hz
                column[:] = np.stack([np.interp(at, frames, axis) for axis in column.T.copy()], axis=1)
    return edited


def _weights_of_all(takes_mm: Sequence[Array], chosen: NDArray[np.intp]) -> MarkerSubset:
    """Least-squares weights without the Gram matrix of all points, which may be thousands."""
    flat = np.concatenate([np.swapaxes(take, 1, 2).reshape(-1, take.shape[1]) for take in takes_mm])
    driving = flat[:, chosen]
    weights = np.asarray(np.linalg.lstsq(driving, flat, rcond=None)[0], np.float64)
    weights[:, chosen] = np.eye(len(chosen))
    return MarkerSubset(chosen, weights, float(np.linalg.norm(flat - driving @ weights)))


def spread_out(rest_mm: Array, count: int, first: list[int]) -> NDArray[np.intp]:
    """``count`` of (M, 3) points as far apart as possible, with the ``first`` ones: farthest point sampling."""
    chosen = first[:count]
    away = np.asarray(cKDTree(rest_mm[chosen]).query(rest_mm)[0])
    while len(chosen) < count:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(rest_mm - rest_mm[chosen[-1]], axis=1))
    return np.sort(chosen)


def facing(rest_mm: Array, labels: Sequence[str], face_mm: Mapping[str, Array]) -> Array:
    """(3, 3): rows of a face's axes, its left, up and out.

    Markers that are feature points of the standard are laid onto ``face_mm``, a standard face. Where too few are, up is
    +y, and out is the direction in which the face is thinnest and bulges.
    """
    named = [index for index, name in enumerate(labels) if name in face_mm]
    if len(named) >= MIN_NAMED:
        ours, theirs = rest_mm[named], np.stack([face_mm[labels[index]] for index in named])
        ours, theirs = ours - ours.mean(axis=0), theirs - theirs.mean(axis=0)
        scale = np.sqrt((theirs**2).sum() / max(float((ours**2).sum()), 1e-9))
        return np.asarray(fit_rigid(scale * ours, theirs).rotation)
    off = rest_mm - rest_mm.mean(axis=0)
    _, vectors = np.linalg.eigh(off[:, [0, 2]].T @ off[:, [0, 2]])
    out = np.array([vectors[0, 0], 0.0, vectors[1, 0]])
    across = np.hypot(off @ np.cross([0.0, 1.0, 0.0], out), off[:, 1])
    middle = across <= np.median(across)
    if (off[middle] @ out).mean() < (off[~middle] @ out).mean():
        out = -out
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(up, out), up, out])


def make_grid(subset: MarkerSubset, rest_mm: Array, columns: int) -> FaceGrid:
    """Lay a grid of points over the markers, (M, 3) mm at rest; +z points out of the face.

    Heights and weights are interpolated by cubic radial functions over the frontal plane; points outside of the
    markers' hull are left out.
    """
    low, high = rest_mm[:, :2].min(axis=0), rest_mm[:, :2].max(axis=0)
    rows = max(2, round(columns * (high[1] - low[1]) / max(high[0] - low[0], 1e-9)))
    across, along = np.meshgrid(np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows))
    flat = np.stack([across.ravel(), along.ravel()], axis=1)
    places = np.column_stack([flat, interpolate_flat(rest_mm[:, :2], rest_mm[:, 2:], flat)])
    regions = interpolate_regions(subset, rest_mm, places)
    at = np.arange(len(places)).reshape(rows, columns)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    triangles = triangles[regions.inside[triangles].all(axis=1)]
    if not len(triangles):
        raise UsageError("markers: must be spread over a face; they span no surface")
    used, corners = np.unique(triangles, return_inverse=True)
    return FaceGrid(places[used], corners.reshape(-1, 3), regions.weights[:, used])
