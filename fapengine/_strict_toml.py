"""Strict reading of TOML into frozen dataclasses, and values checked against their annotations.

A key that a dataclass does not have, one that is missing, and a value of another type or out of range are errors that
name file, key, value and expectation.
"""

import builtins
import dataclasses
import functools
import inspect
import json
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from math import inf
from numbers import Integral, Real
from types import UnionType
from typing import Annotated, Any, ForwardRef, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from fapengine.errors import DataError, UsageError

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")

MAX_BYTES = 16 << 20
MAX_DOTS = 500
"""Parts of a key such as ``a.b.c``; the standard library's reader takes time by their square."""
_BETWEEN = re.compile(r"[\n=,\[\]{}]")
WORDS: dict[object, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
    dict: "a table",
    tuple: "a list",
    Mapping: "a table",
    Sequence: "a list",
    Iterable: "a list",
}
"""Name of each type in error messages."""


@dataclasses.dataclass(frozen=True, slots=True)
class Between:
    """Range of a number, as an annotation: ``Annotated[int, Between(0, 65535)]``."""

    low: float
    high: float = inf

    def __str__(self) -> str:
        return f"{self.low:g} or more" if self.high == inf else f"{self.low:g} to {self.high:g}"


class Checked:
    """Base of dataclasses that reject values which their annotations do not allow.

    Ranges are annotations too: ``Annotated[int, Between(0, 65535)]``.

    Raises
    ------
    UsageError
        When it is created; the message begins with the field's name.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        check_fields(self)


def check_fields(value: object) -> None:
    """Reject fields of a dataclass that their annotations do not allow. Raises as :func:`check_value`."""
    owner: Any = type(value)
    for name, kind in _kinds(owner).items():
        check_value(name, getattr(value, name), kind)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Check the arguments of each call against the annotations; defaults are not checked.

    Raises
    ------
    UsageError
        From the call, for an argument of another type; the message begins with the parameter's name.

    Examples
    --------
    >>> @checked
    ... def half(of: float) -> float:
    ...     return of / 2
    >>> half(of="3")
    Traceback (most recent call last):
    fapengine.errors.UsageError: of: got '3', expected a number
    """
    names = tuple(inspect.signature(function).parameters)
    defaults = {name: each.default for name, each in inspect.signature(function).parameters.items()}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in (*zip(names, args, strict=False), *kwargs.items()):
            if value is not defaults.get(name, inspect.Parameter.empty):
                check_value(name, value, _kinds(function).get(name, Any))
        return function(*args, **kwargs)

    return call


@functools.cache
def _kinds(owner: Any) -> dict[str, Any]:
    """Annotation by name of a function, or of a class and its bases; names that only type checkers know allow all."""
    kinds: dict[str, Any] = {}
    for each in reversed(owner.__mro__) if isinstance(owner, type) else (owner,):
        names = _Names(vars(sys.modules[each.__module__]))
        for name, kind in getattr(each, "__annotations__", {}).items():
            try:
                kinds[name] = eval(kind, {}, names) if isinstance(kind, str) else kind
            except TypeError:  # such a name, with parameters
                kinds[name] = Any
    return kinds


class _Names(dict[str, Any]):
    """Names of a module; builtins, and Any for others."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)


def check_value(name: str, value: object, kind: Any) -> None:
    """Reject a value that its annotation does not allow.

    Raises
    ------
    UsageError
        The message begins with the name, and the place in a list.
    """
    try:
        _converted(value, kind)
    except _UnfitError as trouble:
        item, its_kind, places = _unfit_item(value, kind)
        raise UsageError(f"{name}{places}: {_complaint(item, its_kind)}") from trouble


def parse_toml(
    data: bytes, kind: type[T], name: str, error: type[DataError] = DataError, *, schema: int | None = None
) -> T:
    """Read a whole document.

    Parameters
    ----------
    data : bytes
    kind : type
        Dataclass with a field for each key: of plain types, tuples of them, mappings, or further dataclasses.
    name : str
        Name of the file, for error messages.
    error : type
        Exception to raise.
    schema : int, optional
        Number that the key ``schema`` must have; checked before all other keys, which another version may have.

    Raises
    ------
    DataError
        If it is not TOML, or does not fit; ``where`` is file and key.

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True)
    ... class Page(Checked):
    ...     port: Annotated[int, Between(0, 65535)] = 80
    >>> parse_toml(b"port = 8080", Page, "page.toml")
    Page(port=8080)
    >>> parse_toml(b"port = 70000", Page, "page.toml")
    Traceback (most recent call last):
    fapengine.errors.DataError: got 70000, expected a whole number, 0 to 65535 (at page.toml, port)
    """
    if len(data) > MAX_BYTES:
        raise error(f"got {len(data)} bytes, expected at most {MAX_BYTES}", where=name)
    try:
        text = data.decode()
        if any(part.count(".") > MAX_DOTS for part in _BETWEEN.split(text)):
            raise error(f"got a key of more than {MAX_DOTS} parts", where=name)
        document = tomllib.loads(text)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as trouble:
        raise error(f"is not TOML: {trouble}", where=name) from trouble
    except RecursionError as trouble:
        raise error("got lists or tables that are nested too deeply", where=name) from trouble
    if schema is not None and isinstance(stated := document.get("schema"), int) and stated != schema:
        message = f"schema: got {stated}, expected {schema}; a file of another version must be made again"
        raise error(message, where=spell_path(name, "schema"))
    read: T = _structured(document, kind, (name,), error)
    return read


def quoted(text: str) -> str:
    """Spell a TOML basic string; JSON's escapes are among TOML's, DEL alone must be added."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _structured(value: Any, kind: Any, path: tuple[str | int, ...], error: type[DataError]) -> Any:
    """Convert what tomllib has read into a type; ``path`` is the file and the keys down to the value."""
    if type(None) in get_args(kind):
        kind = get_args(kind)[0]
    plain, parts = get_origin(kind) or kind, get_args(kind)
    if isinstance(value, dict) and dataclasses.is_dataclass(plain):
        return _dataclass(value, plain, path, error)
    if isinstance(value, dict) and plain in (dict, Mapping):
        return {key: _structured(item, parts[1], (*path, key), error) for key, item in value.items()}
    if isinstance(value, list) and plain is tuple and (kinds := _kinds_of_items(kind, value)) is not None:
        items = zip(value, kinds, strict=True)
        return tuple(_structured(item, each, (*path, index), error) for index, (item, each) in enumerate(items))
    try:
        return _converted(value, kind)
    except _UnfitError as trouble:
        complaint = (
            f"got {value!r:.60}, expected a table" if dataclasses.is_dataclass(kind) else _complaint(value, kind)
        )
        raise error(complaint, where=spell_path(*path)) from trouble


class _UnfitError(ValueError):
    """A value does not fit its annotation."""


def _converted(value: Any, kind: Any) -> Any:
    """Convert a value to the type of an annotation, such as a whole number to a float; raise _UnfitError otherwise."""
    kind = _meant(kind)
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if kind is Any or isinstance(kind, ForwardRef | TypeVar):
        return value
    if origin is Annotated:
        value = _converted(value, parts[0])
        if all(part.low <= value <= part.high for part in parts[1:] if isinstance(part, Between)):
            return value
    elif origin is Literal:
        if any(type(value) is type(part) and value == part for part in parts):
            return value
    elif origin in (Union, UnionType):
        for part in parts:
            with suppress(_UnfitError):
                return _converted(value, part)
    elif origin is float and isinstance(value, Real) and not isinstance(value, bool) and value == value:
        with suppress(OverflowError):
            return float(value)
    elif origin is int and isinstance(value, Integral) and not isinstance(value, bool):
        return int(value)
    elif origin in (Sequence, Iterable) and isinstance(value, origin) and not isinstance(value, (str, bytes)):
        return value if origin is Iterable else [_converted(item, parts[0]) for item in value]
    elif origin is tuple and isinstance(value, (list, tuple)):
        if (kinds := _kinds_of_items(kind, value)) is not None:
            return tuple(map(_converted, value, kinds))
    elif origin in (dict, Mapping) and isinstance(value, Mapping):
        return {_converted(key, parts[0]): _converted(item, parts[1]) for key, item in value.items()}
    elif (
        origin not in (int, float, tuple, dict, Mapping, Sequence, Iterable)
        and isinstance(origin, type)
        and isinstance(value, origin)
    ):
        return value
    raise _UnfitError


def _kinds_of_items(kind: Any, values: Sequence[object]) -> Sequence[Any] | None:
    """Types of a list's items; None if its length does not fit."""
    parts = get_args(kind)
    kinds = parts if get_origin(kind) is tuple and parts[-1] is not ... else parts[:1] * len(values)
    return kinds if len(kinds) == len(values) else None


def _unfit_item(value: Any, kind: Any, places: str = "") -> tuple[object, Any, str]:
    """Find the item that makes a list unfit, in lists within lists too: item, type and places such as ``[2][0]``."""
    if get_origin(kind) in (tuple, Sequence) and isinstance(value, (list, tuple)):
        for place, (item, each) in enumerate(zip(value, _kinds_of_items(kind, value) or (), strict=False)):
            try:
                _converted(item, each)
            except _UnfitError:
                return _unfit_item(item, each, f"{places}[{place}]")
    return value, kind, places


def _meant(kind: Any) -> Any:
    """Follow aliases: NumPy 2.5 declares its own by ``type`` (PEP 695) on Python 3.12 and later."""
    while (value := getattr(get_origin(kind) or kind, "__value__", None)) is not None:
        kind = value
    return kind


def _dataclass(table: dict[str, Any], kind: Any, path: tuple[str | int, ...], error: type[DataError]) -> Any:
    fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
    for key, field in fields.items():
        if key not in table and field.default is field.default_factory is dataclasses.MISSING:
            raise error(f"key {key!r} is missing", where=spell_path(*path, key))
    for key in table:
        if key not in fields:
            raise error(f"key {key!r} is unknown", where=spell_path(*path, key))
    kinds = get_type_hints(kind, include_extras=True)
    values = {key: _structured(value, kinds[key], (*path, key), error) for key, value in table.items()}
    try:
        return kind(**values)
    except UsageError as trouble:  # it begins with a field's name
        key, _, complaint = str(trouble).partition(": ")
        named = (complaint, (*path, key)) if key in values else (str(trouble), path)
        raise error(named[0], where=spell_path(*named[1])) from trouble


def spell_path(name: str | int, *keys: str | int) -> str:
    """Spell a file and the keys down to a value.

    Examples
    --------
    >>> spell_path("a.toml", "sink", 0, "url")
    'a.toml, sink[0].url'
    """
    spelled = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return f"{name}, {spelled[1:]}" if keys else str(name)


def _complaint(value: object, kind: Any) -> str:
    shape = getattr(value, "shape", ())
    return f"got {f'an array of shape {shape}' if shape else repr(value):.60}, expected {_spell(kind)}"


def _spell(kind: Any) -> str:
    """Describe the values of a type."""
    kind = _meant(kind)
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        ranges = "".join(f", {part}" for part in parts[1:] if isinstance(part, Between))
        return _spell(parts[0]) + ranges
    if origin is Literal:
        return f"one of {', '.join(map(str, parts))}"
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_spell(part) for part in parts if part is not type(None)))
    if origin is tuple and parts[-1] is not ...:
        return f"a list of {len(parts)}"
    kind = origin or kind
    name = getattr(kind, "__name__", "a value")
    return WORDS.get(kind, "an array" if name == "ndarray" else name)
