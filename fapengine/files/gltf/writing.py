"""glTF as it is written: rows and numbers that are put behind what a document has, and the container around both."""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fapengine.files.gltf.document import BINARY_CHUNK, COMPONENTS, HEADER, JSON_CHUNK, MAGIC, VERSION, WIDTHS

Row = dict[str, Any]
_NUMBERS = {np.dtype(kind): number for number, kind in COMPONENTS.items()}
_TYPES = {width: name for name, width in WIDTHS.items()}
VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""


class Writer:
    """A document that grows at its ends; what it had stays where it is.

    Stateful.

    Parameters
    ----------
    document : dict
        Changed in place.
    binary : bytes
        Content of its first buffer, whose URI is none.
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
        """Add bytes, at a multiple of four."""
        self.binary += bytes(-len(self.binary) % 4)
        row = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)} | more
        self.binary += data
        return self.row("bufferViews", row)

    def accessor(self, values: ArrayLike, *, target: int | None = None, bounds: bool = False) -> int:
        """Add numbers, (N,) or (N, components); the same numbers once more are the same row.

        Parameters
        ----------
        values : array_like
            Of one of glTF's types: 8 to 32 bits, float32.
        target : int, optional
            What the view is bound to.
        bounds : bool
            Whether to state least and greatest, as for positions and times.
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
        """Add (N, components) float32 of which most are 0."""
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
        """Put document, binary and any other chunks, (kind, content), into a container."""
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
