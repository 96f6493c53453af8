"""A face that was watched, by a camera or a tracker, as FAPs: no session, no phones, no model.

Theory of operation
-------------------
Every FAP but the head's and the eyes' moves one feature point along one axis, in units of the neutral face. So a face
whose feature points are seen, with its head held still, needs no model: the neutral pose is found, the face measured
there (FAPU), and each FAP is its point's displacement. Sizes cancel: pixels do as well as millimetres.

The neutral pose is the median of the quietest frames: those in which the whole face moves least, of the half with the
lips nearest to each other; a held vowel is no rest. Lids are open at rest, so theirs is a high quantile of all frames.

Gaze is the place of the iris between the corners of its eye, against an eyeball of an adult's size. The head's turns to
the sides count from the camera; its nod and the gaze count from their medians, because no landmark tells where up or
straight ahead is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from fapengine.capture.held_face import FACE_68, PUPILS, HeldFace, hold_face
from fapengine.capture.landmarks import FEATURE_POINTS
from fapengine.capture.openface import FEATURE_POINTS as OPENFACE_POINTS
from fapengine.capture.openface import OpenFaceTrack
from fapengine.errors import DataError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.codable import to_codable
from fapengine.mpeg4.fapu import AU_RAD, Fapu
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend_rows import arkit_rows

Array = NDArray[np.float64]

QUIET_SHARE, QUIET_S = 0.15, 0.2
"""Share of the frames that count as quiet, and the time over which their motion is summed."""
OPEN_LIDS = 0.75
"""Quantile of the lids' distance at which they are open: blinks and glances down are rarer."""
IRIS_SHOWN = 0.6
"""Share of the open lids' distance under which the iris is guessed, not seen."""
EYE_RADIUS_ES = 12.0 / 62.0
"""Radius of an eyeball in distances of the pupils: those of an adult."""
LIDS = {"3.1": 1.0, "3.2": 1.0, "3.3": -1.0, "3.4": -1.0}
"""Points of the lids, and which way each opens."""
EYE_LIDS = (("3.1", "3.3"), ("3.2", "3.4"))
"""Upper and lower lid of the left and the right eye."""
EYES = {"3.5": (PUPILS[1], 263, 362), "3.6": (PUPILS[0], 33, 133)}
"""Iris and corners of the left and the right eye."""
NEEDED = ("2.2", "2.3", "8.3", "8.4", "9.15", "3.5", "3.6")


def watched_faps(held: HeldFace, rate_hz: float) -> FapTrack:
    """Read FAPs off a detector's landmarks: mouth, brows, lids, cheeks, nose, gaze and the turns of the head.

    Parameters
    ----------
    held : HeldFace
    rate_hz : float
        Frames a second.

    Raises
    ------
    DataError
        If the face cannot be measured.
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
        By feature point; without irises, pupils lie half way between the corners of their eyes.
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
    """A face at rest, from which FAPs count."""

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
        Frames a second.
    gaze : (T, 2, 3) float64, optional
        Place of the left and the right iris from the middle of its eye's corners.

    Raises
    ------
    UsageError
        If a point is missing that measures the face.
    DataError
        If it measures no face.
    """
    rest = resting_face(points, poses, rate_hz, gaze=gaze)
    faps = faps_from_rest(rest, points, poses, gaze=gaze)
    frames = np.arange(len(faps))
    for number in (23, 24, 25, 26):  # as a line through the frames in which lids hide the iris
        angles = faps[:, fap.column(number)]
        shown = ~np.isnan(angles)
        faps[:, fap.column(number)] = np.interp(frames, frames[shown], angles[shown]) if shown.any() else 0.0
    return FapTrack.of(to_codable(faps), rate_hz=rate_hz)


def resting_face(
    points: Mapping[str, Array], poses: Array, rate_hz: float, *, gaze: Array | None = None
) -> RestingFace:
    """Find the face at rest, in frames of a face that does anything.

    Takes points, (T, 3) each, and raises what :func:`faps_of_points` does.
    """
    missing = [name for name in NEEDED if name not in points]
    if missing:
        raise UsageError(f"points: lacks {', '.join(missing)}, expected at least {', '.join(NEEDED)}")
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
    pitch = Rotation.from_matrix(poses).as_euler("YXZ")[:, 1]
    ahead = np.zeros((2, 3)) if gaze is None else np.median(gaze, axis=0)
    return RestingFace(neutral, _measured(neutral), ahead, float(np.median(pitch)), gaps)


def faps_from_rest(rest: RestingFace, points: Mapping[str, Array], poses: Array, *, gaze: Array | None = None) -> Array:
    """Read FAPs off frames of a face that is known at rest; parameters as of :func:`faps_of_points`.

    Returns
    -------
    (T, 68) float64, FAPU
        NaN where lids hide an iris, in the FAPs of its gaze.
    """
    faps = np.zeros((len(poses), fap.FAP_COUNT))
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.point not in points or row.unit is fap.FapUnit.AU:
            continue
        moved = points[row.point] - rest.points[row.point]
        if row.number == 18:  # the chin boss against the jaw, as in trajectory/faps.py
            moved = moved - (points["2.1"] - rest.points["2.1"])
        faps[:, fap.column(row.number)] = moved @ np.array(axis) / rest.fapu.unit(row.unit)
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
    yaw, pitch, roll = Rotation.from_matrix(poses).as_euler("YXZ").T
    for number, angle in ((49, yaw), (48, pitch - rest.pitch_rad), (50, roll)):
        faps[:, fap.column(number)] = angle / AU_RAD
    return faps


def quiet_frames(points: Mapping[str, Array], rate_hz: float) -> NDArray[np.intp]:
    """(N,): frames at rest, those that move least of the half with the lips nearest to each other."""
    places = np.stack([points[name] for name in points if name not in (*LIDS, *EYES)], axis=1)
    speed = np.linalg.norm(np.gradient(places, axis=0), axis=-1).mean(axis=1) if len(places) > 1 else np.zeros(1)
    speed = uniform_filter1d(speed, max(1, round(QUIET_S * rate_hz)), mode="nearest")
    opening = points["2.2"][:, 1] - points["2.3"][:, 1]
    shut = np.flatnonzero(opening <= np.median(opening))
    count = max(1, round(QUIET_SHARE * len(places)))
    return shut[np.argsort(speed[shut], kind="stable")[:count]]


def _measured(neutral: Mapping[str, Array]) -> Fapu:
    """Units of a face; an iris is 11 of 62 mm that pupils are apart, where lids are not seen."""
    es0 = float(neutral["3.5"][0] - neutral["3.6"][0])
    lids = [
        float(neutral[upper][1] - neutral[lower][1])
        for upper, lower in EYE_LIDS
        if upper in neutral and lower in neutral
    ]
    try:
        return Fapu(
            irisd0_mm=float(np.mean(lids)) if lids else es0 * 11.0 / 62.0,
            es0_mm=es0,
            ens0_mm=float((neutral["3.5"][1] + neutral["3.6"][1]) / 2 - neutral["9.15"][1]),
            mns0_mm=float(neutral["9.15"][1] - neutral["2.2"][1]),
            mw0_mm=float(neutral["8.3"][0] - neutral["8.4"][0]),
        )
    except UsageError as error:
        raise DataError(f"face: cannot be measured: {error}") from error


BLINK, BLINK_AT = 848.5, 3.0
"""FAP 19 and 20 of a shut eye (as ARKit's eyeBlink), and the intensity of action unit 45 at which it is shut."""
CHEEKS, CHEEK_FAPS, RAISED_AT = ("cheekSquintLeft", "cheekSquintRight"), (39, 40, 41, 42), 5.0
"""ARKit's shapes of raised cheeks; the FAPs of cheeks, which none of the 68 points shows; action unit 6 at its most."""


def openface_faps(track: OpenFaceTrack) -> FapTrack:
    """Read FAPs off OpenFace's 68 points and its gaze; off its action units, what no point shows: blinks and cheeks.

    Action unit 45 shuts the lids, 6 lifts the cheeks. The others (1 to 5, 7, 9 to 26) move brows, lids, nose, lips and
    chin, whose places the points say better than an intensity of five steps does.

    Raises
    ------
    DataError
        If a face is seen in less than half of the frames, or cannot be measured.
    """
    times = np.arange(len(track.points_mm)) / track.rate_hz
    held = hold_face(times, track.points_mm, pupils_mm=62.0, model=FACE_68)
    points = {name: held.still_mm[:, list(rows)].mean(axis=1) for name, rows in OPENFACE_POINTS.items()}
    faps = faps_of_points(points, held.poses, track.rate_hz).values.astype(np.float64)
    if track.gaze_rad is not None:
        yaw, pitch = (faps[:, fap.column(number)] * AU_RAD for number in (49, 48))
        away = track.gaze_rad - np.stack([yaw, pitch], axis=1)
        away -= np.median(away, axis=0)
        for number, angle in zip((23, 24, 25, 26), away.T[[0, 0, 1, 1]], strict=True):
            faps[:, fap.column(number)] = angle / AU_RAD
    if "AU45" in track.action_units:
        shut = BLINK * np.minimum(track.action_units["AU45"] / BLINK_AT, 1.0)
        for number in (19, 20):
            faps[:, fap.column(number)] = np.maximum(faps[:, fap.column(number)], shut)
    if "AU06" in track.action_units:
        share = np.minimum(track.action_units["AU06"] / RAISED_AT, 1.0)
        columns = [fap.column(number) for number in CHEEK_FAPS]
        faps[:, columns] = share[:, None] * arkit_rows(CHEEKS).sum(axis=0)[columns]
    return FapTrack.of(to_codable(faps), rate_hz=track.rate_hz)
