"""glTF 2.0 and GLB: the JSON document, its buffers, and accessors as arrays (Khronos glTF 2.0, 3.6, 4.4 and 5).

No maintained Python library returns morph targets as arrays: trimesh leaves them out, pygltflib stops at the JSON. So
containers, buffers and accessors are read here. What is not supported is refused by name.

Values of the JSON are checked when they are read, so that an error names the place in the file.
"""

import base64
import binascii
import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import DataError, TruncatedError, UnsupportedError
from fapengine.files.gltf.compression import DRACO, decode_draco, decode_meshopt

MAX_NUMBER = 1e30
"""Larger numbers are mistakes; no position or factor is so large."""


OTHER_FILES = {
    b"version https://git-lfs": "a pointer of Git LFS, expected the file itself (git lfs pull)",
    b"Kaydara FBX": "FBX, expected a file that was exported as .glb, by Blender for example",
    b"; FBX": "FBX, expected a file that was exported as .glb, by Blender for example",
    b"BLENDER": "a project of Blender, expected a file that it exported as .glb",
    b"PK\x03\x04": "a ZIP archive, expected the file in it",
    b"#usda": "USD, expected a file that was exported as .glb, by Blender for example",
    b"PXR-USDC": "USD, expected a file that was exported as .glb, by Blender for example",
    b"<": "a web page, or XML of a kind that is not read here; expected the file that a link leads to",
}
"""Files that are often given by mistake: first bytes, and what the error says."""


def find_other(data: bytes) -> str | None:
    """Say which of :data:`OTHER_FILES` this is, and what was expected; None for any other file."""
    beginning = data[:64].lstrip()
    return next((message for magic, message in OTHER_FILES.items() if beginning.startswith(magic)), None)


def parse_json(data: bytes, where: str) -> "Item":
    """Read a whole document.

    Raises
    ------
    DataError
        If it is not a JSON object, or contains numbers that are not finite.
    """
    try:
        value = json.loads(data.decode("utf-8"), parse_constant=_refuse)
        if b"\\u" in data:
            json.dumps(value, ensure_ascii=False).encode()  # rejects half a surrogate pair, which no path may contain
    except (ValueError, RecursionError) as error:  # Unicode's errors are ValueErrors
        raise DataError(f"is not JSON: {str(error)[:120]}", where=where) from error
    if not isinstance(value, dict):
        raise DataError(f"got {type(value).__name__}, expected a JSON object", where=where)
    return Item(value, "")


def _refuse(name: str) -> float:
    raise ValueError(f"got {name}, expected a number")


class Item:
    """A JSON object and its place, e.g. ``accessors[3].sparse``. The methods raise DataError for wrong types."""

    def __init__(self, values: dict[str, Any], where: str) -> None:
        self._values = values
        self.where = where

    def __contains__(self, key: str) -> bool:
        return self._values.get(key) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def fail(self, key: str, expected: str) -> DataError:
        """Return the error for a key."""
        return DataError(f"{key}: got {self._values.get(key)!r:.60}, expected {expected}", where=self._place(key))

    def item(self, key: str) -> "Item":
        """Object under a key; empty if it is missing."""
        value = self._values.get(key)
        if value is None:
            value = {}
        if not isinstance(value, dict):
            raise self.fail(key, "an object")
        return Item(value, self._place(key))

    def extras(self) -> "Item":
        """Application-specific data; empty if they are not an object, as glTF allows any JSON there."""
        value = self._values.get("extras")
        return Item(value if isinstance(value, dict) else {}, self._place("extras"))

    def items(self, key: str) -> "list[Item]":
        """Array of objects under a key; empty if it is missing."""
        place, values = self._place(key), self._list(key, dict, "objects")
        return [Item(value, f"{place}[{number}]") for number, value in enumerate(values)]

    def strings(self, key: str) -> list[str]:
        """Array of strings under a key; empty if it is missing."""
        return self._list(key, str, "strings")

    def indices(self, key: str, below: int) -> list[int]:
        """Array of indices under a key, each 0 to ``below`` - 1; empty if it is missing."""
        values = self._list(key, int, "indices")
        if not all(0 <= value < below and value is not True for value in values):
            raise self.fail(key, f"indices 0 to {below - 1}")
        return values

    def numbers(self, key: str, default: list[float]) -> list[float]:
        """Array of finite numbers under a key, of the same length as the default."""
        values = self._values.get(key, default)
        if not isinstance(values, list) or len(values) != len(default):
            raise self.fail(key, f"{len(default)} numbers")
        if not all(isinstance(value, int | float) and abs(value) < MAX_NUMBER for value in values):
            raise self.fail(key, f"{len(default)} finite numbers")
        return [float(value) for value in values]

    def number(self, key: str, default: float) -> float:
        """Finite number under a key."""
        value = self._values.get(key, default)
        if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < MAX_NUMBER:
            raise self.fail(key, "a finite number")
        return float(value)

    def index(self, key: str, below: int, default: int | None = None) -> int:
        """Whole number under a key, 0 to ``below`` - 1."""
        value = self._values.get(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < below:
            raise self.fail(key, f"a whole number, 0 to {below - 1}")
        return value

    def string(self, key: str, default: str | None = None) -> str:
        """Text under a key."""
        value = self._values.get(key, default)
        if not isinstance(value, str):
            raise self.fail(key, "a string")
        return value

    def text(self, key: str) -> str:
        """Text under a key that nothing depends on; empty if it is missing or, as exporters write, null."""
        value = self._values.get(key)
        return value if isinstance(value, str) else ""

    def flag(self, key: str) -> bool:
        """Return the boolean under a key; false if it is missing."""
        value = self._values.get(key, False)
        if not isinstance(value, bool):
            raise self.fail(key, "true or false")
        return value

    def _list(self, key: str, kind: type, what: str) -> list[Any]:
        values = self._values.get(key)
        if values is None:
            return []
        if not isinstance(values, list) or not all(isinstance(value, kind) for value in values):
            raise self.fail(key, f"an array of {what}")
        return values

    def _place(self, key: str) -> str:
        return f"{self.where}.{key}" if self.where else key


MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
HEADER, CHUNK_HEADER = 12, 8
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
KINDS = (
    "accessors", "bufferViews", "images", "materials", "meshes", "nodes", "samplers", "scenes", "skins", "textures",
)  # fmt: skip
"""Arrays of a document whose rows are referred to by index."""
MAX_ELEMENTS = 4_000_000
"""Largest count of an accessor; without a buffer view its elements take no bytes in the file."""
MAX_ELEMENTS_IN_ALL = 32_000_000
"""Largest number of elements read from a document; an accessor counts each time that it is used."""
SUPPORTED = (
    "KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit", "EXT_texture_webp", "KHR_texture_basisu",
    "EXT_meshopt_compression", DRACO, "VRM", "VRMC_vrm",
)  # fmt: skip
"""Required extensions that are supported; textures of Basis Universal are left out."""
HARMLESS = ("KHR_materials_", "KHR_lights_", "VRMC_", "KHR_xmp", "KHR_animation_pointer")
"""Prefixes of extensions that change nothing that is read here."""
MESHOPT = "EXT_meshopt_compression"

Fetch = Callable[[str], bytes]
"""Reads a file named in the document, relative to it; raises DataError."""


@dataclass(slots=True)
class Budget:
    """Limit on what is unpacked, as a few bytes of a file may ask for any amount. Stateful."""

    what: str
    limit: int
    taken: int = 0

    def take(self, count: int, where: str) -> None:
        """Count what is about to be unpacked; raise DataError above the limit."""
        self.taken += count
        if self.taken > self.limit:
            raise DataError(f"{self.what}: got {self.taken} in all, expected at most {self.limit}", where=where)


@dataclass(frozen=True, slots=True)
class Gltf:
    """A document with its buffers."""

    root: Item
    rows: dict[str, list[Item]]
    """Rows of the document, by :data:`KINDS`."""
    buffers: tuple[bytes, ...]
    fetch: Fetch
    _views: dict[int, bytes] = field(default_factory=dict, repr=False)
    _primitives: dict[int, NDArray[np.generic]] = field(default_factory=dict, repr=False)
    """Accessors of primitives that Draco has compressed, decoded, by index."""
    elements: Budget = field(default_factory=lambda: Budget("elements", MAX_ELEMENTS_IN_ALL))

    def row(self, item: Item, key: str, kind: str) -> Item:
        """Row of one of the document's arrays, whose index is under a key of an object."""
        return self.rows[kind][self.index(item, key, kind)]

    def index(self, item: Item, key: str, kind: str) -> int:
        """Index under a key of an object, which is one of ``rows[kind]``."""
        return item.index(key, len(self.rows[kind]))

    def numbers(self, item: Item, key: str, shape: tuple[int | None, int | None] = (None, None)) -> Array:
        """(N, components) float64: values of the accessor under a key; normalised and sparse ones are converted.

        Raises
        ------
        DataError
            If the file contradicts itself, or the values do not have the expected shape; None allows any size.
        """
        values = self.accessor(self.index(item, key, "accessors"))
        if any(expected not in (None, size) for expected, size in zip(shape, values.shape, strict=True)):
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise DataError(f"{key}: got shape {values.shape}, expected ({wanted})", where=item.where)
        return values

    def accessor(self, index: int) -> Array:
        """(N, components) float64: values of an accessor; normalised and sparse ones are converted."""
        item = self.rows["accessors"][index]
        count, width, kind = self._shape(item)
        values = np.zeros((count, width), kind)
        if index in self._primitives:
            values = self._primitives[index]
        elif "bufferView" in item:
            values = self._read(item, count, width, kind)
        if "sparse" in item:
            values = self._with_sparse(item.item("sparse"), values, kind)
        with np.errstate(invalid="ignore"):  # signalling NaNs of a damaged file
            numbers = values.astype(np.float64)
        if item.flag("normalized") and kind != "<f4":
            numbers = np.maximum(numbers / np.iinfo(kind).max, -1.0)
        if not (np.abs(numbers) < MAX_NUMBER).all():
            raise DataError(f"got numbers that are not finite, or beyond {MAX_NUMBER:g}", where=item.where)
        return numbers

    def indices(self, primitive: Item, below: int) -> NDArray[np.int64]:
        """(N,) int64: vertex indices of a primitive, each less than ``below``."""
        index = self.index(primitive, "indices", "accessors")
        item = self.rows["accessors"][index]
        count, width, kind = self._shape(item)
        if width != 1 or kind not in ("<u1", "<u2", "<u4"):
            raise DataError(
                f"indices: got {item.string('type')} of {kind[1:]}, expected unsigned scalars", where=item.where
            )
        read = self._primitives[index] if index in self._primitives else self._read(item, count, 1, kind)
        values = np.array(read[:, 0], np.int64)
        if len(values) and values.max() >= below:
            raise DataError(f"indices: got {values.max()}, expected 0 to {below - 1}", where=item.where)
        return values

    def view(self, item: Item) -> bytes:
        """Bytes of the buffer view of an object."""
        index = self.index(item, "bufferView", "bufferViews")
        item = self.rows["bufferViews"][index]
        if MESHOPT in item.item("extensions"):
            return self._unpacked(index, item.item("extensions").item(MESHOPT))
        return self._slice(item)

    def unpack_draco(self, primitive: Item) -> None:
        """Decode a primitive that Draco has compressed; its accessors then return the decoded values.

        Raises
        ------
        DataError
            If it is damaged, or does not match the accessors.
        ResourceError
            If DracoPy is not installed.
        """
        packed = primitive.item("extensions")
        if DRACO not in packed:
            return
        item, attributes = packed.item(DRACO), primitive.item("attributes")
        names = [name for name in item.item("attributes") if name in attributes]
        accessors = {name: self.index(attributes, name, "accessors") for name in names}
        corners = self.index(primitive, "indices", "accessors") if "indices" in primitive else None
        if all(index in self._primitives for index in [*accessors.values(), *([] if corners is None else [corners])]):
            return
        for index in accessors.values():
            self._shape(self.rows["accessors"][index])  # counts the elements
        data = self.view(item)
        wanted = {name: item.item("attributes").index(name, 1 << 16) for name in names}
        numbers, triangles = decode_draco(data, wanted, item.where)
        for name, index in accessors.items():
            self._keep(index, numbers[name])
        if corners is not None:
            self._keep(corners, triangles[:, None])

    def _keep(self, index: int, values: NDArray[np.generic]) -> None:
        item = self.rows["accessors"][index]
        count, width, kind = self._shape(item)
        if values.shape != (count, width):
            raise DataError(f"Draco: got shape {values.shape}, expected {(count, width)}", where=item.where)
        with np.errstate(invalid="ignore"):
            self._primitives[index] = values.astype(kind)

    def _unpacked(self, index: int, item: Item) -> bytes:
        """Bytes of a view that meshoptimizer has compressed; decoded once."""
        if index not in self._views:
            count, stride = item.index("count", MAX_ELEMENTS), item.index("byteStride", 1 << 16)
            self.elements.take(count, item.where)
            mode, name = item.string("mode"), item.string("filter", "NONE")
            self._views[index] = decode_meshopt(
                self._slice(item), mode=mode, count=count, stride=stride, filter_name=name, where=item.where
            )
        return self._views[index]

    def _slice(self, item: Item) -> bytes:
        buffer = self.buffers[item.index("buffer", len(self.buffers))]
        first, length = item.index("byteOffset", len(buffer) + 1, 0), item.index("byteLength", len(buffer) + 1)
        if first + length > len(buffer):
            raise TruncatedError(
                f"buffer view: got bytes {first} to {first + length}, expected at most {len(buffer)}", where=item.where
            )
        return buffer[first : first + length]

    def _shape(self, item: Item) -> tuple[int, int, str]:
        kind = COMPONENTS.get(item.index("componentType", 1 << 16))
        width = WIDTHS.get(item.string("type"))
        if kind is None or width is None:
            raise item.fail(
                "type" if kind else "componentType", f"one of {', '.join(map(str, WIDTHS if kind else COMPONENTS))}"
            )
        count = item.index("count", MAX_ELEMENTS)
        self.elements.take(count, item.where)
        return count, width, kind

    def _read(self, item: Item, count: int, width: int, kind: str) -> NDArray[np.generic]:
        """Elements of a buffer view, which may be interleaved with others."""
        data, row = self.view(item), self.row(item, "bufferView", "bufferViews")
        size = np.dtype(kind).itemsize
        stride = (row.index("byteStride", 1 << 16) if "byteStride" in row else 0) or size * width
        first = item.index("byteOffset", 1 << 40, 0)
        if stride < size * width:
            raise row.fail("byteStride", f"at least {size * width}")
        if count and first + stride * (count - 1) + size * width > len(data):
            raise TruncatedError(
                f"accessor: got {count} elements from byte {first} on, but its view has {len(data)} bytes",
                where=item.where,
            )
        if not count:
            return np.zeros((0, width), kind)
        return np.ndarray((count, width), kind, data, first, (stride, size)).copy()

    def _with_sparse(self, item: Item, values: NDArray[np.generic], kind: str) -> NDArray[np.generic]:
        count = item.index("count", len(values) + 1)
        indices, changes = item.item("indices"), item.item("values")
        index_kind = COMPONENTS.get(indices.index("componentType", 1 << 16))
        if index_kind not in ("<u1", "<u2", "<u4"):
            raise indices.fail("componentType", "5121, 5123 or 5125")
        filled_rows = self._read(indices, count, 1, index_kind)[:, 0].astype(np.int64)
        if count and (filled_rows.max() >= len(values) or (np.diff(filled_rows) <= 0).any()):
            raise DataError(f"sparse indices: expected rising ones below {len(values)}", where=indices.where)
        filled = values.copy()
        filled[filled_rows] = self._read(changes, count, values.shape[1], kind)
        return filled


def parse_gltf(data: bytes, fetch: Fetch, *, every_extension: bool = True) -> Gltf:
    """Read a GLB or a glTF document with its buffers.

    Parameters
    ----------
    data : bytes
    fetch : callable
        Reads the files that it names.
    every_extension : bool
        Whether all extensions that it requires must be supported.

    Raises
    ------
    TruncatedError
        If bytes are missing.
    UnsupportedError
        If the document requires an extension that is not supported.
    DataError
        If it is not valid glTF 2.0; ``where`` is the place in the document.
    """
    if not data:
        raise DataError("glTF: is empty", where="byte 0")
    if other := find_other(data):
        raise DataError(f"glTF: got {other}", where="byte 0")
    text, binary = _unpack(data) if data[:4] == MAGIC else (data, b"")
    root = parse_json(text, "glTF")
    version = root.item("asset").string("version", "")
    if not version.startswith(f"{VERSION}."):
        raise DataError(f"asset.version: got {version!r}, expected {VERSION}.x", where="asset")
    for name in root.strings("extensionsRequired") if every_extension else ():
        if name not in SUPPORTED and not name.startswith(HARMLESS):
            raise UnsupportedError(f"extension: got {name}, which is not supported", where="extensionsRequired")
    buffers = []
    for number, item in enumerate(root.items("buffers")):
        if "uri" not in item and item.item("extensions").item(MESHOPT).flag("fallback"):
            buffers.append(b"")  # a placeholder: its views refer to compressed bytes elsewhere
            continue
        content = fetch_uri(item.string("uri"), fetch, item.where) if "uri" in item or number else binary
        length = item.index("byteLength", 1 << 40)
        if len(content) < length:
            raise TruncatedError(f"buffer: got {len(content)} bytes, expected {length}", where=item.where)
        buffers.append(content)
    return Gltf(root, {kind: root.items(kind) for kind in KINDS}, tuple(buffers), fetch)


def stated_licences(root: Item) -> list[str]:
    """What a document says about its licence, each once, the most exact first; one empty text if it says nothing.

    These are the licence, the copyright and the authors of VRM 1.0, VRM 0.x and the asset itself.
    """
    extensions, asset = root.item("extensions"), root.item("asset")
    new, old = extensions.item("VRMC_vrm").item("meta"), extensions.item("VRM").item("meta")
    stated = (
        new.text("otherLicenseUrl"),
        new.text("copyrightInformation"),
        new.text("licenseUrl"),  # the same in each valid file
        old.text("licenseName"),
        old.text("otherLicenseUrl"),
        asset.text("copyright"),
        *new.strings("authors"),
        old.text("author"),
    )
    return [text for text in dict.fromkeys(stated) if text] or [""]


def text_of_gltf(data: bytes) -> bytes:
    """JSON chunk of a GLB, or a glTF document itself.

    Raises
    ------
    TruncatedError
        If bytes are missing.
    DataError
        If it is a GLB without one.
    """
    return _unpack(data)[0] if data[:4] == MAGIC else data


def fetch_uri(uri: str, fetch: Fetch, where: str) -> bytes:
    """Content of a ``data:`` URI, or of a file relative to the document."""
    if not uri.startswith("data:"):
        return fetch(unquote(uri))
    head, comma, body = uri.partition(",")
    if not comma or not head.endswith(";base64"):
        raise DataError(f"uri: got {uri[:40]!r}, expected base64 data", where=where)
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as error:
        raise DataError(f"uri: is not base64 ({error})", where=where) from error


def split_glb(data: bytes) -> list[tuple[int, bytes]]:
    """Chunks of a GLB in their order: kind and content of each.

    Raises
    ------
    TruncatedError
        If bytes are missing.
    DataError
        If it is not GLB 2.
    """
    if len(data) < HEADER:
        raise TruncatedError(f"GLB: got {len(data)} bytes, expected a header of {HEADER}")
    version, length = struct.unpack_from("<II", data, 4)
    if version != VERSION:
        raise DataError(f"GLB: got version {version}, expected {VERSION}", where="byte 4")
    if length > len(data):
        raise TruncatedError(f"GLB: got {len(data)} bytes, expected {length}", where="byte 8")
    chunks: list[tuple[int, bytes]] = []
    at = HEADER
    while at + CHUNK_HEADER <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += CHUNK_HEADER
        if at + size > length:
            raise TruncatedError(f"GLB chunk: got {length - at} bytes, expected {size}", where=f"byte {at}")
        chunks.append((kind, data[at : at + size]))
        at += size
    return chunks


def _unpack(data: bytes) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a GLB."""
    chunks = dict(reversed(split_glb(data)))  # the first one of a kind counts
    if JSON_CHUNK not in chunks:
        raise DataError("GLB: contains no JSON chunk", where=f"byte {HEADER}")
    return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK, b"")
