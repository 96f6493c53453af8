"""Arrays that enter the package: checked ones in its types, and tables that it ships."""

import hashlib
import io
import struct
import zipfile
import zlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from fapengine.errors import ResourceError, UsageError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
"""The usual types of arrays, of any shape."""

DIGESTS = "SHA256SUMS"
"""File with the digests of the tables in its folder, in the format of ``sha256sum``."""

DAMAGE = (
    ValueError, OSError, EOFError, LookupError, RuntimeError, SyntaxError, struct.error, zlib.error, zipfile.BadZipFile
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


def freeze(owner: object, dtype: DTypeLike = np.float64, **shapes: Sequence[str | int]) -> None:
    """Replace fields of a frozen dataclass by :func:`frozen` copies; an axis name has one length in all of them."""
    lengths: dict[str | int, int] = {}
    for name, shape in shapes.items():
        values = frozen(getattr(owner, name), name, [lengths.get(axis, axis) for axis in shape], dtype)
        lengths |= dict(zip(shape, values.shape, strict=True))
        object.__setattr__(owner, name, values)


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
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)
