"""How commands to a live face are written outside Python: addresses, fields, units and ranges, as data.

The classes of :mod:`.commands` are the table, one class a command and one annotated attribute a field. The OSC codec,
the JSON codec, the client, the page and the tables of the documentation read it through this module, so that a new
command is described once.

Inside, angles are radians and times are seconds. OSC carries degrees, and whole microseconds or milliseconds; JSON
carries the same units as Python.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from math import inf, isfinite, isnan
from typing import Any, ClassVar, TypeVar, cast, get_type_hints

from fapengine.errors import DataError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandSpec:
    """Names of one command outside Python, and what the documentation says of it."""

    doc: str
    """Meaning, as the tables of the documentation tell it."""
    osc: str = ""
    """Address, with the session as first argument."""
    one_shot: str = ""
    """Address without the session."""
    json: str = ""
    """``type`` of the page's message; empty: pages do not send it."""
    is_direct: bool = False
    """True where its OSC message carries its fields and nothing else. Other commands concern one sender's utterances,
    in its numbers and on its clock: they are messages of :mod:`fapengine.live.wire.speech_osc.schema`."""
    is_repeatable: bool = False
    """True where the same again changes nothing, so that a client sends it three times over UDP."""
    is_shown: bool = False
    """True where pages are told of it, so that their controls show what other senders have set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldSpec:
    """One field of a command: a number of no unit, unless a subclass says otherwise."""

    doc: str = ""
    osc: str = ""
    """Name in OSC, with its unit there; empty: OSC does not carry it."""
    tag: str = "f"
    """OSC type tag."""
    json: str = ""
    """Name in JSON; empty: JSON does not carry it."""
    low: float = -inf
    high: float = inf
    is_whole: bool = False

    def to_osc(self, value: Any) -> Any:
        """Give the OSC argument."""
        return value

    def from_osc(self, value: Any) -> Any:
        """Give the Python value.

        Raises
        ------
        DataError
            If the value has no meaning.
        """
        return value

    def to_json(self, value: Any) -> Any:
        """Give the JSON value."""
        return value

    def from_json(self, value: Any) -> Any:
        """Give the Python value of a checked JSON value."""
        return value

    def checked(self, value: Any) -> Any:
        """Return a Python value that lies in its range.

        Raises
        ------
        UsageError
            If it does not.
        """
        if not self.low <= value <= self.high:
            name = self.json or self.osc or "value"
            raise UsageError(f"{name}: got {value}, expected {self.low:g}..{self.high:g}")
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle(FieldSpec):
    """Radians; degrees in OSC."""

    def to_osc(self, value: float) -> float:
        """Give degrees."""
        return math.degrees(value)

    def from_osc(self, value: float) -> float:
        """Take degrees."""
        return math.radians(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration(FieldSpec):
    """Seconds, held within the range; whole microseconds in OSC."""

    tag: str = "i"
    per_s: int = 1_000_000
    """OSC's units in a second."""

    def to_osc(self, value: float) -> int:
        """Give whole units."""
        return round(value * self.per_s)

    def from_osc(self, value: int) -> float:
        """Take whole units."""
        return value / self.per_s

    def checked(self, value: float) -> float:
        """Bring a duration into the range; what is no number is refused."""
        if isnan(value):
            raise UsageError(f"{self.json or self.osc}: got {value}, expected {self.low:g}..{self.high:g}")
        return min(max(value, self.low), self.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class EndlessDuration(FieldSpec):
    """Seconds, or infinity; whole microseconds in OSC, where -1 is for ever."""

    tag: str = "i"

    def to_osc(self, value: float) -> int:
        """Give microseconds, or -1."""
        return -1 if value == inf else round(value * 1e6)

    def from_osc(self, value: int) -> float:
        """Take microseconds, or -1."""
        return inf if value < 0 else value / 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Time(FieldSpec):
    """A time in seconds, or None for at once.

    OSC carries whole microseconds from the arrival, where -1 is at once; see :func:`shifted`.
    """

    tag: str = "i"

    def to_osc(self, value: float | None) -> int:
        """Give microseconds, or -1."""
        return -1 if value is None else max(round(value * 1e6), -1)

    def from_osc(self, value: int) -> float | None:
        """Take microseconds, or -1."""
        return value / 1e6 if value > 0 else None

    def checked(self, value: float | None) -> float | None:
        """Return a time that is finite, or None."""
        if value is not None and not (isfinite(value) and self.low <= value <= self.high):
            raise UsageError(f"{self.osc or 'time'}: got {value}, expected a finite time")
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice(FieldSpec):
    """One of several names."""

    tag: str = "s"
    what: str
    """Noun for error messages."""
    values: Mapping[str, Any]
    """Name to Python value."""
    synonyms: Mapping[str, Any] = field(default_factory=dict)
    """Names that OSC takes besides."""

    def to_osc(self, value: Any) -> str:
        """Give the name."""
        return self.to_json(value)

    def from_osc(self, value: str) -> Any:
        """Find what a name means, synonyms included."""
        return self.named(value)

    def to_json(self, value: Any) -> str:
        """Give the name."""
        names = {**self.values, **self.synonyms}
        return next(name for name, meant in names.items() if meant == value)

    def from_json(self, value: str) -> Any:
        """Find what a name means."""
        return self.values[value]

    def checked(self, value: Any) -> Any:
        """Return one of the values."""
        if value not in self.values.values():
            raise UsageError(f"{self.what}: got {value!r}, expected one of {', '.join(self.values)}")
        return value

    def named(self, name: str) -> Any:
        """Find the value of a name, in small or capital letters.

        Raises
        ------
        DataError
            If there is no such name.
        """
        names = {**self.values, **self.synonyms}
        plain = name.strip().lower()
        if plain not in names:
            raise DataError(f"{self.what}: got {name!r:.40}, expected one of {', '.join(names)}")
        return names[plain]


class Command:
    """What a live face can be told; the subclasses of :mod:`.commands` are frozen dataclasses."""

    __slots__ = ()
    SPEC: ClassVar[CommandSpec]


SomeCommand = TypeVar("SomeCommand", bound=Command)


_FIELDS: dict[type[Command], dict[str, FieldSpec]] = {}


def fields_of(kind: type[Command]) -> dict[str, FieldSpec]:
    """Give the fields of a command that are written outside, by their Python names, in the order of OSC."""
    if kind not in _FIELDS:
        _FIELDS[kind] = _read_fields(kind)
    return _FIELDS[kind]


def _read_fields(kind: type[Command]) -> dict[str, FieldSpec]:
    hints, kinds = get_type_hints(kind, include_extras=True), cast("Any", kind)
    specs = ((each.name, getattr(hints[each.name], "__metadata__", ())) for each in fields(kinds))
    return {name: spec for name, metadata in specs for spec in metadata if isinstance(spec, FieldSpec)}


def defaults_of(kind: type[Command]) -> dict[str, Any]:
    """Give the defaults of the fields that have one."""
    return {each.name: each.default for each in fields(cast("Any", kind)) if each.default is not MISSING}


def python_name(kind: type[Command]) -> str:
    """Give the name of the methods that send a command and that answer it.

    Examples
    --------
    >>> class TurnHead(Command): ...
    >>> python_name(TurnHead)
    'turn_head'
    """
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()


def checked(command: SomeCommand) -> SomeCommand:
    """Return a command with all values in their ranges; durations are brought into them.

    Raises
    ------
    UsageError
        If another value lies beyond its range.
    """
    change: Any = replace
    values = {name: spec.checked(getattr(command, name)) for name, spec in fields_of(type(command)).items()}
    result: SomeCommand = change(command, **values)
    return result


def shifted(command: SomeCommand, by_s: float) -> SomeCommand:
    """Return a command with its times on another clock, such as one that begins when the command arrives."""
    values = {name: getattr(command, name) for name, spec in fields_of(type(command)).items() if isinstance(spec, Time)}
    change: Any = replace
    result: SomeCommand = change(
        command, **{name: time_s + by_s for name, time_s in values.items() if time_s is not None}
    )
    return result
