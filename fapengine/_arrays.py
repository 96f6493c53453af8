"""Arrays that enter the package: checked ones in its types, and tables that it ships."""

import csv
import hashlib
import io
import struct
import tokenize
import tomllib
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import fields
from importlib.resources import files
from numbers import Real
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from fapengine.errors import DataError, ResourceError, UsageError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
"""The usual types of arrays, of any shape."""

Sound = tuple[NDArray[np.int16], int]
"""(N,) int16 mono samples, and the sample rate in Hz."""
SoundLike = tuple[ArrayLike, float]
"""Samples in any form that :func:`as_sound` takes, and the sample rate in Hz."""
SOUND_RATES_HZ = (1_000, 768_000)
"""Lowest and highest sample rate."""
MAX_CHANNELS = 32
MAX_OVERSHOOT = 4.0
"""Largest float sample: decoders and resamplers overshoot 1 by some dB, integers as floats by thousands."""
SAMPLE_KINDS = {
    "f2": (0.0, 1.0), "f4": (0.0, 1.0), "f8": (0.0, 1.0), "i2": (0.0, 2.0**15), "i4": (0.0, 2.0**31),
    "u1": (128.0, 128.0),
}  # fmt: skip
"""Silence and full scale of each kind of samples, by NumPy's codes."""

DIGESTS = "SHA256SUMS"
"""File with the digests of the tables in its folder, in the format of ``sha256sum``."""

MAX_UNPACKED = 1 << 30
"""Bytes of the arrays of one file."""
DAMAGE = (
    ValueError, OSError, EOFError, LookupError, RuntimeError, SyntaxError, tokenize.TokenError, struct.error,
    zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""Exceptions that zipfile and NumPy raise on archives that are truncated or damaged."""


def frozen(
    array: ArrayLike, name: str, shape: Sequence[str | int], dtype: DTypeLike, *, finite: bool = True
) -> NDArray[Any]:
    """Copy ``array``, check it, and make the copy read-only.

    Parameters
    ----------
    array : array_like
        What the caller passed.
    name : str
        Name of the field, for the message.
    shape : sequence of str or int
        An int must match; a string names a free axis, and equal strings must have equal lengths.
        ``"..."`` in front allows any leading axes.
    dtype : dtype
        Wanted type. A conversion that would lose values is an error, rounding of floats is not.
    finite : bool
        Refuse NaN and infinities in floating arrays.

    Returns
    -------
    ndarray
        Contiguous, of ``dtype``, not writeable.

    Raises
    ------
    UsageError
        ``values: got shape (2, 66), expected (T, 68)``.

    Examples
    --------
    >>> frozen([[1, 2, 3]], "points_mm", ("M", 3), np.float64).flags.writeable
    False
    """
    try:
        values = np.asarray(array)
        numeric = values.dtype.kind in "biuf"
    except ValueError as error:  # ragged nested lists
        raise UsageError(f"{name}: got a ragged sequence, expected shape {_spell(shape)}") from error
    wanted = np.dtype(dtype)
    if not numeric:
        raise UsageError(f"{name}: got dtype {values.dtype}, expected {wanted}")
    if not _fits(values.shape, shape):
        raise UsageError(f"{name}: got shape {values.shape}, expected {_spell(shape)}")
    if values.dtype.kind == "f" and finite and not np.isfinite(values).all():
        bad = np.argwhere(~np.isfinite(values))[0]
        raise UsageError(f"{name}: got {values[tuple(bad)]} at index {tuple(bad.tolist())}, expected finite numbers")
    with np.errstate(invalid="ignore", over="ignore"):
        copy = np.array(values, dtype=wanted, order="C", copy=True)
    if wanted.kind in "iub" and values.size and not np.array_equal(copy, values):
        bad = np.argwhere(copy != values)[0]
        raise UsageError(f"{name}: got {values[tuple(bad)]} at index {tuple(bad.tolist())}, which {wanted} cannot hold")
    copy.flags.writeable = False
    return copy


def as_sound(sound: SoundLike, name: str = "sound") -> Sound:
    """Convert sound in any usual form to 16-bit mono.

    Parameters
    ----------
    sound : (array_like, int)
        Samples, (N,) or (N, C): float in -1..1, int16, int32 or uint8, as soundfile and librosa give them. The mean of
        C channels (at most :data:`MAX_CHANNELS`) is taken; (1, N) and (1, 1, N), as voices of PyTorch give them, are
        mono. Floats beyond 1 are clipped; beyond :data:`MAX_OVERSHOOT` they are an error. And the sample rate, a whole
        number in :data:`SOUND_RATES_HZ`.
    name : str
        Name of the argument, for messages.

    Returns
    -------
    samples : (N,) int16
        Read-only.
    rate_hz : int

    Raises
    ------
    UsageError
        ``sound: got dtype int64, expected int16, int32, uint8 or float``.
    """
    try:
        samples, rate_hz = sound
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"{name}: got {type(sound).__name__}, expected a pair: samples, and their rate in Hz"
        ) from error
    low, high = SOUND_RATES_HZ
    if not (isinstance(rate_hz, Real) and low <= rate_hz <= high and float(rate_hz).is_integer()):
        raise UsageError(f"{name}: got a rate of {rate_hz!s:.40} Hz, expected {low} to {high}, a whole number")
    try:
        values = np.asarray(samples)
    except ValueError as error:  # ragged nested lists
        raise UsageError(f"{name}: got a ragged sequence, expected shape (N,) or (N, channels)") from error
    kind = values.dtype.str[1:]
    if kind not in SAMPLE_KINDS:
        raise UsageError(f"{name}: got dtype {values.dtype}, expected int16, int32, uint8 or float")
    while values.ndim > 1 and len(values) == 1 and values.shape[-1] > MAX_CHANNELS:  # a batch of one, as of PyTorch
        values = values[0]
    if values.ndim not in (1, 2) or (values.ndim == 2 and not 1 <= values.shape[1] <= MAX_CHANNELS):
        raise UsageError(
            f"{name}: got shape {values.shape}, expected (N,) or (N, channels) with 1 to {MAX_CHANNELS} channels"
        )
    if values.dtype == np.int16 and values.ndim == 1:
        if values.flags.writeable:
            values = values.copy()
            values.flags.writeable = False
        return values, int(rate_hz)
    mono = values.astype(np.float64).reshape(len(values), values.shape[1] if values.ndim == 2 else 1).mean(axis=1)
    if not np.isfinite(mono).all():
        at = int(np.argmin(np.isfinite(mono)))
        raise UsageError(f"{name}: got {mono[at]} at {at}, expected finite numbers")
    peak = np.abs(values).max(initial=0) if kind[0] == "f" else 0.0
    if peak > MAX_OVERSHOOT:
        raise UsageError(f"{name}: got {values.dtype} samples up to {peak:g}, expected -1 to 1; pass integers as int16")
    centre, full_scale = SAMPLE_KINDS[kind]
    scaled = np.clip(np.rint((mono - centre) * (2.0**15 / full_scale)), -(2**15), 2**15 - 1).astype(np.int16)
    scaled.flags.writeable = False
    return scaled, int(rate_hz)


def freeze(owner: object, dtype: DTypeLike = np.float64, **shapes: Sequence[str | int]) -> None:
    """Replace fields of a frozen dataclass by :func:`frozen` copies; an axis name has one length in all of them."""
    lengths: dict[str | int, int] = {}
    for name, shape in shapes.items():
        values = frozen(getattr(owner, name), name, [lengths.get(axis, axis) for axis in shape], dtype)
        lengths |= dict(zip(shape, values.shape, strict=True))
        object.__setattr__(owner, name, values)


class Rebuilt:
    """Base of frozen dataclasses with arrays or mappings: copies and pickles are as read-only as the original."""

    __slots__ = ()

    def __reduce__(self) -> tuple[object, ...]:
        """Keep the arguments of the constructor; a mapping proxy itself cannot be pickled."""
        values = {one.name: getattr(self, one.name) for one in fields(self) if one.init}  # type: ignore[arg-type]
        plain = {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in values.items()}
        return _rebuild, (type(self), plain)


def _rebuild(kind: type, values: dict[str, Any]) -> object:
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        elif isinstance(value, dict):
            values[name] = MappingProxyType(value)
    return kind(**values)


def _fits(got: tuple[int, ...], wanted: Sequence[str | int]) -> bool:
    if wanted and wanted[0] == "...":
        wanted = wanted[1:]
        got = got[max(0, len(got) - len(wanted)) :]
    if len(got) != len(wanted):
        return False
    lengths: dict[str, int] = {}
    for length, axis in zip(got, wanted, strict=True):
        if isinstance(axis, int):
            if length != axis:
                return False
        elif lengths.setdefault(axis, length) != length:
            return False
    return True


def _spell(shape: Sequence[str | int]) -> str:
    return f"({', '.join(str(axis) for axis in shape)}{',' if len(shape) == 1 else ''})"


def read_table(package: str, name: str) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz`` file in a package: name to array, each of any shape (...).

    Raises
    ------
    ResourceError
        If the file is missing, or its SHA-256 digest is not the one in :data:`DIGESTS`.
    """
    folder = files(package)
    try:
        data = (folder / name).read_bytes()
        digests = dict(line.split()[::-1] for line in (folder / DIGESTS).read_text("ascii").splitlines())
    except OSError as error:
        raise ResourceError(f"{name}: not found in {package}; reinstall fapengine") from error
    if hashlib.sha256(data).hexdigest() != digests.get(name):
        raise ResourceError(f"{name}: its digest is not the one in {DIGESTS}; reinstall fapengine")
    return unpack(data)


def read_rows(package: str, name: str) -> list[list[str]]:
    """Read a table of a package, ``.csv``, without the line that names its columns."""
    return list(csv.reader((files(package) / name).read_text("utf-8").splitlines()))[1:]


def read_tables(package: str, name: str) -> dict[str, Any]:
    """Read the tables of a package, ``.toml``."""
    return tomllib.loads((files(package) / name).read_text("utf-8"))


def unpack(data: bytes) -> dict[str, NDArray[Any]]:
    """Read the arrays of a file of our own, name to array, each of any shape (...).

    Raises
    ------
    DataError
        If they have more than :data:`MAX_UNPACKED` bytes. Damage raises any of :data:`DAMAGE`.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MAX_UNPACKED:
        raise DataError(f"got {size} bytes unpacked, expected at most {MAX_UNPACKED}")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)


def pack(*, compressed: bool = True, **arrays: Any) -> bytes:
    """Write arrays, each of any shape (...), as an ``.npz`` file."""
    buffer = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, **arrays)
    return buffer.getvalue()
