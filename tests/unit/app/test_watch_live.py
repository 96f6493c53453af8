"""A camera that moves a face: pictures that come too fast, a detector that fails, a film in place of a camera."""

import threading
import time
from collections.abc import Iterator
from typing import Self

import numpy as np
import pytest

from fapengine.app.watch_live import Eyes, at_their_times, watch_live
from fapengine.errors import ResourceError, UsageError
from fapengine.files.landmarks import LANDMARKS

PICTURE = np.zeros((4, 4, 3), np.uint8)
APART_S, LIMIT_S = 0.005, 300.0


class Detector:
    """Notes each picture's first byte; while it looks at one, so many more come. Stateful."""

    def __init__(self, misses: int = 0, fails_at: int | None = None) -> None:
        self.misses, self.fails_at, self.seen = misses, fails_at, []
        self.came = 0
        self._may_come, self._has_come = threading.Semaphore(int(misses > 0)), threading.Semaphore(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def find(self, picture: np.ndarray) -> np.ndarray:
        if len(self.seen) == self.fails_at:
            self._may_come.release(100)
            raise ResourceError("face detector: has ended")
        self.seen.append(int(picture[0, 0, 0]))
        if len(self.seen) > 1 or not self.misses:  # the camera itself waits for the first
            self._may_come.release(max(self.misses, 1))
            for _ in range(self.misses):
                assert self._has_come.acquire(timeout=LIMIT_S)
        return np.full((LANDMARKS, 3), np.nan, np.float32)

    def pictures(self, count: int) -> Iterator[tuple[float, np.ndarray]]:
        for number in range(count):
            assert number == 0 or self._may_come.acquire(timeout=LIMIT_S)
            self.came += 1
            yield number * APART_S, PICTURE + number
            if number:
                self._has_come.release()
        self._has_come.release(self.misses + 1)


def wait_for(eyes: Eyes) -> None:
    until_s = time.monotonic() + LIMIT_S
    while not eyes.is_over:
        assert time.monotonic() < until_s
        eyes.faps(time.monotonic())
        time.sleep(0.005)
    eyes.faps(time.monotonic())


def test_pictures_that_come_too_fast_are_left_out_and_none_waits() -> None:
    detector = Detector(misses=3)
    with Eyes(detector.pictures(59), lambda: detector, lambda: detector.came * APART_S) as eyes:
        wait_for(eyes)
    assert detector.seen == [0, *range(1, 59, 3)]  # the newest is what is looked at
    assert len(detector.seen) == eyes.counts.pictures
    assert eyes.counts.pictures + eyes.counts.late == 59
    assert max(eyes.counts.delays_s) < 3.5 * APART_S  # never by more than the picture before
    assert eyes.counts.faces == 0


def test_none_is_left_out_where_the_detector_keeps_up() -> None:
    detector = Detector()
    with Eyes(detector.pictures(20), lambda: detector) as eyes:
        wait_for(eyes)
    assert detector.seen == list(range(20))
    assert eyes.counts.late == 0


def test_what_fails_is_told_to_who_asks_for_the_face() -> None:
    detector = Detector(fails_at=3)
    eyes = Eyes(detector.pictures(20), lambda: detector)
    with eyes, pytest.raises(ResourceError, match="has ended"):
        wait_for(eyes)

    def broken() -> object:
        yield 0.0, PICTURE
        raise ResourceError("camera: gives no picture")

    with Eyes(broken(), Detector) as eyes, pytest.raises(ResourceError, match="gives no picture"):
        wait_for(eyes)


def test_a_film_is_played_at_its_own_rate() -> None:
    now_s, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now_s[0] += seconds

    shown = []
    for time_s, _ in at_their_times(((0.5 + n / 25, PICTURE) for n in range(6)), clock=lambda: now_s[0], sleep=sleep):
        shown.append((round(time_s, 3), round(now_s[0], 3)))
        now_s[0] += 0.3 if time_s == 0.5 else 0.1 if len(shown) == 3 else 0.01  # the first takes long, the third too
    assert shown == [(0.5, 100.0), (0.54, 100.34), (0.58, 100.38), (0.62, 100.48), (0.66, 100.49), (0.7, 100.5)]
    assert min(slept) == 0.0  # what is late is not waited for


def test_what_cannot_move_a_face_is_told() -> None:
    for source, message in (
        ("talk.wav", "expected webcam or a video"),
        ("webcam:front", "webcam:1 for the second"),
        ("none.mp4", "no such file"),
    ):
        with pytest.raises(UsageError, match=message):
            watch_live(source, lambda: pytest.fail("a screen was opened"))
