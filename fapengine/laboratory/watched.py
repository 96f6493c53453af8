"""A face seen by a camera or a tracker, as FAPs: no session, no phones, no model.

Theory of operation
-------------------
Every FAP except those of the head and the eyes moves one feature point along one axis, in units of the neutral face. So
a face with visible feature points, its head held still, needs no model: the neutral pose is found, the face measured
there (FAPU), and each FAP is its point's displacement. Sizes cancel: pixels do as well as millimetres.

The neutral pose is the median of the quietest frames: those in which the whole face moves least, of the half with the
lips nearest to each other; a held vowel is not rest. Lids are open at rest, so theirs is a high quantile of all frames.

Gaze is the place of the iris between the corners of its eye, for an eyeball of an adult's size. Head yaw and roll count
from the camera; head pitch and gaze count from their medians, because no landmark shows where up or straight ahead is.

Live (:class:`WatchedFace`), landmarks come in as they are seen, and FAPs are asked for at any time; the caller has the
clock. After :data:`FIRST_S` of a face, its neutral pose is measured in these frames. Every :data:`AGAIN_S` it is
measured again in the last :data:`KEPT_S`, because a person may not begin with a neutral face, or sit still. Two neutral
poses are blended for :data:`BLEND_S`, so nothing jumps. A lost face keeps its pose for :data:`HOLD_S`, because a
detector misses single frames, and then eases to neutral; when it is seen again, it eases back.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, frozen
from fapengine.capture.held_face import (
    FACE_68,
    FACE_MESH,
    PUPILS,
    FaceModel,
    HeldFace,
    KnownHead,
    hold_face,
    learn_head,
)
from fapengine.capture.landmarks import FEATURE_POINTS, OPENFACE_FEATURE_POINTS, OpenFaceTrack
from fapengine.errors import DataError, UsageError, as_data_error
from fapengine.geometry.rigid import yaw_pitch_roll
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD, EYE_LIDS, Fapu, faps_of_displacements, measure_distances
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget.blend import shape_rows

QUIET_SHARE, QUIET_S = 0.15, 0.2
"""Fraction of the frames that count as quiet, and the time over which their motion is summed."""
OPEN_LIDS = 0.75
"""Quantile of the lids' distance at which they are open: blinks and looks down are rarer."""
IRIS_SHOWN = 0.6
"""Fraction of the open lids' distance below which the iris is guessed, not seen."""
EYE_RADIUS_ES = 12.0 / 62.0
"""Radius of an eyeball in distances of the pupils: those of an adult."""
EYES = {"3.5": (PUPILS[1], 263, 362), "3.6": (PUPILS[0], 33, 133)}
"""Iris and corners of the left and the right eye."""
NEEDED = ("2.2", "2.3", "8.3", "8.4", "9.15", "3.5", "3.6")


def watched_faps(held: HeldFace, rate_hz: float) -> FapTrack:
    """Read FAPs off a detector's landmarks: mouth, brows, lids, cheeks, nose, gaze and the turns of the head.

    Parameters
    ----------
    rate_hz : float
        Frame rate.
    """
    points, gaze = points_of_face(held.still_mm)
    return faps_of_points(points, held.poses, rate_hz, gaze=gaze)


def points_of_face(still_mm: Array) -> tuple[dict[str, Array], Array | None]:
    """Name the landmarks of a face mesh that is held still.

    Parameters
    ----------
    still_mm : (T, 468 or 478, 3) float64

    Returns
    -------
    points : dict of str to (T, 3)
        By feature point; without irises, pupils are in the middle between the corners of their eyes.
    gaze : (T, 2, 3) or None
        As of :func:`faps_of_points`; None without irises.
    """
    points = {name: still_mm[:, index] for index, name in FEATURE_POINTS.items()}
    middles = {name: still_mm[:, corners].mean(axis=1) for name, (_, *corners) in EYES.items()}
    if still_mm.shape[1] <= max(PUPILS):
        return points | middles, None
    irises = {name: still_mm[:, iris] for name, (iris, *_) in EYES.items()}
    return points | irises, np.stack([irises[name] - middles[name] for name in EYES], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RestingFace:
    """The neutral face, relative to which FAPs are measured."""

    points: Mapping[str, Array]
    """(3,) by feature point."""
    fapu: Fapu
    gaze: Array
    """(2, 3): irises of eyes that look straight ahead; 0 where none were seen."""
    pitch_rad: float
    """Nod of a head that is held straight."""
    gaps: Array
    """(2,): distance of the left and the right eye's open lids; 0 where they were not seen."""


def faps_of_points(points: Mapping[str, Array], poses: Array, rate_hz: float, *, gaze: Array | None = None) -> FapTrack:
    """Read FAPs off feature points of a head that is held still.

    Parameters
    ----------
    points : mapping of str to (T, 3) float64
        In any one unit of length; head axes, +x to the subject's left, +y up, +z out of the face. At least
        :data:`NEEDED`.
    poses : (T, 3, 3) float64
        Rotations of the head against the camera.
    rate_hz : float
        Frame rate.
    gaze : (T, 2, 3) float64, optional
        Position of the left and the right iris relative to the middle of its eye's corners.
    """
    rest = resting_face(points, poses, rate_hz, gaze=gaze)
    faps = faps_from_rest(rest, points, poses, gaze=gaze)
    frames = np.arange(len(faps))
    for number in (23, 24, 25, 26):  # as a line through the frames in which lids hide the iris
        angles = faps[:, fap.column(number)]
        shown = ~np.isnan(angles)
        faps[:, fap.column(number)] = np.interp(frames, frames[shown], angles[shown]) if shown.any() else 0.0
    return FapTrack.from_values(to_codable(faps), rate_hz=rate_hz)


def resting_face(
    points: Mapping[str, Array], poses: Array, rate_hz: float, *, gaze: Array | None = None
) -> RestingFace:
    """Find the neutral face in frames with any motion.

    Points are (T, 3) each; parameters and errors are those of :func:`faps_of_points`.
    """
    missing = [name for name in NEEDED if name not in points]
    if missing:
        raise UsageError(f"points: missing {', '.join(missing)}; requires {', '.join(NEEDED)}")
    quiet = quiet_frames(points, rate_hz)
    neutral = {name: np.median(place[quiet], axis=0) for name, place in points.items()}
    gaps = np.zeros(2)
    for eye, (upper, lower) in enumerate(EYE_LIDS):
        if upper in points and lower in points:
            gap = points[upper][:, 1] - points[lower][:, 1]
            gaps[eye] = np.quantile(gap, OPEN_LIDS)
            off = np.abs(gap - gaps[eye])
            opened = off <= max(np.ptp(gap) / 20, off.min())
            neutral[upper], neutral[lower] = (np.median(points[name][opened], axis=0) for name in (upper, lower))
    pitch = yaw_pitch_roll(poses)[:, 1]
    ahead = np.zeros((2, 3)) if gaze is None else np.median(gaze, axis=0)
    return RestingFace(neutral, _measured(neutral), ahead, float(np.median(pitch)), gaps)


def faps_from_rest(rest: RestingFace, points: Mapping[str, Array], poses: Array, *, gaze: Array | None = None) -> Array:
    """Read FAPs off frames of a face that is known at rest; parameters as of :func:`faps_of_points`.

    Returns
    -------
    (T, 68) float64, FAPU
        NaN where lids hide an iris, in the FAPs of its gaze.
    """
    faps = faps_of_displacements({name: place - rest.points[name] for name, place in points.items()}, rest.fapu)
    if gaze is not None:
        away = (gaze - rest.gaze) / (EYE_RADIUS_ES * rest.fapu.es0_mm)
        angles = np.arcsin(np.clip(away[..., :2], -1.0, 1.0))
        angles[..., 1] = angles[..., 1].mean(axis=1, keepdims=True)  # both eyes look up and down together
        for eye, (upper, lower) in enumerate(EYE_LIDS):
            if upper in points and lower in points:
                hidden = points[upper][:, 1] - points[lower][:, 1] <= IRIS_SHOWN * rest.gaps[eye]
                angles[hidden, eye] = np.nan
            faps[:, fap.column(23 + eye)] = angles[:, eye, 0] / AU_RAD
            faps[:, fap.column(25 + eye)] = -angles[:, eye, 1] / AU_RAD
    yaw, pitch, roll = yaw_pitch_roll(poses).T
    for number, angle in ((49, yaw), (48, pitch - rest.pitch_rad), (50, roll)):
        faps[:, fap.column(number)] = angle / AU_RAD
    return faps


def quiet_frames(points: Mapping[str, Array], rate_hz: float) -> NDArray[np.intp]:
    """(N,): frames at rest, those that move least of the half with the lips nearest to each other."""
    places = np.stack([points[name] for name in points if name not in (*EYES, *EYE_LIDS[0], *EYE_LIDS[1])], axis=1)
    speed = np.linalg.norm(np.gradient(places, axis=0), axis=-1).mean(axis=1) if len(places) > 1 else np.zeros(1)
    window = max(1, round(QUIET_S * rate_hz))
    around = np.pad(speed, (window // 2, (window - 1) // 2), mode="edge")
    speed = np.convolve(around, np.full(window, 1 / window), "valid")
    opening = points["2.2"][:, 1] - points["2.3"][:, 1]
    shut = np.flatnonzero(opening <= np.median(opening))
    count = max(1, round(QUIET_SHARE * len(places)))
    return shut[np.argsort(speed[shut], kind="stable")[:count]]


def _measured(neutral: Mapping[str, Array]) -> Fapu:
    """Units of a face; where lids are not seen, an iris is 11 of the 62 mm between the pupils."""
    found = measure_distances(neutral)
    with as_data_error("face: cannot be measured: "):
        return Fapu(**({"irisd0_mm": found["es0_mm"] * 11.0 / 62.0} | found))


BLINK, BLINK_AT = 848.5, 3.0
"""FAP 19 and 20 of a shut eye (as ARKit's eyeBlink), and the intensity of action unit 45 at which it is shut."""
CHEEKS, CHEEK_FAPS, RAISED_AT = ("cheekSquintLeft", "cheekSquintRight"), (39, 40, 41, 42), 5.0
"""ARKit's shapes of raised cheeks; the FAPs of cheeks, which none of the 68 points shows; action unit 6 at its most."""


def openface_faps(track: OpenFaceTrack) -> FapTrack:
    """Read FAPs off OpenFace's 68 points and its gaze; off its action units, what no point shows: blinks and cheeks.

    Action unit 45 shuts the lids, 6 lifts the cheeks. The others (1 to 5, 7, 9 to 26) move brows, lids, nose, lips and
    chin, for which the points are more precise than an intensity of five steps.
    """
    times = np.arange(len(track.points_mm)) / track.rate_hz
    held = hold_face(times, track.points_mm, pupils_mm=62.0, model=FACE_68)
    points = {name: held.still_mm[:, list(rows)].mean(axis=1) for name, rows in OPENFACE_FEATURE_POINTS.items()}
    faps = faps_of_points(points, held.poses, track.rate_hz).values.astype(np.float64)
    if track.gaze_rad is not None:
        yaw, pitch = (faps[:, fap.column(number)] * AU_RAD for number in (49, 48))
        away = track.gaze_rad - np.stack([yaw, pitch], axis=1)
        away -= np.median(away, axis=0)
        for number, angle in zip((23, 24, 25, 26), away.T[[0, 0, 1, 1]], strict=True):
            faps[:, fap.column(number)] = angle / AU_RAD
    if "AU45" in track.action_units:
        lids = [fap.column(19), fap.column(20)]
        shut = BLINK * np.minimum(track.action_units["AU45"] / BLINK_AT, 1.0)
        faps[:, lids] = np.maximum(faps[:, lids], shut[:, None])
    if "AU06" in track.action_units:
        raised = np.minimum(track.action_units["AU06"] / RAISED_AT, 1.0)
        columns = fap.columns(*CHEEK_FAPS)
        faps[:, columns] = raised[:, None] * shape_rows(CHEEKS).sum(axis=0)[columns]
    return FapTrack.from_values(to_codable(faps), rate_hz=track.rate_hz)


FIRST_S, AGAIN_S, KEPT_S = 1.5, 3.0, 30.0
"""Time of a face until its neutral pose is measured; interval of new measurements; time that they cover."""
KEEP_HZ = 15.0
"""Frames per second that are kept for it."""
BLEND_S = 1.0
HOLD_S, EASE_S = 0.2, 0.5
"""Time for which a lost face keeps its pose, and in which it eases to neutral, and back."""
GAZE = fap.columns(23, 24, 25, 26)
PUPILS_MM = 62.0
"""Distance of an adult's pupils; no FAP depends on it."""

Calibration = tuple[KnownHead, RestingFace]


class WatchedFace:
    """A face seen live; see the theory of operation.

    Stateful.

    Parameters
    ----------
    model : FaceModel
        Model of the landmarks: the face mesh, with irises or without.
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
        """Number of times that the neutral pose was measured."""

    @property
    def is_known(self) -> bool:
        """Whether the neutral face is known; before, it is shown neutral."""
        return self._known is not None

    def see(self, time_s: float, landmarks: ArrayLike) -> None:
        """Add a frame.

        Parameters
        ----------
        time_s : float
            Time of the image; rising.
        landmarks : (N, 3) array_like, px or mm
            To the right, down, and away from the camera; NaN where no face was seen.
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
        blend = (time_s - self._known_since_s) / BLEND_S
        if self._before is not None and blend < 1:
            faps = blend * faps + (1 - blend) * self._read(self._before, points)
        self._shown, self._seen_s = faps, time_s

    def faps(self, time_s: float) -> NDArray[np.int32]:
        """Return the frame to show, (68,) int32 FAPU; times rise from call to call."""
        since_s = 0.0 if self._asked_s is None else max(time_s - self._asked_s, 0.0)
        self._asked_s = time_s
        direction = 1 if time_s - self._seen_s <= HOLD_S else -1
        self._weight = float(np.clip(self._weight + direction * since_s / EASE_S, 0.0, 1.0))
        eased = self._weight**2 * (3 - 2 * self._weight)
        return to_codable((eased * self._shown)[None]).ravel()

    def _calibrate(self, time_s: float) -> None:
        """Measure the neutral pose in the kept frames; a face that cannot be measured is retried later."""
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
        faps[GAZE] = self._gaze = np.where(np.isnan(faps[GAZE]), self._gaze, faps[GAZE])
        return faps
