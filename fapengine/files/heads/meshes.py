"""Faces from files: glTF, GLB, VRM and ICT-FaceKit's folders with blendshapes, and other meshes without."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UnsupportedError, UsageError, as_data_error
from fapengine.files.gltf.document import Fetch, parse_gltf
from fapengine.files.gltf.scene import read_scene
from fapengine.files.paths import locating, read_bytes
from fapengine.files.pictures import MAX_PIXELS
from fapengine.files.recordings import MESHES, find_paint, library_of, load_textured
from fapengine.laboratory.setup import Paint
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh

NEUTRAL_NAMES = ("generic_neutral_mesh.obj", "neutral.obj")
IDENTITY = "identity"
MIN_MOTION_SHARE = 1e-6
"""Displacement of a vertex, as a fraction of the mesh's size, that is more than rounding."""
ICT_VERTICES = 26719
ICT_SURFACES = (
    ("Face", 9409), ("Head and neck", 11248), ("Mouth socket", 13294), ("Eye socket left", 13678),
    ("Eye socket right", 14062), ("Gums and tongue", 17039), ("Teeth", 21451), ("Eyeball left", 23021),
    ("Eyeball right", 24591), ("Tear fluid left", 24795), ("Tear fluid right", 24999), ("Eye blend", 25047),
    ("Eye occlusion", 25351), ("Eyelashes", 26719),
)  # fmt: skip
"""Parts of ICT-FaceKit's mesh in order, and the vertex after the last of each."""
ICT_TRANSLUCENT = ("Tear fluid", "Eye blend", "Eye occlusion")


def load_ict_folder(folder: Path) -> BlendshapeMesh:
    """Read a folder of OBJ files, as ICT-FaceKit has it: a neutral face, and one file per blendshape.

    Raises
    ------
    UsageError
        If a file cannot be read, or there is no neutral face.
    DataError
        If the content of a file is wrong; ``where`` is file and line.
    """
    meshes = sorted(path for path in folder.glob("*.[oO][bB][jJ]") if path.is_file())
    named = {path.name.lower(): path for path in meshes}
    neutral = next((named[name] for name in NEUTRAL_NAMES if name in named), None)
    if neutral is None:
        raise UsageError(f"{folder}: contains no {' or '.join(NEUTRAL_NAMES)}; expected a folder as of ICT-FaceKit")
    vertices, triangles, surface, names = _obj(neutral)
    source, paint = np.arange(len(vertices)), Paint()
    if b"map_Kd" in library_of(read_bytes(neutral), neutral):
        _, triangles, paint, source = _painted(neutral)
    still = MIN_MOTION_SHARE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    blendshapes = {}
    for path in meshes:
        if path == neutral or path.name.startswith(IDENTITY):
            continue
        moved = _vertices(read_bytes(path), str(path))
        if len(moved) != len(vertices):
            raise DataError(
                f"OBJ: got {len(moved)} vertices, expected {len(vertices)} as in {neutral.name}", where=str(path)
            )
        moves = (moved - vertices)[source]
        kept = np.flatnonzero(np.abs(moves).max(axis=1) > still)
        blendshapes[path.stem] = Blendshape(kept, moves[kept])
    notes: tuple[str, ...] = ()
    if len(vertices) == ICT_VERTICES:
        ends = [end for _, end in ICT_SURFACES]
        surface, names = np.searchsorted(ends, np.arange(len(vertices)), side="right"), [n for n, _ in ICT_SURFACES]
    surface = surface[source]
    hidden = [number for number, name in enumerate(names) if name.startswith(ICT_TRANSLUCENT)]
    if hidden:
        triangles = triangles[~np.isin(surface[triangles[:, 0]], hidden)]
        notes = tuple(f"{names[number]}: left out, as it is translucent" for number in hidden)
    return BlendshapeMesh(
        vertices=vertices[source], triangles=triangles, blendshapes=blendshapes, surfaces=tuple(names), surface=surface,
        notes=notes, texture=paint.texture, uv=paint.uv, albedo=paint.albedo,
    )  # fmt: skip


def _vertices(data: bytes, where: str) -> NDArray[np.float64]:
    """(V, 3): vertices of an OBJ file."""
    rows = [line.split()[1:4] for line in data.splitlines() if line[:2] in (b"v ", b"v\t")]
    try:
        vertices = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise DataError(f"OBJ: got vertices that are not three numbers ({error})", where=where) from error
    if not len(vertices) or not np.isfinite(vertices).all():
        raise DataError(f"OBJ: got {len(vertices)} vertices, expected finite ones, 1 or more", where=where)
    return vertices


def _obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], list[str]]:
    """Vertices, triangles, the surface of each vertex, and the names of surfaces (materials, groups or objects)."""
    data = read_bytes(path)
    vertices = _vertices(data, str(path))
    surface, names, current = np.zeros(len(vertices), np.int64), [""], 0
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(data.splitlines(), 1):
        word, _, rest = line.partition(b" ")
        if word in (b"usemtl", b"g", b"o"):
            name = rest.strip().decode("utf-8", "replace")
            names += [] if name in names else [name]
            current = names.index(name)
        elif word == b"f":
            try:
                corners = [int(corner.partition(b"/")[0]) for corner in rest.split()]
            except ValueError:
                corners = []
            corners = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
            if len(corners) < 3 or not all(0 <= corner < len(vertices) for corner in corners):
                raise DataError(
                    f"OBJ face: got {rest[:40]!r}, expected 3 or more indices of 1 to {len(vertices)}",
                    where=f"{path}, line {number}",
                )
            surface[corners] = current
            triangles += [(corners[0], second, third) for second, third in pairwise(corners[1:])]
    if not triangles:
        raise DataError("OBJ: contains no face", where=str(path))
    return vertices, np.array(triangles, np.int64), surface, names


RIG_ENDINGS = (".glb", ".gltf", ".vrm")


def is_rig(path: Path) -> bool:
    """Whether a path may hold a mesh with blendshapes."""
    return path.suffix.lower() in RIG_ENDINGS or path.is_dir()


def load_rig(path: Path) -> BlendshapeMesh:
    """Read a mesh and its blendshapes.

    Raises
    ------
    UsageError
        If it cannot be read or has another ending.
    UnsupportedError
        If it requires an extension that is not supported.
    DataError
        If its content is wrong; ``where`` is file and place.
    """
    if path.is_dir():
        return load_ict_folder(path)
    if path.suffix.lower() not in RIG_ENDINGS:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(RIG_ENDINGS)} or a folder")
    with locating(path, ": "):
        return read_scene(parse_gltf(read_bytes(path), files_beside(path)))


def files_beside(path: Path) -> Fetch:
    """Return a function that reads the files that a document names, which are in its folder or below."""

    def fetch(name: str) -> bytes:
        try:
            beside = (path.parent / name).resolve()
        except (ValueError, RuntimeError) as error:  # a NUL in the name; a circle of links
            raise DataError(f"uri: got {name!r}, expected a file's name ({error})") from error
        if not beside.is_relative_to(path.parent.resolve()):
            raise DataError(f"uri: got {name!r}, expected a file in the folder of {path.name}")
        with as_data_error("uri: "):
            return read_bytes(beside)

    return fetch


def load_neutral(path: Path) -> BlendshapeMesh:
    """Read a mesh without blendshapes, with its colours.

    Returns
    -------
    BlendshapeMesh
        Vertices in the file's order, units and axes, then copies along the seams of its texture; that texture, or the
        colours of its vertices, if any.

    Raises
    ------
    UsageError
        If it cannot be read or its ending is unknown.
    DataError
        If it contains no mesh, or a texture that is too large.
    ResourceError
        If trimesh is not installed.
    """
    if path.suffix.lower() not in MESHES:
        expected = ", ".join(dict.fromkeys((*MESHES, *RIG_ENDINGS)))
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {expected}")
    vertices, triangles, paint, _ = _painted(path)
    return BlendshapeMesh(
        vertices=vertices, triangles=triangles, blendshapes={}, texture=paint.texture, uv=paint.uv, albedo=paint.albedo
    )


def _painted(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], Paint, NDArray[np.int64]]:
    """Vertices, (N, 3), triangles and colours of a mesh, and the vertex of the file that each is, (N,)."""
    vertices, triangles, visual, source = load_textured(path)
    paint = find_paint(visual, len(vertices)) or Paint()
    if paint.texture is not None and paint.texture.shape[0] * paint.texture.shape[1] > MAX_PIXELS:
        size = f"{paint.texture.shape[1]}x{paint.texture.shape[0]}"
        raise UnsupportedError(f"texture: got {size} pixels, expected at most {MAX_PIXELS}", where=str(path))
    return vertices, triangles, paint, source
