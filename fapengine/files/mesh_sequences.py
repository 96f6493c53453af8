"""Sequences of meshes, as papers on 3D faces exchange them, and lists of their vertices."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DAMAGE
from fapengine.capture.arrays import POSITION_NAMES, unpack_npz
from fapengine.errors import DataError
from fapengine.files.paths import naming, read_bytes
from fapengine.files.recordings import MESHES, load_mesh, mesh_files

ARRAYS = (".npy", ".npz")


def is_mesh_sequence(path: Path) -> bool:
    """Whether a path is that of arrays of vertices, or of a folder of meshes, a mesh per frame."""
    return path.suffix.lower() in ARRAYS or (path.is_dir() and bool(mesh_files(path)))


def load_vertices(path: Path) -> NDArray[Any]:
    """Read positions of vertices, (T, V, 3) or as the file holds them, in the file's unit.

    Parameters
    ----------
    path : Path
        ``.npy``; ``.npz`` with one array, or one named as in a recording; a folder of meshes, ordered by the numbers in
        their names; or one mesh, whose positions are (1, V, 3).

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If its content is wrong.
    ResourceError
        If trimesh is needed and not installed.
    """
    if path.is_dir() or path.suffix.lower() in MESHES:
        frames = [load_mesh(file)[0] for file in (mesh_files(path) if path.is_dir() else [path])]
        counts = {len(frame) for frame in frames}
        if len(counts) != 1:
            raise DataError(f"{path}: got meshes of {sorted(counts)} vertices, expected one number")
        return np.stack(frames)
    with naming(path):
        return _array(read_bytes(path))


def _array(data: bytes) -> NDArray[Any]:
    if data[:2] != b"PK":
        try:
            return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
        except (*DAMAGE, MemoryError) as error:
            raise DataError(f"NPY: damaged, or contains Python objects: {error}") from error
    arrays = unpack_npz(data)
    name = next((name for name in ("vertices", *POSITION_NAMES) if name in arrays), None)
    if name is None and len(arrays) != 1:
        raise DataError(f"NPZ: got arrays {sorted(arrays)}, expected one, or one called vertices")
    return arrays[name or next(iter(arrays))]


def load_indices(path: Path) -> NDArray[np.int64]:
    """Read vertex indices: a text of whole numbers, separated by commas or white space, or an array of them (``.npy``).

    Returns
    -------
    (N,) int64

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it contains something else.
    """
    data = read_bytes(path)
    with naming(path):
        if path.suffix.lower() in ARRAYS:
            array = _array(data)
            array = np.flatnonzero(array) if array.dtype == bool else array.reshape(-1)
            if array.dtype.kind not in "iu":
                raise DataError(f"indices: got {array.dtype}, expected whole numbers, or true and false")
            return array.astype(np.int64)
        words = data.replace(b",", b" ").split()
        try:
            return np.array([int(word) for word in words], np.int64)
        except (ValueError, OverflowError) as error:
            raise DataError(f"indices: got {error}, expected whole numbers") from error
