"""Dense faces of profiles, as heads."""

from pathlib import Path

from fapengine.errors import UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.folder import TOML_NAME as HEAD_NAME
from fapengine.files.heads.folder import HeadInfo
from fapengine.files.heads.tables import load_feature_points
from fapengine.files.paths import locating, read_bytes
from fapengine.laboratory.dense_face import DenseFace, ModeRig, make_dense_head
from fapengine.laboratory.dense_file import ARRAYS_NAME, TOML_NAME, parse_dense
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.rig.import_head import ImportedHead
from fapengine.profiles import TOML_NAME as PROFILE_NAME

ADAPTED = "head"
"""Folder in a profile with the built-in head adapted to its dense face."""


def is_profile(folder: Path) -> bool:
    """Whether a folder is a profile, with or without a dense face."""
    return (folder / PROFILE_NAME).is_file() or (folder / TOML_NAME).is_file()


def adapted_in(folder: Path) -> Path | None:
    """Find the built-in head adapted to a profile's dense face; None without one."""
    head = folder / ADAPTED
    return head if is_profile(folder) and (head / HEAD_NAME).is_file() else None


def load_dense(folder: Path, points: Path | None = None) -> tuple[DenseFace, dict[str, int]]:
    """Read the dense face of a profile, and a table of feature points on it.

    ``points`` are in the vertices of the reference scan, or in mm of the dense face.

    Raises
    ------
    UsageError
        If the profile has no dense face, or a file cannot be read.
    ProfileError
        If its content is wrong; ``where`` is the file.
    DataError
        If the table is wrong.
    """
    if not (folder / TOML_NAME).is_file():
        older = (
            ", or fit it again: an earlier fapengine wrote its dense.npz" if (folder / ARRAYS_NAME).is_file() else ""
        )
        raise UsageError(f"{folder}: has no dense face ({TOML_NAME}); expected a profile fitted with [[scan]]{older}")
    with locating(folder, "/"):
        face = parse_dense({name: read_bytes(folder / name) for name in (TOML_NAME, ARRAYS_NAME)})
    return face, load_feature_points(points, face.neutral_face_mm, face.triangles) if points else {}


def dense_info(face: DenseFace, used: tuple[str, ...] = ()) -> HeadInfo:
    """Origin of a dense face; ``used`` are the blendshapes of the head made from it."""
    return HeadInfo(f"dense face of {face.subject}", face.licence, used)


def load_dense_head(folder: Path, points: Path | None = None) -> tuple[ImportedHead, ModeRig, HeadInfo]:
    """Make a head from the dense face of a profile.

    Parameters and errors are those of :func:`load_dense`; raises DataError if no head can be made from it.
    """
    face, marked = load_dense(folder, points)
    with locating(folder):
        imported, rig = make_dense_head(face, load_built(MEASURED), marked)
    return imported, rig, dense_info(face, imported.used)
