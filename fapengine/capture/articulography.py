"""Recordings of electromagnetic articulographs: Carstens AG500 and AG501, NDI Wave, and Haskins' MVIEW.

Sensors become markers. Axes, head and names are the session's business, as for every recording.

* Carstens ``.pos``: little-endian floats, seven for each sensor of a frame: x, y, z in mm, phi, theta in degrees, rms
  and a spare one. AG501 has a header in text, whose second line is its length in bytes; AG500 has none: 12 sensors at
  200 Hz.
* NDI Wave: a table with a time, then for each sensor ``Sensor N Id``, ``Sensor N Status``, x, y, z and a quaternion.
* MVIEW ``.mat``: a struct array of MATLAB, one element for each signal, with ``NAME``, ``SRATE`` and ``SIGNAL`` (T, 3
  or more): x, y, z in mm; x is forward and z up. A signal with one column is sound.

Layouts: the CRAN package rticulate, Praat's EMA.cpp, ema2wav, and the guide of Python-EMA-Viewer.
"""

import re

import numpy as np
from numpy.typing import NDArray

from fapengine.capture.conventions import numbers, rate_of
from fapengine.capture.marker_track import RATES_HZ, RawTrack, RecordedSound
from fapengine.capture.matlab import struct_arrays
from fapengine.errors import DataError, TruncatedError

FIELDS = 7
MAX_SENSORS = 64
AG500_SENSORS, AG500_HZ = 12, 200.0
MAGIC = b"AG50xDATA"
MAX_HEADER = 1 << 16
WAVE_SENSOR = re.compile(r"sensor\s+(\w+)\s+status$", re.IGNORECASE)
MAX_SIGNALS = 256


def parse_pos(data: bytes) -> RawTrack:
    """Read a Carstens recording.

    Raises
    ------
    TruncatedError
        If it ends before its first frame.
    DataError
        If its header contradicts itself, or its size is not a whole number of frames.
    """
    sensors, rate_hz, begin = _pos_header(data) if data.startswith(MAGIC) else (AG500_SENSORS, AG500_HZ, 0)
    frames, rest = divmod(len(data) - begin, 4 * FIELDS * sensors)
    if frames < 1:
        raise TruncatedError("POS: contains no frames", where=f"byte {begin}")
    if rest:
        raise DataError(
            f"POS: got {len(data) - begin} bytes of frames, expected a multiple of {4 * FIELDS * sensors} for {sensors}"
            " sensors",
            where=f"byte {begin}",
        )
    with np.errstate(invalid="ignore"):  # of NaNs that signal, which a damaged file may hold
        values = np.frombuffer(data, "<f4", offset=begin).reshape(frames, sensors, FIELDS)[..., :3].astype(np.float64)
    return _sensors(values, [f"S{number + 1}" for number in range(sensors)], rate_hz, up="+z")


def _pos_header(data: bytes) -> tuple[int, float, int]:
    """Sensors, rate and length of the header of an AG501."""
    lines = data[: data.find(b"\0") if b"\0" in data[:MAX_HEADER] else MAX_HEADER].split(b"\n")
    found = {name: value for name, _, value in (line.partition(b"=") for line in lines)}
    try:
        size, sensors = int(lines[1]), int(found[b"NumberOfChannels"])
        rate_hz = float(found[b"SamplingFrequencyHz"])
    except (IndexError, KeyError, ValueError) as error:
        raise DataError(
            "POS: header lacks its size, NumberOfChannels or SamplingFrequencyHz", where="byte 0"
        ) from error
    if not (0 < sensors <= MAX_SENSORS and 0 < rate_hz < 1e5 and len(MAGIC) < size <= MAX_HEADER):
        raise DataError(f"POS: got {sensors} sensors, {rate_hz:g} Hz and a header of {size} bytes", where="byte 0")
    return sensors, rate_hz, min(size, len(data))


def is_wave(header: list[str]) -> bool:
    """Whether a table's first row is that of an NDI Wave."""
    return any(WAVE_SENSOR.match(cell) for cell in header)


def parse_wave(rows: list[list[str]]) -> RawTrack:
    """Read the rows of an NDI Wave's table. Raises as :func:`fapengine.capture.table.parse_table`."""
    names = {column: match[1] for column, cell in enumerate(rows[0]) if (match := WAVE_SENSOR.match(cell))}
    body = [row for row in rows[1:] if any(row)]
    if not body:
        raise TruncatedError("table: contains no frames", where="line 2")
    first = max(names)
    if [cell[:1].lower() for cell in rows[0][first + 1 : first + 4]] != ["x", "y", "z"]:
        raise DataError(f"table: got {rows[0][first + 1 : first + 4]}, expected X, Y, Z after a status", where="line 1")
    places = [column + axis for column in names for axis in (1, 2, 3)]
    cells = [[row[column] if column < len(row) else "" for column in (0, *places)] for row in body]
    table = numbers(cells, 1 + len(places), 2)
    return _sensors(
        table[:, 1:].reshape(len(body), len(names), 3), [f"S{name}" for name in names.values()], rate_of(table[:, 0])
    )


def parse_mview(data: bytes) -> RawTrack:
    """Read a recording in MVIEW's format.

    Raises
    ------
    DataError
        If it is not a MATLAB file with such a struct array, or its sensors differ in length or rate.
    """
    signals: dict[str, tuple[float, NDArray[np.float64]]] = {}
    sounds = []
    for signal in next(struct_arrays(data, ("NAME", "SRATE", "SIGNAL")), [])[:MAX_SIGNALS]:
        name, rate, values = str(signal["NAME"]), np.ravel(signal["SRATE"]), signal["SIGNAL"]
        if isinstance(values, np.ndarray) and values.ndim == 2 and values.shape[1] >= 3 and rate.dtype == np.float64:
            signals[name] = (float(rate[:1].sum()), values[:, :3])
        else:
            sounds.append(name)
    if not signals:
        raise DataError("MVIEW: no signal has three columns or more")
    rates, shapes = {rate for rate, _ in signals.values()}, {values.shape for _, values in signals.values()}
    if len(rates) > 1 or len(shapes) > 1:
        raise DataError(f"MVIEW: sensors differ in rate or length: {sorted(rates)} Hz, {sorted(shapes)}")
    notes = (f"signals {', '.join(sounds)} are no sensors: left out",) if sounds else ()
    positions = np.stack([values for _, values in signals.values()], axis=1)
    return _sensors(positions, [*signals], rates.pop(), up="+z", notes=notes)


def parse_mview_sound(data: bytes) -> RecordedSound | None:
    """Read the sound of a recording in MVIEW's format; None without one. Raises as :func:`parse_mview`."""
    for signal in next(struct_arrays(data, ("NAME", "SRATE", "SIGNAL")), [])[:MAX_SIGNALS]:
        rate, values = np.ravel(signal["SRATE"]), signal["SIGNAL"]
        if (
            isinstance(values, np.ndarray)
            and 1 in values.shape
            and rate.dtype == np.float64
            and rate[:1].sum() >= RATES_HZ[0]
        ):
            return RecordedSound.of(str(signal["NAME"]), values.ravel(), float(rate[0]))
    return None


def _sensors(
    positions: NDArray[np.float64],
    labels: list[str],
    rate_hz: float | None,
    up: str | None = None,
    notes: tuple[str, ...] = (),
) -> RawTrack:
    """A track of sensors, (T, M, 3) mm; a sensor without a place in any frame is left out."""
    positions[~np.isfinite(positions).all(axis=-1)] = np.nan
    shown = ~np.isnan(positions[..., 0]).all(axis=0) & positions.any(axis=(0, 2))
    return RawTrack(
        positions=positions[:, shown],
        labels=tuple(np.array(labels)[shown].tolist()),
        rate_hz=rate_hz if rate_hz is not None and np.isfinite(rate_hz) and rate_hz > 0 else None,
        units="mm",
        up=up,
        notes=notes,
    )
