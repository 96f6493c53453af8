"""C3D, the recording format of marker systems: reader and writer.

Theory of operation
-------------------
Blocks of 512 bytes: a header, parameters in groups, data. Each frame holds four numbers for every point (x, y, z and a
word whose sign says whether the point was seen) and the analog samples, one channel of which may be sound. Numbers are
floats, or integers times POINT:SCALE, in the byte order of one of three processors; DEC floats are IEEE floats with
their halves exchanged, times four. Float data in this machine's byte order are used in place, so a memory map is read
frame by frame only where needed.

Layout: the C3D user guide, sections on header, parameters and 3D data. The frame count is stored in four places,
because the first two are 16 bits wide; the largest count that the data can hold is used.
"""

import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.capture.marker_track import RATES_HZ as SOUND_HZ
from fapengine.capture.marker_track import MarkerTrack, RawTrack, RecordedSound
from fapengine.errors import DataError, TruncatedError

Buffer = bytes | memoryview

BLOCK = 512
KEY = 0x50
INTEL, DEC, MIPS = 84, 85, 86
POINT_WORDS = 4
MAX_POINTS = 20_000
MODEL_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of POINT that list the results of a body model among the markers (Vicon's names)."""
SOUND_NAME = re.compile(r"audio|mic|sound|voice|speech|acoust", re.IGNORECASE)
"""Names of analog channels that are sound."""
PAGES = 64
"""Largest number of LABELS, LABELS2, ... that are read."""


@dataclass(frozen=True, slots=True)
class _Processor:
    order: str
    dec: bool

    def floats(self, data: Buffer, count: int, offset: int) -> NDArray[np.float32]:
        if not self.dec:
            return np.frombuffer(data, f"{self.order}f4", count, offset)
        halves = np.frombuffer(data, "<u2", 2 * count, offset).reshape(-1, 2)
        swapped = np.ascontiguousarray(halves[:, ::-1])
        return np.asarray(swapped.view("<f4")[:, 0] / np.float32(4), np.float32)

    def integers(self, data: Buffer, count: int, offset: int) -> NDArray[np.int16]:
        return np.frombuffer(data, f"{self.order}i2", count, offset)


Parameters = dict[str, dict[str, NDArray[np.float64] | list[str]]]


def parse_c3d(data: Buffer) -> RawTrack:
    """Read a recording.

    Parameters
    ----------
    data : bytes or memoryview
        The whole file; a memory map works too.

    Raises
    ------
    TruncatedError
        If it ends before its data do.
    DataError
        If it is not C3D, or its header contradicts itself; ``where`` is the byte.
    """
    layout = _layout(data)
    count, frames, remarks = layout.count, layout.frames, layout.remarks
    point = layout.parameters.get("POINT", {})
    labels, outputs = _labels(point, count), _model_outputs(point)
    kept = [index for index, label in enumerate(labels) if label not in outputs]
    if len(kept) < count:
        remarks += (f"{count - len(kept)} trajectories are model outputs (angles, forces ...), not markers: left out",)
    table = layout.table(data)[:, : POINT_WORDS * count].reshape(frames, count, POINT_WORDS)
    table = table if len(kept) == count else table[:, kept]
    with np.errstate(invalid="ignore"):  # of NaNs that signal, which a damaged file may hold
        positions = np.array(table[..., :3], np.float64)
    if not layout.real:
        positions *= layout.scale
    positions[~(table[..., 3] >= 0)] = np.nan
    positions[~np.isfinite(positions).all(axis=-1)] = np.nan
    return RawTrack(
        positions=positions,
        labels=tuple(labels[index] for index in kept),
        rate_hz=layout.rate if np.isfinite(layout.rate) and layout.rate > 0 else None,
        units=_text(point, "UNITS"),
        up=_text(point, "Y_SCREEN"),
        notes=remarks,
    )


@dataclass(frozen=True, slots=True)
class _Layout:
    processor: _Processor
    parameters: Parameters
    header: NDArray[np.int_]
    count: int
    """Number of points."""
    scale: float
    rate: float
    begin: int
    """Byte of the first frame."""
    frames: int
    words: int
    """Numbers of a frame: four for a point, and the analog samples."""
    real: bool
    """Whether they are floats."""
    remarks: tuple[str, ...]

    def table(self, data: Buffer) -> NDArray[Any]:
        """(frames, words)."""
        read = self.processor.floats if self.real else self.processor.integers
        return read(data, self.frames * self.words, self.begin).reshape(self.frames, self.words)


def _layout(data: Buffer) -> _Layout:
    """Read header and parameters."""
    if len(data) < BLOCK:
        raise TruncatedError(f"C3D: must have a header of {BLOCK} bytes, got {len(data)} bytes", where="byte 0")
    if data[1] != KEY or not data[0]:
        raise DataError(
            f"not a C3D file: starts with {bytes(data[:2]).hex(' ')} instead of a parameter block and 50",
            where="byte 0",
        )
    start = (data[0] - 1) * BLOCK
    if len(data) < start + 4:
        raise TruncatedError("C3D: ends before its parameters", where=f"byte {start}")
    processor = {INTEL: _Processor("<", False), DEC: _Processor("<", True), MIPS: _Processor(">", False)}.get(
        data[start + 3]
    )
    if processor is None:
        raise DataError(f"C3D: processor must be 84, 85 or 86, got {data[start + 3]}", where=f"byte {start + 3}")
    header = processor.integers(data, 10, 0).view(np.uint16 if processor.order == "<" else ">u2").astype(int)
    scale, rate = float(processor.floats(data, 1, 12)[0]), float(processor.floats(data, 1, 20)[0])
    parameters = _parameters(data, start, _parameters_end(data, start, int(header[8])), processor)
    point = parameters.get("POINT", {})
    count = int(_number(point, "USED", header[1]))
    if not 0 < count <= MAX_POINTS:
        raise DataError(f"C3D: must have 1 to {MAX_POINTS} points, got {count}", where="byte 2, or POINT:USED")
    scale, rate = _number(point, "SCALE", scale), _number(point, "RATE", rate)
    begin, remarks = _data_begin(data, start, [int(_number(point, "DATA_START", 0)), int(header[8])])
    real = scale < 0
    words = POINT_WORDS * count + int(header[2])
    width = words * (4 if real else 2)
    frames, notes = _frame_count(parameters, header, (len(data) - begin) // width)
    return _Layout(processor, parameters, header, count, scale, rate, begin, frames, words, real, (*remarks, *notes))


def parse_c3d_sound(data: Buffer) -> RecordedSound | None:
    """Read the analog channel that is sound: the first whose name says so, else the only one; None without one.

    Raises as :func:`parse_c3d`.
    """
    layout = _layout(data)
    analog = layout.parameters.get("ANALOG", {})
    each = max(int(layout.header[9]), 1)
    channels = int(layout.header[2]) // each
    rate_hz = each * layout.rate
    if not channels or channels * each != int(layout.header[2]) or not SOUND_HZ[0] <= rate_hz <= SOUND_HZ[1]:
        return None
    labels = (_labels(analog, channels) + ("",) * channels)[:channels]
    named = [index for index, label in enumerate(labels) if SOUND_NAME.search(label)]
    if not named and channels > 1:
        return None
    chosen = named[0] if named else 0
    samples = layout.table(data)[:, POINT_WORDS * layout.count :].reshape(-1, channels)[:, chosen]
    if not layout.real and _text(analog, "FORMAT") == "UNSIGNED":
        samples = samples.astype(np.int64) % 65536
    with np.errstate(invalid="ignore"):
        return RecordedSound.of(labels[chosen] or "analog", samples.astype(np.float64), rate_hz)


def _parameters_end(data: Buffer, start: int, data_block: int) -> int:
    """Byte after the parameters; data there is not a record, whatever the offset of the last one says.

    The number of parameter blocks and the block of the data may each be 0 or wrong; the later end is used.
    """
    return min(max(start + BLOCK * data[start + 2], (data_block - 1) * BLOCK), len(data)) or len(data)


def _data_begin(data: Buffer, start: int, blocks: list[int]) -> tuple[int, tuple[str, ...]]:
    """Byte of the first frame: from POINT:DATA_START or the header, else after the parameters."""
    for at, block in enumerate(blocks):
        if start < (block - 1) * BLOCK < len(data):
            note = f"POINT:DATA_START is {blocks[0]}: using the header's block {block}"
            return (block - 1) * BLOCK, (note,) if at and blocks[0] else ()
    begin = start + BLOCK * data[start + 2]
    if not start < begin < len(data):
        raise DataError(
            f"C3D: data must be after the parameters, got blocks {blocks} of {len(data) // BLOCK}",
            where="byte 16, and POINT:DATA_START",
        )
    return begin, (
        f"the file does not say where its data begin: read from block {begin // BLOCK + 1}, after the parameters",
    )


def _parameters(data: Buffer, start: int, end: int, processor: _Processor) -> Parameters:
    """Follow the chain of groups and parameters; each record holds the offset of the next."""
    groups: dict[int, str] = {}
    by_group: dict[int, dict[str, NDArray[np.float64] | list[str]]] = {}
    at = start + 4
    try:
        while at + 2 <= end:
            letters, group = struct.unpack_from("bb", data, at)
            letters = abs(letters)
            if not letters or not group:
                break
            name = bytes(data[at + 2 : at + 2 + letters]).decode("latin-1").strip().upper()
            value_at = at + 2 + letters
            (step,) = struct.unpack_from(f"{processor.order}h", data, value_at)
            if group < 0:
                groups[-group] = name
            else:
                by_group.setdefault(group, {})[name] = _value(data, value_at + 2, processor)
            if step <= 0:
                break
            at = value_at + step
    except (struct.error, IndexError, ValueError) as error:
        raise TruncatedError("C3D: a parameter runs past the end", where=f"byte {at}") from error
    parameters: Parameters = {}
    for number, values in by_group.items():
        parameters.setdefault(groups.get(number, str(number)), {}).update(values)
    return parameters


def _value(data: Buffer, at: int, processor: _Processor) -> NDArray[np.float64] | list[str]:
    kind, dimensions = struct.unpack_from("bB", data, at)
    shape = [data[at + 2 + index] for index in range(dimensions)]
    value_at, count = at + 2 + dimensions, int(np.prod(shape)) if shape else 1
    if value_at + count * abs(kind) > len(data):
        raise IndexError
    if kind == -1:
        width = shape[0] if shape else 1
        text = bytes(data[value_at : value_at + count]).decode("latin-1")
        return [text[n : n + width].strip("\0 ") for n in range(0, count, width)] if width else []
    if kind == 1:
        return np.frombuffer(data, np.uint8, count, value_at).astype(np.float64)
    if kind == 2:
        return processor.integers(data, count, value_at).astype(np.float64)
    if kind == 4:
        with np.errstate(invalid="ignore"):  # of NaNs that signal
            return processor.floats(data, count, value_at).astype(np.float64)
    return np.zeros(0)


def _number(group: dict[str, NDArray[np.float64] | list[str]], name: str, default: float) -> float:
    value = group.get(name)
    if not isinstance(value, np.ndarray) or not value.size or not np.isfinite(value[0]):
        return default
    number = float(value[0])
    return number + 65536 if name in ("USED", "DATA_START") and number < 0 else number


def _text(group: dict[str, NDArray[np.float64] | list[str]], name: str) -> str | None:
    value = group.get(name)
    return value[0] or None if isinstance(value, list) and value else None


def _labels(point: dict[str, NDArray[np.float64] | list[str]], count: int) -> tuple[str, ...]:
    labels: list[str] = []
    for page in range(1, PAGES):
        more = point.get("LABELS" if page == 1 else f"LABELS{page}")
        if not isinstance(more, list):
            break
        labels += more
    return tuple((labels + [""] * count)[:count])


def _model_outputs(point: dict[str, NDArray[np.float64] | list[str]]) -> set[str]:
    """Labels of trajectories that a body model wrote: angles and forces, not positions."""
    listed = (point.get(name) for name in MODEL_OUTPUTS)
    return {label for labels in listed if isinstance(labels, list) for label in labels if label}


def _frame_count(parameters: Parameters, header: NDArray[np.int_], room: int) -> tuple[int, tuple[str, ...]]:
    """Choose the largest count that the data can hold; without a count, all frames in the file."""
    claims = [int(header[4]) - int(header[3]) + 1]
    point, trial = parameters.get("POINT", {}), parameters.get("TRIAL", {})
    claims += [int(_number(point, name, 0)) % 65536 if name == "FRAMES" else int(_number(point, name, 0))
               for name in ("FRAMES", "LONG_FRAMES")]  # fmt: skip
    ends = [trial.get(name) for name in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD")]
    if all(isinstance(end, np.ndarray) and end.size == 2 and np.isfinite(end).all() for end in ends):
        first, last = (int(end[0]) % 65536 + 65536 * int(end[1]) for end in ends if isinstance(end, np.ndarray))
        claims.append(last - first + 1)
    claimed = max(claims)
    if room < 1:
        raise TruncatedError("C3D: ends before its first frame", where="data")
    if claimed < 1:
        return room, (f"no frame count: all {room} frames in the file are read",)
    held = [claim for claim in claims if 1 <= claim <= room]
    if not held:
        raise TruncatedError(f"C3D: truncated, has {room} of {claimed} frames", where="data")
    return max(held), ()


def format_c3d(track: MarkerTrack) -> bytes:
    """Write a recording: Intel floats, mm, gaps with residual -1 at the origin.

    Labels after the 255th go to LABELS2 and so on; a count above 65,535 frames goes to TRIAL:ACTUAL_END_FIELD and
    POINT:LONG_FRAMES.
    """
    frames, count = track.positions_mm.shape[:2]
    parameters, blocks = _written_parameters(track, 0)
    parameters, _ = _written_parameters(track, 2 + blocks)
    header = struct.pack("<BBHHHHHfHHf", 2, KEY, count, 0, 1, min(frames, 65535), 0, -1.0, 2 + blocks, 0, track.rate_hz)
    table = np.zeros((frames, count, POINT_WORDS), "<f4")
    table[..., :3] = np.nan_to_num(track.positions_mm)
    table[..., 3] = np.where(track.valid, 0.0, -1.0)
    return header.ljust(BLOCK, b"\0") + parameters + table.tobytes()


def _written_parameters(track: MarkerTrack, data_block: int) -> tuple[bytes, int]:
    frames, count = track.positions_mm.shape[:2]
    records = [_group(1, "POINT"), _group(2, "TRIAL"), _group(3, "ANALOG")]
    records += [
        _integers(1, "USED", [count]),
        _floats(1, "SCALE", [-1.0]),
        _floats(1, "RATE", [track.rate_hz]),
        _integers(1, "DATA_START", [data_block]),
        _integers(1, "FRAMES", [min(frames, 65535)]),
        _floats(1, "LONG_FRAMES", [frames]),
        _strings(1, "UNITS", ["mm"]),
        _strings(1, "Y_SCREEN", ["+Y"]),
        _integers(2, "ACTUAL_START_FIELD", [1, 0]),
        _integers(2, "ACTUAL_END_FIELD", [frames % 65536, frames // 65536]),
        _integers(3, "USED", [0]),
    ]
    for page, first in enumerate(range(0, count, 255), 1):
        records.append(_strings(1, "LABELS" + (str(page) if page > 1 else ""), track.labels[first : first + 255]))
    body = b"".join(records) + b"\0\0"
    blocks = -(-(len(body) + 4) // BLOCK)
    return (struct.pack("<BBBB", 1, KEY, blocks & 0xFF, INTEL) + body).ljust(blocks * BLOCK, b"\0"), blocks


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<hB", 3, 0)


def _record(group: int, name: str, body: bytes) -> bytes:
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<h", len(body) + 3) + body + b"\0"


def _integers(group: int, name: str, values: list[int]) -> bytes:
    data = np.array(values).astype("<u2").tobytes()
    return _record(group, name, struct.pack("<bBB", 2, 1, len(values)) + data)


def _floats(group: int, name: str, values: ArrayLike) -> bytes:
    data = np.asarray(values, "<f4")
    return _record(group, name, struct.pack("<bBB", 4, 1, data.size) + data.tobytes())


def _strings(group: int, name: str, values: tuple[str, ...] | list[str]) -> bytes:
    width = max(len(value) for value in values)
    data = b"".join(value.ljust(width).encode("latin-1", "replace") for value in values)
    return _record(group, name, struct.pack("<bBBB", -1, 2, width, len(values)) + data)
