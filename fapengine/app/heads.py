"""Heads from any name: built-in, a style, the folder of a head, or a mesh file."""

from pathlib import Path

from fapengine._strict_toml import checked
from fapengine.files.heads.built import load_built
from fapengine.files.heads.load import DEFAULT_HEAD
from fapengine.files.heads.load import load_head as load_by_name
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh


@checked
def load_head(
    name: str | Path | HeadStyle = DEFAULT_HEAD, *, points: str | Path | None = None, mapping: str | Path | None = None
) -> FaceMesh:
    """Load a head.

    Parameters
    ----------
    name : str, Path or HeadStyle
        ``"default"`` is the built-in head, ``"default:age=0.8"`` or a :class:`HeadStyle` the same with another look.
        Else a
        folder from ``fapengine head import``, a profile with a dense face, or a mesh file (.glb, .gltf, .vrm; with
        ``points`` also .obj, .ply, .stl), which is imported.
    points : str or Path, optional
        Table of feature points of a mesh file; required if it has no blendshapes.
    mapping : str or Path, optional
        Table (.toml) of the meaning of other blendshape names.

    Returns
    -------
    FaceMesh
        Vertices in mm of the standard face.

    Raises
    ------
    UsageError
        If there is no such folder, file or look, or points for a mesh without blendshapes are missing.
    DataError
        If a file's content is wrong, or no face can be made from it.
    ResourceError
        If trimesh is needed and not installed.
    """
    if isinstance(name, HeadStyle):
        return load_built(name)
    path = Path(name)
    if points is not None:
        from fapengine.files.heads.dense import is_profile, load_dense_head

    if points is not None and is_profile(path):
        return load_dense_head(path, Path(points))[0].mesh
    if path.is_file() or points is not None or mapping is not None:
        from fapengine.files.heads.import_file import import_head_file  # much of scipy, for files alone

        return import_head_file(path, Path(points) if points else None, Path(mapping) if mapping else None)[0].mesh
    return load_by_name(str(name))
