"""Faces from files: glTF, GLB, VRM and ICT-FaceKit's folders with blendshapes, and any mesh without."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.gltf.document import Fetch, parse_gltf
from fapengine.files.gltf.images import MAX_PIXELS
from fapengine.files.gltf.scene import read_scene
from fapengine.files.heads.ict_facekit import load_ict_folder
from fapengine.files.paths import read_bytes
from fapengine.files.recordings import MESHES, load_mesh
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
    if path.suffix.lower() not in MESHES:
        raise UsageError(f"{path}: got ending {path.suffix!r}, expected one of {', '.join(MESHES)}")
    vertices, triangles, visual = load_mesh(path)
    texture, uv = _texture(visual, len(vertices))
    if texture is not None and texture.shape[0] * texture.shape[1] > MAX_PIXELS:
        size = f"{texture.shape[1]}x{texture.shape[0]}"
        raise UnsupportedError(f"texture: got {size} pixels, expected at most {MAX_PIXELS}", where=str(path))
    albedo = None if texture is not None else _albedo(visual)
    return BlendshapeMesh(vertices=vertices, triangles=triangles, blendshapes={}, texture=texture, uv=uv, albedo=albedo)


def _texture(visual: Any, count: int) -> tuple[NDArray[np.uint8] | None, NDArray[np.float64] | None]:
    """Picture and places in it of a mesh with one material; trimesh counts v from below."""
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None or uv is None or np.shape(uv) != (count, 2) or not np.isfinite(uv).all():
        return None, None
    return np.asarray(image.convert("RGBA"), np.uint8), np.asarray(uv, np.float64) * [1.0, -1.0] + [0.0, 1.0]


def _albedo(visual: Any) -> NDArray[np.float64] | None:
    """Linear RGB of each vertex; None where the file says nothing about colour."""
    coloured = visual.to_color() if hasattr(visual, "to_color") else visual
    if not getattr(coloured, "defined", False):  # a material whose picture is not there has no colours either
        return None
    srgb = np.asarray(coloured.vertex_colors, np.float64)[:, :3] / 255.0
    if np.ptp(srgb, axis=0).max() == 0.0:
        return None  # one colour for all is a default, not a painting
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
