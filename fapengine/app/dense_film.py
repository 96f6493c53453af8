"""Recorded takes on dense faces: the videos of papers 003 and 004."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fapengine.app.drawing import on_one_axis
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.load import load_head_of_modes
from fapengine.files.recordings import is_table, load_markers
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh

if TYPE_CHECKING:
    from fapengine.laboratory.dense_face import ModeRig
    from fapengine.laboratory.marker_driver import DrivenTake, Way

TAKES = (".c3d", ".trc", ".npz", ".tsv")
"""Endings of marker recordings; a .csv may be one."""


def is_take(path: Path) -> bool:
    """Whether a path is a marker recording, not FAPs or blendshapes."""
    return path.suffix.lower() in TAKES or is_table(path)


def drive(path: Path, rig: "ModeRig", way: "Way" = "estimator") -> "DrivenTake":
    """Drive the modes of a dense face by a recording.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If its content is wrong, or it does not show this face; ``where`` is the file.
    """
    recording = load_markers(path)
    try:
        return rig.driver.follow(recording.markers, way)
    except DataError as error:
        raise type(error)(error.message, where=f"{path}, {error.where}" if error.where else str(path)) from error


def takes_on_heads(
    takes: Sequence[Path], heads: Sequence[str], *, way: "Way" = "estimator", still_head: bool = False
) -> tuple[float, list[FaceMesh], list[list[Pose]], list[str]]:
    """Apply takes to dense faces, side by side: at the highest rate, until the longest ends.

    Parameters
    ----------
    takes, heads : sequence
        Of equal length, or one of either.
    way : str
        ``"estimator"`` (paper 004) or ``"modes"`` (paper 003).
    still_head : bool
        True to leave out head motion.

    Returns
    -------
    rate_hz : float
    meshes : list of FaceMesh
        Of each face.
    rows : list of list of Pose
        By frame, then by face.
    notes : list of str

    Raises
    ------
    UsageError
        If a take is not a marker recording, or a head has no modes.
    DataError
        If a take does not show the face.
    """
    from fapengine.laboratory.dense_face import moved_by_modes, poses  # much of scipy, for takes alone

    other = next((path for path in takes if not is_take(path)), None)
    if other is not None:
        raise UsageError(f"track: cannot show {other} together with a marker recording; use marker recordings only")
    loaded = {name: load_head_of_modes(name) for name in dict.fromkeys(heads)}
    moved = {name: moved_by_modes(mesh, rig) for name, (mesh, rig) in loaded.items()}
    count = max(len(takes), len(heads))
    paths = [*takes] * (count if len(takes) == 1 else 1)
    names = [*heads] * (count if len(heads) == 1 else 1)
    notes: list[str] = []
    columns: list[list[Pose]] = []
    rates: list[float] = []
    for path, name in zip(paths, names, strict=True):
        rig = loaded[name][1]
        driven = drive(path, rig, way)
        notes += [f"{path.name}: {note}" for note in driven.notes]
        columns.append(poses(rig, driven, still_head=still_head))
        rates.append(driven.rate_hz)
    rate_hz, shown = on_one_axis(list(map(len, columns)), rates)
    rows = [[column[row] for column, row in zip(columns, frame, strict=True)] for frame in zip(*shown, strict=True)]
    return rate_hz, [moved[name] for name in names], rows, notes
