"""Recordings as text: CSV and TSV tables, exports of Vicon, Qualisys and OptiTrack, and TRC of OpenSim.

The header of a table decides:

* long, one marker per row: columns named marker (or label), x, y, z and frame or time;
* wide, one frame per row: columns ``NAME_x NAME_y NAME_z`` (or ``NAME.x``, ``NAME:X``, ``NAME X``);
* Vicon Nexus: a row of names, each above its first column, a row ``Frame, Sub Frame, X, Y, Z ...``, a row of units;
* OptiTrack Motive: ``Format Version`` in the first cell, rows ``Type``, ``Name`` ..., then ``Frame, Time (Seconds)``;
* Qualisys QTM: lines ``NO_OF_FRAMES``, ``FREQUENCY``, ``MARKER_NAMES`` ..., then numbers;
* NDI Wave: ``Sensor 1 Id``, ``Sensor 1 Status`` ... (:mod:`.articulography`).

TRC, the format of Motion Analysis and OpenSim, has five header lines, then a line per frame.
"""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.articulography import is_wave, parse_wave
from fapengine.capture.conventions import decode_text, numbers, rate_of, split_rows, whole
from fapengine.capture.marker_track import MarkerTrack, RawTrack
from fapengine.errors import DataError, TruncatedError

Rows = list[list[str]]

MARKER_WORDS, FRAME_WORDS, TIME_WORDS = (
    {"marker", "label", "name"},
    {"frame", "frame#"},
    {"time", "time_s", "t", "time (seconds)"},
)
AXIS = re.compile(r"^(?P<name>.+?)[\s_.:\-]*(?P<axis>[xyz])(?:\s*[\[(](?P<unit>\w+)[\])])?$", re.IGNORECASE)
LENGTH_UNITS = {"mm", "cm", "m", "in", "inch"}
SEARCHED = 40
"""Lines searched for a header."""


def parse_table(data: bytes) -> RawTrack:
    """Read a recording in CSV or TSV.

    Raises
    ------
    TruncatedError
        If there is a header, but no frame.
    DataError
        If no header is recognized, or a cell is not a number; ``where`` is line and column.
    """
    rows = split_rows(decode_text(data, "table"))
    if not any(any(row) for row in rows):
        raise DataError("table: empty", where="line 1")
    if is_wave(rows[0]):
        return parse_wave(rows)
    first = rows[0][0].lower() if rows[0] else ""
    if first == "format version":
        return _optitrack(rows)
    if any(row and row[0].upper() == "MARKER_NAMES" for row in rows[:SEARCHED]):
        return _qualisys(rows)
    for line, row in enumerate(rows[:SEARCHED]):
        words = [cell.lower() for cell in row]
        if MARKER_WORDS & set(words) and {"x", "y", "z"} <= set(words):
            return _long(rows, line, words)
        if "sub frame" in words and words.count("x") >= 1:
            return _vicon(rows, line)
        axis_matches = [AXIS.match(cell) for cell in row]
        if sum(match is not None for match in axis_matches) >= 3 and words.count("x") == 0:
            return _wide(rows, line, axis_matches, words)
    raise DataError(
        "table: no header with markers; use columns marker, x, y, z or NAME_x, NAME_y, NAME_z", where="line 1"
    )


def _body(rows: Rows, line: int) -> Rows:
    body = [row for row in rows[line:] if any(row)]
    if not body:
        raise TruncatedError("table: contains no frames", where=f"line {line + 1}")
    return body


def _column(words: Sequence[str], wanted: set[str]) -> int | None:
    return next((index for index, word in enumerate(words) if word in wanted), None)


def _long(rows: Rows, line: int, words: list[str]) -> RawTrack:
    body = _body(rows, line + 1)
    marker, frame, time = (_column(words, wanted) for wanted in (MARKER_WORDS, FRAME_WORDS, TIME_WORDS))
    assert marker is not None
    when = frame if frame is not None else time
    if when is None:
        raise DataError("table: column frame or time missing", where=f"line {line + 1}")
    short = next((n for n, row in enumerate(body) if len(row) <= marker or not row[marker]), None)
    if short is not None:
        raise DataError("table: marker name missing", where=f"line {line + 2 + short}, column {marker + 1}")
    labels = tuple(dict.fromkeys(row[marker] for row in body))
    cells = [[row[c] if c < len(row) else "" for c in (when, time or 0, *map(words.index, "xyz"))] for row in body]
    table = numbers(cells if time is not None else [[c[0], "", *c[2:]] for c in cells], 5, line + 2)
    moments, places = np.unique(table[:, 0], return_inverse=True)
    if np.isnan(moments).any():
        bad = int(np.isnan(table[:, 0]).argmax())
        raise DataError("table: frame or time missing", where=f"line {line + 2 + bad}, column {when + 1}")
    positions = np.full((len(moments), len(labels), 3), np.nan)
    index = {name: number for number, name in enumerate(labels)}
    columns = np.array([index[row[marker]] for row in body])
    twice = np.bincount(places * len(labels) + columns, minlength=1)
    if twice.max() > 1:
        at = int(twice.argmax())
        raise DataError(f"table: marker {labels[at % len(labels)]!r} is repeated at {moments[at // len(labels)]:g}")
    positions[places, columns] = table[:, 2:]
    times = np.full(len(moments), np.nan)
    times[places] = table[:, 1]
    return RawTrack(
        positions=whole(positions), labels=labels, rate_hz=rate_of(times if time is not None else moments[:0])
    )


def _wide(rows: Rows, line: int, axis_matches: list[re.Match[str] | None], words: list[str]) -> RawTrack:
    columns: dict[str, dict[str, int]] = {}
    units = set()
    for index, match in enumerate(axis_matches):
        if match is not None and words[index] not in FRAME_WORDS | TIME_WORDS:
            columns.setdefault(match["name"].strip(), {})[match["axis"].lower()] = index
            units |= {match["unit"].lower()} if match["unit"] else set()
    partial = next((name for name, axes in columns.items() if len(axes) < 3), None)
    if partial is not None:
        raise DataError(
            f"table: marker {partial!r} has {'/'.join(sorted(columns[partial]))} only; needs x, y and z",
            where=f"line {line + 1}",
        )
    order = [axes[axis] for axes in columns.values() for axis in "xyz"]
    time = _column(words, TIME_WORDS)
    used = {*order, time}  # others may hold text, such as the name of a condition
    body = [[cell if column in used else "" for column, cell in enumerate(row)] for row in _body(rows, line + 1)]
    table = numbers(body, len(rows[line]), line + 2)
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=tuple(columns),
        rate_hz=None if time is None else rate_of(table[:, time]),
        units=next(iter(units)) if len(units) == 1 else None,
    )


def _spread(names: Sequence[str], axes: Sequence[str]) -> tuple[tuple[str, ...], list[int]]:
    """Labels, and the columns of all coordinates in order; a name is above the first of its three columns."""
    labels, order, name = [], [], ""
    for index, axis in enumerate(axes):
        name = names[index] if index < len(names) and names[index] else name
        if axis.lower() == "x" and [a.lower() for a in axes[index : index + 3]] == ["x", "y", "z"]:
            labels.append(name)
            order += [index, index + 1, index + 2]
    return tuple(labels), order


def _vicon(rows: Rows, line: int) -> RawTrack:
    """Read Nexus; of the blocks in the file, the trajectories are the one with axes X, Y, Z."""
    labels, order = _spread(rows[line - 1] if line else [], rows[line])
    if not labels or not all(labels):
        raise DataError("table: marker names above X, Y, Z missing", where=f"line {line}")
    units = rows[line + 1] if line + 1 < len(rows) else []
    unit = next((cell.lower() for cell in units if cell.lower() in LENGTH_UNITS), None)
    stop = next((n for n in range(line + 1, len(rows)) if not any(rows[n])), len(rows))
    body = [row for row in rows[line + 1 : stop] if row[0].lstrip("-").isdigit()]
    if not body:
        raise TruncatedError("table: contains no frames", where=f"line {line + 1}")
    table = numbers(body, len(rows[line]), line + 2 + bool(unit))
    rates = [row[0] for row in rows[:line] if len([c for c in row if c]) == 1 and row[0].replace(".", "").isdigit()]
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=labels,
        rate_hz=float(rates[-1]) if rates and float(rates[-1]) > 0 else None,
        units=unit,
        up="+z",  # of Nexus
    )


def _optitrack(rows: Rows) -> RawTrack:
    facts = dict(zip((cell.lower() for cell in rows[0][::2]), rows[0][1::2], strict=False))
    line = next((n for n, row in enumerate(rows[:SEARCHED]) if row and row[0].lower() == "frame"), None)
    names = next((row for row in rows[:SEARCHED] if "Name" in row[:2]), None)
    kinds = next((row for row in rows[:SEARCHED] if "Type" in row[:2]), None)
    if line is None or names is None:
        raise DataError("table: rows Name and Frame of a Motive export missing", where="line 1")
    labels, order = _spread(names, rows[line])
    if kinds is not None:  # bones and rigid bodies have positions too
        kept = [
            n
            for n in range(len(labels))
            if kinds[order[3 * n] : order[3 * n] + 1] and "marker" in kinds[order[3 * n]].lower()
        ]
        labels, order = tuple(labels[n] for n in kept), [c for n in kept for c in order[3 * n : 3 * n + 3]]
    if not labels:
        raise DataError("table: contains no marker columns", where=f"line {line + 1}")
    table = numbers(_body(rows, line + 1), len(rows[line]), line + 2)
    units = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "inch"}
    return RawTrack(
        positions=whole(table[:, order].reshape(len(table), -1, 3)),
        labels=labels,
        rate_hz=rate_of(table[:, 1]),
        units=units.get(facts.get("length units", "").lower()),
        up="+y",  # of Motive
    )


def _qualisys(rows: Rows) -> RawTrack:
    facts = {row[0].upper(): row[1:] for row in rows[:SEARCHED] if row and not _is_number(row[0])}
    labels = tuple(name for name in facts["MARKER_NAMES"] if name)
    line = next((n for n, row in enumerate(rows) if row and _is_number(row[0])), None)
    if not labels or line is None:
        raise TruncatedError("table: no frames after MARKER_NAMES", where=f"line {len(rows)}")
    body = _body(rows, line)
    extra = max(len(row) for row in body) - 3 * len(labels)
    if extra < 0 or extra > 3:
        raise DataError(
            f"table: must have {3 * len(labels)} columns, or frame and time before them, got {3 * len(labels) + extra}",
            where=f"line {line + 1}",
        )
    skipped = 2 if extra >= 2 else 0  # frame and time; a tab after the last column makes one more
    table = numbers(body, skipped + 3 * len(labels), line + 1)
    rate = facts.get("FREQUENCY", [""])
    return RawTrack(
        positions=whole(table[:, skipped:].reshape(len(table), len(labels), 3)),
        labels=labels,
        rate_hz=float(rate[0]) if rate and _is_number(rate[0]) and float(rate[0]) > 0 else None,
        units="mm",  # of QTM
        up="+z",
    )


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell.replace(",", "."))))
    except ValueError:
        return False


def format_table(track: MarkerTrack, *, long: bool = False, delimiter: str = ",") -> bytes:
    """Write a recording in mm: one frame per row, or with ``long`` one visible marker per row."""
    times: NDArray[np.float64] = np.arange(track.frame_count) / track.rate_hz
    if long:
        lines = [delimiter.join(("frame", "time", "marker", "x", "y", "z"))]
        for frame, marker in np.argwhere(track.valid):
            cells = (f"{value:.5f}" for value in track.positions_mm[frame, marker])
            lines.append(delimiter.join((str(frame), f"{times[frame]:.6f}", track.labels[marker], *cells)))
    else:
        names = (f"{name}_{axis} [mm]" for name in track.labels for axis in "xyz")
        lines = [delimiter.join(("frame", "time", *names))]
        for index, frame in enumerate(track.positions_mm):
            cells = ("" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel())
            lines.append(delimiter.join((str(index), f"{times[index]:.6f}", *cells)))
    return ("\n".join(lines) + "\n").encode()


FIRST_COLUMNS = 2
"""Frame number and time."""


def parse_trc(data: bytes) -> RawTrack:
    """Read a recording in TRC.

    Raises
    ------
    TruncatedError
        If it ends within its header, or without a frame.
    DataError
        If a header field or a cell is wrong; ``where`` is the line.
    """
    lines = decode_text(data, "TRC").splitlines()
    if not lines or not lines[0].startswith("PathFileType"):
        raise DataError(f"TRC: must start with PathFileType, got {(lines or [''])[0]!r:.40}", where="line 1")
    if len(lines) < 6:
        raise TruncatedError(
            f"TRC: must have a header of 5 lines and frames, got {len(lines)} lines", where=f"line {len(lines)}"
        )
    sign = max("\t,", key=lines[3].count)
    rows = [[cell.strip() for cell in (line.split(sign) if sign in line else line.split())] for line in lines]
    names, values = ([cell for cell in row if cell] for row in rows[1:3])  # some write two TABs between them
    if len(names) != len(values):
        names, values = rows[1:3]
    fields = dict(zip((name.lower() for name in names), values, strict=False))
    labels, columns = _trc_names(rows[3][FIRST_COLUMNS:])
    if not labels:
        raise DataError("TRC: contains no marker names", where="line 4")
    first = next((n for n in range(4, len(rows)) if rows[n] and rows[n][0].lstrip("-").isdigit()), None)
    if first is None:
        raise TruncatedError("TRC: contains no frames", where=f"line {len(rows)}")
    body = [row for row in rows[first:] if any(row)]
    filled = np.array([max(n for n, cell in enumerate(row) if cell) + 1 for row in body])
    held, odd = divmod(int(filled.max()) - FIRST_COLUMNS, 3)
    if odd and held >= columns[-1] + 1:
        raise DataError(
            f"TRC: {filled.max()} cells; must be {FIRST_COLUMNS} and three for each of"
            f" {len(labels)} named or more markers",
            where=f"line {first + int(filled.argmax()) + 1}",
        )
    count = max(held, columns[-1] + 1)
    table = numbers(body, FIRST_COLUMNS + 3 * count, first + 1)
    stated = _trc_rate(fields)
    positions = whole(table[:, FIRST_COLUMNS:].reshape(len(table), count, 3)[:, columns])
    wanted = fields.get("nummarkers", "")
    notes: tuple[str, ...] = ()
    if count > len(labels):
        notes = (f"{count - len(labels)} of {count} trajectories have no name and are left out",)
    elif wanted.isdigit() and int(wanted) != len(labels):
        notes = (f"NumMarkers says {wanted}, but {len(labels)} are named",)
    return RawTrack(
        positions=positions,
        labels=labels,
        rate_hz=stated or rate_of(table[:, 1]),
        units=fields.get("units") or None,
        notes=notes,
    )


def _trc_names(cells: list[str]) -> tuple[tuple[str, ...], list[int]]:
    """Labels, and the trajectory index of each: a label is above the first of three columns, or they are contiguous."""
    at = [index for index, cell in enumerate(cells) if cell]
    spread = all(index % 3 == 0 for index in at)
    return tuple(cells[index] for index in at), [index // 3 for index in at] if spread else list(range(len(at)))


def _trc_rate(fields: dict[str, str]) -> float | None:
    try:
        rate = float(fields.get("datarate", ""))
    except ValueError:
        return None
    return rate if np.isfinite(rate) and rate > 0 else None


def format_trc(track: MarkerTrack) -> bytes:
    """Write a recording in mm; positions that were not seen are left empty."""
    frames, count = track.positions_mm.shape[:2]
    rate = f"{track.rate_hz:.10g}"
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tfapengine.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{count}\tmm\t{rate}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(track.labels) + "\t\t",
        "\t\t" + "\t".join(f"X{n}\tY{n}\tZ{n}" for n in range(1, count + 1)),
        "",
    ]
    for index, frame in enumerate(track.positions_mm):
        cells = ("" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel())
        lines.append(f"{index + 1}\t{index / track.rate_hz:.6f}\t" + "\t".join(cells))
    return ("\n".join(lines) + "\n").encode()
