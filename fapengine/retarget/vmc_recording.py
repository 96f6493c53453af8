"""A recorded VMC stream, as FAPs: the text output of ``oscdump`` of liblo (Debian: liblo-tools 0.31).

VMC has no file format; any of its streams can be recorded with ``oscdump 39539 > face.osc``. A line is the time of
arrival (two hexadecimal numbers, whole seconds and units of 2**-32 s), the address, the types and the values::

    eeada2a5.d7a6efc2 /VMC/Ext/Blend/Val sf "jawOpen" 0.250000

``/VMC/Ext/Blend/Apply`` ends a frame; shapes that were not sent since the last one keep their values. Times are the
sender's (``/VMC/Ext/T``) if every frame has one, else those of arrival. Other addresses are ignored.
"""

import re

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError, TruncatedError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget.blend_tracks import named_weights

LINE = re.compile(rb"[0-9a-f]{8}\.[0-9a-f]{8} /")
_VALUE = re.compile(r'sf "([^"]*)" (\S+)$')
_BONE = re.compile(r'sf+ "Head" (.+)$')
MAX_RATE_HZ = 240.0
MAX_FILLED = 100
"""Largest number of regular frames per recorded one: more means a wrong clock, and could need gigabytes."""
Frame = tuple[float | None, float, dict[str, float], tuple[float, ...]]
"""Sender's time, time of arrival, weights by name, rotation of the head as x, y, z, w."""


def is_vmc_recording(data: bytes) -> bool:
    """Detect the output of ``oscdump``."""
    return LINE.match(data) is not None


def parse_vmc_recording(data: bytes) -> FapTrack:
    """Read a recorded VMC stream.

    Raises
    ------
    TruncatedError
        If it has fewer than two frames.
    DataError
        If a line is not from ``oscdump``, a value is not a number, or the shapes are of no known set.
    """
    frames = _frames(data.decode("utf-8", errors="replace"))
    if len(frames) < 2:
        raise TruncatedError(f"VMC recording: got {len(frames)} frames, expected two or more")
    sent = [frame[0] for frame in frames]
    times_s = np.array([frame[1] for frame in frames])
    if None not in sent and (np.diff(np.array(sent, np.float64)) > 0).all():
        times_s = np.array(sent, np.float64)
    steps_s = np.diff(times_s)
    if (steps_s < 0).any() or times_s[-1] <= times_s[0]:
        raise DataError("VMC recording: times must rise")
    rate_hz = float(np.clip(round(1 / np.median(steps_s[steps_s > 0])), 1, MAX_RATE_HZ))
    count = int((times_s[-1] - times_s[0]) * rate_hz + 0.01) + 1
    if count > MAX_FILLED * len(frames):
        raise DataError(
            f"VMC recording: got times over {times_s[-1] - times_s[0]:g} s in {len(frames)} frames at {rate_hz:g} Hz,"
            f" expected at most {MAX_FILLED} times as long as its frames last"
        )
    shapes, weights = named_weights([frame[2] for frame in frames], sorted(frames[-1][2]), "/VMC/Ext/Blend/Val")
    turns = _turns_rad(np.array([frame[3] for frame in frames]))
    even_s = times_s[0] + np.arange(count) / rate_hz
    table = np.column_stack([np.clip(weights, 0.0, 1.0), turns])
    evenly = np.stack([np.interp(even_s, times_s, column) for column in table.T], axis=1)
    faps = shapes.to_faps(evenly[:, : len(shapes.names)])
    for index, number in enumerate((49, 48, 50)):
        faps[:, fap.column(number)] = evenly[:, len(shapes.names) + index] / AU_RAD
    return FapTrack.of(to_codable(faps), rate_hz=rate_hz)


def _frames(text: str) -> list[Frame]:
    frames: list[Frame] = []
    weights: dict[str, float] = {}
    head: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    sent_s: float | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        where = f"line {number}"
        if not line.strip():
            continue
        time, _, rest = line.partition(" ")
        address, _, values = rest.partition(" ")
        if LINE.match(line.encode()) is None:
            raise DataError(f"VMC recording: got {line:.40}, expected a line of oscdump", where=where)
        if address == "/VMC/Ext/Blend/Val" and (found := _VALUE.match(values)):
            weights[found[1]] = _number(found[2], where)
        elif address == "/VMC/Ext/T":
            sent_s = _number(values.removeprefix("f "), where)
        elif address == "/VMC/Ext/Bone/Pos" and (found := _BONE.match(values)):
            pose = tuple(_number(value, where) for value in found[1].split())
            if len(pose) != 7 or not 0.5 < sum(value**2 for value in pose[3:]) < 2:
                raise DataError(f"Head: got {found[1]:.60}, expected a position and a unit quaternion", where=where)
            head = pose[3:]
        elif address == "/VMC/Ext/Blend/Apply" and weights:
            arrived_s = int(time[:8], 16) + int(time[9:], 16) / 2**32
            frames.append((sent_s, arrived_s, dict(weights), head))
            sent_s = None
    return frames


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise DataError(f"VMC recording: got {text!r:.40}, expected a number", where=where)
    return value


def _turns_rad(rotations: Array) -> Array:
    """(T, 4) quaternions of Unity, rotation about z, then x, then y -> (T, 3) yaw, pitch, roll signs as FAPs."""
    x, y, z, w = (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).T
    yaw = np.arctan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * x - y * z), -1, 1))
    roll = np.arctan2(2 * (x * y + w * z), 1 - 2 * (x * x + z * z))
    return np.stack([-yaw, pitch, -roll], axis=1)
