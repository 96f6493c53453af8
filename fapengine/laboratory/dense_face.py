"""The dense face that a fit has learned, with all that papers 003 and 004 need to move it.

:mod:`.dense_file` writes and reads it; :func:`make_dense_head` makes a head of it, moved by FAPs and takes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices, freeze
from fapengine.errors import DataError, UsageError
from fapengine.geometry.rigid import RigidMotion
from fapengine.laboratory.marker_driver import DrivenTake, MarkerDriver, SessionMarkers
from fapengine.laboratory.setup import Paint
from fapengine.mesh.deform import BONE_COUNT, HEAD, Pose
from fapengine.mesh.face_mesh import Channel, DeformationBasis, FaceMesh
from fapengine.mesh.rig.blendshape_basis import ROW_FAPU, USUAL_WEIGHT
from fapengine.mesh.rig.blendshape_mesh import Blendshape, BlendshapeMesh
from fapengine.mesh.rig.import_head import ImportedHead, import_head
from fapengine.models.dense import DenseModes, LinearEstimator

NEAR_MM = 8.0
"""Distance from its marker within which a feature point's vertex is looked for; without one, the nearest is used."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DenseFace(SessionMarkers):
    """Dense vertices, their origin, and the markers that drive them. Arrays are read-only."""

    subject: str
    licence: str
    modes: DenseModes
    """Paper 003, section 4: moved by the weights of ``sparse``."""
    estimator: LinearEstimator
    """Paper 004: all modes that the scans span."""
    triangles: Indices
    """(F, 3): of the reference scan."""
    paint: Paint | None
    noise_mm: float
    left_out_mm: tuple[float, float]
    """Mean vertex distance of a scan predicted from the others: dense modes, estimator."""
    scan_weights: Array
    """(S, J): weights of ``sparse`` in each scan."""
    take_weights: Mapping[str, Array] = field(default_factory=dict)
    """(T, J) by take: weights of ``sparse`` in each frame."""

    def __post_init__(self) -> None:
        SessionMarkers.__post_init__(self)
        vertices, weights = len(self.estimator.mean_face_mm), len(self.sparse.modes_mm)
        freeze(self, scan_weights=("S", weights))
        freeze(self, np.int64, triangles=("F", 3))
        paint = self.paint or Paint()
        for name, got, expected in (
            ("estimator markers", self.estimator.mean_markers_mm, len(self.labels)),
            ("vertices of the modes", self.modes.mean_mm, vertices),
            ("dense modes", self.modes.modes_mm, weights),
            ("paint: vertices", paint.uv, vertices),
            ("paint: vertices", paint.albedo, vertices),
        ):
            if got is not None and len(got) != expected:
                raise UsageError(f"{name}: got {len(got)}, expected {expected}")
        if self.triangles.size and not 0 <= self.triangles.min() <= self.triangles.max() < vertices:
            raise UsageError(f"triangles: must have vertices 0 to {vertices - 1}")
        if not (self.estimator.variances > 0).all():
            raise UsageError("variances: must be positive")

    @property
    def deviations_mm(self) -> Array:
        """(K,): standard deviation of each of the estimator's modes over the scans."""
        return np.asarray(np.sqrt(self.estimator.variances))

    @property
    def neutral_face_mm(self) -> Array:
        """(V, 3): the dense face at the neutral pose of the markers."""
        return self.estimator.faces_mm(self.neutral_mm)

    def faces_mm(self, weights: Array) -> Array:
        """(..., K) weights of a :class:`.marker_driver.DrivenTake` -> (..., V, 3) mm, head axes."""
        return self.neutral_face_mm + np.tensordot(weights * self.deviations_mm, self.estimator.modes, axes=1)

    def driver(self) -> MarkerDriver:
        """Return the driver that converts markers into weights of the estimator's modes."""
        rows = self.estimator.modes.reshape(len(self.deviations_mm), -1)
        neutral = self.estimator.coefficients(self.neutral_mm)
        off = (self.modes.mean_mm - self.estimator.mean_face_mm).reshape(-1)
        return MarkerDriver(
            **{shared.name: getattr(self, shared.name) for shared in fields(SessionMarkers)},
            matrix=self.estimator.matrix / self.deviations_mm[:, None],
            from_sparse=self.modes.modes_mm.reshape(len(self.modes.modes_mm), -1) @ rows.T / self.deviations_mm,
            offset=(rows @ off - neutral) / self.deviations_mm,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModeRig:
    """The modes on a head, in the head's space, and what drives them. Arrays are read-only."""

    driver: MarkerDriver
    modes_mm: NDArray[np.float32]
    """(K, V, 3): motion of the head's vertices by one standard deviation of each mode."""
    axes: Array
    """(3, 3): turns head axes of the session into the head's space."""
    scale: float
    """Millimetres of the head's space for one of the session's."""
    origin_mm: Array
    """(3,): the session's origin in the head's space."""

    def __post_init__(self) -> None:
        freeze(self, np.float32, modes_mm=(len(self.driver.matrix), "V", 3))
        freeze(self, axes=(3, 3), origin_mm=(3,))
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise UsageError(f"scale: must be a positive number, got {self.scale}")

    @property
    def names(self) -> list[str]:
        """(K,): names of the modes, those of their morph targets."""
        return mode_names(len(self.modes_mm))

    def head_transforms(self, motion: RigidMotion) -> Array:
        """(T, 4, 4): motion of the head, in the head's space."""
        turn = self.axes @ motion.rotation @ self.axes.T
        transforms = np.tile(np.eye(4), (len(turn), 1, 1))
        transforms[:, :3, :3] = turn
        transforms[:, :3, 3] = self.origin_mm - turn @ self.origin_mm + self.scale * motion.translation_mm @ self.axes.T
        return transforms


def moved_by_modes(mesh: FaceMesh, rig: ModeRig) -> FaceMesh:
    """Return the head driven by the weights of the modes themselves, ``ROW_FAPU`` for a standard deviation."""
    count, vertices = rig.modes_mm.shape[:2]
    if vertices != len(mesh.vertices_mm):
        raise UsageError(f"modes_mm: got {vertices} vertices, expected {len(mesh.vertices_mm)}, the head's")
    basis = DeformationBasis(
        channels=(Channel(3, -np.inf, np.inf),),
        offsets=count * np.arange(vertices + 1, dtype=np.int64),
        entry_channels=np.tile(np.arange(count), vertices),
        entry_mm=(rig.modes_mm / ROW_FAPU).swapaxes(0, 1).reshape(-1, 3),
        mix=np.zeros((count, 1), np.float32),
    )
    return replace(mesh, basis=basis)


def poses(rig: ModeRig, take: DrivenTake, *, still_head: bool = False) -> list[Pose]:
    """Poses of the head of :func:`moved_by_modes`, one for each frame of a take."""
    transforms = np.tile(np.eye(4), (len(take.weights), BONE_COUNT, 1, 1))
    if not still_head:
        transforms[:, HEAD] = rig.head_transforms(take.head)
    return [Pose(ROW_FAPU * weights, bones) for weights, bones in zip(take.weights, transforms, strict=True)]


def make_dense_head(
    face: DenseFace, standard: FaceMesh, points: Mapping[str, int] | None = None
) -> tuple[ImportedHead, ModeRig]:
    """Make a head of the dense face: its modes make the FAPs; fields of least bending add what the modes lack.

    Parameters
    ----------
    standard : FaceMesh
        Gives scale and axes.
    points : mapping of str to int, optional
        Vertices of further feature points, or in place of those that the markers show.
    """
    modes = face.deviations_mm[:, None, None] * face.estimator.modes
    names = mode_names(len(modes))
    shapes = [Blendshape(np.arange(modes.shape[1]), move / USUAL_WEIGHT) for move in modes]
    mesh, vertices = neutral_mesh(face, dict(zip(names, shapes, strict=True)), points)
    imported = import_head(mesh, names, vertices, standard)
    placed = imported.placed
    rig = ModeRig(
        driver=face.driver(),
        modes_mm=(placed.scale * modes[:, placed.kept] @ placed.rotation.T).astype(np.float32),
        axes=placed.rotation,
        scale=placed.scale,
        origin_mm=placed.to_head_space(np.zeros(3)),
    )
    return imported, rig


def mode_names(count: int) -> list[str]:
    """Names of modes as blendshapes."""
    return [f"mode {number + 1}" for number in range(count)]


def neutral_mesh(
    face: DenseFace, blendshapes: Mapping[str, Blendshape], points: Mapping[str, int] | None = None
) -> tuple[BlendshapeMesh, dict[str, int]]:
    """Mesh of the face in the neutral pose of the markers, with its colours, and the vertices of its feature points.

    Parameters
    ----------
    blendshapes : mapping of str to Blendshape
        Of the mesh; displacements (N, 3) mm.
    points : mapping of str to int, optional
        Vertices of more feature points; they replace those that the markers show.
    """
    neutral, chosen, paint = face.neutral_face_mm, dict(points or {}), face.paint or Paint()
    mesh = BlendshapeMesh(
        vertices=neutral, triangles=face.triangles, blendshapes=blendshapes,
        uv=paint.uv, texture=paint.texture, albedo=paint.albedo,
    )  # fmt: skip
    return mesh, _find_points(face, neutral, set(chosen.values())) | chosen


def _find_points(face: DenseFace, neutral_mm: Array, used: set[int]) -> dict[str, int]:
    """Find the vertices, of (V, 3) mm, of markers that are feature points: nearby, unused, and moving alike.

    Motion in each mode separates the lips where they touch.
    """
    found: dict[str, int] = {}
    for marker, point in enumerate(face.points):
        if not point:
            continue
        far = np.linalg.norm(neutral_mm - face.neutral_mm[marker], axis=1)
        near = np.flatnonzero(far <= max(NEAR_MM, 1.001 * far.min()))
        unlike = ((face.modes.modes_mm[:, near] - face.sparse.modes_mm[:, marker, None]) ** 2).sum(axis=(0, 2))
        for vertex in near[np.argsort(far[near] ** 2 + unlike, kind="stable")].tolist():
            if vertex not in used:
                used.add(vertex)
                found[point] = vertex
                break
    if not found:
        raise DataError("markers: contain no feature point; requires lips and chin", where=face.subject)
    return found
