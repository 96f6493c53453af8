"""A head as the browser page fetches it: one file, laid out so that every array is uploaded where it lies.

Layout, little-endian: ``FAPHEAD1``, the length of a JSON text (uint32), the text, zeros up to a multiple of 16; then
the arrays, each at the next multiple of 16. The text names them with kind, shape and offset from the start of the
file, and holds what a frame's uniforms need: attributes, channels' table, pivots and FAPU. What the arrays mean:
:class:`fapengine.render.packing.PackedMesh`.
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.fap import FapUnit
from fapengine.render.packing import ATTRIBUTE_SIZES, PUPIL_RANGE, PUPIL_SHARE, pack

MAGIC = b"FAPHEAD1"
ALIGNMENT = 16
_KINDS = {"float32": "<f4", "float64": "<f8", "uint32": "<u4", "uint8": "u1"}


def head_binary(mesh: FaceMesh) -> bytes:
    """Write a head for the page; the same head gives the same bytes.

    Raises
    ------
    UsageError
        If the mesh has more channels than the shaders have room for.
    """
    packed = pack(mesh)
    channels = [(channel.fap, channel.start, channel.stop) for channel in mesh.basis.channels]
    arrays: dict[str, NDArray[Any]] = {
        "vertices": packed.vertices,
        **{f"part.{name}": triangles for name, triangles in packed.parts.items()},
        "displacements": packed.displacements,
        "normal_deltas": packed.normal_deltas,
        **({} if packed.skin is None else {"skin": packed.skin}),
        "channels": np.array(channels, dtype=np.float64).reshape(-1, 3),  # starts and stops may be infinite
        "mix": np.zeros((0, 0), np.float32) if mesh.basis.mix is None else mesh.basis.mix,
    }
    about = {
        "attributes": list(ATTRIBUTE_SIZES.items()),
        "iris": packed.iris,
        "irisAlbedo": packed.iris_albedo.tolist(),
        "edge": packed.edge_mm,
        "texelsPerMm": packed.texels_per_mm,
        "pupilShare": PUPIL_SHARE,
        "pupilRange": PUPIL_RANGE,
        "jawPivot": mesh.jaw_pivot_mm.tolist(),
        "headPivot": mesh.head_pivot_mm.tolist(),
        "eyePivots": mesh.eye_pivots_mm.tolist(),
        "chin": mesh.point_mm("2.1").tolist(),
        "units": {unit.value: mesh.fapu.unit(unit) for unit in FapUnit},
    }
    return _file(about, arrays)


def _file(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    places: dict[str, Any] = {}
    text = b""
    for _ in range(4):  # offsets stand in the text, and the text's length moves them: settled in two or three rounds
        start, before = _aligned(len(MAGIC) + 4 + len(text)), text
        for name, array in arrays.items():
            kind = next(kind for kind, code in _KINDS.items() if np.dtype(code) == array.dtype)
            places[name] = {"kind": kind, "shape": array.shape, "offset": start}
            start = _aligned(start + array.nbytes)
        text = json.dumps(about | {"arrays": places}, separators=(",", ":"), allow_nan=False).encode()
        if len(text) == len(before):
            break
    out = bytearray(MAGIC + struct.pack("<I", len(text)) + text)
    for name, array in arrays.items():
        out += bytes(places[name]["offset"] - len(out))
        out += np.ascontiguousarray(array, dtype=_KINDS[places[name]["kind"]]).tobytes()
    return bytes(out)


def _aligned(length: int) -> int:
    return -(-length // ALIGNMENT) * ALIGNMENT
