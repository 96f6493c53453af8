"""Commands to a live face outside Python: addresses, fields, units and ranges, as data.

The classes of :mod:`.commands` are the table: one class per command, one annotated attribute per field. The OSC codec,
the JSON codec, the client, the web page and the tables in the documentation read it through this module, so a command
is described once.

In Python, angles are radians and times are seconds. OSC carries degrees, and whole microseconds or milliseconds. JSON
carries the same units as Python.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from math import inf, isfinite, isnan
from typing import Any, ClassVar, TypeVar, get_type_hints

from fapengine.errors import DataError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandSpec:
    """Names of one command outside Python, and its description."""

    doc: str
    """Description in the tables of the documentation."""
    osc: str = ""
    """Address, with the session as first argument."""
    one_shot: str = ""
    """Address without the session."""
    json: str = ""
    """``type`` of the web page's message; empty if pages do not send it."""
    is_direct: bool = False
    """Whether its OSC message carries its fields and nothing else. Other commands concern one sender's utterances, in
    that sender's numbering and on its clock: they are messages of :mod:`fapengine.wire.speech_osc.schema`."""
    is_repeatable: bool = False
    """Whether repeating it changes nothing; a client sends such commands three times over UDP."""
    is_shown: bool = False
    """Whether it is sent to web pages, so that their controls show what other senders have set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldSpec:
    """One field of a command: a number without a unit, unless a subclass says otherwise."""

    doc: str = ""
    osc: str = ""
    """Name in OSC, with its unit; empty if OSC does not carry it."""
    tag: str = "f"
    """OSC type tag."""
    json: str = ""
    """Name in JSON; empty if JSON does not carry it."""
    low: float = -inf
    high: float = inf
    is_whole: bool = False

    def to_osc(self, value: Any) -> Any:
        """Convert to the OSC argument."""
        return value

    def from_osc(self, value: Any) -> Any:
        """Convert from the OSC argument. Raises DataError if the value has no meaning."""
        return value

    def to_json(self, value: Any) -> Any:
        """Convert to JSON."""
        return value

    def from_json(self, value: Any) -> Any:
        """Convert from a checked JSON value."""
        return value

    def checked(self, value: Any) -> Any:
        """Return a Python value within its range. Raises UsageError for one that is out of range."""
        if not self.low <= value <= self.high:
            name = self.json or self.osc or "value"
            raise UsageError(f"{name}: got {value}, expected {self.low:g} to {self.high:g}")
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle(FieldSpec):
    """Radians; degrees in OSC."""

    def to_osc(self, value: float) -> float:
        """Convert to degrees."""
        return math.degrees(value)

    def from_osc(self, value: float) -> float:
        """Convert from degrees."""
        return math.radians(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration(FieldSpec):
    """Seconds, clamped to the range; whole microseconds in OSC."""

    tag: str = "i"
    per_s: int = 1_000_000
    """OSC units per second."""

    def to_osc(self, value: float) -> int:
        """Convert to whole units."""
        return round(value * self.per_s)

    def from_osc(self, value: int) -> float:
        """Convert from whole units."""
        return value / self.per_s

    def checked(self, value: float) -> float:
        """Clamp to the range; NaN is rejected."""
        if isnan(value):
            raise UsageError(f"{self.json or self.osc}: got {value}, expected {self.low:g} to {self.high:g}")
        return min(max(value, self.low), self.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class EndlessDuration(FieldSpec):
    """Seconds, or infinity; whole microseconds in OSC, where -1 is infinite."""

    tag: str = "i"

    def to_osc(self, value: float) -> int:
        """Return microseconds, or -1."""
        return -1 if value == inf else round(value * 1e6)

    def from_osc(self, value: int) -> float:
        """Read microseconds, or -1."""
        return inf if value < 0 else value / 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Time(FieldSpec):
    """A time in seconds, or None for now.

    OSC carries whole microseconds from the arrival, where -1 is now; see :func:`shifted`.
    """

    tag: str = "i"

    def to_osc(self, value: float | None) -> int:
        """Return microseconds, or -1."""
        return -1 if value is None else max(round(value * 1e6), -1)

    def from_osc(self, value: int) -> float | None:
        """Read microseconds, or -1."""
        return value / 1e6 if value > 0 else None

    def checked(self, value: float | None) -> float | None:
        """Return a finite time, or None."""
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
    """Further names that OSC accepts."""

    def to_osc(self, value: Any) -> str:
        """Convert to the name."""
        return self.to_json(value)

    def to_json(self, value: Any) -> str:
        """Convert to the name."""
        names = {**self.values, **self.synonyms}
        return next(name for name, meant in names.items() if meant == value)

    def from_json(self, value: str) -> Any:
        """Return the value of a name."""
        return self.values[value]

    def checked(self, value: Any) -> Any:
        """Return one of the values."""
        if value not in self.values.values():
            raise UsageError(f"{self.what}: got {value!r}, expected one of {', '.join(self.values)}")
        return value

    def from_osc(self, value: str) -> Any:
        """Return the value of a name or synonym, in any case.

        Raises
        ------
        DataError
            If there is no such name.
        """
        names = {**self.values, **self.synonyms}
        plain = value.strip().lower()
        if plain not in names:
            raise DataError(f"{self.what}: got {value!r:.40}, expected one of {', '.join(names)}")
        return names[plain]


@dataclass(frozen=True, slots=True)
class Command:
    """A command to a live face; :mod:`.commands` has the subclasses."""

    SPEC: ClassVar[CommandSpec]


SomeCommand = TypeVar("SomeCommand", bound=Command)


_FIELDS: dict[type[Command], dict[str, FieldSpec]] = {}


def fields_of(kind: type[Command]) -> dict[str, FieldSpec]:
    """Return the fields of a command that are sent, by Python name, in the order of OSC."""
    if kind not in _FIELDS:
        hints = get_type_hints(kind, include_extras=True)
        specs = ((each.name, getattr(hints[each.name], "__metadata__", ())) for each in fields(kind))
        _FIELDS[kind] = {name: spec for name, metadata in specs for spec in metadata if isinstance(spec, FieldSpec)}
    return _FIELDS[kind]


def defaults_of(kind: type[Command]) -> dict[str, Any]:
    """Return the defaults of the fields that have one."""
    return {each.name: each.default for each in fields(kind) if each.default is not MISSING}


def checked(command: SomeCommand) -> SomeCommand:
    """Return a command with all values in range; durations are clamped.

    Raises
    ------
    UsageError
        If another value is out of range.
    """
    specs = fields_of(type(command))
    return replace(command, **{name: spec.checked(getattr(command, name)) for name, spec in specs.items()})


def shifted(command: SomeCommand, by_s: float) -> SomeCommand:
    """Return a command with its times moved to another clock."""
    specs = fields_of(type(command))
    times_s = {name: getattr(command, name) for name, spec in specs.items() if isinstance(spec, Time)}
    return replace(command, **{name: time_s + by_s for name, time_s in times_s.items() if time_s is not None})
