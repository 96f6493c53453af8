"""BVH, the text format of skeletons in motion: every joint is a marker.

A hierarchy of joints with offsets and channels, then one line of numbers for each frame. Rotations are in degrees and
apply in the order of the channels, about axes that move with the joint; positions replace the joint's offset, or are
added to it where a file writes them as zero. Lengths have no unit; a skeleton with feet and a head tells its size.
Layout: Meredith and Maddock 2001, "Motion capture file formats explained".
"""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.conventions import decode_text
from fapengine.capture.marker_track import RawTrack
from fapengine.errors import DataError, TruncatedError

MAX_JOINTS, MAX_DEPTH = 2000, 200
MAX_JOINTS_PER_CHANNEL = 2
"""A joint with one channel and its end: a small file cannot ask for gigabytes of joints that do not move."""
AXES = {"x": 0, "y": 1, "z": 2}
FOOT, HEAD = re.compile("foot|ankle|toe", re.IGNORECASE), re.compile("head|neck", re.IGNORECASE)
"""Names of joints at both ends of a body."""


@dataclass(slots=True)
class _Joint:
    name: str
    parent: int
    """Its index; -1 for a root."""
    offset: NDArray[np.float64]
    channels: list[tuple[str, int]]
    """``"position"`` or ``"rotation"``, and the axis."""


def parse_bvh(data: bytes) -> RawTrack:
    """Read a recording.

    Raises
    ------
    TruncatedError
        If it ends before its last frame.
    DataError
        If it is not BVH; ``where`` is the word.
    """
    words = decode_text(data, "BVH").split()
    if not words or words[0].upper() != "HIERARCHY":
        raise DataError(f"BVH: begins with {words[:1]}, expected HIERARCHY", where="word 1")
    try:
        joints, at = _hierarchy(words)
        if words[at].upper() != "MOTION" or words[at + 1].lower() != "frames:":
            raise DataError(f"BVH: got {words[at]!r:.20}, expected MOTION and Frames:", where=f"word {at + 1}")
        count, step_s = int(words[at + 2]), float(words[at + 5])
        rate_hz = _rate_hz(step_s, words[at + 5])
    except IndexError as error:
        raise TruncatedError("BVH: ends within its header", where=f"word {len(words)}") from error
    except ValueError as error:
        raise DataError(f"BVH: {error}", where="header") from error
    width = sum(len(joint.channels) for joint in joints)
    cells = words[at + 6 : at + 6 + count * width] if count > 0 else []
    if not cells or len(cells) < count * width:
        raise TruncatedError(f"BVH: has {len(cells)} of {max(count, 0) * width} numbers", where=f"word {len(words)}")
    try:
        frames = np.array(cells, np.float64).reshape(count, width)
    except ValueError as error:
        raise DataError(f"BVH: {error}", where="frames") from error
    frames[~np.isfinite(frames)] = np.nan
    places = _places(joints, frames)
    return RawTrack(
        positions=places,
        labels=tuple(joint.name for joint in joints),
        rate_hz=rate_hz,
        height=_height(joints, places[0]),
        notes=("every joint counts as a marker; BVH does not state its unit",),
    )


def _height(joints: list[_Joint], places: NDArray[np.float64]) -> float | None:
    """Longest way from a foot to a head along the bones, in the file's unit; None without a body."""
    bones = [float(np.linalg.norm(place - places[joint.parent])) for joint, place in zip(joints, places, strict=True)]
    ways: list[dict[int, float]] = []
    """Of each joint: the joints above it and itself, and how far it is from them."""
    for index, joint in enumerate(joints):
        above = ways[joint.parent] if joint.parent >= 0 else {}
        ways.append({each: length + bones[index] for each, length in above.items()} | {index: 0.0})
    feet = [way for joint, way in zip(joints, ways, strict=True) if FOOT.search(joint.name)]
    heads = [way for joint, way in zip(joints, ways, strict=True) if HEAD.search(joint.name)]
    lengths = [
        min((foot[each] + head[each] for each in foot.keys() & head.keys()), default=0.0)
        for foot in feet
        for head in heads
    ]
    height = max(lengths, default=0.0)
    return height if math.isfinite(height) and height > 0 else None


def _rate_hz(step_s: float, text: str) -> float | None:
    """Frame rate of a step that is rounded or cut: the whole rate, or NTSC's, that may be written like that."""
    if not math.isfinite(step_s) or step_s <= 1e-6:
        return None
    digits = len(text.partition(".")[2])
    whole = round(1 / step_s)
    near = (rate for rate in (whole, whole / 1.001) if rate and abs(1 / rate - step_s) < 10.0**-digits)
    return float(next(near, 1 / step_s))


def _hierarchy(words: list[str]) -> tuple[list[_Joint], int]:
    """Joints in the order of their channels, and the position of the word after them."""
    joints: list[_Joint] = []
    open_joints: list[int] = []
    at = 1
    while words[at].upper() != "MOTION":
        word = words[at].lower()
        if word in ("root", "joint", "end"):
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name} end" if word == "end" else words[at + 1]
            joints.append(_Joint(name, parent, np.zeros(3), []))
            if words[at + 2] != "{" or len(joints) > MAX_JOINTS or len(open_joints) >= MAX_DEPTH:
                raise ValueError(f"joint {name!r:.30}: has no block, or is one too many")
            open_joints.append(len(joints) - 1)
            at += 3
        elif word == "offset" and open_joints:
            joints[open_joints[-1]].offset = np.array(words[at + 1 : at + 4], np.float64)
            at += 4
        elif word == "channels" and open_joints:
            names = words[at + 2 : at + 2 + int(words[at + 1])]
            joints[open_joints[-1]].channels = [(name[1:].lower(), AXES.get(name[0].lower(), -1)) for name in names]
            wrong = [name for name, (kind, axis) in zip(names, joints[open_joints[-1]].channels, strict=True)
                     if kind not in ("position", "rotation") or axis < 0]  # fmt: skip
            if wrong or not 0 < len(names) <= 6:
                raise ValueError(f"channels: got {names}, expected up to six such as Xposition and Zrotation")
            at += 2 + len(names)
        elif word == "}" and open_joints:
            open_joints.pop()
            at += 1
        else:
            raise ValueError(f"got {words[at]!r:.20}, expected a joint, OFFSET, CHANNELS or a brace")
    offsets = [joint.offset for joint in joints]
    if not joints or open_joints or any(each.shape != (3,) or not np.isfinite(each).all() for each in offsets):
        raise ValueError("no joint, an open brace, or an offset without three finite numbers")
    width = sum(len(joint.channels) for joint in joints)
    if len(joints) > MAX_JOINTS_PER_CHANNEL * width:
        raise ValueError(f"{len(joints)} joints have {width} channels, expected one for every two joints or more")
    return joints, at


def _places(joints: list[_Joint], frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J, 3): every joint in every frame."""
    places = np.empty((len(frames), len(joints), 3))
    turns: list[NDArray[np.float64]] = []
    added = _are_added(joints, frames)
    column = 0
    for index, joint in enumerate(joints):
        local = np.tile(joint.offset, (len(frames), 1))
        values = frames[:, column : column + len(joint.channels)]
        column += len(joint.channels)
        turned = [(number, axis) for number, (kind, axis) in enumerate(joint.channels) if kind == "rotation"]
        for number, (kind, axis) in enumerate(joint.channels):
            if kind == "position":
                kept = local[:, axis] if added and joint.parent >= 0 else 0.0
                local[:, axis] = kept + values[:, number]
        turn = np.tile(np.eye(3), (len(frames), 1, 1))
        for number, axis in turned:
            turn = turn @ _about(axis, np.radians(np.nan_to_num(values[:, number])))
        if joint.parent < 0:
            places[:, index] = local
            turns.append(turn)
        else:
            above = turns[joint.parent]
            places[:, index] = places[:, joint.parent] + np.einsum("tij,tj->ti", above, local)
            turns.append(above @ turn)
    return places


def _are_added(joints: list[_Joint], frames: NDArray[np.float64]) -> bool:
    """Whether positions of joints below a root are nearer to zero than to the joints' offsets."""
    columns = [
        (column, joint.offset[axis])
        for column, (joint, kind, axis) in enumerate(
            (joint, *channel) for joint in joints for channel in joint.channels
        )
        if kind == "position" and joint.parent >= 0
    ]
    if not columns:
        return False
    values, offsets = frames[:, [column for column, _ in columns]], np.array([offset for _, offset in columns])
    return bool(np.nansum(abs(values)) < np.nansum(abs(values - offsets)))


def _about(axis: int, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, 3, 3): turns about an axis, counter-clockwise seen from its end."""
    turn = np.zeros((len(angles_rad), 3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, first, first] = turn[:, second, second] = np.cos(angles_rad)
    turn[:, second, first] = np.sin(angles_rad)
    turn[:, first, second] = -np.sin(angles_rad)
    return turn
