"""Blendshape tracks: the CSV of Live Link Face and similar apps, MediaPipe's scores, Azure Speech's JSON, recorded VMC.

CSV has a header of shape names (any case, ``Left``/``Right`` or ``_L``/``_R``), found by name because their order
differs between tools, and one row per frame. The names decide the set: ARKit's 52, Oculus' 15 visemes, VRM's presets.
Azure sends JSON events ``{"FrameIndex": n, "BlendShapes": [[55 numbers], ...]}``, 60 frames per second: ARKit's 52 in
Live Link's order, then headRoll, leftEyeRoll, rightEyeRoll. Head rotations are in rad, with the signs of FAP 48 to 50;
no FAP rolls the eyes.

VMC has no file format; any of its streams can be recorded with ``oscdump 39539 > face.osc`` of liblo (Debian:
liblo-tools 0.31). A line is the time of arrival (two hexadecimal numbers, whole seconds and units of 2**-32 s), the
address, the types and the values::

    eeada2a5.d7a6efc2 /VMC/Ext/Blend/Val sf "jawOpen" 0.250000

``/VMC/Ext/Blend/Apply`` ends a frame; shapes that were not sent since the last one keep their values. Times are the
sender's (``/VMC/Ext/T``) if every frame has one, else those of arrival. Other addresses are ignored.
"""

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fapengine._arrays import Array
from fapengine.capture.conventions import parse_json
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget import visemes
from fapengine.retarget.arkit import approximate_arkit, arkit_map, arkit_to_faps
from fapengine.retarget.blend import ARKIT_NAMES


@dataclass(frozen=True, slots=True)
class ShapeSet:
    """A set of named shapes, and the conversion from and to FAPs."""

    key: str
    names: tuple[str, ...]
    """(B,) names as they are usually written."""
    from_faps: Callable[[Array, float], Array]
    """(T, 68) FAPU of one face over time, and their rate, Hz -> (T, B)."""
    to_faps: Callable[[Array], Array]
    """(T, B) -> (T, 68) FAPU."""
    aliases: tuple[tuple[str, str], ...] = ()
    """Other names, and the name that each means."""


_RPM_VOWELS = (("viseme_I", "ih"), ("viseme_O", "oh"), ("viseme_U", "ou"))
SHAPE_SETS = {
    entry.key: entry
    for entry in (
        ShapeSet(
            "arkit", tuple(name[0].upper() + name[1:] for name in ARKIT_NAMES),
            lambda faps, _rate_hz: approximate_arkit(faps), arkit_to_faps,
        ),
        ShapeSet(
            "oculus", visemes.OCULUS_NAMES, visemes.approximate_visemes, visemes.visemes_to_faps,
            tuple((before + name, name) for before in ("viseme_", "vrc.v_") for name in visemes.OCULUS_NAMES)
            + _RPM_VOWELS,
        ),
        ShapeSet("vrm0", visemes.VRM0_NAMES, visemes.approximate_presets, visemes.presets_to_faps),
        ShapeSet("vrm1", visemes.VRM1_NAMES, visemes.approximate_presets, visemes.presets_to_faps),
    )
}  # fmt: skip
"""Sets by key."""


def shape_set(key: str) -> ShapeSet:
    """Find a set.

    Raises
    ------
    UsageError
        If the key is unknown.
    """
    if key not in SHAPE_SETS:
        raise UsageError(f"shapes: got {key!r}, expected one of {', '.join(SHAPE_SETS)}")
    return SHAPE_SETS[key]


RATE_HZ = 60.0
"""Frame rate of Azure, and of Live Link Face unless its timecodes say otherwise."""
TIMECODE_RATES_HZ = (24, 25, 30, 48, 50, 60)
"""Usual rates at which timecodes count frames."""
AZURE_WIDTH = 55
SCORES_HZ = 30.0
"""Frame rate of scores without times."""
SCORE_KEYS = ("blendshapes", "faceBlendshapes", "face_blendshapes", "categories", "scores")
"""Keys of a frame's scores in MediaPipe's results, which depend on the programming language."""
TIME_KEYS = {"time": 1.0, "time_s": 1.0, "timestamp": 1e3, "timestamp_ms": 1e3, "timestampMs": 1e3}
"""Keys of a frame's time, and their units per second."""
CSV_TIMES = {"time": 1.0, "times": 1.0, "timestampms": 1e3, "timems": 1e3, "timestamp": 0.0}
"""Bare names of columns with times, and their units per second; 0 for seconds or milliseconds, by their steps."""
HEAD = {"headyaw": 49, "headpitch": 48, "headroll": 50}
"""Columns of head rotation that Live Link adds, in rad, and the FAP of each."""
MAX_FRAMES = 10_000_000
MAX_SHAPES_HZ = 1000.0
LATE = 0.5
"""How far a frame may be from its regular time before it counts as lost or late, in frames."""
MIN_NAMES = 8
MAX_WEIGHT, MAX_PER_CENT = 2.0, 200.0
"""Largest weight, and largest one in per cent; programs overdrive shapes."""


def parse_blend_track(data: bytes) -> FapTrack:
    """Read a track of blendshapes as FAPs.

    Raises
    ------
    TruncatedError
        If there is no frame.
    DataError
        If it is neither JSON events nor CSV with shape names, or a value is not a number; ``where`` is its place.
    """
    text = _decode(data)
    shapes, weights, head, clock = _json(text) if text.lstrip()[:1] in ("[", "{") else _csv(text)
    if not len(weights):
        raise TruncatedError("blend shapes: contains no frame")
    largest, remarks = float(weights.max(initial=0.0)), []
    if clock is None:
        rate_hz = RATE_HZ
        if len(weights) > 1:
            remarks.append(f"blend shapes: no times say the rate; read at {RATE_HZ:g} frames per second")
    elif isinstance(clock, float):
        rate_hz = clock
    else:
        table, rate_hz = _evened(np.column_stack([weights, *head.values()]), clock)
        weights, head = table[:, : weights.shape[1]], dict(zip(head, table[:, weights.shape[1] :].T, strict=True))
        longest_s = float(np.diff(clock).max())
        remarks.append(
            f"blend shapes: frames are up to {longest_s:.3g} s apart; filled at {rate_hz:g} frames per second"
        )
    if largest > MAX_PER_CENT:
        raise DataError(f"blend shapes: got a weight of {largest:g}, expected 0..1, or 0..100 per cent")
    if largest > MAX_WEIGHT:
        weights = weights / 100
        remarks.append(f"blend shapes: weights up to {largest:g} were read as per cent")
    faps = shapes.to_faps(np.clip(weights, 0.0, 1.0))
    furthest = max((float(np.abs(turn).max(initial=0.0)) for turn in head.values()), default=0.0)
    if furthest > np.pi:
        head = {number: np.deg2rad(turn) for number, turn in head.items()}
        remarks.append(f"blend shapes: turns of the head up to {furthest:g} were read as degrees")
    for number, turn in head.items():
        faps[:, fap.column(number)] = turn / AU_RAD
    return replace(FapTrack.from_values(to_codable(faps), rate_hz=rate_hz), remarks=tuple(remarks))


def is_blend_table(data: bytes) -> bool:
    """Whether data are a CSV table whose columns are blendshapes of one set."""
    first, _, _ = data.removeprefix(codecs.BOM_UTF8).lstrip().partition(b"\n")
    try:
        header = first.decode()
        find_set([_bare(cell) for cell in next(_cells(header), [])], where="line 1")
    except (DataError, csv.Error, UnicodeDecodeError):
        return False
    return True


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"blend shapes: is not UTF-8 text: {error.reason}", where=f"byte {error.start}") from error


Found = tuple[ShapeSet, Array, dict[int, Array], float | Array | None]
"""Set, weights (T, B), rotations of the head in rad by FAP, and frame rate, or each frame's time in s, or neither."""


def _json(text: str) -> Found:
    whole = parse_json(text, "blend shapes")
    events = whole if isinstance(whole, list) else [whole]
    if len(events) == 1 and isinstance(events[0], dict) and "weightMat" in events[0]:
        return _matrix(events[0])
    if len(events) == 1 and isinstance(events[0], dict) and isinstance(events[0].get("frames"), list):
        names, events = events[0].get("names"), events[0]["frames"]
        if isinstance(names, list):
            events = [_named(event, names, f"frame {number}") for number, event in enumerate(events, 1)]
    if not events:
        raise TruncatedError("blend shapes: contains no frame")
    return _azure(events) if any(isinstance(e, dict) and "FrameIndex" in e for e in events) else _scores(events)


def _named(frame: Any, names: list[Any], where: str) -> Any:
    """Give names to the ``weights`` of a frame whose file lists them once, in ``names``, as BEAT's does."""
    weights = frame.get("weights") if isinstance(frame, dict) else None
    if not isinstance(weights, list):
        return frame
    if len(weights) != len(names):
        raise DataError(f"weights: got {len(weights)}, expected {len(names)}, one per name", where=where)
    return {key: frame[key] for key in TIME_KEYS if key in frame} | {
        "scores": dict(zip(map(str, names), weights, strict=True))
    }


def _matrix(export: Mapping[str, Any]) -> Found:
    """Parse Audio2Face's export: ``facsNames``, ``weightMat`` with a row per frame, and ``exportFps``."""
    try:
        names, table = [str(name) for name in export["facsNames"]], np.array(export["weightMat"], np.float64)
        rate_hz = float(export.get("exportFps", SCORES_HZ))
        if table.shape != (len(table), len(names)) or not 1 <= rate_hz <= MAX_RATE_HZ:
            raise ValueError(
                f"weightMat of shape {table.shape} for {len(names)} names at {rate_hz:g} frames per second"
            )
    except (TypeError, KeyError, ValueError, OverflowError) as error:
        raise DataError(f"blend shapes: got {error!s:.80}, expected facsNames, weightMat and exportFps") from error
    shapes, columns = find_set([_bare(name) for name in names], where="facsNames")
    weights = np.zeros((len(table), len(shapes.names)))
    weights[:, [shapes.names.index(name) for name in columns]] = table[:, list(columns.values())]
    if not np.isfinite(weights).all():
        raise DataError("blend shapes: got a value that is not finite")
    return shapes, weights, {}, rate_hz


def _scores(events: list[Any]) -> Found:
    """Parse one object per frame: MediaPipe's categories, or scores by name."""
    frames: list[dict[str, float]] = []
    times_s: list[float] = []
    for number, event in enumerate(events):
        try:
            scores = event
            if isinstance(event, dict):
                scores = next((event[key] for key in SCORE_KEYS if key in event), event)
                at_s = next((float(event[key]) / per_s for key, per_s in TIME_KEYS.items() if key in event), None)
                times_s += [] if at_s is None else [at_s]
            if isinstance(scores, list):
                if scores and isinstance(scores[0], list):  # one list per face
                    scores = scores[0]
                scores = {str(s.get("categoryName", s.get("category_name"))): s["score"] for s in scores}
            frames.append({_bare(name): float(v) for name, v in scores.items() if name not in TIME_KEYS})
        except (TypeError, KeyError, ValueError, AttributeError, OverflowError) as error:
            raise DataError(
                f"blend shapes: got {type(error).__name__} {error}, expected scores by name, or Azure's FrameIndex and"
                f" frames of {AZURE_WIDTH} values",
                where=f"event {number + 1}",
            ) from error
    shapes, weights = named_weights(frames, list(dict.fromkeys(name for frame in frames for name in frame)), "event 1")
    clock: float | Array = SCORES_HZ
    if len(times_s) == len(frames) and len(frames) > 1 and times_s[-1] > times_s[0]:
        clock = _clock(np.array(times_s), "")
    return shapes, weights, {}, clock


def named_weights(frames: Sequence[Mapping[str, float]], names: list[str], where: str) -> tuple[ShapeSet, Array]:
    """Find the set of named shapes; returns it and the weights of all frames, (T, B), 0 where a name is missing.

    ``names`` are in lower case, as the keys of ``frames``; ``where`` says where they were read.

    Raises
    ------
    DataError
        If fewer than 8 names are of one set, or a weight is not finite.
    """
    shapes, columns = find_set([_bare(name) for name in names], where=where)
    weights = np.zeros((len(frames), len(shapes.names)))
    for name, column in columns.items():
        weights[:, shapes.names.index(name)] = [frame.get(names[column], 0.0) for frame in frames]
    if not np.isfinite(weights).all():
        raise DataError("blend shapes: got a value that is not finite")
    return shapes, weights


def _azure(events: list[Any]) -> Found:
    frames: dict[int, list[Any]] = {}
    for number, event in enumerate(events):
        where = f"event {number + 1}"
        try:
            first, rows = event["FrameIndex"], event["BlendShapes"]
            if isinstance(first, bool) or not isinstance(first, int) or not 0 <= first < MAX_FRAMES or not rows:
                raise ValueError(f"FrameIndex {first!r:.20}")
            for offset, row in enumerate(rows):
                if not isinstance(row, list) or len(row) != AZURE_WIDTH:
                    raise ValueError(f"a frame of {len(row) if isinstance(row, list) else row!r:.20} values")
                frames[first + offset] = row
        except (TypeError, KeyError, ValueError) as error:
            raise DataError(
                f"blend shapes: got {error}, expected FrameIndex and frames of 55 values", where=where
            ) from error
    order = sorted(frames)
    if order[-1] - order[0] + 1 > 4 * len(order) + 600:
        raise DataError(f"blend shapes: got frames {order[0]} to {order[-1]}, of which only {len(order)} are present")
    try:
        table = np.array([frames[index] for index in order], dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"blend shapes: got a value that is not a number: {error}") from error
    if not np.isfinite(table).all():
        raise DataError("blend shapes: got a value that is not finite")
    every = np.arange(order[0], order[-1] + 1)
    held = table[np.searchsorted(order, every, side="right") - 1]  # a lost frame repeats the previous one
    shapes = replace(SHAPE_SETS["arkit"], to_faps=arkit_map().to_faps)
    return shapes, held[:, :52], {50: held[:, 52]}, RATE_HZ


def _bare(name: str) -> str:
    """Normalise a shape's name: lower case, letters and digits only, sides in full."""
    low = name.strip().lower()
    for short, side in (("_l", "left"), ("_r", "right")):
        low = low.removesuffix(short) + side if low.endswith(short) else low
    return "".join(character for character in low if character.isalnum())


def _cells(text: str) -> Iterator[list[str]]:
    """Rows of a table; between semicolons or tabs numbers may have decimal commas."""
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    rows = csv.reader(io.StringIO(text), delimiter=delimiter)
    return rows if delimiter == "," else ([cell.replace(",", ".") for cell in row] for row in rows)


def _csv(text: str) -> Found:
    try:
        rows = [row for row in _cells(text) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise DataError(f"blend shapes: is not a table: {error}") from error
    header = [_bare(cell) for cell in rows[0]] if rows else []
    shapes, columns = find_set(header, where="line 1")
    wanted = {**columns, **{name: header.index(name) for name in HEAD if name in header}}
    table = np.zeros((len(rows) - 1, len(wanted)))
    for line, row in enumerate(rows[1:]):
        for column, index in enumerate(wanted.values()):
            try:
                table[line, column] = float(row[index])
            except (IndexError, ValueError) as error:
                raise DataError(
                    f"{header[index]}: got {row[index] if index < len(row) else 'nothing'!r:.40}, expected a number",
                    where=f"line {line + 2}, column {index + 1}",
                ) from error
    if not np.isfinite(table).all():
        line, column = np.argwhere(~np.isfinite(table))[0]
        raise DataError("got a number that is not finite", where=f"line {line + 2}, {list(wanted)[column]}")
    weights = np.zeros((len(table), len(shapes.names)))
    weights[:, [shapes.names.index(name) for name in columns]] = table[:, : len(columns)]
    turns = {HEAD[name]: table[:, len(columns) + n] for n, name in enumerate(list(wanted)[len(columns) :])}
    clock: float | Array | None = None
    timed = next((header.index(name) for name in CSV_TIMES if name in header), None)
    if timed is not None and len(rows) > 2:
        where = f"column {timed + 1}"
        try:
            times_s = np.array([float(row[timed]) for row in rows[1:]])
        except (IndexError, ValueError) as error:
            raise DataError(f"{header[timed]}: is not a number", where=where) from error
        if not (np.isfinite(times_s).all() and times_s[-1] > times_s[0]):
            raise DataError(f"time: got {times_s[0]:g} to {times_s[-1]:g} s, expected rising times", where=where)
        per_s = CSV_TIMES[header[timed]] or (1e3 if np.median(np.diff(times_s)) >= 1 else 1.0)
        clock = _clock(times_s / per_s, where)
    elif "timecode" in header:
        column = header.index("timecode")
        clock = _timecodes([row[column] if column < len(row) else "" for row in rows[1:]])
    return shapes, weights, turns, clock


def _timecodes(cells: Sequence[str]) -> float | Array | None:
    """Rate or times by Live Link Face's timecodes, ``HH:MM:SS:FF.fraction``; None if they do not tell.

    FF counts at a rate that the file does not state: the lowest usual one above its largest value, once a second is
    complete.
    """
    found = [re.fullmatch(r"(\d+):(\d+):(\d+):(\d+(?:\.\d+)?)", cell.strip()) for cell in cells]
    parts = np.array([[float(part) for part in match.groups()] for match in found if match])
    if len(parts) != len(cells) or len(parts) < 2:
        return None
    seconds_s, frames = parts[:, :3] @ (3600.0, 60.0, 1.0), parts[:, 3]
    base_hz = next((rate for rate in TIMECODE_RATES_HZ if int(frames.max()) < rate), None)
    if base_hz is None or np.ptp(seconds_s) < 1:
        return None
    times_s = np.unwrap(seconds_s + frames / base_hz, period=86_400.0)
    if times_s[-1] <= times_s[0]:
        return None
    if not np.ptp(frames):
        raise DataError("Timecode: got whole seconds, expected the frame in the last field; rename it to Time if it is")
    return _clock(times_s, "Timecode")


def find_set(header: list[str], *, where: str) -> tuple[ShapeSet, dict[str, int]]:
    """Find the set that most normalised names belong to, and the column of each of its names.

    Raises
    ------
    DataError
        If fewer than 8 names are of one set; ``where`` says where they were read.
    """
    candidates: list[tuple[ShapeSet, dict[str, int]]] = []
    for shapes in SHAPE_SETS.values():
        spelled = [(_bare(name), name) for name in shapes.names]
        spelled += [(_bare(alias), name) for alias, name in shapes.aliases]
        candidates.append((shapes, {name: header.index(bare) for bare, name in spelled if bare in header}))
    shapes, columns = max(candidates, key=lambda candidate: len(candidate[1]))
    if len(columns) < MIN_NAMES:
        raise DataError(
            f"blend shapes: got {len(columns)} names of {shapes.key} in the header, expected at least {MIN_NAMES}"
            f" of one of {', '.join(SHAPE_SETS)}",
            where=where,
        )
    return shapes, columns


def _rate(count: int, first_s: float, last_s: float, where: str) -> float:
    """Frame rate of ``count`` frames."""
    rate_hz = float(f"{(count - 1) / (last_s - first_s):.5g}")
    if not 1 <= rate_hz <= MAX_SHAPES_HZ:
        raise DataError(f"time: frames per second must be 1 to 1000, got {rate_hz:g}", where=where)
    return rate_hz


def _clock(times_s: Array, where: str) -> float | Array:
    """Mean frame rate of times, (T,) s, from which no frame is further than half a frame; otherwise the times."""
    if not np.isfinite(times_s).all():
        raise DataError("time: got one that is not finite", where=where)
    rate_hz = _rate(len(times_s), float(times_s[0]), float(times_s[-1]), where)
    steps_s = np.diff(times_s)
    even = np.abs(times_s - np.linspace(times_s[0], times_s[-1], len(times_s))).max() * rate_hz <= LATE
    return rate_hz if even or steps_s.min() <= 0 else times_s


def _evened(table: Array, times_s: Array) -> tuple[Array, float]:
    """Interpolate frames, (T, N), at regular times, the median step apart. Returns them and their rate."""
    rate_hz = float(f"{1 / np.median(np.diff(times_s)):.5g}")
    count = round((times_s[-1] - times_s[0]) * rate_hz) + 1
    if count > MAX_FILLED * len(table) or not 1 <= rate_hz <= MAX_SHAPES_HZ:
        raise DataError(f"time: got {len(table)} frames, expected most of {count:g} at {rate_hz:g} frames per second")
    regular_s = times_s[0] + np.arange(count) / rate_hz
    return np.stack([np.interp(regular_s, times_s, column) for column in table.T], axis=1), rate_hz


def format_blend_csv(track: FapTrack, shapes: str = "arkit") -> bytes:
    """Format FAPs as a CSV of shapes and head rotation in rad, with seconds in the first column.

    ``shapes`` is one of :data:`SHAPE_SETS`.

    Raises
    ------
    UsageError
        If the set is unknown.
    """
    chosen = shape_set(shapes)
    weights = chosen.from_faps(track.values.astype(np.float64), track.rate_hz)
    turns = np.stack([track.values[:, fap.column(number)] * AU_RAD for number in HEAD.values()], axis=1)
    lines = [",".join(("Time", *chosen.names, "HeadYaw", "HeadPitch", "HeadRoll"))]
    for time, row in zip(track.times_s - track.times_s[:1], np.column_stack([weights, turns]), strict=True):
        lines.append(f"{time:.6f}," + ",".join(f"{value:.5f}" for value in row))
    return ("\n".join(lines) + "\n").encode()


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
    return FapTrack.from_values(to_codable(faps), rate_hz=rate_hz)


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
