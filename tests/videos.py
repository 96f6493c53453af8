"""Whole videos, decoded for the tests that look at their frames."""

from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Video:
    """A decoded video."""

    frames: NDArray[np.uint8]
    """(T, height, width, 3) uint8, sRGB."""
    rate_hz: float
    duration_s: float
    """Duration of the images, s."""
    sound_duration_s: float
    """0 without sound."""


def load_video(path: Path) -> Video:
    """Decode a short video."""
    with av.open(str(path)) as container:
        rate_hz = float(container.streams.video[0].average_rate or 0)
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    sound_s = 0.0
    with av.open(str(path)) as container:
        if container.streams.audio:
            sound_s = sum(frame.samples / frame.sample_rate for frame in container.decode(audio=0))
    return Video(np.stack(frames), rate_hz, len(frames) / rate_hz, sound_s)
