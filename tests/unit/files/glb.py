"""Writes glTF for tests: a small builder, and a whole mesh with shapes."""

import base64
import io
import json
import struct
from typing import Any

import numpy as np
from PIL import Image

from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """Stateful: a document and its one buffer."""

    def __init__(self) -> None:
        self.blob = bytearray()
        self.doc: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [],
        }  # fmt: skip

    def row(self, kind: str, value: dict[str, Any]) -> int:
        self.doc.setdefault(kind, []).append(value)
        return len(self.doc[kind]) - 1

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        row = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)} | more
        self.blob += data
        return self.row("bufferViews", row)

    def accessor(self, array: Any, kind: str = "f4", **more: Any) -> int:
        values = np.asarray(array, kind)
        width = 1 if values.ndim == 1 else values.shape[1]
        row = {"bufferView": self.view(values.tobytes()), "componentType": KINDS[kind], "count": len(values)}
        if kind == "f4" and width == 3 and len(values):
            row |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self.row("accessors", row | {"type": TYPES[width]} | more)

    def sparse(self, count: int, at: Any, values: Any, kind: str = "u4") -> int:
        whole = np.zeros((count, 3), "f4")
        whole[np.asarray(at, int)] = values
        row: dict[str, Any] = {
            "componentType": 5126, "count": count, "type": "VEC3",
            "min": whole.min(axis=0).tolist(), "max": whole.max(axis=0).tolist(),
        }  # fmt: skip
        if len(at):
            row["sparse"] = {
                "count": len(at),
                "indices": {"bufferView": self.view(np.asarray(at, kind).tobytes()), "componentType": KINDS[kind]},
                "values": {"bufferView": self.view(np.asarray(values, "f4").tobytes())},
            }
        return self.row("accessors", row)

    def image(self, pixels: Any) -> int:
        buffer = io.BytesIO()
        Image.fromarray(np.asarray(pixels, np.uint8)).save(buffer, "PNG")
        image = self.row("images", {"bufferView": self.view(buffer.getvalue()), "mimeType": "image/png"})
        return self.row("textures", {"source": image})

    def node(self, *, shown: bool = True, **fields: Any) -> int:
        number = self.row("nodes", fields)
        if shown:
            self.doc["scenes"][0]["nodes"].append(number)
        return number

    def glb(self) -> bytes:
        doc = self.doc | {"buffers": [{"byteLength": len(self.blob)}]}
        text = json.dumps(doc).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.blob) + bytes(-len(self.blob) % 4)
        length = 12 + 8 + len(text) + 8 + len(binary)
        return (
            struct.pack("<4sII", b"glTF", 2, length)
            + struct.pack("<II", len(text), 0x4E4F534A) + text
            + struct.pack("<II", len(binary), 0x004E4942) + binary
        )  # fmt: skip

    def gltf(self, uri: str | None = None) -> bytes:
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(bytes(self.blob)).decode()
        return json.dumps(self.doc | {"buffers": [{"byteLength": len(self.blob), "uri": uri}]}).encode()


def square(builder: Builder, *, indices: str = "u2", targets: tuple[str, ...] = ("rise",), **primitive: Any) -> int:
    """Add a mesh: a unit square of two triangles; each target lifts one corner by 1."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    rows = []
    for number in range(len(targets)):
        lifted = np.zeros((4, 3))
        lifted[number, 2] = 1.0
        rows.append({"POSITION": builder.accessor(lifted)})
    item = {
        "attributes": {"POSITION": builder.accessor(corners)},
        "indices": builder.accessor([0, 1, 2, 0, 2, 3], indices),
        "targets": rows,
    }
    return builder.row("meshes", {"primitives": [item | primitive], "extras": {"targetNames": list(targets)}})


def write_rig(mesh: BlendshapeMesh, *, indices: str = "u4", matrix: Any = None, material: Any = None) -> Builder:
    """Write a mesh with its shapes, a mesh for each of its surfaces, whose vertices it alone has."""
    builder = Builder()
    surface = mesh.surface if mesh.surface is not None else np.zeros(len(mesh.vertices), int)
    for number, name in enumerate(mesh.surfaces or ("Head",)):
        triangles = mesh.triangles[surface[mesh.triangles[:, 0]] == number]
        if not len(triangles):
            continue
        used, corners = np.unique(triangles, return_inverse=True)
        attributes = {"POSITION": builder.accessor(mesh.vertices[used])}
        if mesh.uv is not None:
            attributes["TEXCOORD_0"] = builder.accessor(mesh.uv[used])
        if mesh.albedo is not None:
            attributes["COLOR_0"] = builder.accessor(mesh.albedo[used])
        targets = []
        for shape in mesh.blendshapes.values():
            mine = np.isin(shape.vertices, used)
            at = np.searchsorted(used, shape.vertices[mine])
            targets.append({"POSITION": builder.sparse(len(used), at, shape.moves[mine])})
        item: dict[str, Any] = {
            "attributes": attributes, "indices": builder.accessor(corners.ravel(), indices), "targets": targets,
        }  # fmt: skip
        if material is not None:
            item["material"] = material
        row = builder.row(
            "meshes", {"name": name, "primitives": [item], "extras": {"targetNames": list(mesh.blendshapes)}}
        )
        builder.node(name=name, mesh=row, **({} if matrix is None else {"matrix": matrix}))
    return builder
