"""Decoders of compressed glTF: EXT_meshopt_compression with its filters, and KHR_draco_mesh_compression.

meshopt follows the text of the extension (bitstream and filters, appendices A and B); Draco is decoded by DracoPy:
https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Vendor/EXT_meshopt_compression
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, TruncatedError, UnsupportedError, any_error_as

ATTRIBUTES, TRIANGLES, INDICES = "ATTRIBUTES", "TRIANGLES", "INDICES"
HEADERS = {ATTRIBUTES: 0xA0, TRIANGLES: 0xE1, INDICES: 0xD1}
GROUP, MAX_BLOCK, BLOCK_BYTES, MIN_TAIL = 16, 256, 8192, 32
MAX_STRIDE = 256
EXPLICIT = 13
"""Code of a triangle's third corner from which the corner is not in the FIFO."""

Bytes = NDArray[np.uint8]


def decode_meshopt(data: bytes, *, mode: str, count: int, stride: int, filter_name: str, where: str) -> bytes:
    """Decode a buffer view that meshoptimizer has compressed.

    Parameters
    ----------
    data : bytes
    mode : str
        ``ATTRIBUTES``, ``TRIANGLES`` or ``INDICES``.
    count : int
        Number of elements.
    stride : int
        Bytes per element.
    filter_name : str
        ``NONE``, ``OCTAHEDRAL``, ``QUATERNION`` or ``EXPONENTIAL``.
    where : str
        Place of the view, for error messages.

    Raises
    ------
    TruncatedError
        If bytes are missing.
    UnsupportedError
        If mode, version or filter is unknown.
    DataError
        If the numbers contradict each other.
    """
    if mode not in HEADERS or not data or data[0] != HEADERS[mode]:
        raise UnsupportedError(f"meshopt: got mode {mode!r} with header {data[:1].hex() or 'none'}", where=where)
    allowed = (2, 4) if mode != ATTRIBUTES else range(4, MAX_STRIDE + 1, 4)
    if stride not in allowed or (mode == TRIANGLES and count % 3):
        raise DataError(f"meshopt: got {count} elements of {stride} bytes as {mode}", where=where)
    try:
        if mode == ATTRIBUTES:
            return _filtered(_vertices(data, count, stride), filter_name, where).tobytes()
        decoded = _triangles(data, count) if mode == TRIANGLES else _sequence(data, count)
    except IndexError as error:
        raise TruncatedError("meshopt: the bytes do not match the number of elements", where=where) from error
    return decoded.astype("<u2" if stride == 2 else "<u4").tobytes()


def _vertices(data: bytes, count: int, stride: int) -> Bytes:
    """(count, stride): decode deltas of each byte to the previous element, in groups of 16 of one bit width."""
    tail = max(stride, MIN_TAIL)
    if len(data) < 1 + tail + count * stride // (4 * GROUP):  # each group has a two-bit header
        raise IndexError
    values = np.empty((count, stride), np.uint8)
    last = np.frombuffer(data, np.uint8, stride, len(data) - stride)
    most, at, end = min(BLOCK_BYTES // stride & ~(GROUP - 1), MAX_BLOCK), 1, len(data) - tail
    for start in range(0, count, most):
        size = min(most, count - start)
        groups = -(-size // GROUP)
        deltas = np.zeros((stride, groups * GROUP), np.uint8)
        for byte in range(stride):
            head = data[at : at + -(-groups // 4)]
            at += -(-groups // 4)
            for group in range(groups):
                kind = head[group // 4] >> 2 * (group % 4) & 3
                if kind:
                    at = _group(data, at, kind, deltas[byte, GROUP * group : GROUP * (group + 1)])
            if at > end:
                raise IndexError
        signed = (deltas >> 1) ^ (0 - (deltas & 1)).astype(np.uint8)
        block = (np.cumsum(signed, axis=1, dtype=np.uint8)[:, :size] + last[:, None]).astype(np.uint8)
        values[start : start + size] = block.T
        last = block[:, -1]
    return values


def _group(data: bytes, at: int, kind: int, out: Bytes) -> int:
    """Read 16 deltas of 2, 4 or 8 bits; the largest value of 2 or 4 bits means that a whole byte follows the group."""
    if kind == 3:
        out[:] = np.frombuffer(data[at : at + GROUP].ljust(GROUP, b"\0"), np.uint8)
        return at + GROUP
    bits = 2 * kind
    packed = np.frombuffer(data[at : at + 2 * bits].ljust(2 * bits, b"\0"), np.uint8)
    shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
    out[:] = (packed[:, None] >> shifts & ((1 << bits) - 1)).ravel()
    at += 2 * bits
    escaped = np.flatnonzero(out == (1 << bits) - 1)
    if len(escaped):
        out[escaped] = np.frombuffer(data[at : at + len(escaped)].ljust(len(escaped), b"\0"), np.uint8)
    return at + len(escaped)


class _Reader:
    """A sequence of variable-length numbers. Stateful."""

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self._data, self.at, self.end, self.last = data, at, end, 0

    def byte(self) -> int:
        if self.at >= self.end:
            raise IndexError
        self.at += 1
        return self._data[self.at - 1]

    def number(self) -> int:
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128 or shift > 28:
                return value & 0xFFFFFFFF

    def finish(self) -> None:
        """Reject bytes that are left over."""
        if self.at != self.end:
            raise IndexError

    def index(self) -> int:
        """Read an index as a signed difference from the last one."""
        value = self.number()
        self.last = self.last + ((value >> 1) ^ -(value & 1)) & 0xFFFFFFFF
        return self.last


def _triangles(data: bytes, count: int) -> NDArray[np.int64]:
    """(count,): decode corners of triangles, most of which share an edge with one of the last sixteen."""
    total = count // 3
    reader, table = _Reader(data, 1 + total, len(data) - 16), data[-16:]
    edges, vertices = [(0, 0)] * 16, [0] * 16
    edge_at = vertex_at = following = 0
    corners: list[int] = []
    if len(data) < 1 + total + 16:
        raise IndexError
    for code in data[1 : 1 + total]:
        if code < 0xF0:
            a, b = edges[(edge_at - 1 - (code >> 4)) & 15]
            kind = code & 15
            if kind == 0:
                c, is_new, following = following, True, following + 1
            elif kind < EXPLICIT:
                c, is_new = vertices[(vertex_at - 1 - kind) & 15], False
            else:
                is_new = True
                if kind == 15:
                    c = reader.index()
                else:
                    c = reader.last = reader.last + (kind - (kind ^ 3)) & 0xFFFFFFFF
            fresh, pairs = [c] * is_new, ((c, b), (a, c))
        else:
            auxiliary = table[code & 15] if code < 0xFE else reader.byte()
            if code >= 0xFE and auxiliary == 0:
                following = 0
            kinds = (15 if code == 0xFF else 0, auxiliary >> 4, auxiliary & 15)
            found = []
            for kind in kinds:
                if kind == 0:
                    found.append(following)
                    following += 1
                else:
                    found.append(vertices[(vertex_at - kind) & 15])
            if code >= 0xFE:
                found = [reader.index() if kind == 15 else corner for kind, corner in zip(kinds, found, strict=True)]
            a, b, c = found
            explicit = (0, 15) if code >= 0xFE else (0,)
            fresh = [corner for kind, corner in zip(kinds, found, strict=True) if kind in explicit]
            pairs = ((b, a), (c, b), (a, c))  # type: ignore[assignment]
        corners += (a, b, c)
        for corner in fresh:
            vertices[vertex_at & 15] = corner
            vertex_at += 1
        for pair in pairs:
            edges[edge_at & 15] = pair
            edge_at += 1
    reader.finish()
    return np.array(corners, np.int64)


def _sequence(data: bytes, count: int) -> NDArray[np.int64]:
    """(count,): decode indices, stored as differences from one of two previous ones."""
    reader, lasts = _Reader(data, 1, len(data) - 4), [0, 0]
    values = np.empty(count, np.int64)
    for place in range(count):
        number = reader.number()
        run, number = number & 1, number >> 1
        lasts[run] = lasts[run] + ((number >> 1) ^ -(number & 1)) & 0xFFFFFFFF
        values[place] = lasts[run]
    reader.finish()
    return values


def _filtered(values: Bytes, name: str, where: str) -> NDArray[np.generic]:
    """Undo a filter; sizes are those that the extension allows."""
    stride = values.shape[1]
    if name == "NONE":
        return values
    with np.errstate(all="ignore"):  # damaged values are rejected where they are used
        if name == "OCTAHEDRAL" and stride in (4, 8):
            return _octahedral(values.view("<i1" if stride == 4 else "<i2"))
        if name == "QUATERNION" and stride == 8:
            return _quaternion(values.view("<i2"))
        if name == "EXPONENTIAL":
            whole = values.view("<i4")
            return np.asarray(np.ldexp((whole << 8 >> 8).astype(np.float32), whole >> 24), "<f4")
    raise UnsupportedError(f"meshopt: got filter {name!r} of {stride} bytes", where=where)


def _octahedral(packed: NDArray[np.signedinteger]) -> NDArray[np.generic]:
    """(N, 4) integers -> (N, 4): unit vectors from a square, times the largest integer; the fourth is unchanged."""
    most = float(np.iinfo(packed.dtype).max)
    x, y, one = packed[:, :3].astype(np.float64).T
    one = np.where(one == 0, 1.0, one)
    x, y = x / one, y / one
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    vector = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=1)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    out = packed.copy()
    out[:, :3] = np.round(vector / np.where(length > 0, length, 1.0) * most)
    return out


def _quaternion(packed: NDArray[np.signedinteger]) -> NDArray[np.generic]:
    """(N, 4) -> (N, 4): unit quaternions from their three smaller components, times 32767."""
    scale = (packed[:, 3] | 3).astype(np.float64)[:, None] * np.sqrt(2.0)
    three = packed[:, :3] / scale
    largest = np.sqrt(np.maximum(1.0 - (three**2).sum(axis=1), 0.0))
    place = packed[:, 3].astype(np.int64) & 3
    out, rows = np.empty_like(packed), np.arange(len(packed))
    for number in range(3):
        out[rows, (place + 1 + number) % 4] = np.round(three[:, number] * 32767)
    out[rows, place] = np.round(largest * 32767)
    return out


DracoPy = Late("DracoPy", "DracoPy", "an avatar packed by Draco")


DRACO = "KHR_draco_mesh_compression"
MAGIC = b"DRACO"
KIND, MESH = 7, b"\1"
"""Where a header says what it describes, and how it says a mesh."""


def decode_draco(data: bytes, wanted: dict[str, int], where: str) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Decode one primitive that Draco has compressed.

    Parameters
    ----------
    data : bytes
        Content of its buffer view.
    wanted : dict of str to int
        Unique number in the data by attribute.
    where : str
        Place in the document, for error messages.

    Returns
    -------
    dict of str to (V, components)
        Values of each attribute, in the stored type.
    (N,) int64
        Indices of the triangles' corners, each below V.

    Raises
    ------
    DataError
        If it is damaged, or an attribute is missing.
    ResourceError
        If DracoPy is not installed.
    """
    if data[: len(MAGIC)] != MAGIC:
        raise DataError("Draco: got data that do not begin with DRACO", where=where)
    if data[KIND : KIND + 1] != MESH:  # a cloud of points takes memory for as many as its header names
        raise DataError("Draco: got no mesh, expected triangles", where=where)
    decode = DracoPy.decode  # raises ResourceError if it is not installed
    with any_error_as(partial(DataError, where=where), "Draco: cannot be decoded"):
        mesh = decode(data)
        corners = np.asarray(mesh.faces).astype(np.int64).reshape(-1)
        found = {row["unique_id"]: np.atleast_1d(row["data"]) for row in mesh.attributes}
        count = len(np.asarray(mesh.points))
    numbers: dict[str, NDArray[Any]] = {}
    for name, unique in wanted.items():
        if unique not in found:
            raise DataError(f"Draco: contains no attribute {unique}, expected it as {name}", where=where)
        numbers[name] = found[unique].reshape(len(found[unique]), -1)
        if len(numbers[name]) != count:
            raise DataError(f"Draco: got {len(numbers[name])} of {name}, expected {count}", where=where)
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        raise DataError(f"Draco: got a triangle of vertex {corners.max()}, expected 0 to {count - 1}", where=where)
    return numbers, corners
