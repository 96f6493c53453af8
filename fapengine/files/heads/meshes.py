"""Faces from files: glTF, GLB, VRM and ICT-FaceKit's folders with blendshapes, and any mesh without."""

from pathlib import Path

from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.gltf.document import Fetch, parse_gltf
from fapengine.files.gltf.images import MAX_PIXELS
from fapengine.files.gltf.scene import read_scene
from fapengine.files.heads.ict_facekit import load_ict_folder
from fapengine.files.mesh_colours import find_paint
from fapengine.files.paths import read_bytes
from fapengine.laboratory.setup import Paint
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

RIG_ENDINGS = (".glb", ".gltf", ".vrm")


def is_rig(path: Path) -> bool:
    """Whether a path may hold a mesh with blendshapes."""
    return path.suffix.lower() in RIG_ENDINGS or path.is_dir()


def load_rig(path: Path) -> BlendshapeMesh:
    """Read a mesh and its blendshapes.

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
        return load_ict_folder(path)
    if path.suffix.lower() not in RIG_ENDINGS:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(RIG_ENDINGS)} or a folder")
    try:
        return read_scene(parse_gltf(read_bytes(path), files_beside(path)))
    except DataError as error:
        raise type(error)(error.message, where=f"{path}: {error.where}" if error.where else str(path)) from error


def files_beside(path: Path) -> Fetch:
    """Make what reads the files that a document names: those in its own folder, and below it."""

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

    return fetch


def load_neutral(path: Path) -> BlendshapeMesh:
    """Read a mesh without blendshapes, with its colours.

    Returns
    -------
    BlendshapeMesh
        Vertices in the file's order, units and axes; its texture, or the colours of its vertices, where it has any.

    Raises
    ------
    UsageError
        If it cannot be read or its ending is unknown.
    DataError
        If it holds no mesh, or a texture too large to be read again.
    ResourceError
        If trimesh is not installed.
    """
    from fapengine.files.recordings import MESHES, load_mesh

    if path.suffix.lower() not in MESHES:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(MESHES)}")
    vertices, triangles, visual = load_mesh(path)
    paint = find_paint(visual, len(vertices)) or Paint()
    if paint.texture is not None and paint.texture.shape[0] * paint.texture.shape[1] > MAX_PIXELS:
        size = f"{paint.texture.shape[1]}x{paint.texture.shape[0]}"
        raise UnsupportedError(f"texture: got {size} pixels, expected at most {MAX_PIXELS}", where=str(path))
    return BlendshapeMesh(
        vertices=vertices, triangles=triangles, blendshapes={}, texture=paint.texture, uv=paint.uv, albedo=paint.albedo
    )
