"""From what a file says to what it means: missing markers, units, axes, labels; and checks for implausible motion.

Nothing here is silent: every correction made on a guess comes back as a note.

Before that, tables of numbers in text: decoding, delimiters, decimal commas, empty cells.
"""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.capture.marker_track import MarkerTrack, RawTrack
from fapengine.errors import DataError, UsageError, as_data_error

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "."})
LIMIT = 1 << 17
"""Longest cell; longer ones are not a table's."""


def decode_text(data: bytes, name: str) -> str:
    """Decode UTF-8 (with or without BOM), UTF-16 with BOM, or Latin-1 as old systems write it.

    Raises
    ------
    DataError
        If there are NUL bytes.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        raise DataError(f"{name}: is not text, contains NUL bytes", where=f"character {text.index(chr(0))}")
    return text


def parse_json(text: str, name: str) -> Any:
    """Read a JSON document, or JSON lines as the list of their values.

    Raises
    ------
    DataError
        If it is neither, or nested too deeply.
    """
    try:
        try:
            return json.loads(text)
        except ValueError:
            return [json.loads(line) for line in text.splitlines() if line.strip()]
    except ValueError as error:
        raise DataError(f"{name}: is neither JSON nor JSON lines: {error}") from error
    except RecursionError as error:
        raise DataError(f"{name}: is nested too deeply") from error


def split_rows(text: str) -> list[list[str]]:
    """Split text into stripped cells; the delimiter is the most frequent of tab, ``;`` and ``,`` in the longest line.

    Raises
    ------
    DataError
        If a cell is too long.
    """
    longest = max(text.splitlines(), key=len, default="")
    delimiter = max("\t;,", key=longest.count)
    csv.field_size_limit(LIMIT)
    try:
        return [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter)]
    except csv.Error as error:
        raise DataError(f"table: {error}") from error


def numbers(rows: Sequence[Sequence[str]], width: int, first_line: int) -> NDArray[np.float64]:
    """Parse cells, (R, width) float64; empty cells, missing line ends and NA are NaN, decimal commas are points.

    Raises
    ------
    DataError
        For a cell that is not a number; ``where`` is line and column.
    """
    table = np.full((len(rows), width), np.nan)
    for index, row in enumerate(rows):
        for column, cell in enumerate(row[:width]):
            if cell.lower() in MISSING:
                continue
            try:
                table[index, column] = float(cell.replace(",", "."))
            except ValueError as error:
                raise DataError(
                    f"not a number: {cell!r:.40}", where=f"line {first_line + index}, column {column + 1}"
                ) from error
    table[~np.isfinite(table)] = np.nan
    return table


def whole(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Set all three coordinates to NaN where one is: (T, M, 3) -> (T, M, 3)."""
    return np.where(np.isnan(positions).any(axis=-1, keepdims=True), np.nan, positions)


def rate_of(times_s: NDArray[np.float64]) -> float | None:
    """Frame rate of rising times, (T,) s, to five digits; None if there are too few or they do not rise."""
    steps = np.diff(times_s[~np.isnan(times_s)])
    return float(f"{1.0 / np.median(steps):.5g}") if len(steps) and np.median(steps) > 0 else None


UNITS_MM = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
"""Length of one unit in mm."""
SENTINELS = (-16512.0, 16512.0, 9999.0, -9999.0, 99999.0, -99999.0, 999999.0, -999999.0, 9999999.0, -9999999.0)
"""Numbers that mean "not seen" in exports of several systems."""
ABSURD = 1e6
"""Distance in mm, 1 km, beyond which a marker is taken as missing."""
FACE_MM = (40.0, 700.0)
"""Diagonal of the box around a face's markers, from lips alone to a whole head."""
BODY_MM = (900.0, 2600.0)
"""Diagonal of the box around the markers of a whole body."""
PERSON_MM, USUAL_PERSON_MM = (1500.0, 2400.0), 1900.0
"""From toes to the top of the head along the bones, and that of a person 1.75 m tall."""
SHOWN = 3
"""Labels listed in a note."""
UNLABELLED = re.compile(r"^(\*\d*|u[_ ]?\d+|unl?abell?ed[ _-]*\d*|uname\*?\d*|new \d+)$", re.IGNORECASE)
POINT_NAME = re.compile(r"^(?:fdp|fp|p)?[ _-]?(\d{1,2})[._-](\d{1,2})$", re.IGNORECASE)
FRAMES_FOR_SIZE = 500
AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
MIN_ZEROS = 3
"""Number of zero positions of one marker from which they mean "not seen"; fewer may be real."""
MAX_COORDINATE = 1e9
"""Largest coordinate, in any unit: a thousand kilometres in millimetres."""


def understand(
    raw: RawTrack, *, units: str | None = None, up: str | None = None, rate_hz: float | None = None
) -> tuple[MarkerTrack, tuple[str, ...]]:
    """Make a MarkerTrack, mm, +y up.

    Parameters
    ----------
    raw : RawTrack
    units : str, optional
        One of :data:`UNITS_MM`; overrides the file's.
    up : str, optional
        One of :data:`AXES`; overrides the file's. Without either, +y.
    rate_hz : float, optional
        Overrides the file's.

    Returns
    -------
    track : MarkerTrack
    notes : tuple of str
        What was guessed, dropped or looks wrong.

    Raises
    ------
    UsageError
        If ``units`` or ``up`` is unknown.
    DataError
        If there is no frame, no labelled marker, no rate, or no way to know the units.
    """
    check_conventions(units, up)
    notes = list(raw.notes)
    if not raw.positions.size:
        raise DataError(f"recording: contains no frames or no markers, got shape {raw.positions.shape}")
    rate = rate_hz if rate_hz is not None else raw.rate_hz
    if rate is None:
        raise DataError("recording: frame rate missing; give rate_hz (in session.toml), or rising times")
    labels, kept = _names(raw.labels, notes)
    positions = raw.positions if len(kept) == len(raw.labels) else raw.positions[:, kept]
    if raw.height is None:  # the joints of a body are always seen, also one at the origin
        positions = _without_sentinels(positions, labels, notes)
    if (beyond := np.abs(positions) > MAX_COORDINATE).any():
        raise DataError(f"recording: coordinates must be at most {MAX_COORDINATE:g}, got {positions[beyond][0]:g}")
    scale = _scale(positions, raw.units, units, notes) if raw.height is None else _body_scale(raw.height, units, notes)
    positions = positions if scale == 1.0 else positions * scale
    positions = _without_absurd(positions, labels, notes)
    positions = _turned(positions, _axis(up, raw.up, notes))
    with as_data_error():
        return MarkerTrack(positions_mm=positions, labels=labels, rate_hz=rate), tuple(notes)


def _names(raw_names: Sequence[str], notes: list[str]) -> tuple[tuple[str, ...], list[int]]:
    """Labels without prefixes, and the columns that have one."""
    names = [name.strip() for name in raw_names]
    kept = [index for index, name in enumerate(names) if name and not UNLABELLED.match(name.split(":")[-1])]
    if len(kept) < len(names):
        notes.append(f"{len(names) - len(kept)} trajectories without a label are left out")
    if not kept:
        raise DataError(f"recording: none of {len(names)} trajectories is labelled")
    prefixes = {names[index].rpartition(":")[0] for index in kept}
    labels = [names[index].rpartition(":")[2] if len(prefixes) == 1 else names[index] for index in kept]
    labels = [f"{int(m[1])}.{int(m[2])}" if (m := POINT_NAME.match(label)) else label for label in labels]
    return _different(labels, notes), kept


def _different(labels: Sequence[str], notes: list[str]) -> tuple[str, ...]:
    """Append numbers to repeated labels: old systems cut them to four characters."""
    twice = [label for label, count in Counter(labels).items() if count > 1]
    if not twice:
        return tuple(labels)
    notes.append(
        f"labels {', '.join(twice[:SHOWN])}{' ...' if twice[SHOWN:] else ''} are repeated: later ones are"
        f" called {again(twice[0])} ..."
    )
    given: dict[str, None] = {}
    for label in labels:
        number = 2
        name = label
        while name in given:
            name, number = again(label, number), number + 1
        given[name] = None
    return tuple(given)


def again(label: str, number: int = 2) -> str:
    """Name the second, third ... marker with the same label."""
    return f"{label}#{number}"


def _without_sentinels(positions: Array, labels: Sequence[str], notes: list[str]) -> Array:
    """Replace zeros and numbers that mean "not seen" by gaps."""
    large = np.abs(positions) >= min(map(abs, SENTINELS))
    for value in SENTINELS if large.any() else ():
        hits = np.any(positions == value, axis=-1)
        if hits.any():
            notes.append(f"{hits.sum()} places of {value:g} are taken as not seen ({_most(hits, labels)})")
            positions = np.where(hits[..., None], np.nan, positions)
    x, y, z = np.moveaxis(positions == 0.0, -1, 0)
    zeros = x & y & z
    zeros = zeros & (zeros.sum(axis=0) >= min(MIN_ZEROS, len(positions)))
    if zeros.any():
        notes.append(f"{zeros.sum()} places at the origin are taken as not seen ({_most(zeros, labels)})")
        positions = np.where(zeros[..., None], np.nan, positions)
    return positions


def _without_absurd(positions: Array, labels: Sequence[str], notes: list[str]) -> Array:
    beyond = np.abs(positions) > ABSURD
    if beyond.any():
        far = np.any(beyond, axis=-1)
        notes.append(f"{far.sum()} places farther than a kilometre are taken as not seen ({_most(far, labels)})")
        positions = np.where(far[..., None], np.nan, positions)
    return positions


def _most(hits: NDArray[np.bool_], labels: Sequence[str]) -> str:
    counts = hits.sum(axis=0)
    worst = np.argsort(-counts, kind="stable")[:3]
    return ", ".join(f"{labels[index]} {counts[index]}x" for index in worst if counts[index])


def check_conventions(units: str | None, up: str | None) -> None:
    """Raise a UsageError for a unit or an upward axis that :func:`understand` does not know."""
    if units is not None and units.lower() not in UNITS_MM:
        raise UsageError(f"units: unknown unit {units!r}; use {', '.join(UNITS_MM)}")
    if up and _signed(up) not in AXES:
        raise UsageError(f"up: unknown axis {up!r}; use {', '.join(AXES)}")


def _signed(axis: str) -> str:
    axis = axis.strip().lower()
    return axis if axis[:1] in ("+", "-") else f"+{axis}"


def _scale(positions: Array, stated: str | None, units: str | None, notes: list[str]) -> float:
    """Factor to mm: as requested, as the file says, else mm if that gives the size of a face."""
    unit = (units or stated or "").lower()
    if unit and unit not in UNITS_MM:
        notes.append(f"the file's unit {unit!r} is unknown")
        unit = ""
    size = _diagonal(positions)
    factor = UNITS_MM.get(unit, 1.0)
    fits = size is None or FACE_MM[0] <= size * factor <= FACE_MM[1]
    others = [
        f"{name} would make it {size * length:.0f} mm"
        for name, length in UNITS_MM.items()
        if size is not None and FACE_MM[0] <= size * length <= FACE_MM[1] and name not in ("dm", "inch")
    ]
    if size is not None and BODY_MM[0] <= size * UNITS_MM["m"] <= BODY_MM[1]:
        others.insert(0, f"m would make it {size * UNITS_MM['m']:.0f} mm, a body")
    hint = f" ({'; '.join(others)})" if others else ""
    if unit and not fits:
        notes.append(f"the markers span {(size or 0) * factor:.4g} mm, which is not a face: wrong units?{hint}")
    elif not unit and not fits:
        raise DataError(
            f"units: not stated, and the markers span {size:.4g} of them, not a face in mm{hint}; give units=UNIT"
        )
    elif not unit:
        notes.append(f"units are not stated: taken as mm{'' if size is None else f', the markers span {size:.0f}'}")
    return factor


def _body_scale(height: float, units: str | None, notes: list[str]) -> float:
    """Factor to mm of a skeleton: as requested, else the unit that gives a person, else a person's usual size."""
    unit = (
        units.lower()
        if units
        else next((name for name, length in UNITS_MM.items() if PERSON_MM[0] <= height * length <= PERSON_MM[1]), "")
    )
    factor = UNITS_MM[unit] if unit else USUAL_PERSON_MM / height
    tall = f"the skeleton is {height:.4g} long from toe to head"
    if not units:
        taken = (
            f"taken as {unit}" if unit else f"in no usual unit: 1 is taken as {factor:.4g} mm, so that it is a person"
        )
        notes.append(f"units are not stated: {tall}, {taken}")
    elif not PERSON_MM[0] <= height * factor <= PERSON_MM[1]:
        notes.append(f"{tall}, {height * factor:.4g} mm, which is not a person: wrong units?")
    return factor


def _diagonal(positions: Array) -> float | None:
    """Diagonal of the box around the median positions of some frames; None if fewer than three markers are seen."""
    positions = positions[:: max(1, len(positions) // FRAMES_FOR_SIZE)]
    seen = ~np.isnan(positions[..., 0]).all(axis=0)
    if seen.sum() < 3:
        return None
    places = np.nanmedian(positions[:, seen], axis=0)
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def _axis(up: str | None, stated: str | None, notes: list[str]) -> str:
    """Normalise the axis that points up to one of :data:`AXES`."""
    axis = _signed(up or stated or "+y")
    if axis in AXES:
        return axis
    notes.append(f"the file's upward axis {stated!r} is unknown: taken as +y")
    return "+y"


def _turned(positions: Array, up: str) -> Array:
    """Rotate so that ``up`` becomes +y, without mirroring."""
    number, sign = "xyz".index(up[1]), 1.0 if up[0] == "+" else -1.0
    if up == "+y":
        return positions
    rotation = np.zeros((3, 3))
    rotation[1, number] = sign
    rotation[0, 1 if number == 0 else 0] = 1.0
    rotation[2] = np.cross(rotation[0], rotation[1])
    return np.asarray(positions @ rotation.T)


MAX_SPEED_MM_S = 1500.0
"""Lips and jaw stay below a fifth of this in speech; a fast head turn comes close."""
EXCHANGE_SHARE = 0.5
"""Markers have swapped if swapping them back leaves less than this fraction of their steps."""
SHOWN_FINDINGS = 5


def check_track(track: MarkerTrack) -> tuple[str, ...]:
    """Check a track for implausible motion.

    Returns
    -------
    findings : tuple of str
        Markers that swap from one frame to the next, jump, or never move; each names marker and frame.
    """
    return (*_exchanges(track), *_constant(track))


def _exchanges(track: MarkerTrack) -> list[str]:
    before, after = track.positions_mm[:-1], track.positions_mm[1:]
    step = np.nan_to_num(np.linalg.norm(after - before, axis=-1))
    limit = max(MAX_SPEED_MM_S / track.rate_hz, 3.0)
    both = track.valid[1:] & track.valid[:-1]
    known = np.where(both | ~both.any(axis=1, keepdims=True), step, np.nan)  # a step that no marker shows is 0
    jumps = step - np.nanmedian(known, axis=1, keepdims=True) > limit  # against what the head as a whole does
    remarks = []
    for frame in np.flatnonzero(jumps.any(axis=1)):
        movers = np.flatnonzero(jumps[frame])
        pairs = _pairs(before[frame, movers], after[frame, movers], step[frame, movers])
        for first, other in pairs:
            names = track.labels[movers[first]], track.labels[movers[other]]
            remarks.append(f"markers {names[0]} and {names[1]} exchange places at frame {frame + 1}")
        paired = {index for pair in pairs for index in pair}
        remarks += [
            f"marker {track.labels[movers[n]]} jumps by {step[frame, movers[n]]:.0f} mm at frame {frame + 1}"
            for n in range(len(movers))
            if n not in paired
        ]
    if len(remarks) > SHOWN_FINDINGS:
        remarks = [*remarks[:SHOWN_FINDINGS], f"and {len(remarks) - SHOWN_FINDINGS} more jumps"]
    return remarks


def _pairs(before: NDArray[np.float64], after: NDArray[np.float64], step: NDArray[np.float64]) -> list[tuple[int, int]]:
    across = np.linalg.norm(after[:, None] - before[None], axis=-1)
    total = across + across.T
    near = total < EXCHANGE_SHARE * (step[:, None] + step[None])
    return [(int(first), int(other)) for first, other in np.argwhere(np.triu(near, 1))]


def _constant(track: MarkerTrack) -> list[str]:
    if track.frame_count < 2:
        return []
    shown = np.where(np.isnan(track.positions_mm), -np.inf, track.positions_mm).max(axis=0)
    lowest = np.where(np.isnan(track.positions_mm), np.inf, track.positions_mm).min(axis=0)
    still = (shown == lowest).all(axis=-1) & (track.valid.sum(axis=0) > 1)
    return [f"marker {track.labels[index]} never moves" for index in np.flatnonzero(still)]
