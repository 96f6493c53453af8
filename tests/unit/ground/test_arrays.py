import copy
import pickle
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from types import MappingProxyType

import numpy as np
import pytest

import fapengine
from fapengine._arrays import frozen
from fapengine.errors import UsageError


def test_copy_is_read_only_and_apart_from_the_source() -> None:
    source = np.zeros((2, 3))
    gate = frozen(source, "x", ("M", 3), np.float32)
    source[0, 0] = 9
    assert gate[0, 0] == 0
    assert gate.dtype == np.float32
    with pytest.raises(ValueError, match="read-only"):
        gate[0, 0] = 1


@pytest.mark.parametrize(
    ("array", "shape", "dtype", "message"),
    [
        (np.zeros((2, 66)), ("T", 68), float, r"values: got shape \(2, 66\), expected \(T, 68\)"),
        (np.zeros((2, 3)), ("N", "N"), float, r"got shape \(2, 3\), expected \(N, N\)"),
        (np.zeros(3), ("N", 3), float, r"got shape \(3,\)"),
        ([[1], [1, 2]], ("N", 2), float, "ragged"),
        (["a"], ("N",), float, "got dtype"),
        ([1.0, np.nan], ("N",), float, r"got nan at index \(1,\), expected finite"),
        ([1.5], ("N",), np.int32, "got 1.5"),
        ([2**40], ("N",), np.int32, "int32 cannot hold"),
        ([-1], ("N",), np.uint8, "uint8 cannot hold"),
    ],
)
def test_refuses(array: object, shape: tuple[str | int, ...], dtype: type, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        frozen(array, "values", shape, dtype)  # type: ignore[arg-type]


def test_leading_axes_are_free_behind_an_ellipsis() -> None:
    for batch in ((), (1,), (3, 1, 2)):
        assert frozen(np.zeros((*batch, 4, 3)), "p", ("...", "M", 3), float).shape == (*batch, 4, 3)


def test_infinity_passes_where_it_is_asked_for() -> None:
    assert np.isinf(frozen([np.inf], "x", ("N",), float, finite=False)[0])


def same(one: object, other: object) -> bool:
    """Whether values are equal down to arrays, and whether all arrays and mappings of the second are read-only."""
    if isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        return np.array_equal(one, other) and one.dtype == other.dtype and not other.flags.writeable
    if isinstance(one, MappingProxyType):
        return (
            isinstance(other, MappingProxyType)
            and list(one) == list(other)
            and all(map(same, one.values(), other.values()))
        )
    if is_dataclass(one) and not isinstance(one, type):
        return type(one) is type(other) and all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return one == other


@pytest.mark.parametrize("duplicate", [lambda value: pickle.loads(pickle.dumps(value)), copy.deepcopy])
@pytest.mark.parametrize(
    "value",
    [
        fapengine.FapTrack.pose(open_jaw=300),
        fapengine.load_profile("grid_s1_en"),
        fapengine.load_head("default:hair=false,level=coarse"),
        fapengine.Phone("m", 0.0, 0.1),
        fapengine.PhoneTrack.from_phones([fapengine.Phone("m", 0.0, 0.1)]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_copies_and_pickles_are_equal_and_read_only(value: object, duplicate: Callable[[object], object]) -> None:
    assert same(value, duplicate(value))
