"""Primitives packed by Draco (KHR_draco_mesh_compression), unpacked by DracoPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError

if TYPE_CHECKING:
    import DracoPy
else:
    DracoPy = Late("DracoPy", "DracoPy", "an avatar packed by Draco")


DRACO = "KHR_draco_mesh_compression"
MAGIC = b"DRACO"


def decode_draco(data: bytes, wanted: dict[str, int], where: str) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Unpack one primitive.

    Parameters
    ----------
    data : bytes
        Content of its buffer view.
    wanted : dict of str to int
        Attribute to its unique number in the data.
    where : str
        Place in the document, for messages.

    Returns
    -------
    dict of str to (V, components)
        Numbers of each attribute, in the type that they are stored in.
    (N,) int64
        Indices of the triangles' corners, one triangle after the other, each below V.

    Raises
    ------
    DataError
        If it is damaged, lacks an attribute, or holds no triangles.
    ResourceError
        If DracoPy is not installed.
    """
    if data[: len(MAGIC)] != MAGIC:
        raise DataError("Draco: got data without its mark, expected DRACO first", where=where)
    decode = DracoPy.decode
    try:
        mesh = decode(data)
        corners = np.asarray(mesh.faces).astype(np.int64).reshape(-1)
        found = {row["unique_id"]: np.asarray(row["data"]) for row in mesh.attributes}
    except ResourceError:
        raise
    except Exception as error:  # whatever the library trips over, the data are at fault
        raise DataError(f"Draco: cannot be unpacked ({type(error).__name__}: {error})", where=where) from error
    numbers: dict[str, NDArray[Any]] = {}
    count = len(np.asarray(mesh.points))
    for name, unique in wanted.items():
        if unique not in found:
            raise DataError(f"Draco: got no attribute {unique}, expected it as {name}", where=where)
        numbers[name] = found[unique].reshape(len(found[unique]), -1)
        if len(numbers[name]) != count:
            raise DataError(f"Draco: got {len(numbers[name])} of {name}, expected {count}", where=where)
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        raise DataError(f"Draco: got a triangle of vertex {corners.max()}, expected 0..{count - 1}", where=where)
    return numbers, corners
