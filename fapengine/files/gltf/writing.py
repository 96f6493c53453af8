"""Writing glTF: rows and values appended to a document, animation curves, and the GLB container."""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array
from fapengine.files.gltf.document import BINARY_CHUNK, COMPONENTS, HEADER, JSON_CHUNK, MAGIC, VERSION, WIDTHS
from fapengine.files.provenance import mark
from fapengine.geometry.rigid import quaternions_from_rotations
from fapengine.models.via_points import KeyedCurve, key_curve

Row = dict[str, Any]
_NUMBERS = {np.dtype(kind): number for number, kind in COMPONENTS.items()}
_TYPES = {width: name for name, width in WIDTHS.items()}
VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""


class Writer:
    """A glTF document that grows at its ends; existing rows and bytes stay in place. Stateful.

    Parameters
    ----------
    document : dict
        Changed in place.
    binary : bytes
        Content of its first buffer, which has no URI.
    """

    def __init__(self, document: Row, binary: bytes = b"") -> None:
        self.document = document
        self.binary = bytearray(binary)
        self._written: dict[tuple[bytes, str], int] = {}

    def row(self, kind: str, value: Row) -> int:
        """Add a row to one of the document's arrays; returns its index."""
        rows = self.document.setdefault(kind, [])
        rows.append(value)
        return len(rows) - 1

    def view(self, data: bytes, **more: int) -> int:
        """Append bytes, aligned to four."""
        self.binary += bytes(-len(self.binary) % 4)
        row = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)} | more
        self.binary += data
        return self.row("bufferViews", row)

    def accessor(self, values: ArrayLike, *, target: int | None = None, bounds: bool = False) -> int:
        """Add values, (N,) or (N, components); equal values share one accessor.

        Parameters
        ----------
        values : array_like
            Integers of 8 to 32 bits, or float32.
        target : int, optional
            Target of the buffer view.
        bounds : bool
            Whether to state minimum and maximum, as glTF requires for positions and times.
        """
        array = np.ascontiguousarray(values)
        width = array.shape[1] if array.ndim == 2 else 1
        data, named = array.tobytes(), f"{array.dtype.str} {array.shape} {target} {bounds}"
        if (data, named) not in self._written:
            more = {} if target is None else {"target": target}
            row = {"bufferView": self.view(data, **more)} | _shape(array, width)
            self._written[data, named] = self.row("accessors", row | (_bounds(array) if bounds else {}))
        return self._written[data, named]

    def sparse(self, values: ArrayLike) -> int:
        """Add (N, components) float32 that are mostly 0."""
        array = np.ascontiguousarray(values, np.float32)
        moved = np.flatnonzero((array != 0).any(axis=1))
        row = _shape(array, array.shape[1]) | _bounds(array)
        if len(moved):
            indices = moved.astype(np.uint16 if len(array) <= 1 << 16 else np.uint32)
            row["sparse"] = {
                "count": len(moved),
                "indices": {"bufferView": self.view(indices.tobytes()), "componentType": _NUMBERS[indices.dtype]},
                "values": {"bufferView": self.view(array[moved].tobytes())},
            }
        return self.row("accessors", row)

    def glb(self, *others: tuple[int, bytes]) -> bytes:
        """Return the GLB of document, binary and any other chunks, (kind, content)."""
        if self.binary:
            buffers = self.document.setdefault("buffers", [])
            if not buffers:
                buffers.append({})
            buffers[0]["byteLength"] = len(self.binary)
        text = json.dumps(self.document, ensure_ascii=False, separators=(",", ":")).encode()
        chunks = [_chunk(JSON_CHUNK, text, b" ")]
        if self.binary:
            chunks.append(_chunk(BINARY_CHUNK, bytes(self.binary), b"\0"))
        chunks += [_chunk(kind, content, b"\0") for kind, content in others]
        return struct.pack("<4sII", MAGIC, VERSION, HEADER + sum(map(len, chunks))) + b"".join(chunks)


def _shape(array: "np.ndarray[Any, Any]", width: int) -> Row:
    return {"componentType": _NUMBERS[array.dtype], "count": len(array), "type": _TYPES[width]}


def _bounds(array: "np.ndarray[Any, Any]") -> Row:
    flat = array.reshape(len(array), -1)
    return {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}


def _chunk(kind: int, content: bytes, padding: bytes) -> bytes:
    content += padding * (-len(content) % 4)
    return struct.pack("<II", len(content), kind) + content


WEIGHT_TOLERANCE, TURN_TOLERANCE = 0.01, 0.002
"""Largest error of cubic curves: of a weight, and of a quaternion's components (0.23 degrees)."""
TOLERANCES = {"weights": WEIGHT_TOLERANCE, "rotation": TURN_TOLERANCE, "translation": WEIGHT_TOLERANCE}
"""Tolerance by the animated property of a node."""


def quaternions_of(matrices: Array) -> Array:
    """(T, 4) x y z w of rotations (T, 3, 3); of both signs, the one nearer to the previous frame."""
    quaternions = np.roll(quaternions_from_rotations(matrices), -1, axis=1)
    flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0))
    quaternions[1:] *= flips[:, None]
    return quaternions


class Curves:
    """Samplers and channels of one animation; ``count`` is the number of keys. Stateful."""

    def __init__(self, writer: Writer, rate_hz: float, keys: str) -> None:
        self._writer, self._rate_hz, self._keys = writer, rate_hz, keys
        self._made: dict[tuple[bytes, str], int] = {}
        self.samplers: list[Row] = []
        self.channels: list[Row] = []
        self.count = 0

    def row(self, name: str) -> Row:
        """Return the animation's row."""
        row: Row = {"name": name, "samplers": self.samplers, "channels": self.channels}
        return row | ({"extras": marked} if (marked := mark()) else {})

    def add(self, node: int, path: str, values: Array) -> None:
        """Animate a property of a node: ``weights`` (T, targets), ``rotation`` (T, 4) or ``translation`` (T, 3)."""
        key = values.tobytes(), path
        if key not in self._made:  # meshes of one face have the same weights
            curve = key_curve(values, self._rate_hz, self._keys, TOLERANCES[path])
            self.count += len(curve.times_s)
            self._made[key] = len(self.samplers)
            self.samplers.append(self._sampler(curve, path))
        self.channels.append({"sampler": self._made[key], "target": {"node": node, "path": path}})

    def _sampler(self, curve: KeyedCurve, path: str) -> Row:
        times = self._writer.accessor(curve.times_s.astype(np.float32), bounds=True)
        out = curve.values
        if curve.slopes is not None:  # at each key the slope before, the value and the slope after
            out = np.stack([curve.slopes, curve.values, curve.slopes], axis=1)
        flat = out.reshape(-1) if path == "weights" else out.reshape(-1, curve.values.shape[1])
        row = {"input": times, "output": self._writer.accessor(flat.astype(np.float32))}
        return row if curve.slopes is None else row | {"interpolation": "CUBICSPLINE"}
