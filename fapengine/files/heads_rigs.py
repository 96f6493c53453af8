"""Meshes with shapes from files: glTF, GLB and VRM, and ICT-FaceKit's folders; and what a mapping file says of shapes.

ICT-FaceKit's layout: a folder with ``generic_neutral_mesh.obj`` and an ``.obj`` of the same vertices for each
expression, named after it (``browDown_L.obj``); ``identity000.obj`` and on are other people and are left alone.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._toml import parse_toml
from fapengine.errors import DataError, UsageError
from fapengine.files.gltf import parse_gltf
from fapengine.files.gltf_scene import read_scene
from fapengine.files.paths import read_bytes
from fapengine.mesh.morphs import MorphMesh, Shape
from fapengine.mpeg4 import fap

RIGS = (".glb", ".gltf", ".vrm")
NEUTRAL = ("generic_neutral_mesh.obj", "neutral.obj")
IDENTITY = "identity"
STILL_SHARE = 1e-6
"""Of the mesh's size: what moves less does not move."""
ICT_VERTICES = 26719
ICT_SURFACES = (
    ("Face", 9409), ("Head and neck", 11248), ("Mouth socket", 13294), ("Eye socket left", 13678),
    ("Eye socket right", 14062), ("Gums and tongue", 17039), ("Teeth", 21451), ("Eyeball left", 23021),
    ("Eyeball right", 24591), ("Tear fluid left", 24795), ("Tear fluid right", 24999), ("Eye blend", 25047),
    ("Eye occlusion", 25351), ("Eyelashes", 26719),
)  # fmt: skip
"""Parts of ICT-FaceKit's mesh in its order, and the vertex where each ends."""
ICT_TRANSLUCENT = ("Tear fluid", "Eye blend", "Eye occlusion")


def is_rig(path: Path) -> bool:
    """Whether a path may hold a mesh with shapes."""
    return path.suffix.lower() in RIGS or path.is_dir()


def load_rig(path: Path) -> MorphMesh:
    """Read a mesh and its shapes.

    Raises
    ------
    UsageError
        If it cannot be read or is of no kind that is known.
    UnsupportedError
        If it is compressed, or requires another extension that is not understood.
    DataError
        If its content is wrong; ``where`` is file and place.
    """
    if path.is_dir():
        return _ict(path)
    if path.suffix.lower() not in RIGS:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(RIGS)} or a folder")

    def fetch(name: str) -> bytes:
        try:
            beside = (path.parent / name).resolve()
        except (ValueError, RuntimeError) as error:  # a NUL in the name; links that lead in a circle
            raise DataError(f"uri: got {name!r}, expected a file's name ({error})") from error
        if not beside.is_relative_to(path.parent.resolve()):
            raise DataError(f"uri: got {name!r}, expected a file in the folder of {path.name}")
        try:
            return read_bytes(beside)
        except UsageError as error:
            raise DataError(f"uri: {error}") from error

    try:
        return read_scene(parse_gltf(read_bytes(path), fetch))
    except DataError as error:
        raise type(error)(error.message, where=f"{path}: {error.where}" if error.where else str(path)) from error


def load_mapping(path: Path) -> dict[str, str | dict[int, float]]:
    """Read what shapes mean: a table ``[shapes]`` of ARKit's, Oculus' or VRM's names, ``unused``, or FAPs.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If it is wrong; ``where`` is file and key.
    """
    table = parse_toml(read_bytes(path), str(path))
    shapes = table.table("shapes")
    table.finish()
    found: dict[str, str | dict[int, float]] = {}
    for name in shapes:
        if shapes.is_table(name):
            faps = shapes.table(name)
            found[name] = {_fap(key, faps.where(key)): _value(faps.take(key, float), faps.where(key)) for key in faps}
            if not found[name]:
                raise shapes.fail(name, "got no FAP, expected some")
        else:
            found[name] = shapes.take(name, str)
    return found


def _fap(key: str, where: str) -> int:
    numbers = {row.name: row.number for row in fap.FAPS} | {str(row.number): row.number for row in fap.FAPS}
    if numbers.get(key, 0) < 3:
        raise DataError(f"got {key!r}, expected a FAP by number, 3..68, or by name", where=where)
    return numbers[key]


def _value(value: float, where: str) -> float:
    if not (np.isfinite(value) and value != 0.0):
        raise DataError(f"got {value}, expected FAPU at the shape's full weight, not 0", where=where)
    return value


def _ict(folder: Path) -> MorphMesh:
    neutral = next((folder / name for name in NEUTRAL if (folder / name).is_file()), None)
    if neutral is None:
        raise UsageError(f"{folder}: got no {NEUTRAL[0]}, expected a folder as ICT-FaceKit has it")
    vertices, triangles, surface, names = _obj(neutral)
    still = STILL_SHARE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    shapes = {}
    for path in sorted(folder.glob("*.obj")):
        if path == neutral or path.name.startswith(IDENTITY):
            continue
        there = _vertices(read_bytes(path), str(path))
        if len(there) != len(vertices):
            raise DataError(
                f"OBJ: got {len(there)} vertices, expected {len(vertices)} as in {neutral.name}", where=str(path)
            )
        moves = there - vertices
        kept = np.flatnonzero(np.abs(moves).max(axis=1) > still)
        shapes[path.stem] = Shape(kept, moves[kept])
    notes: tuple[str, ...] = ()
    if len(vertices) == ICT_VERTICES:
        ends = [end for _, end in ICT_SURFACES]
        surface, names = np.searchsorted(ends, np.arange(len(vertices)), side="right"), [n for n, _ in ICT_SURFACES]
    hidden = [number for number, name in enumerate(names) if name.startswith(ICT_TRANSLUCENT)]
    if hidden:
        triangles = triangles[~np.isin(surface[triangles[:, 0]], hidden)]
        notes = tuple(f"{names[number]}: left out, as it is translucent" for number in hidden)
    return MorphMesh(
        vertices=vertices, triangles=triangles, shapes=shapes, surfaces=tuple(names), surface=surface, notes=notes
    )


def _vertices(data: bytes, where: str) -> NDArray[np.float64]:
    """(V, 3): places of an OBJ file."""
    rows = [line.split()[1:4] for line in data.splitlines() if line[:2] in (b"v ", b"v\t")]
    try:
        vertices = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise DataError(f"OBJ: got vertices that are not three numbers ({error})", where=where) from error
    if not len(vertices) or not np.isfinite(vertices).all():
        raise DataError(f"OBJ: got {len(vertices)} vertices, expected some, all finite", where=where)
    return vertices


def _obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], list[str]]:
    """Places, triangles, and the surface of each vertex by the materials' names."""
    data = read_bytes(path)
    vertices = _vertices(data, str(path))
    surface, names, now = np.zeros(len(vertices), np.int64), [""], 0
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(data.splitlines(), 1):
        word, _, rest = line.partition(b" ")
        if word in (b"usemtl", b"g", b"o"):
            name = rest.strip().decode("utf-8", "replace")
            names += [] if name in names else [name]
            now = names.index(name)
        elif word == b"f":
            try:
                corners = [int(corner.partition(b"/")[0]) for corner in rest.split()]
            except ValueError as error:
                raise DataError(
                    f"OBJ face: got {rest[:40]!r}, expected indices", where=f"{path}, line {number}"
                ) from error
            corners = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
            if len(corners) < 3 or not all(0 <= corner < len(vertices) for corner in corners):
                raise DataError(
                    f"OBJ face: got {rest[:40]!r}, expected 3 or more of 1..{len(vertices)}",
                    where=f"{path}, line {number}",
                )
            surface[corners] = now
            triangles += [(corners[0], one, other) for one, other in pairwise(corners[1:])]
    if not triangles:
        raise DataError("OBJ: got no face, expected some", where=str(path))
    return vertices, np.array(triangles, np.int64), surface, names
