"""Landmarks of the face in a film, by MediaPipe's face mesh in an environment of its own.

The detector wants an older NumPy than this package, so it is another Python: the one that :data:`VARIABLE` names, or
that of ``make detector`` beside this one. It gets one picture at a time (:mod:`.detector_program`), so memory
does not grow with the film.
"""

import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self, cast

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.video import stream_pictures

VARIABLE = "FAPENGINE_DETECTOR"
"""Environment variable with the path of a Python that has mediapipe."""
MAX_SIDE = 640
"""Longer side of the pictures that the detector gets."""
LANDMARKS = 478


def detector_python() -> Path:
    """Find the detector's Python.

    Raises
    ------
    ResourceError
        If there is none.
    """
    named = os.environ.get(VARIABLE)
    path = Path(named) if named else Path(sys.prefix) / "detector" / "bin" / "python"
    if not path.is_file():
        raise ResourceError(
            f"face detector: got none at {path}; mend it with: make detector (in a checkout), or {VARIABLE}=PYTHON, one"
            " with mediapipe==0.10.21"
        )
    return path


def landmarks_of(
    path: Path, *, model: Path | None = None, on_frame: Callable[[], None] = lambda: None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the face in every frame of a film.

    Parameters
    ----------
    path : Path
    model : Path, optional
        MediaPipe's ``face_landmarker.task``, for its newer wheels, which have no model inside.
    on_frame : callable
        Called after each frame.

    Returns
    -------
    times_s : (T,) float64, s
        From 0.
    landmarks : (T, 478, 3) float64, px
        NaN where no face was found.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it holds no picture, or is damaged.
    ResourceError
        If the detector is not there, or ends.
    """
    if not path.is_file():
        detector_python()  # the detector's own message goes first
        raise UsageError(f"{path}: cannot be read (no such file)")
    times, found = landmarks_of_pictures(stream_pictures(path, max_side=MAX_SIDE), model=model, on_frame=on_frame)
    if not len(found):
        raise DataError(f"{path}: holds no picture")
    return times, found


def landmarks_of_pictures(
    pictures: Iterable[tuple[float, NDArray[np.uint8]]],
    *,
    model: Path | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the face in pictures as they come: time in s and (H, W, 3) sRGB each, all of one size.

    Returns and raises as :func:`landmarks_of`; without a picture, both arrays are empty.
    """
    times_s: list[float] = []
    found: list[NDArray[np.float32]] = []
    with Detector(model) as detector:
        for time_s, picture in pictures:
            times_s.append(time_s)
            found.append(detector.find(picture))
            on_frame()
    times = np.array(times_s)
    return times - times[:1], np.array(found, dtype=np.float64).reshape(-1, LANDMARKS, 3)


class Detector:
    """The detector's program, for pictures of one size as they come. Use it in ``with``.

    Stateful.

    Parameters
    ----------
    model : Path, optional
        As of :func:`landmarks_of`.

    Raises
    ------
    ResourceError
        If it is not there.
    """

    def __init__(self, model: Path | None = None) -> None:
        self._python = detector_python()
        program = Path(__file__).with_name("detector_program.py")
        command = [str(self._python), "-I", str(program), *([str(model)] if model else [])]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._given, self._answers = _pipe(self._process.stdin), _pipe(self._process.stdout)
        self._is_begun = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def find(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Find the face in a picture, (H, W, 3) sRGB: (478, 3) px, NaN where there is none.

        Raises
        ------
        ResourceError
            If the detector has ended.
        """
        size = LANDMARKS * 3 * 4
        try:
            if not self._is_begun:
                self._given.write(struct.pack("<II", picture.shape[1], picture.shape[0]))
            self._given.write(picture.tobytes())
            self._given.flush()
            if not self._is_begun and self._answers.read(1) != b"\1":
                raise BrokenPipeError
            self._is_begun = True
            data = self._answers.read(size)
            if len(data) < size:
                raise BrokenPipeError
        except (BrokenPipeError, ValueError) as error:  # ended by itself, or closed
            raise ResourceError(f"face detector: {self._python} has ended; does it have mediapipe?") from error
        return np.frombuffer(data, np.float32).reshape(LANDMARKS, 3)

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._given, self._answers):
            with suppress(OSError):
                pipe.close()


def _pipe(pipe: object) -> BinaryIO:
    return cast("BinaryIO", pipe)
