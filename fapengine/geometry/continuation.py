"""Values that are known at some vertices of a mesh, continued over the others with least bending."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

from fapengine._arrays import frozen
from fapengine.errors import UsageError


def continue_smoothly(values: ArrayLike, known: ArrayLike, triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Continue values of known vertices, (V, C), over a mesh (graph bilaplacian): known ones stay, others bend least.

    A part of the mesh without a known vertex takes the mean value.

    Raises
    ------
    UsageError
        If nothing is known.
    """
    field = frozen(values, "values", ("V", "C"), np.float64)
    mask = np.asarray(known, dtype=bool)
    if not mask.any():
        raise UsageError("known: got no vertex, expected at least one")
    if mask.all():
        return field.copy()
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    both = np.concatenate([edges, edges[:, ::-1]])
    links = csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(len(field), len(field)))
    links.data[:] = 1.0
    degree: NDArray[np.float64] = np.asarray(links.sum(axis=1)).ravel()
    laplacian = diags_array((degree > 0).astype(float)) - diags_array(1.0 / np.maximum(degree, 1.0)) @ links
    # A trace of pull to the mean keeps parts without a known vertex solvable.
    mean = field[mask].mean(axis=0)
    free = np.flatnonzero(~mask)
    energy = (laplacian.T @ laplacian + 1e-9 * diags_array(np.ones(len(field)))).tocsr()
    right = -(energy[free] @ np.where(mask[:, None], field - mean, 0.0))
    result = field.copy()
    result[free] = mean + splu(energy[free][:, free].tocsc()).solve(np.ascontiguousarray(right))
    return result
