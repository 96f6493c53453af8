"""Recordings as NumPy archives: ``positions`` (T, M, 3), ``labels``; if known ``rate_hz``, ``units``, ``valid``.

Via points of ``fapengine reduce`` have ``via_mm`` (N, M, 3) and ``times_s`` (N,) instead of positions.
"""

import io
import math
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import DAMAGE, pack
from fapengine.capture.marker_track import MarkerTrack, RawTrack
from fapengine.errors import DataError

POSITION_NAMES = ("positions", "positions_mm", "markers", "points", "via_mm")
MAX_FREE_BYTES, MAX_RATIO = 1 << 26, 100
"""Bounds for the unpacked size as float64: in bytes for any archive, and as a multiple of the archive.

Real motion packs to a half or a tenth; a small file cannot ask for gigabytes.
"""


def parse_npz(data: bytes) -> RawTrack:
    """Read a recording.

    Raises
    ------
    DataError
        If the archive is damaged, has no positions or labels, or their shapes do not fit; ``where`` is the array.
    """
    arrays_by_name = unpack_npz(data)
    name = next((name for name in POSITION_NAMES if name in arrays_by_name), None)
    if name is None:
        raise DataError(f"NPZ: needs {' or '.join(POSITION_NAMES)}, has {sorted(arrays_by_name)}")
    positions = arrays_by_name[name]
    if positions.ndim != 3 or positions.shape[2] != 3 or not positions.size or positions.dtype.kind not in "fiu":
        raise DataError(f"NPZ: must be numbers (T, M, 3), got {positions.dtype} of shape {positions.shape}", where=name)
    positions = positions.astype(np.float64)
    labels = arrays_by_name.get("labels", np.zeros(0, "U1"))
    if labels.dtype.kind not in "US" or labels.shape != positions.shape[1:2]:
        raise DataError(
            f"NPZ: must be {positions.shape[1]} strings, got {labels.dtype} of shape {labels.shape}", where="labels"
        )
    valid = arrays_by_name.get("valid")
    if valid is not None:
        if valid.shape != positions.shape[:2]:
            raise DataError(f"NPZ: must have shape {positions.shape[:2]}, got {valid.shape}", where="valid")
        positions[~valid.astype(bool)] = np.nan
    positions[~np.isfinite(positions).all(axis=-1)] = np.nan
    units = arrays_by_name.get("units")
    times_s = arrays_by_name["times_s"] if name == "via_mm" and "times_s" in arrays_by_name else None
    return RawTrack(
        times_s=times_s,
        positions=positions,
        labels=tuple(str(label) for label in labels.astype(str)),
        rate_hz=_rate(arrays_by_name),
        units="mm"
        if name.endswith("_mm")
        else (str(units) if units is not None and units.dtype.kind in "US" else None),
    )


def unpack_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """Read the arrays of an archive, of any shape ``(...)``, by name.

    Raises
    ------
    DataError
        If it is damaged, contains Python objects, or is far smaller than what it unpacks to.
    """
    try:
        size, most = _unpacked_bytes(data), max(MAX_FREE_BYTES, MAX_RATIO * len(data))
        if size > most:
            raise DataError(f"NPZ: {size} bytes of numbers in an archive of {len(data)}; must be at most {most}")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except DataError:
        raise
    except (*DAMAGE, MemoryError) as error:  # a header may claim any shape
        raise DataError(f"NPZ: damaged, or contains Python objects: {error}") from error


def _unpacked_bytes(data: bytes) -> int:
    """Size of all arrays as float64, from their headers; nothing is unpacked."""
    size = 0
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            size += entry.file_size
            if not entry.filename.endswith(".npy"):
                continue
            with archive.open(entry) as member:
                version = np.lib.format.read_magic(member)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, kind = read(member)
            size += max(math.prod(shape) * 8 - entry.file_size, 0) if kind.kind in "fiub" else 0
    return size


def _rate(arrays_by_name: dict[str, NDArray[Any]]) -> float | None:
    rate = arrays_by_name.get("rate_hz", arrays_by_name.get("fps"))
    if rate is None:
        return None
    if rate.size != 1 or rate.dtype.kind not in "fiu" or not (np.isfinite(rate).all() and float(rate.ravel()[0]) > 0):
        raise DataError(f"NPZ: must be one positive number, got {rate!r:.40}", where="rate_hz")
    return float(rate.ravel()[0])


def format_npz(track: MarkerTrack) -> bytes:
    """Write a recording."""
    return pack(positions_mm=track.positions_mm, labels=np.array(track.labels), rate_hz=track.rate_hz)
