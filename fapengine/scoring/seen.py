"""A mouth that a face detector saw: landmarks of a film to :class:`.mouth.Mouth`.

Theory of operation
-------------------
The head is held still (:mod:`fapengine.capture.held_face`); the distance of the pupils is an adult's
(:data:`fapengine.retarget.blend.ADULT`).

Rest is what the film itself shows: lips that touch, at the smallest distance that is seen (but no more than
:data:`TOUCH_MM`, or a mouth that never shuts would count as shut); everything else at its median while the
lips are shut.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.held_face import hold_face
from fapengine.retarget.blend import ADULT
from fapengine.scoring.mouth import LIP_POINTS, Mouth

Array = NDArray[np.float64]

LIPS = {
    "2.2": 13, "2.3": 14, "2.4": 308, "2.5": 78, "2.6": 311, "2.7": 81, "2.8": 402, "2.9": 178,
    "8.1": 0, "8.2": 17, "8.3": 291, "8.4": 61, "8.5": 269, "8.6": 39, "8.7": 405, "8.8": 181,
}  # fmt: skip
"""Landmark of each feature point of the lips."""
LIDS = ((386, 374, 263, 362), (159, 145, 33, 133))
"""Upper lid, lower lid and corners of the left and the right eye."""
TOUCH_MM = 1.5
"""Greatest distance of inner lips that is taken for a touch: the detector seldom says 0."""
SHUT_MM = 1.0
SHUT_SHARE = 0.25
"""Height of a shut eye, as the detector says it, against the open one."""


def mouth_of_landmarks(times_s: Array, landmarks: Array) -> Mouth:
    """Look at landmarks.

    Parameters
    ----------
    times_s : (T,) float64, s
        Rising, from 0.
    landmarks : (T, 478, 3) float64, px
        To the right, down, and away from the camera; NaN where no face was seen.

    Raises
    ------
    DataError
        If a face is seen in less than half of the frames, or in fewer than two.
    """
    held = hold_face(times_s, landmarks, pupils_mm=ADULT.es0_mm)
    return _mouth(times_s, held.still_mm, held.turns)


def _mouth(times_s: Array, still: Array, turns: Array) -> Mouth:
    """Read a mouth off a head that is held still; (T, 478, 3) mm and (T, 3, 3)."""
    gap = still[:, LIPS["2.2"], 1] - still[:, LIPS["2.3"], 1]
    opening = gap - min(float(np.percentile(gap, 2)), TOUCH_MM)
    shut = opening <= max(SHUT_MM, float(np.percentile(opening, 5)))
    lips = still[:, [LIPS[name] for name in LIP_POINTS]]
    width = np.linalg.norm(still[:, LIPS["8.3"]] - still[:, LIPS["8.4"]], axis=1)
    lower = still[:, LIPS["2.3"], 1]
    return Mouth(
        times_s,
        lips - np.median(lips[shut], axis=0),
        opening,
        width - np.median(width[shut]),
        lower - np.median(lower[shut]),
        np.stack([_closed(still, *lids) for lids in LIDS], axis=1),
        _angles(turns),
    )


def _closed(still: Array, upper: int, lower: int, outer: int, inner: int) -> Array:
    """(T,): how far an eye is shut, 0..1."""
    height = np.linalg.norm(still[:, upper] - still[:, lower], axis=1)
    height /= np.linalg.norm(still[:, outer] - still[:, inner], axis=1)
    opened = float(np.percentile(height, 75))
    closed: Array = np.clip((1.0 - height / max(opened, 1e-9)) / (1.0 - SHUT_SHARE), 0.0, 1.0)
    return closed


def _angles(turns: Array) -> Array:
    """(T, 3) rad: pitch down, yaw to the subject's left, roll to the right ear, of rotations (T, 3, 3) of the head."""
    forward, left = turns[:, :, 2], turns[:, :, 0]
    pitch = -np.arcsin(np.clip(forward[:, 1], -1, 1))
    yaw = np.arctan2(forward[:, 0], forward[:, 2])
    roll = np.arctan2(left[:, 1], left[:, 0])
    return np.stack([pitch, yaw, roll], axis=1)
