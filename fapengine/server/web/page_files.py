"""Data that the page loads before it renders: shaders, FAPs with their sliders, expressions, cameras; and a head.

A head is one file whose arrays can be uploaded without a copy. Little-endian: ``FAPHEAD1``, the length of a JSON text
(uint32), the text, zeros up to a multiple of 16; then the arrays, each at the next multiple of 16. The text lists the
arrays with kind, shape and offset from the start of the file, and the values of a frame's uniforms: attributes, table
of channels, pivots and FAPU. :class:`fapengine.render.packing.PackedMesh` describes the arrays.

Built-in heads are made by child processes of high niceness, one at a time, so that no face waits for them.
"""

import asyncio
import gzip
import json
import struct
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._child import NICENESS, Child, Parent, command, end_soon_with_parent
from fapengine.engine import commands
from fapengine.engine.command_table import Command, fields_of
from fapengine.errors import ResourceError
from fapengine.expressions import EXPRESSION_NAMES
from fapengine.mesh.default_head.style import PEOPLE
from fapengine.mesh.deform import (
    LIDS,
    LIMITS,
    LIPS,
    PARTED,
    PARTED_FAPU,
    RESTING,
    SMILE_FAPU,
    SMILING,
    UPPER_SHARE,
)
from fapengine.mesh.face_mesh import PUPIL_SHARE, FaceMesh, lid_share
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FapSpec, FapUnit
from fapengine.render import programs
from fapengine.render.camera import PRESETS
from fapengine.render.drawing import EDGES
from fapengine.render.packed import packed_mesh
from fapengine.render.packing import ATTRIBUTE_SIZES, PUPIL_RANGE
from fapengine.speaking import DEFAULT_RATE_WPM, RATES_WPM

MAGIC = b"FAPHEAD1"
ALIGNMENT = 16
_KINDS = {"float32": "<f4", "float64": "<f8", "uint32": "<u4", "uint8": "u1"}
GROUP_NAMES = {
    2: "Jaw, chin and inner lips", 3: "Eyes", 4: "Brows", 5: "Cheeks", 6: "Tongue", 7: "Head", 8: "Outer lips",
    9: "Nose", 10: "Ears",
}  # fmt: skip
"""Groups of Table C.1 with their names on the page."""
REACH: dict[FapUnit, int] = {
    FapUnit.MNS: 700, FapUnit.MW: 300, FapUnit.ES: 200, FapUnit.ENS: 300, FapUnit.IRISD: 1000, FapUnit.AU: 50_000,
}  # fmt: skip
"""Range of a slider, FAPU: about that of a human face; the standard's limits are several times as large."""
OWN_REACH = {
    3: 1400, 14: 300, 15: 200, 21: 500, 22: 500, 29: 400, 30: 400, 44: 500, 46: 500, 47: 90_000,
}  # fmt: skip
"""FAP numbers with a range other than that of their unit."""
HEAD_REACH_DEG = {"yaw_rad": 45, "pitch_rad": 30, "roll_rad": 30}
"""Range of the sliders that turn the head, about that of a neck without effort."""
PAGE_WALL = (0.058, 0.066, 0.078)
"""Linear RGB of the wall behind the face, the background colour of the page."""
PAGE_CAMERAS = ("front", "three-quarter", "profile", "mouth")
"""Cameras with a button and a digit key each."""
UNUSED = ("wire", "enlarge", "planes")
"""Programs that the page does not use."""


def setup(*, voices: dict[str, str], rate_wpm: int = DEFAULT_RATE_WPM) -> dict[str, Any]:
    """Return the data, which can be written as JSON.

    Parameters
    ----------
    voices : dict of str to str
        Language codes and names of the server's voices.
    rate_wpm : int
        Speaking rate of the server's voice, words per minute.
    """
    stages = {
        " ".join((name, *defined)): {
            "vertex": programs.stage_source(vertex, programs.ES_HEADER, defined),
            "fragment": programs.stage_source(fragment, programs.ES_HEADER, defined),
        }
        for name, (vertex, fragment) in programs.STAGES.items()
        for defined in programs.VARIANTS.get(name, ((),))
        if name not in UNUSED and programs.PICTURE not in defined
    }
    turns = fields_of(commands.TurnHead)
    return {
        "programs": stages,
        "parts": {name: part._asdict() for name, part in programs.PARTS.items()},
        "max_fine_edge_px": programs.MAX_FINE_EDGE_PX,
        "skin_level_bias": programs.SKIN_LEVEL_BIAS,
        "fine_samples": EDGES["fine"],
        "wall": PAGE_WALL,
        "rest": [[list(rest.values.items()), rest.yields_to, rest.limit] for rest in RESTING],
        "smile": [[corner, *SMILE_FAPU, list(values.items())] for corner, values in SMILING],
        "parted": [PARTED, PARTED_FAPU, UPPER_SHARE],
        "lips": LIPS,
        "limits": list(LIMITS.items()),
        "lids": LIDS,
        "groups": [{"name": name, "faps": [_slider(row) for row in fap.FAPS if row.group == group]}
                   for group, name in GROUP_NAMES.items()],
        "ranges": {kind.SPEC.json: _ranges(kind) for kind in commands.COMMANDS if kind.SPEC.json},
        "head": [
            {"name": turns[name].json, "positive": turns[name].doc, "reach": reach}
            for name, reach in HEAD_REACH_DEG.items()
        ],
        "expressions": list(EXPRESSION_NAMES),
        "cameras": {
            name: {"yaw": camera.yaw_deg, "pitch": camera.pitch_deg, "target": camera.target_mm,
                   "distance": camera.distance_mm, "field": camera.field_deg}
            for name, camera in ((name, PRESETS[name]) for name in PAGE_CAMERAS)
        },
        "voices": voices,
        "rates": {"low": RATES_WPM[0], "high": RATES_WPM[1], "usual": rate_wpm},
        "heads": {"": "The server's", **{name: name.capitalize() for name in PEOPLE}},
    }  # fmt: skip


def _ranges(kind: type[Command]) -> dict[str, dict[str, float]]:
    """Return the finite ranges of a command's numbers."""
    specs = (spec for spec in fields_of(kind).values() if spec.json and isfinite(spec.high - spec.low))
    return {spec.json: {"low": spec.low, "high": spec.high} for spec in specs}


def _slider(row: FapSpec) -> dict[str, Any]:
    reach = OWN_REACH.get(row.number, LIMITS.get(row.number, REACH[row.unit]))
    reach = min(reach, row.intra_limit * row.quantiser_step)
    return {
        "number": row.number, "name": row.name, "unit": row.unit.value, "positive": row.positive.value,
        "low": -reach if row.bidirectional else 0, "high": reach,
    }  # fmt: skip


def head_binary(mesh: FaceMesh) -> bytes:
    """Write a head for the page. The result is deterministic.

    Raises UsageError if the mesh has more channels than the shaders have room for.
    """
    packed = packed_mesh(mesh)
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
        "attributes": list(ATTRIBUTE_SIZES.items()), "iris": packed.iris, "irisAlbedo": packed.iris_albedo.tolist(),
        "edge": packed.edge_mm, "texelsPerMm": packed.texels_per_mm, "pupilShare": PUPIL_SHARE,
        "lid": lid_share(mesh), "pupilRange": PUPIL_RANGE, "jawPivot": mesh.jaw_pivot_mm.tolist(),
        "headPivot": mesh.head_pivot_mm.tolist(), "eyePivots": mesh.eye_pivots_mm.tolist(),
        "chin": mesh.point_mm("2.1").tolist(), "units": {unit.value: mesh.fapu.unit(unit) for unit in FapUnit},
    }  # fmt: skip
    return _file(about, arrays)


def _file(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    places: dict[str, Any] = {}
    text = b""
    for _ in range(4):  # the text has the offsets, which depend on its length: settled after two or three rounds
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


class Heads:
    """Heads by name, compressed; only the latest is kept. Stateful; close it."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._latest: tuple[str, bytes] = "", b""
        self._child: Child | None = None
        self._is_closed = False

    async def packed(self, name: str) -> bytes:
        """Return the file of a head (:mod:`.page_files`), compressed by gzip.

        Raises ResourceError if its process cannot be started, or has ended.
        """
        async with self._turn:
            if self._is_closed:
                raise ResourceError("head: the server stops")
            if self._latest[0] != name:
                self._child = Child("head", command(__name__, name, niceness=NICENESS))
                try:
                    self._latest = name, (await asyncio.to_thread(self._child.ask, {}))[1]
                except EOFError as error:
                    raise ResourceError("head: its process has ended") from error
                finally:
                    self._child.close()
            return self._latest[1]

    def close(self) -> None:
        """End the process that makes a head."""
        self._is_closed = True
        if self._child is not None:
            self._child.close()


def main(parent: Parent, name: str) -> None:
    """Make the head; the child's program."""
    from fapengine.files.heads.load import load_head
    from fapengine.server.web.page_files import head_binary

    end_soon_with_parent()
    for _ in parent.messages():
        parent.tell({}, gzip.compress(head_binary(load_head(name)), 6, mtime=0))
