"""Errors of meshes as papers on speech-driven 3D faces report them, in the unit of the mesh.

Theory of operation
-------------------
x(t, v) is the position of vertex v in frame t of the reference, y(t, v) that of the system, n(v) that of the neutral
face. Papers and their programs differ in squares, so both forms are given.

*Lip vertex error* (Richard et al., "MeshTalk", ICCV 2021): the largest distance of all lip vertices in a frame,
averaged over frames, ``mean_t max_v |y - x|``. The programs of FaceFormer and CodeTalker (``main/cal_metric.py``) and
TorchMetrics (``LipVertexError``) square the distance: ``mean_t max_v |y - x|²``. Tables quote the square.

*Mean vertex error* (Stan et al., "FaceDiffuser", MIG 2023, ``compute_objective_metrics.py``): ``mean_t mean_v |y - x|``
over all vertices.

*Upper-face dynamics deviation* (Xing et al., "CodeTalker", CVPR 2023): how much less the upper face moves than the
reference's, ``mean_v (std_t |x - n| - std_t |y - n|)``. CodeTalker's program takes the deviation of the squared
distance, ``mean_v (std_t |x - n|² - std_t |y - n|²)``. Deviations divide by T. Positive: it moves less.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, Indices
from fapengine.errors import UsageError

FRAMES_AT_ONCE = 256
"""Frames that are converted to float64 together: dense meshes take 0.5 MB each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VertexErrors:
    """Errors of one sequence of meshes. None for a measure whose vertices are not given."""

    frames: int
    """Number of frames compared: those that both sequences have."""
    mve: float
    """Mean vertex error, in the mesh's unit."""
    lve: float | None = None
    """Lip vertex error as its definition says, in the mesh's unit."""
    lve_squared: float | None = None
    """Lip vertex error as programs compute and tables print it, in the unit squared."""
    fdd: float | None = None
    """Upper-face dynamics deviation as its paper defines it, in the mesh's unit."""
    fdd_squared: float | None = None
    """Upper-face dynamics deviation as its program computes and tables print it, in the unit squared."""


def vertex_errors(
    made: ArrayLike,
    against: ArrayLike,
    *,
    lips: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    neutral: ArrayLike | None = None,
) -> VertexErrors:
    """Compare two sequences of meshes with the same vertices.

    Parameters
    ----------
    made, against : (T, V, 3) or (T, 3 V)
        Positions of a system and of its reference, in any unit. Frames beyond the shorter one are left out.
    lips, upper : (N,) int, optional
        Vertices of the lips, and of the upper face.
    neutral : (V, 3) or (3 V,), optional
        The face at rest; ``upper`` needs it.

    Returns
    -------
    VertexErrors
        ``frames``; ``mve``, ``lve``, ``fdd`` in the mesh's unit; ``lve_squared``, ``fdd_squared`` in its square, as
        papers print them. None where vertices are not given.

    Raises
    ------
    UsageError
        If shapes do not fit, a number is not finite, or an index is out of range.

    Examples
    --------
    >>> rest = np.zeros((2, 3, 3))
    >>> moved = rest + [0.0, 0.0, 2.0]
    >>> found = vertex_errors(moved, rest, lips=[0])
    >>> found.mve, found.lve, found.lve_squared
    (2.0, 2.0, 4.0)
    """
    true = _positions(against, "against")
    other = _positions(made, "made", true.shape[1])
    count = min(len(true), len(other))
    mouth = _vertices(lips, "lips", true.shape[1])
    brow = _vertices(upper, "upper", true.shape[1])
    rest = None if neutral is None else _positions(np.reshape(neutral, (1, -1)), "neutral", true.shape[1])
    if brow is not None and rest is None:
        raise UsageError("upper: requires neutral, the face at rest, from which the motion of the upper face counts")
    apart = np.zeros(0)
    furthest: list[Array] = []
    for first in range(0, count, FRAMES_AT_ONCE):
        piece = slice(first, min(first + FRAMES_AT_ONCE, count))
        distance = np.linalg.norm(other[piece].astype(np.float64) - true[piece].astype(np.float64), axis=-1)
        apart = np.append(apart, distance.mean(axis=1))
        if mouth is not None:
            furthest.append(distance[:, mouth].max(axis=1))
    lve = np.concatenate(furthest) if furthest else None
    fdd = fdd_squared = None
    if brow is not None and rest is not None:
        moved = [
            np.linalg.norm(each[:count][:, brow].astype(np.float64) - rest[0, brow], axis=-1) for each in (true, other)
        ]
        fdd, fdd_squared = (
            float((of_true.std(axis=0) - of_made.std(axis=0)).mean())
            for of_true, of_made in (moved, [each**2 for each in moved])
        )
    return VertexErrors(
        frames=count,
        mve=float(apart.mean()),
        lve=None if lve is None else float(lve.mean()),
        lve_squared=None if lve is None else float((lve**2).mean()),
        fdd=fdd,
        fdd_squared=fdd_squared,
    )


def _positions(values: ArrayLike, name: str, vertices: int | None = None) -> NDArray[np.floating]:
    """(T, V, 3) of positions that may be flat."""
    array = np.asarray(values)
    if array.ndim == 2 and array.shape[1] % 3 == 0:
        array = array.reshape(len(array), -1, 3)
    expected = f"(T, {'V' if vertices is None else vertices}, 3)"
    if array.ndim != 3 or array.shape[2] != 3 or not array.size or vertices not in (None, array.shape[1]):
        raise UsageError(f"{name}: got shape {array.shape}, expected {expected}, or its frames flat")
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise UsageError(f"{name}: got {array.dtype} or numbers that are not finite, expected finite numbers")
    return array


def _vertices(indices: ArrayLike | None, name: str, count: int) -> Indices | None:
    if indices is None:
        return None
    array = np.asarray(indices)
    if array.ndim != 1 or not array.size or array.dtype.kind not in "iu":
        raise UsageError(f"{name}: got {array.dtype} of shape {array.shape}, expected whole numbers (N,)")
    if array.min() < 0 or array.max() >= count:
        raise UsageError(f"{name}: got vertices {array.min()} to {array.max()}, expected 0 to {count - 1}")
    return array.astype(np.int64)
