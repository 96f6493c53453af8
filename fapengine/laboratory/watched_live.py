"""A face that is watched now: landmarks in as they come, FAPs out at any time. The caller has the clock.

Theory of operation
-------------------
What :mod:`.watched` finds in a whole film is found in what was seen so far. After :data:`FIRST_S` of a face, its
neutral pose is taken from these frames; every :data:`AGAIN_S` it is taken anew from the last :data:`KEPT_S`, for nobody
begins with a face at rest, or sits still. Two neutral poses are blended for :data:`BLEND_S`, so nothing jumps.

A face that is lost stays as it was for :data:`HOLD_S`, because a detector misses single frames, and then eases to rest;
when it is seen again, it eases back.
"""

from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.capture.held_face import FACE_MESH, FaceModel, KnownHead, learn_head
from fapengine.errors import DataError
from fapengine.laboratory.watched import RestingFace, faps_from_rest, points_of_face, resting_face
from fapengine.mpeg4 import fap
from fapengine.mpeg4.codable import to_codable

Array = NDArray[np.float64]

FIRST_S, AGAIN_S, KEPT_S = 1.5, 3.0, 30.0
"""Time of a face until its neutral pose is taken; interval at which it is taken again; time that it is taken from."""
KEEP_HZ = 15.0
"""Frames a second that are kept for it."""
BLEND_S = 1.0
HOLD_S, EASE_S = 0.2, 0.5
"""Time for which a lost face stays as it was, and in which it eases to rest, and back."""
GAZE = tuple(fap.column(number) for number in (23, 24, 25, 26))
PUPILS_MM = 62.0
"""An adult's pupils are so far apart; no FAP depends on it."""

Calibration = tuple[KnownHead, RestingFace]


class WatchedFace:
    """A face that is watched now; see the theory of operation.

    Stateful.

    Parameters
    ----------
    model : FaceModel
        Whose landmarks they are: of the face mesh, with irises or without.
    """

    def __init__(self, model: FaceModel = FACE_MESH) -> None:
        self._model = model
        self._kept: deque[tuple[float, Array]] = deque()
        self._known: Calibration | None = None
        self._before: Calibration | None = None
        self._known_since_s = -np.inf
        self._shown = np.zeros(fap.FAP_COUNT)
        self._gaze = np.zeros(len(GAZE))
        self._seen_s = -np.inf
        self._asked_s: float | None = None
        self._weight = 0.0
        self.calibrations = 0
        """Number of times that the neutral pose was taken."""

    @property
    def is_known(self) -> bool:
        """Whether the face at rest is known: before, it is shown at rest."""
        return self._known is not None

    def see(self, time_s: float, landmarks: ArrayLike) -> None:
        """Take a frame.

        Parameters
        ----------
        time_s : float
            When it was taken; rising.
        landmarks : (N, 3) array_like, px or mm
            To the right, down, and away from the camera; NaN where no face was seen.

        Raises
        ------
        UsageError
            If the number of landmarks is another.
        """
        points = frozen(landmarks, "landmarks", (self._model.count, 3), np.float64, finite=False)
        if not np.isfinite(points).all():
            return
        if not self._kept or time_s - self._kept[-1][0] >= 1 / KEEP_HZ - 1e-6:
            self._kept.append((time_s, points))
        while self._kept[0][0] < time_s - KEPT_S:
            self._kept.popleft()
        due_s = FIRST_S if self._known is None else AGAIN_S
        if time_s - max(self._kept[0][0], self._known_since_s) >= due_s - 1e-6:
            self._calibrate(time_s)
        if self._known is None:
            return
        faps = self._read(self._known, points)
        share = (time_s - self._known_since_s) / BLEND_S
        if self._before is not None and share < 1:
            faps = share * faps + (1 - share) * self._read(self._before, points)
        self._shown, self._seen_s = faps, time_s

    def faps(self, time_s: float) -> NDArray[np.int32]:
        """Return what is to be shown, (68,) int32 FAPU; times rise from call to call."""
        since_s = 0.0 if self._asked_s is None else max(time_s - self._asked_s, 0.0)
        self._asked_s = time_s
        way = 1 if time_s - self._seen_s <= HOLD_S else -1
        self._weight = float(np.clip(self._weight + way * since_s / EASE_S, 0.0, 1.0))
        eased = self._weight**2 * (3 - 2 * self._weight)
        values: NDArray[np.int32] = to_codable((eased * self._shown)[None])[0]
        return values

    def _calibrate(self, time_s: float) -> None:
        """Take the neutral pose from what is kept; a face that cannot be measured is looked at again later."""
        times, frames = zip(*self._kept, strict=True)
        rate_hz = (len(times) - 1) / (times[-1] - times[0])
        head = learn_head(np.stack(frames), pupils_mm=PUPILS_MM, model=self._model)
        still, poses = head.hold(np.stack(frames))
        points, gaze = points_of_face(still)
        self._before, self._known_since_s = self._known, time_s
        try:
            self._known = head, resting_face(points, poses, rate_hz, gaze=gaze)
        except DataError:
            return
        self.calibrations += 1

    def _read(self, known: Calibration, landmarks: Array) -> Array:
        """(68,): FAPs of one frame; while lids hide an iris, its gaze stays as it was."""
        head, rest = known
        still, poses = head.hold(landmarks[None])
        points, gaze = points_of_face(still)
        faps: Array = faps_from_rest(rest, points, poses, gaze=gaze)[0]
        columns = list(GAZE)
        self._gaze = np.where(np.isnan(faps[columns]), self._gaze, faps[columns])
        faps[columns] = self._gaze
        return faps
