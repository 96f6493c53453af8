"""Landmarks of a head that is known to a mouth: whatever its place, size and turn."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fapengine.capture.held_face import FACE_MESH, PUPILS
from fapengine.errors import DataError, UsageError
from fapengine.retarget.blend import ADULT
from fapengine.scoring.mouth import LIDS, LIP_POINTS, LIPS, TOUCH_MM, mouth_of_landmarks

Array = NDArray[np.float64]
TIMES_S = np.arange(100) / 25
OPENING_MM = 6 * np.maximum(np.sin(2 * np.pi * TIMES_S), 0)
WIDER_MM = 2 * np.sin(2 * np.pi * 0.7 * TIMES_S) * (OPENING_MM > 0)
PITCH, YAW, ROLL = (0.1 * np.sin(2 * np.pi * hz * TIMES_S) for hz in (0.5, 0.75, 1.25))


def head_mm() -> Array:
    """(478, 3): points of a face at rest, to the subject's left, up, out; most of them lie where they like."""
    points = np.random.default_rng(3).normal(scale=(40, 50, 20), size=(FACE_MESH.count, 3))
    half = ADULT.es0_mm / 2
    points[list(PUPILS)] = [[-half, 30, 0], [half, 30, 0]]
    for (upper, lower, outer, inner), side in zip(LIDS, (1, -1), strict=True):
        points[[upper, lower, outer, inner]] = [
            [side * half, 35, 0], [side * half, 25, 0], [side * (half + 14), 30, 0], [side * (half - 14), 30, 0]
        ]  # fmt: skip
    points[[10, 152]] = [[0, 90, 0], [0, -80, 0]]
    for number, name in enumerate(LIPS):
        points[LIPS[name]] = [10 * np.cos(number), -40, 10]
    points[[LIPS["2.2"], LIPS["2.3"]]] = [[0, -40, 12], [0, -40, 12]]
    points[[LIPS["8.3"], LIPS["8.4"]]] = [[25, -40, 5], [-25, -40, 5]]
    return points


def film(*, opening_mm: Array = OPENING_MM, blink: slice = slice(60, 66)) -> Array:
    """(T, 478, 3) px: the head speaks, turns, comes nearer and goes across the picture."""
    points = np.repeat(head_mm()[None], len(TIMES_S), axis=0)
    points[:, LIPS["2.2"], 1] += 0.4 * opening_mm
    points[:, LIPS["2.3"], 1] -= 0.6 * opening_mm
    points[:, LIPS["8.3"], 0] += WIDER_MM / 2
    points[:, LIPS["8.4"], 0] -= WIDER_MM / 2
    for upper, lower, _, _ in LIDS:
        points[blink, upper, 1], points[blink, lower, 1] = 31, 30
    turns = Rotation.from_euler("YXZ", np.stack([YAW, PITCH, ROLL], axis=1)).as_matrix()
    points = np.einsum("tij,tnj->tni", turns, points)
    points *= (2.0 + 0.3 * np.sin(TIMES_S))[:, None, None]
    points += np.stack([300 + 20 * TIMES_S, -250 + 5 * TIMES_S, 0 * TIMES_S], axis=1)[:, None]
    return points * (1.0, -1.0, -1.0)


def test_the_mouth_is_what_it_was() -> None:
    mouth = mouth_of_landmarks(TIMES_S, film())
    np.testing.assert_allclose(mouth.opening_mm, OPENING_MM, atol=1e-6)
    np.testing.assert_allclose(mouth.width_mm, WIDER_MM, atol=1e-6)
    np.testing.assert_allclose(mouth.lower_mm, -0.6 * OPENING_MM, atol=1e-6)
    np.testing.assert_allclose(mouth.lips_mm[:, LIP_POINTS.index("8.3"), 0], WIDER_MM / 2, atol=1e-6)
    assert (mouth.shut[60:66] > 0.9).all()
    assert (mouth.shut[:60] < 1e-6).all()


def test_the_head_turns_as_it_did() -> None:
    head = mouth_of_landmarks(TIMES_S, film()).head_rad
    for seen, true in zip(head.T, (PITCH, YAW, ROLL), strict=True):
        np.testing.assert_allclose(seen - seen.mean(), true - true.mean(), atol=0.012)


def test_lips_that_never_touch_are_open() -> None:
    mouth = mouth_of_landmarks(TIMES_S, film(opening_mm=OPENING_MM + 5))
    np.testing.assert_allclose(mouth.opening_mm, OPENING_MM + 5 - TOUCH_MM, atol=1e-6)


def test_frames_without_a_face_are_filled_in() -> None:
    seen = film()
    seen[[0, 5, 6, 99]] = np.nan
    mouth = mouth_of_landmarks(TIMES_S, seen)
    still = np.ones(100, bool)
    still[[0, 5, 6, 99]] = False
    np.testing.assert_allclose(mouth.opening_mm[still], OPENING_MM[still], atol=1e-5)
    assert OPENING_MM[4] < mouth.opening_mm[5] < OPENING_MM[7]


def test_a_film_of_something_else_is_refused() -> None:
    seen = film()
    seen[40:] = np.nan
    with pytest.raises(DataError, match="only 40 of 100 frames show a face"):
        mouth_of_landmarks(TIMES_S, seen)
    with pytest.raises(UsageError, match="landmarks"):
        mouth_of_landmarks(TIMES_S, seen[:, :300])
    assert len(set(FACE_MESH.steady)) == len(FACE_MESH.steady)
