"""Face landmarks of a video, by MediaPipe's face mesh in a separate Python environment.

The detector needs an older NumPy than this package, so it runs in another Python: the one in :data:`VARIABLE`, or the
one that ``make detector`` installs. It receives one image at a time (:mod:`.detector_program`), so memory use does not
grow with the video.
"""

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fapengine._child import Child
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.video import stream_pictures

VARIABLE = "FAPENGINE_DETECTOR"
"""Environment variable with the path of a Python that has mediapipe."""
MAX_SIDE = 640
"""Longer side of the images sent to the detector."""
LANDMARKS = 478


def detector_python() -> Path:
    """Find the detector's Python.

    Raises
    ------
    ResourceError
        If it is not installed.
    """
    named = os.environ.get(VARIABLE)
    path = Path(named) if named else Path(sys.prefix) / "detector" / "bin" / "python"
    if not path.is_file():
        raise ResourceError(
            f"face detector: not found at {path}. Install it with: make detector (in a checkout). Or set {VARIABLE} to"
            " a Python that has mediapipe==0.10.21"
        )
    return path


def landmarks_of(
    path: Path, *, model: Path | None = None, on_frame: Callable[[], None] = lambda: None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the face in every frame of a video.

    Parameters
    ----------
    path : Path
    model : Path, optional
        MediaPipe's ``face_landmarker.task``, for its newer wheels, which do not include a model.
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
        If it contains no images, or is damaged.
    ResourceError
        If the detector is not installed, or ends.
    """
    if not path.is_file():
        detector_python()  # the detector's own message goes first
        raise UsageError(f"{path}: cannot be read (no such file)")
    times, found = landmarks_of_pictures(stream_pictures(path, max_side=MAX_SIDE), model=model, on_frame=on_frame)
    if not len(found):
        raise DataError(f"{path}: contains no image")
    return times, found


def landmarks_of_pictures(
    pictures: Iterable[tuple[float, NDArray[np.uint8]]],
    *,
    model: Path | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the face in images as they arrive: time in s and (H, W, 3) sRGB each, all of one size.

    Returns and raises as :func:`landmarks_of`; without images, both arrays are empty.
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
    """The detector's process, for images of one size. Use it as a context manager.

    Stateful. ``model`` is that of :func:`landmarks_of`.

    Raises
    ------
    ResourceError
        If it is not installed.
    """

    def __init__(self, model: Path | None = None) -> None:
        self._python = detector_python()
        program = Path(__file__).with_name("detector_program.py")
        command = [str(self._python), "-I", str(program), *([str(model)] if model else [])]
        self._child = Child("face detector", command, is_quiet=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def find(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Find the face in an image, (H, W, 3) sRGB: (478, 3) px, NaN without one.

        Raises
        ------
        ResourceError
            If the detector has ended.
        """
        height, width, _ = picture.shape
        try:
            _, data = self._child.ask({"width": width, "height": height}, picture.tobytes())
        except EOFError as error:
            raise ResourceError(f"face detector: {self._python} has ended; does it have mediapipe?") from error
        return np.frombuffer(data, np.float32).reshape(LANDMARKS, 3)

    def close(self) -> None:
        """End the process."""
        self._child.close()
