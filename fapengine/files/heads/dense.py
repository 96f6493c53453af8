"""Dense faces of profiles, as heads."""

from pathlib import Path

from fapengine.errors import DataError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.folder import TOML_NAME as HEAD_NAME
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.tables import load_feature_points
from fapengine.files.paths import read_bytes
from fapengine.laboratory.dense_face import DenseFace, ModeRig, make_dense_head
from fapengine.laboratory.dense_file import ARRAYS_NAME, TOML_NAME, parse_dense
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.rig.import_head import ImportedHead
from fapengine.profiles import TOML_NAME as PROFILE_NAME

ADAPTED = "head"
"""Folder, within a profile, of the built-in head adapted to its dense face."""


def is_profile(folder: Path) -> bool:
    """Whether a folder is a profile, with or without a dense face."""
    return (folder / PROFILE_NAME).is_file() or (folder / TOML_NAME).is_file()


def adapted_in(folder: Path) -> Path | None:
    """Find the built-in head adapted to a profile's dense face; None without one."""
    head = folder / ADAPTED
    return head if is_profile(folder) and (head / HEAD_NAME).is_file() else None


def load_dense(folder: Path) -> DenseFace:
    """Read the dense face of a profile.

    Raises
    ------
    UsageError
        If the profile has none.
    ProfileError
        If its content is wrong; ``where`` is the file.
    """
    if not (folder / TOML_NAME).is_file():
        older = ", or fit it anew: an earlier fapengine wrote its dense.npz" if (folder / ARRAYS_NAME).is_file() else ""
        raise UsageError(f"{folder}: has no dense face ({TOML_NAME}); expected a profile fitted with [[scan]]{older}")
    try:
        return parse_dense({name: read_bytes(folder / name) for name in (TOML_NAME, ARRAYS_NAME)})
    except DataError as error:
        raise type(error)(error.message, where=f"{folder}/{error.where}") from error


def dense_info(folder: Path) -> HeadInfo:
    """Origin of a dense face, without making a head from it. Raises as :func:`load_dense`."""
    face = load_dense(folder)
    return HeadInfo(f"dense face of {face.subject}", face.licence)


def load_dense_head(folder: Path, points: Path | None = None) -> tuple[ImportedHead, ModeRig, HeadInfo]:
    """Make a head from the dense face of a profile.

    ``points`` is a table of feature points, in the vertices of the reference scan or in mm of the dense face.

    Raises
    ------
    UsageError
        As :func:`load_dense`, or if the table cannot be read.
    DataError
        If no head can be made from it; ``where`` is the folder.
    """
    face = load_dense(folder)
    marked = load_feature_points(points, face.neutral_face_mm, face.triangles) if points else {}
    try:
        imported, rig = make_dense_head(face, load_built(HeadStyle()), marked)
    except DataError as error:
        raise type(error)(error.message, where=str(folder)) from error
    return imported, rig, HeadInfo(f"dense face of {face.subject}", face.licence, imported.used)
