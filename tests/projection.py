"""Where points are in an image."""

import numpy as np
from numpy.typing import NDArray

from fapengine.render.camera import Camera


def project(camera: Camera, points_mm: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """(..., 2) pixels, from the top left corner, of world points (..., 3) mm in an image of (width, height)."""
    matrix = camera.clip_from_world(size[0] / size[1])
    clip = points_mm @ matrix[:, :3].T + matrix[:, 3]
    return np.asarray((clip[..., :2] / clip[..., 3:] * 0.5 + 0.5) * np.asarray(size))
