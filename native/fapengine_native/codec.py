"""The loops of fapengine's codec: functions by the names, parameters and results of ``fapengine.codec.kernels``.

They change the same arrays to the same numbers. Release Python's lock while they run.

Raises
------
ValueError
    If an array has another type, shape or layout than ``fapengine`` gives it, or a table has what no plane can have.
"""

import ctypes
from typing import Any

import numpy as np

from fapengine_native._library import library


class _Models(ctypes.Structure):
    _fields_ = [
        ("fields", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("base", ctypes.c_void_p),
        ("counts", ctypes.c_void_p),
        ("tree", ctypes.c_void_p),
        ("totals", ctypes.c_void_p),
        ("room", ctypes.c_int64),
    ]


def _address(array: Any, kind: Any, shape: tuple[int, ...] | None = None, *, changes: bool = True) -> int:
    """Return where an array's numbers lie, if they are as the library reads them, and writes them if it ``changes``."""
    is_as_needed = array.flags.carray if changes else array.flags.c_contiguous and array.flags.aligned
    if array.dtype != kind or not is_as_needed or (shape is not None and array.shape != shape):
        raise ValueError(f"array: got {array.dtype} {array.shape}, expected {np.dtype(kind)} {shape or ''}, contiguous")
    return int(array.ctypes.data)


def _models(fields: Any, base: Any, counts: Any, tree: Any, totals: Any) -> Any:
    count, room = len(fields), len(counts)
    made = _Models(
        _address(fields, np.int64, (count, 8), changes=False), count, _address(base, np.int64, (count,)),
        _address(counts, np.int32, (room,)), _address(tree, np.int32, (room,)), _address(totals, np.int64, (count,)),
        room,
    )  # fmt: skip
    return ctypes.byref(made)


def _sound(answer: int) -> int:
    if answer < 0:
        raise ValueError("fields: an alphabet or a step that no plane can have")
    return answer


def _bits(bits: Any, at: int) -> tuple[int, int, int]:
    if not 0 <= at <= len(bits):
        raise ValueError(f"at: got {at}, expected 0 to {len(bits)}")
    return _address(bits, np.uint8, (len(bits),), changes=False), len(bits), at


def reset_models(fields: Any, base: Any, counts: Any, tree: Any, totals: Any) -> None:
    """Make the models of all coded fields uniform."""
    _sound(library.fapengine_native_reset_models(_models(fields, base, counts, tree, totals)) - 1)


def _written(answer: int, end: ctypes.c_int64, out: Any) -> int:
    _sound(answer - 1)
    if end.value > len(out):
        raise ValueError(f"out: got {len(out)} bits, expected {end.value}")
    return end.value


def encode_plane(
    intra: bool, target: Any, flags: Any, fields: Any, previous: Any, models: Any, clamp: bool, out: Any, at: int
) -> int:
    """Write the arithmetic data of one plane."""
    end, target, flags = ctypes.c_int64(), *(np.ascontiguousarray(each, np.int64) for each in (target, flags))
    _address(out, np.uint8)
    answer = library.fapengine_native_encode_plane(
        _models(fields, *models[:4]), intra, _address(target, np.int64, (len(fields),), changes=False),
        _address(flags, np.int64, (3,), changes=False), _address(previous, np.int64, (len(fields),)), clamp,
        *_bits(out, at), ctypes.byref(end),
    )  # fmt: skip
    return _written(answer, end, out)


def encode_predicted(
    targets: Any, flags: Any, skips: Any, fields: Any, previous: Any, models: Any, clamp: bool, out: Any, at: int
) -> int:
    """Write P planes with their headers."""
    end, planes = ctypes.c_int64(), len(targets)
    targets, flags, skips = (np.ascontiguousarray(each, np.int64) for each in (targets, flags, skips))
    _address(out, np.uint8)
    answer = library.fapengine_native_encode_predicted(
        _models(fields, *models[:4]), _address(targets, np.int64, (planes, len(fields)), changes=False),
        _address(flags, np.int64, (planes, 3), changes=False), _address(skips, np.int64, (planes,), changes=False),
        planes, _address(previous, np.int64, (len(fields),)), clamp, *_bits(out, at), ctypes.byref(end),
    )  # fmt: skip
    return _written(answer, end, out)


def _plane(fields: Any, previous: Any, found: Any, flags: Any, costs: Any) -> tuple[int, int, int, int | None]:
    count = len(fields)
    return (
        _address(previous, np.int64, (count,)), _address(found, np.int64, (4, count)), _address(flags, np.int64, (3,)),
        _address(costs, np.float64, (count,)) if len(costs) else None,
    )  # fmt: skip


def decode_settled(
    intra: bool, bits: Any, at: int, fields: Any, previous: Any, models: Any, found: Any, flags: Any, costs: Any
) -> tuple[int, int]:
    """Decode a plane if the given bits settle it."""
    end = ctypes.c_int64()
    status = library.fapengine_native_decode_settled(
        _models(fields, *models[:4]), intra, *_bits(bits, at), *_plane(fields, previous, found, flags, costs),
        ctypes.byref(end),
    )  # fmt: skip
    return _sound(status), end.value


def keep_plane(intra: bool, found: Any, fields: Any, previous: Any, models: Any) -> None:
    """Keep a decoded plane."""
    count = len(fields)
    addresses = _address(found, np.int64, (4, count), changes=False), _address(previous, np.int64, (count,))
    _sound(library.fapengine_native_keep_plane(_models(fields, *models[:4]), intra, *addresses) - 1)


def decode_predicted(
    bits: Any, at: int, fresh: bool, final: bool, fields: Any, previous: Any, models: Any, found: Any, flags: Any,
    costs: Any, values: Any, value_flags: Any, extents: Any,
) -> tuple[int, int, int, int]:  # fmt: skip
    """Decode P planes until something else follows."""
    how, room = (ctypes.c_int64 * 3)(), len(values)
    status = library.fapengine_native_decode_predicted(
        _models(fields, *models[:4]), *_bits(bits, at), fresh, final, *_plane(fields, previous, found, flags, costs),
        room, _address(values, np.int64, (room, len(fields))), _address(value_flags, np.int64, (room, 3)),
        _address(extents, np.int64, (room, 3)), how,
    )  # fmt: skip
    return how[0], how[1], _sound(status), how[2]


def find_intra(bits: Any, start: int, bodies: bool) -> int:
    """Find the next bit where an I plane may begin."""
    return int(library.fapengine_native_find_intra(*_bits(bits, min(start, len(bits))), bodies))
