"""Encoder and decoder of the messages of :mod:`.schema`.

The decoder is lenient where nothing can be misunderstood: it takes a number from any numeric type, because not every
OSC library can send ``h``, and ignores surplus arguments.
"""

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from itertools import chain
from typing import Any

from fapengine.engine.command_table import Command, defaults_of, fields_of
from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.schema import Kind, Phones, Sound, Wire, WordTimes

MAX_INDEX = 1_000_000
_RANGES = {"i": (-(2**31), 2**31 - 1), "h": (-(2**63), 2**63 - 1)}
_TYPES: dict[str, tuple[type, str]] = {"s": (str, "a string"), "b": (bytes, "a blob")}


@dataclass(frozen=True, slots=True)
class Layout:
    """Arguments of one message."""

    address: str
    tags: str
    required: int
    """Number of arguments that must be there."""
    names: tuple[str, ...]


_LAYOUTS: dict[Kind, Layout] = {}


def layout(kind: Kind) -> Layout:
    """Return the arguments of a message, by the class that describes it."""
    if kind in _LAYOUTS:
        return _LAYOUTS[kind]
    if issubclass(kind, Command):
        specs = {name: spec for name, spec in fields_of(kind).items() if spec.osc}
        required = 1 + sum(name not in defaults_of(kind) for name in specs)
        tags = "s" + "".join(spec.tag for spec in specs.values())
        found = Layout(kind.SPEC.osc, tags, required, ("session", *(spec.osc for spec in specs.values())))
    else:
        required = sum(each.default is MISSING for each in fields(kind))
        found = Layout(kind.ADDRESS, kind.TAGS, required, tuple(each.name for each in fields(kind)))
    _LAYOUTS[kind] = found
    return found


def encode(wire: Wire) -> bytes:
    """Encode one message. Raises UsageError if a value does not fit its type."""
    if isinstance(wire, schema.SessionCommand):
        kind, specs = type(wire.command), fields_of(type(wire.command)).items()
        values = [spec.to_osc(getattr(wire.command, name)) for name, spec in specs if spec.osc]
        return osc.message(layout(kind).address, layout(kind).tags, wire.session, *values)
    values, tags = [getattr(wire, name) for name in layout(type(wire)).names], wire.TAGS
    if isinstance(wire, Phones | WordTimes):
        *head, rows, last = values
        values = [*head, len(rows), *chain.from_iterable(rows)]
        tags += wire.ROW_TAGS * len(rows)
        if last is not None:
            values.append(last)
            tags += wire.LAST_TAG
    return osc.message(wire.ADDRESS, tags, *values)


def parse(kind: Kind, message: osc.Message) -> Wire:
    """Decode a message of a known address: ``from_sender()[address]`` or ``FROM_ENGINE[address]``.

    Raises
    ------
    DataError
        If an argument is missing, of a wrong type, or out of range.
    """
    expected, arguments = layout(kind), message.arguments
    if len(arguments) < expected.required:
        raise _error(f"{expected.address}: got {len(arguments)} arguments, expected {expected.required} or more")
    values = [_value(value, tag, expected.address) for value, tag in zip(arguments, expected.tags, strict=False)]
    if issubclass(kind, Command):
        specs = [(name, spec) for name, spec in fields_of(kind).items() if spec.osc]
        fields_given = {name: spec.from_osc(value) for (name, spec), value in zip(specs, values[1:], strict=False)}
        make_command: Callable[..., Command] = kind
        wire: Wire = schema.SessionCommand(values[0], make_command(**fields_given))
    elif issubclass(kind, Phones | WordTimes):
        wire = _parse_rows(kind, values, message)
    else:
        make: Callable[..., Wire] = kind
        wire = make(*values)
    if isinstance(wire, Sound):
        length = len(wire.samples)
        if not 0 < length <= schema.MAX_DATAGRAM or length % 2:
            raise _error(f"{wire.ADDRESS}: got {length} bytes, expected 2 to {schema.MAX_DATAGRAM}, int16")
        if (
            not 0 <= wire.first_sample <= schema.MAX_FIRST_SAMPLE
            or not schema.RATES_HZ[0] <= wire.rate_hz <= schema.RATES_HZ[1]
        ):
            raise _error(
                f"{wire.ADDRESS}: got sample {wire.first_sample} at {wire.rate_hz} Hz, expected"
                f" 0 to {schema.MAX_FIRST_SAMPLE} at {schema.RATES_HZ[0]} to {schema.RATES_HZ[1]} Hz"
            )
    session = getattr(wire, "session", "-")
    if not 1 <= len(session.encode()) <= schema.SESSION_BYTES:
        raise _error(f"session: got {session!r:.50}, expected 1 to {schema.SESSION_BYTES} bytes")
    return wire


def surplus(kind: Kind, message: osc.Message) -> int:
    """Count the arguments after those of the schema."""
    arguments, expected = message.arguments, len(layout(kind).tags)
    if issubclass(kind, Phones | WordTimes) and len(arguments) >= expected:
        count = arguments[expected - 1]
        expected += len(kind.ROW_TAGS) * count + 1 if isinstance(count, int) else 0
    return max(len(arguments) - expected, 0)


def _value(value: osc.Argument, tag: str, where: str) -> Any:
    """Return an argument as the type of the schema."""
    if tag in _TYPES:
        kind, noun = _TYPES[tag]
        if not isinstance(value, kind):
            raise _error(f"{where}: got {value!r:.40}, expected {noun}")
        return value
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise _error(f"{where}: got {value!r:.40}, expected a number")
    if tag == "f":
        return float(value)
    lowest, highest = _RANGES[tag]
    whole = round(value)
    if not lowest <= whole <= highest:
        raise _error(f"{where}: got {value!r:.40}, expected {lowest} to {highest}")
    return whole


def _parse_rows(kind: type[Phones | WordTimes], values: list[Any], message: osc.Message) -> Phones | WordTimes:
    """Decode phones or words: ``values`` end with their count; the rows and one optional argument follow."""
    *head, first, count = values
    noun, width, begin = "word" if issubclass(kind, WordTimes) else "phone", len(kind.ROW_TAGS), len(values)
    if not 1 <= count <= kind.MAX_ROWS or not 0 <= first <= MAX_INDEX:
        raise _error(
            f"{kind.ADDRESS}: got {count} {noun}s from {first}, expected 1 to {kind.MAX_ROWS} from 0 to {MAX_INDEX}"
        )
    stop = begin + width * count
    if len(message.arguments) < stop:
        raise _error(f"{kind.ADDRESS}: got {len(message.arguments)} arguments, expected {stop}")
    flat, tags = message.arguments[begin:stop], kind.ROW_TAGS * count
    floats: Any = chain.from_iterable(flat[part::width] for part in range(width) if kind.ROW_TAGS[part] == "f")
    if message.tags[begin:stop] != tags or not all(map(math.isfinite, floats)):
        flat = tuple(_value(value, tag, kind.ADDRESS) for value, tag in zip(flat, tags, strict=True))
    rows: Any = tuple(map(kind.ROW, *(flat[part::width] for part in range(width))))
    for label, start_us, duration_us, *_ in rows:
        if not (0 <= start_us <= schema.MAX_DURATION_US and 0 <= duration_us <= schema.MAX_DURATION_US):
            raise _error(
                f"{noun} {label!r:.30}: got {start_us} us for {duration_us} us, expected 0 to {schema.MAX_DURATION_US}"
            )
        if noun == "word" and len(label.encode()) > schema.WORD_BYTES:
            raise _error(f"{noun} {label!r:.30}: got {len(label.encode())} bytes, expected 0 to {schema.WORD_BYTES}")
    last = [_value(value, kind.LAST_TAG, kind.ADDRESS) for value in message.arguments[stop : stop + 1]]
    make: Callable[..., Phones | WordTimes] = kind
    return make(*head, first, rows, *last)


def _error(text: str) -> DataError:
    return DataError(text, clause="docs/osc.md")
