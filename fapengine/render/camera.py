"""The camera: presets, and its projection matrix."""

from dataclasses import dataclass, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import UsageError

NEAR_MM, FAR_MM = 100.0, 3000.0


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera on a circle around a point of the head."""

    yaw_deg: float = 0.0
    """Rotation from the front towards the subject's left."""
    pitch_deg: float = 0.0
    """Rotation upwards."""
    target_mm: tuple[float, float, float] = (0.0, 18.0, 30.0)
    distance_mm: float = 900.0
    field_deg: float = 19.4
    """Vertical field of view."""

    def __post_init__(self) -> None:
        if not (NEAR_MM < self.distance_mm < FAR_MM / 1.5 and 1 < self.field_deg < 120):
            raise UsageError(f"camera: got {self}, expected {NEAR_MM:g} < distance < {FAR_MM / 1.5:g}, 1 < field < 120")

    @property
    def position_mm(self) -> Array:
        """(3,): position of the camera."""
        yaw, pitch = np.deg2rad([self.yaw_deg, self.pitch_deg])
        towards = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        return np.asarray(self.target_mm) + self.distance_mm * towards

    def clip_from_world(self, aspect: float) -> Array:
        """(4, 4): world mm to clip space; y points down, so that images are read top row first."""
        forward = np.asarray(self.target_mm) - self.position_mm
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        view = np.eye(4)
        view[:3, :3] = right, np.cross(right, forward), -forward
        view[:3, 3] = -view[:3, :3] @ self.position_mm
        scale = 1 / np.tan(np.deg2rad(self.field_deg) / 2)
        depth = FAR_MM - NEAR_MM
        projection = np.array(
            [
                [scale / aspect, 0, 0, 0],
                [0, -scale, 0, 0],
                [0, 0, -(FAR_MM + NEAR_MM) / depth, -2 * FAR_MM * NEAR_MM / depth],
                [0, 0, -1, 0],
            ]
        )
        return projection @ view

    def pixels_per_mm(self, height_px: int) -> float:
        """Pixels per millimetre at the target in an image of that height."""
        return height_px / (2 * self.distance_mm * float(np.tan(np.deg2rad(self.field_deg) / 2)))


PRESETS: dict[str, Camera] = {
    "front": Camera(),
    "close": Camera(target_mm=(0.0, 8.0, 60.0), distance_mm=800.0, field_deg=14.5),
    "three-quarter": Camera(yaw_deg=35.0, pitch_deg=4.0),
    "three-quarter-right": Camera(yaw_deg=-35.0, pitch_deg=4.0),
    "profile": Camera(yaw_deg=90.0),
    "profile-right": Camera(yaw_deg=-90.0),
    "low": Camera(pitch_deg=-18.0),
    "high": Camera(pitch_deg=22.0),
    "eyes": Camera(target_mm=(0.0, 26.0, 80.0), distance_mm=600.0, field_deg=11.0),
    "mouth": Camera(target_mm=(0.0, -36.0, 100.0), distance_mm=500.0, field_deg=11.0),
}
"""Cameras by name."""


def preset(name: str) -> Camera:
    """Return one of :data:`PRESETS`, or the front camera turned by ``"YAW,PITCH"`` in degrees.

    Raises
    ------
    UsageError
        If it is neither.

    Examples
    --------
    >>> preset("20,-5").yaw_deg
    20.0
    """
    if name in PRESETS:
        return PRESETS[name]
    try:
        yaw_deg, pitch_deg = map(float, name.split(","))
    except ValueError:
        raise UsageError(
            f"camera: got {name!r}, expected one of {', '.join(PRESETS)}, or YAW,PITCH in degrees"
        ) from None
    if not (-360 <= yaw_deg <= 360 and -89 <= pitch_deg <= 89):
        raise UsageError(f"camera: got {name!r}, expected a yaw of -360 to 360 and a pitch of -89 to 89 degrees")
    return replace(PRESETS["front"], yaw_deg=yaw_deg, pitch_deg=pitch_deg)


def turned(camera: Camera, turns: float) -> Camera:
    """Rotate a camera around the head by a number of turns towards the subject's left."""
    return replace(camera, yaw_deg=camera.yaw_deg + 360.0 * turns)
