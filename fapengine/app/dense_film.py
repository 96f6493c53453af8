"""Recorded takes on dense faces: the videos of papers 003 and 004."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fapengine._arrays import Array
from fapengine.app.dotted import MAX_WEIGHTS, dotted_mesh
from fapengine.app.drawing import on_one_axis
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.load import load_head_of_modes
from fapengine.files.recordings import is_table, load_markers
from fapengine.mesh.deform import Pose
from fapengine.mesh.face_mesh import FaceMesh

if TYPE_CHECKING:
    from fapengine.laboratory.dense_face import ModeRig
    from fapengine.laboratory.marker_driver import DrivenTake, Way

POSTURES = 40
"""Frames of a take that show which markers move together."""
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
    takes: Sequence[Path],
    heads: Sequence[str],
    *,
    way: "Way" = "estimator",
    still_head: bool = False,
    with_markers: bool = False,
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
    with_markers : bool
        True to show a take's markers, and the facets between them, to the left of its face: figure 5 of paper 003.

    Returns
    -------
    rate_hz : float
    meshes : list of FaceMesh
        From left to right.
    rows : list of list of Pose
        By frame, then by mesh.
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
    meshes: list[FaceMesh] = []
    columns: list[list[Pose]] = []
    rates: list[float] = []
    for path, name in zip(paths, names, strict=True):
        rig = loaded[name][1]
        driven = drive(path, rig, way)
        notes += [f"{path.name}: {note}" for note in driven.notes]
        shown = poses(rig, driven, still_head=still_head)
        if with_markers:
            sparse, weights = sparse_mesh(rig, driven)
            meshes.append(sparse)
            columns.append([Pose(row, pose.bones) for row, pose in zip(weights, shown, strict=True)])
            rates.append(driven.rate_hz)
        meshes.append(moved[name])
        columns.append(shown)
        rates.append(driven.rate_hz)
    rate_hz, sampled = on_one_axis(list(map(len, columns)), rates)
    rows = [[column[row] for column, row in zip(columns, frame, strict=True)] for frame in zip(*sampled, strict=True)]
    return rate_hz, meshes, rows, notes


def sparse_mesh(rig: "ModeRig", driven: "DrivenTake") -> tuple[FaceMesh, Array]:
    """Make a mesh of a take's markers and the facets between them, and its (T, W) weights.

    The weights are those of the principal components of the take, as many as a renderer takes: all of the motion, or
    all but what cannot be seen.
    """
    from fapengine.models.dense import sparse_facets

    places = rig.scale * driven.markers_mm @ rig.axes.T + rig.origin_mm
    mean, moved = places.mean(axis=0), (places - places.mean(axis=0)).reshape(len(places), -1)
    modes = np.linalg.eigh(moved.T @ moved)[1].T[-MAX_WEIGHTS:]
    moves = modes.reshape(len(modes), *mean.shape)
    facets = sparse_facets(places[:: max(1, len(places) // POSTURES)])
    return dotted_mesh((mean, moves), facets, (mean, moves), np.zeros(len(mean), bool)), moved @ modes.T
