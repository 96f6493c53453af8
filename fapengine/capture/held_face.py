"""A face that a detector saw, with its head held still: landmarks of a film in the head's own axes, mm.

Theory of operation
-------------------
Landmarks are those of MediaPipe's face mesh (:data:`FACE_MESH`): 478 points, in pixels, with a depth of the same scale
that is guessed from one picture; or the 68 of OpenFace (:data:`FACE_68`). Points that no expression moves tell where
the head is: their mean shape over the film is the head, and each frame's scale, turn and place are taken out. The
distance of the pupils is what the caller says, which makes millimetres. Frames in which no face is seen are filled in
from those beside them.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError
from fapengine.geometry.rigid import RigidMotion, fit_rigid, fit_template

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FaceModel:
    """What a detector's landmarks are."""

    count: int
    steady: tuple[int, ...]
    """Landmarks that no expression moves."""
    pupils: tuple[tuple[int, ...], tuple[int, ...]]
    """Landmarks between which the right and the left pupil lie."""
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
"""Share of the frames in which a face must be seen."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldFace:
    """Landmarks of a head that stands still, and what it did. Arrays are read-only."""

    still_mm: Array
    """(T, N, 3): to the subject's left, up, out of the face."""
    turns: Array
    """(T, 3, 3): rotation of the head from its mean pose, in the same axes."""
    poses: Array
    """(T, 3, 3): the same against the camera: a head that looks into it is not turned. Where up is, is a guess."""
    seen: NDArray[np.bool_]
    """(T,): frames in which a face was seen."""


def hold_face(times_s: Array, landmarks: ArrayLike, *, pupils_mm: float, model: FaceModel = FACE_MESH) -> HeldFace:
    """Take the head's motion out of landmarks.

    Parameters
    ----------
    times_s : (T,) float64, s
        Rising, from 0.
    landmarks : (T, N, 3) array_like, px or mm
        To the right, down, and away from the camera; NaN where no face was seen.
    pupils_mm : float
        Distance of the pupils.
    model : FaceModel
        Whose landmarks they are.

    Raises
    ------
    DataError
        If a face is seen in less than half of the frames, or in fewer than two.
    """
    points = frozen(landmarks, "landmarks", ("T", model.count, 3), np.float64, finite=False)
    seen = ~np.isnan(points).any(axis=(1, 2))
    if seen.sum() < 2 or seen.mean() < MIN_SEEN_SHARE:
        raise DataError(f"film: got a face in {int(seen.sum())} of {len(seen)} frames, expected one in most of them")
    head, fit = _steadied(_filled(times_s, points, seen), model)
    still = np.einsum("tij,tnj->tni", fit.rotation, head) + fit.translation_mm[:, None]
    upright, scale = _upright(still, model), _scale(still, model, pupils_mm)
    turns = np.swapaxes(fit.rotation @ np.linalg.inv(_mean_rotation(fit.rotation)), 1, 2)
    poses = np.swapaxes(upright @ fit.rotation, 1, 2)
    return HeldFace(scale * still @ upright.T, upright @ turns @ upright.T, poses, seen)


@dataclass(frozen=True, slots=True, eq=False)
class KnownHead:
    """A head that was seen before: what :func:`hold_face` finds in a whole film, for frames that come one by one."""

    model: FaceModel
    steady: Array
    """(K, 3): its points that no expression moves, of size 1."""
    upright: Array
    """(3, 3): turns those axes into the head's."""
    scale: float
    """Millimetres of size 1."""

    def hold(self, landmarks: ArrayLike) -> tuple[Array, Array]:
        """Hold frames still: (T, N, 3) landmarks as of :func:`hold_face`, a face in each.

        Returns
        -------
        still_mm : (T, N, 3)
        poses : (T, 3, 3)
            Both as of :class:`HeldFace`.
        """
        points = frozen(landmarks, "landmarks", ("T", self.model.count, 3), np.float64)
        head, fit = _steadied(points, self.model, self.steady)
        still = np.einsum("tij,tnj->tni", fit.rotation, head) + fit.translation_mm[:, None]
        return self.scale * still @ self.upright.T, np.swapaxes(self.upright @ fit.rotation, 1, 2)


def learn_head(landmarks: ArrayLike, *, pupils_mm: float, model: FaceModel = FACE_MESH) -> KnownHead:
    """Learn a head from frames that show it: (T, N, 3) landmarks as of :func:`hold_face`, a face in each."""
    points = frozen(landmarks, "landmarks", ("T", model.count, 3), np.float64)
    head, fit = _steadied(points, model)
    still = np.einsum("tij,tnj->tni", fit.rotation, head) + fit.translation_mm[:, None]
    steady = still[:, model.steady].mean(axis=0)
    return KnownHead(model, steady, _upright(still, model), _scale(still, model, pupils_mm))


def _steadied(points: Array, model: FaceModel, template: Array | None = None) -> tuple[Array, RigidMotion]:
    """Points to the left, up, out of the face, of size 1 about 0; and the motions that lay them on the template."""
    head = points * (1.0, -1.0, -1.0)
    steady = head[:, model.steady]
    middle = steady.mean(axis=1, keepdims=True)
    size = np.sqrt(((steady - middle) ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    head = (head - middle) / size
    steady = head[:, model.steady]
    return head, fit_rigid(steady, fit_template(steady) if template is None else template)


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
    """Rotation (3, 3) that lays the eyes level and the forehead above the chin."""
    mean = still.mean(axis=0)
    right_eye, left_eye = (mean[list(corners)].mean(axis=0) for corners in model.corners)
    left, up = left_eye - right_eye, mean[model.top] - mean[model.chin]
    left /= np.linalg.norm(left)
    up -= (up @ left) * left
    up /= np.linalg.norm(up)
    return np.stack([left, up, np.cross(left, up)])
