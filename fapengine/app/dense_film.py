"""Recorded takes on dense faces, and markers as dots that move: the videos of papers 003 and 004."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices
from fapengine.app.drawing import on_one_axis
from fapengine.errors import UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.load import load_head_of_modes
from fapengine.files.paths import locating
from fapengine.files.recordings import is_table, load_markers
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.deform import BONE_COUNT, Pose
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh, Material

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
    with locating(path):
        return rig.driver.follow(recording.markers, way)


def takes_on_heads(
    takes: Sequence[Path],
    heads: Sequence[str],
    *,
    way: "Way" = "estimator",
    still_head: bool = False,
    with_markers: bool = False,
) -> tuple[float, list[FaceMesh], list[list[Pose]], list[str]]:
    """Apply takes to dense faces, side by side: at the highest rate, until the longest ends.

    Raises UsageError if a take is not a marker recording, or a head has no modes; DataError if a take does not show the
    face.

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


LARGE, SMALL, SKIN = (0.75, 0.06, 0.04), (0.9, 0.9, 0.9), (0.50, 0.30, 0.22)
"""Linear RGB of large and small dots, and of the surface."""
DOT_MM = {True: 2.6, False: 1.2}
"""Radius of a large and of a small dot."""
OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
FACETS = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
MAX_WEIGHTS = 128
"""Weights that a renderer takes."""
WIDEST_MM = 170.0
"""Width of a face that fills the image."""
PLACE_MM = np.array([0.0, 20.0, 60.0])
"""Position of the middle of a face without a head, head space."""
MOVED_BONES = np.tile(np.eye(4), (BONE_COUNT, 1, 1))
"""Bones of a head that keeps still."""


def fitting(surface_mm: Array) -> tuple[float, Array]:
    """Scale and shift, (3,) mm, that put a surface, (N, 3) mm, into the image."""
    scale = min(1.0, WIDEST_MM / max(float(np.ptp(surface_mm[:, 0])), 1e-9))
    return scale, PLACE_MM - scale * surface_mm.mean(axis=0)


def dotted_mesh(
    surface: tuple[Array, Array], triangles: Indices, dots: tuple[Array, Array], is_large: NDArray[np.bool_]
) -> FaceMesh:
    """Make a mesh that W weights move, and the head's bone.

    Parameters
    ----------
    surface : (N, 3) and (W, N, 3) mm
        Vertices at rest in head space, and how far each weight moves them.
    triangles : (F, 3)
        Of the surface, counter-clockwise seen from outside.
    dots : (D, 3) and (W, D, 3) mm
        The same of the dots.
    is_large : (D,)
        Large dots are red.
    """
    sizes = np.where(is_large, DOT_MM[True], DOT_MM[False])
    balls = (dots[0][:, None] + sizes[:, None, None] * OCTAHEDRON).reshape(-1, 3)
    vertices = np.concatenate([surface[0], balls])
    corners = np.concatenate(
        [triangles, (len(surface[0]) + 6 * np.arange(len(dots[0]))[:, None, None] + FACETS).reshape(-1, 3)]
    )
    moves = np.concatenate([surface[1], np.repeat(dots[1], 6, axis=1)], axis=1)
    colours = np.repeat(np.where(is_large[:, None], LARGE, SMALL), 6, axis=0)
    total, width = len(vertices), len(moves)
    return FaceMesh(
        vertices_mm=vertices.astype(np.float32),
        normals=vertex_normals(vertices, corners).astype(np.float32),
        uv=np.zeros((total, 2), np.float32),
        albedo=np.concatenate([np.tile(SKIN, (len(surface[0]), 1)), colours]).astype(np.float32),
        material=np.full(total, Material.SKIN, np.uint8),
        occlusion=np.ones(total, np.float32),
        bone=np.zeros(total, np.uint8),
        bone_weight=np.zeros(total, np.float32),
        head_weight=np.ones(total, np.float32),
        triangles=corners.astype(np.int32),
        feature_points={},
        jaw_pivot_mm=np.zeros(3),
        head_pivot_mm=np.zeros(3),
        eye_pivots_mm=np.zeros((2, 3)),
        fapu=load_built(MEASURED).fapu,
        basis=DeformationBasis(
            channels=(Channel(3, -np.inf, np.inf),),
            offsets=(width * np.arange(total + 1)).astype(np.int32),
            entry_channels=np.tile(np.arange(width), total).astype(np.int32),
            entry_mm=moves.swapaxes(0, 1).reshape(-1, 3).astype(np.float32),
            mix=np.zeros((width, 1), np.float32),
        ),
    )
