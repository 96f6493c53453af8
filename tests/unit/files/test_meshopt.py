"""EXT_meshopt_compression: what meshoptimizer packs is unpacked to the byte, and any bytes are read or refused."""

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import DataError
from fapengine.files.gltf.compression import decode_meshopt
from fapengine.files.gltf.document import parse_gltf
from tests.unit.files.glb import Builder

VECTORS = json.loads((Path(__file__).parents[2] / "vectors" / "gltf" / "meshopt.json").read_text())


def unpacked(vector: dict[str, Any], data: bytes) -> bytes:
    told = {"mode": vector["mode"], "count": vector["count"], "stride": vector["stride"]}
    return decode_meshopt(data, **told, filter_name=vector["filter"], where="")


@pytest.mark.parametrize("vector", VECTORS, ids=lambda one: f"{one['mode']} {one['filter']} {one['stride']}")
def test_its_own_decoder_gives_the_same(vector: dict[str, Any]) -> None:
    packed = bytes.fromhex(vector["packed"])
    assert unpacked(vector, packed).hex() == vector["unpacked"]
    for cut in range(0, len(packed), 7):
        with pytest.raises(DataError):
            unpacked(vector, packed[:cut])


def test_every_mode_and_filter_is_there() -> None:
    assert {(one["mode"], one["filter"]) for one in VECTORS} == {
        ("ATTRIBUTES", "NONE"), ("ATTRIBUTES", "OCTAHEDRAL"), ("ATTRIBUTES", "QUATERNION"),
        ("ATTRIBUTES", "EXPONENTIAL"), ("TRIANGLES", "NONE"), ("INDICES", "NONE"),
    }  # fmt: skip


@settings(max_examples=150)
@given(st.sampled_from(VECTORS), st.integers(0, 10**4), st.integers(0, 255), st.integers(1, 10**6))
def test_any_bytes_are_read_or_refused(vector: dict[str, Any], at: int, byte: int, count: int) -> None:
    damaged = bytearray.fromhex(vector["packed"])
    damaged[at % len(damaged)] = byte
    for asked in (vector["count"], count):
        with contextlib.suppress(DataError):
            unpacked({**vector, "count": asked}, bytes(damaged))


def test_a_packed_view_is_an_accessor_s() -> None:
    vector = next(one for one in VECTORS if one["filter"] == "EXPONENTIAL")
    builder = Builder()
    view = builder.view(bytes.fromhex(vector["packed"]))
    row = dict(builder.doc["bufferViews"][view])
    packed = {"buffer": 0, "byteStride": 12, "count": 40, "mode": "ATTRIBUTES", "filter": "EXPONENTIAL"}
    packed |= {"byteOffset": row["byteOffset"], "byteLength": row["byteLength"]}
    builder.doc["bufferViews"][view] = {
        "buffer": 0, "byteLength": 480, "byteStride": 12, "extensions": {"EXT_meshopt_compression": packed},
    }  # fmt: skip
    builder.row("accessors", {"bufferView": view, "componentType": 5126, "count": 40, "type": "VEC3"})
    builder.doc["extensionsRequired"] = ["EXT_meshopt_compression"]
    gltf = parse_gltf(builder.glb(), lambda _: b"")
    assert gltf.accessor(0).astype("<f4").tobytes().hex() == vector["unpacked"]
