"""Landmarks from a video with head motion removed: the face in the head's own axes, mm.

Theory of operation
-------------------
Landmarks are those of MediaPipe's face mesh (:data:`FACE_MESH`): 478 points, in pixels, with a depth of the same scale
inferred from one image; or the 68 of OpenFace (:data:`FACE_68`). Points that no expression moves give the head pose:
their mean shape over the video is the head, and scale, rotation and position of each frame are removed. The pupil
distance, given by the caller, converts to millimetres. Frames without a face are interpolated.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, frozen
from fapengine.errors import DataError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_template


@dataclass(frozen=True, slots=True)
class FaceModel:
    """Layout of a detector's landmarks."""

    count: int
    steady: tuple[int, ...]
    """Landmarks that no expression moves."""
    pupils: tuple[tuple[int, ...], tuple[int, ...]]
    """Landmarks whose mean is the right and the left pupil."""
    corners: tuple[tuple[int, int], tuple[int, int]]
    """Corners of the right and the left eye."""
    top: int
    chin: int


PUPILS = (468, 473)
"""Right and left iris of the face mesh."""
FACE_MESH = FaceModel(
    478,
    # corners of the eyes, the nose's ridge, the forehead and the temples
    (33, 133, 263, 362, 168, 6, 197, 195, 8, 9, 10, 151, 127, 356, 54, 284),
    ((PUPILS[0],), (PUPILS[1],)),
    ((33, 133), (263, 362)),
    10,
    152,
)
FACE_MESH_468 = replace(FACE_MESH, count=468, pupils=FACE_MESH.corners)
"""The same without irises."""
FACE_68 = FaceModel(68, (27, 28, 29, 30, 36, 39, 42, 45, 0, 16), ((36, 39), (42, 45)), ((36, 39), (42, 45)), 27, 8)
MIN_SEEN_SHARE = 0.5
"""Fraction of the frames in which a face must be found."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldFace:
    """Landmarks with head motion removed, and that motion. Arrays are read-only."""

    still_mm: Array
    """(T, N, 3): to the subject's left, up, out of the face."""
    turns: Array
    """(T, 3, 3): rotation of the head from its mean pose, in the same axes."""
    poses: Array
    """(T, 3, 3): rotation relative to the camera; identity if the head faces it. The upright direction is estimated."""
    seen: NDArray[np.bool_]
    """(T,): frames in which a face was found."""


def hold_face(times_s: Array, landmarks: ArrayLike, *, pupils_mm: float, model: FaceModel = FACE_MESH) -> HeldFace:
    """Remove head motion from landmarks.

    Parameters
    ----------
    times_s : (T,) float64, s
        Rising, from 0.
    landmarks : (T, N, 3) array_like, px or mm
        To the right, down, and away from the camera; NaN where no face was found.
    pupils_mm : float
        Distance between the pupils.
    model : FaceModel
        Layout of the landmarks.

    Raises
    ------
    DataError
        If a face is found in fewer than half of the frames, or in fewer than two.
    """
    points = frozen(landmarks, "landmarks", ("T", model.count, 3), np.float64, finite=False)
    seen = ~np.isnan(points).any(axis=(1, 2))
    if seen.sum() < 2 or seen.mean() < MIN_SEEN_SHARE:
        raise DataError(f"video: only {int(seen.sum())} of {len(seen)} frames show a face; most must")
    still, fit = _steadied(_filled(times_s, points, seen), model)
    upright, scale = _upright(still, model), _scale(still, model, pupils_mm)
    turns = np.swapaxes(fit.rotation @ np.linalg.inv(_mean_rotation(fit.rotation)), 1, 2)
    poses = np.swapaxes(upright @ fit.rotation, 1, 2)
    return HeldFace(scale * still @ upright.T, upright @ turns @ upright.T, poses, seen)


@dataclass(frozen=True, slots=True, eq=False)
class KnownHead:
    """A head learned in advance: frames can then be processed one at a time, as :func:`hold_face` does a video."""

    model: FaceModel
    steady: Array
    """(K, 3): its points that no expression moves, normalised to size 1."""
    upright: Array
    """(3, 3): rotates those axes to the head's."""
    scale: float
    """Millimetres per unit of size."""

    def hold(self, landmarks: ArrayLike) -> tuple[Array, Array]:
        """Remove head motion from frames, (T, N, 3) landmarks as for :func:`hold_face`, each with a face.

        Returns
        -------
        still_mm : (T, N, 3)
        poses : (T, 3, 3)
            Both as in :class:`HeldFace`.
        """
        points = frozen(landmarks, "landmarks", ("T", self.model.count, 3), np.float64)
        still, fit = _steadied(points, self.model, self.steady)
        return self.scale * still @ self.upright.T, np.swapaxes(self.upright @ fit.rotation, 1, 2)


def learn_head(landmarks: ArrayLike, *, pupils_mm: float, model: FaceModel = FACE_MESH) -> KnownHead:
    """Learn a head from frames, (T, N, 3) landmarks as for :func:`hold_face`, each with a face."""
    points = frozen(landmarks, "landmarks", ("T", model.count, 3), np.float64)
    still, _ = _steadied(points, model)
    steady = still[:, model.steady].mean(axis=0)
    return KnownHead(model, steady, _upright(still, model), _scale(still, model, pupils_mm))


def _steadied(points: Array, model: FaceModel, template: Array | None = None) -> tuple[Array, RigidMotion]:
    """Points to the left, up, out of the face, of size 1 about 0, without head motion; and the motions that do it."""
    head = points * (1.0, -1.0, -1.0)
    steady = head[:, model.steady]
    middle = steady.mean(axis=1, keepdims=True)
    size = np.sqrt(((steady - middle) ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    head = (head - middle) / size
    steady = head[:, model.steady]
    fit = fit_rigid(steady, fit_template(steady) if template is None else template)
    return np.einsum("tij,tnj->tni", fit.rotation, head) + fit.translation_mm[:, None], fit


def _scale(still: Array, model: FaceModel, pupils_mm: float) -> float:
    apart = np.linalg.norm(np.subtract(*(still[:, eye].mean(axis=1) for eye in model.pupils)), axis=1)
    return float(pupils_mm / np.median(apart))


def _filled(times_s: Array, points: Array, seen: NDArray[np.bool_]) -> Array:
    flat = points.reshape(len(points), -1)
    columns = [np.interp(times_s, times_s[seen], column[seen]) for column in flat.T]
    return np.stack(columns, axis=1).reshape(points.shape)


def _mean_rotation(rotations: Array) -> Array:
    u, _, v = np.linalg.svd(rotations.mean(axis=0))
    mean: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return mean


def _upright(still: Array, model: FaceModel) -> Array:
    """Rotation (3, 3) that makes the eyes level and puts the forehead above the chin."""
    mean = still.mean(axis=0)
    right_eye, left_eye = (mean[list(corners)].mean(axis=0) for corners in model.corners)
    left, up = left_eye - right_eye, mean[model.top] - mean[model.chin]
    left /= np.linalg.norm(left)
    up -= (up @ left) * left
    up /= np.linalg.norm(up)
    return np.stack([left, up, np.cross(left, up)])
