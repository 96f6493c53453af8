"""Messages of :mod:`.schema` to OSC, and back.

Readers are lenient where nothing can be misunderstood: a number is taken from any numeric type (not every OSC library
can send ``h``), surplus arguments are ignored.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, cast

from fapengine.engine.command_table import Command, defaults_of, fields_of
from fapengine.errors import DataError
from fapengine.wire import osc
from fapengine.wire.speech_osc.schema import (
    MAX_DATAGRAM,
    MAX_DURATION_US,
    MAX_FIRST_SAMPLE,
    MAX_PHONES,
    MAX_WORDS,
    PHONE_TAGS,
    SESSION_BYTES,
    WORD_BYTES,
    WORD_TAGS,
    Kind,
    Phones,
    SessionCommand,
    Sound,
    Wire,
    WirePhone,
    WireWord,
    WordTimes,
)
from fapengine.wire.speech_osc.sound_window import RATES_HZ

CLAUSE = "docs/osc.md"
_RANGES = {"i": (-(2**31), 2**31 - 1), "h": (-(2**63), 2**63 - 1)}


@dataclass(frozen=True, slots=True)
class Layout:
    """Arguments of one message."""

    address: str
    tags: str
    required: int
    """Number of arguments without which the message cannot be understood."""
    names: tuple[str, ...]


_LAYOUTS: dict[Kind, Layout] = {}


def layout(kind: Kind) -> Layout:
    """Give the arguments of a message, by the class that describes it."""
    if kind not in _LAYOUTS:
        _LAYOUTS[kind] = _read_layout(kind)
    return _LAYOUTS[kind]


def _read_layout(kind: Kind) -> Layout:
    if issubclass(kind, Command):
        specs = {name: spec for name, spec in fields_of(kind).items() if spec.osc}
        required = sum(name not in defaults_of(kind) for name in specs)
        tags = "s" + "".join(spec.tag for spec in specs.values())
        return Layout(kind.SPEC.osc, tags, 1 + required, ("session", *(spec.osc for spec in specs.values())))
    return Layout(kind.ADDRESS, kind.TAGS, kind.REQUIRED, tuple(field.name for field in fields(kind)))


def encode(wire: Wire) -> bytes:
    """Write one message.

    Raises
    ------
    UsageError
        If a value does not fit its type.
    """
    if isinstance(wire, SessionCommand):
        kind, specs = type(wire.command), fields_of(type(wire.command)).items()
        values = [spec.to_osc(getattr(wire.command, name)) for name, spec in specs if spec.osc]
        return osc.message(layout(kind).address, layout(kind).tags, wire.session, *values)
    if isinstance(wire, Phones):
        head: list[osc.Argument] = [
            wire.session, wire.utterance, wire.sequence, wire.first_index, len(wire.phones)
        ]  # fmt: skip
        for phone in wire.phones:
            head += (phone.label, phone.start_us, phone.duration_us, phone.flags, phone.weight)
        tags = wire.TAGS + PHONE_TAGS * len(wire.phones)
        if wire.revision is not None:
            head.append(wire.revision)
            tags += "i"
        return osc.message(wire.ADDRESS, tags, *head)
    if isinstance(wire, WordTimes):
        start: list[osc.Argument] = [wire.session, wire.utterance, wire.first_index, len(wire.words)]
        flat = [value for word in wire.words for value in (word.text, word.start_us, word.duration_us)]
        tags = wire.TAGS + WORD_TAGS * len(wire.words) + "s"
        return osc.message(wire.ADDRESS, tags, *start, *flat, wire.voice)
    return osc.message(wire.ADDRESS, wire.TAGS, *(getattr(wire, name) for name in layout(type(wire)).names))


def parse(kind: Kind, message: osc.Message) -> Wire:
    """Read a message of a known address: ``from_sender()[address]`` or ``FROM_ENGINE[address]``.

    Raises
    ------
    DataError
        If an argument is missing, of a wrong type, or out of range.
    """
    expected, arguments = layout(kind), message.arguments
    if len(arguments) < expected.required:
        raise DataError(
            f"{expected.address}: got {len(arguments)} arguments, expected {expected.required} or more", clause=CLAUSE
        )
    values = [_value(value, tag, expected.address) for value, tag in zip(arguments, expected.tags, strict=False)]
    make: Callable[..., Wire] = partial(_command, kind) if issubclass(kind, Command) else kind
    if kind in (Phones, WordTimes):
        wire: Wire = _phones(values, message) if kind is Phones else _words(values, message)
    else:
        wire = make(*values)
    if isinstance(wire, Sound):
        _check_sound(wire)
    session = getattr(wire, "session", "-")
    if not 1 <= len(session.encode()) <= SESSION_BYTES:
        raise DataError(f"session: got {session!r:.50}, expected 1..{SESSION_BYTES} bytes", clause=CLAUSE)
    return wire


def surplus(kind: Kind, message: osc.Message) -> int:
    """Count the arguments behind those that the schema knows."""
    expected = len(layout(kind).tags)
    if kind is Phones and len(message.arguments) > 4 and isinstance(message.arguments[4], int):
        expected += 5 * message.arguments[4] + 1
    if kind is WordTimes and len(message.arguments) > 3 and isinstance(message.arguments[3], int):
        expected += 3 * message.arguments[3] + 1
    return max(len(message.arguments) - expected, 0)


def _command(kind: type[Command], session: str, *values: Any) -> SessionCommand:
    specs = [(name, spec) for name, spec in fields_of(kind).items() if spec.osc]
    make: Callable[..., Command] = kind
    arguments = {name: spec.from_osc(value) for (name, spec), value in zip(specs, values, strict=False)}
    return SessionCommand(session, make(**arguments))


def _check_sound(wire: Sound) -> None:
    length = len(wire.samples)
    if not 0 < length <= MAX_DATAGRAM or length % 2:
        raise DataError(f"{wire.ADDRESS}: got {length} bytes, expected 2..{MAX_DATAGRAM}, int16", clause=CLAUSE)
    if not 0 <= wire.first_sample <= MAX_FIRST_SAMPLE or not RATES_HZ[0] <= wire.rate_hz <= RATES_HZ[1]:
        raise DataError(
            f"{wire.ADDRESS}: got sample {wire.first_sample} at {wire.rate_hz} Hz, expected 0..{MAX_FIRST_SAMPLE} at"
            f" {RATES_HZ[0]}..{RATES_HZ[1]} Hz",
            clause=CLAUSE,
        )


def _value(value: osc.Argument, tag: str, where: str) -> str | int | float | bytes:
    """Take an argument for what the schema says it is."""
    if tag == "b":
        if isinstance(value, bytes):
            return value
        raise DataError(f"{where}: got {value!r:.40}, expected a blob", clause=CLAUSE)
    if tag == "s":
        if isinstance(value, str):
            return value
        raise DataError(f"{where}: got {value!r:.40}, expected a string", clause=CLAUSE)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise DataError(f"{where}: got {value!r:.40}, expected a number", clause=CLAUSE)
    if tag == "f":
        return float(value)
    lowest, highest = _RANGES[tag]
    whole = round(value)
    if not lowest <= whole <= highest:
        raise DataError(f"{where}: got {value!r:.40}, expected {lowest}..{highest}", clause=CLAUSE)
    return whole


def _phones(values: list[Any], message: osc.Message) -> Phones:
    arguments = message.arguments
    session, (utterance, sequence, first, count) = str(values[0]), map(int, values[1:])
    if not 1 <= count <= MAX_PHONES or not 0 <= first <= 1_000_000:
        raise DataError(
            f"{Phones.ADDRESS}: got {count} phones from {first}, expected 1..{MAX_PHONES} from 0..1000000",
            clause=CLAUSE,
        )
    stop = 5 + 5 * count
    if len(arguments) < stop:
        raise DataError(f"{Phones.ADDRESS}: got {len(arguments)} arguments, expected {stop}", clause=CLAUSE)
    tags = PHONE_TAGS * count
    flat = arguments[5:stop]
    if message.tags[5:stop] != tags or not all(map(math.isfinite, cast("tuple[float, ...]", flat[4::5]))):
        flat = tuple(_value(value, tag, Phones.ADDRESS) for value, tag in zip(flat, tags, strict=True))
    phones = tuple(map(_phone, *(cast("tuple[Any, ...]", flat[part::5]) for part in range(5))))
    revision: Any = _value(arguments[stop], "i", Phones.ADDRESS) if len(arguments) > stop else None
    return Phones(session, utterance, sequence, first, phones, None if revision is None else int(revision))


def _words(values: list[Any], message: osc.Message) -> WordTimes:
    arguments = message.arguments
    session, (utterance, first, count) = str(values[0]), map(int, values[1:])
    if not 1 <= count <= MAX_WORDS or not 0 <= first <= 1_000_000:
        raise DataError(
            f"{WordTimes.ADDRESS}: got {count} words from {first}, expected 1..{MAX_WORDS} from 0..1000000",
            clause=CLAUSE,
        )
    stop = 4 + 3 * count
    if len(arguments) < stop:
        raise DataError(f"{WordTimes.ADDRESS}: got {len(arguments)} arguments, expected {stop}", clause=CLAUSE)
    flat: list[Any] = [
        _value(value, tag, WordTimes.ADDRESS)
        for value, tag in zip(arguments[4:stop], WORD_TAGS * count, strict=True)
    ]  # fmt: skip
    words = tuple(map(_word, flat[::3], flat[1::3], flat[2::3]))
    voice = str(_value(arguments[stop], "s", WordTimes.ADDRESS)) if len(arguments) > stop else ""
    return WordTimes(session, utterance, first, words, voice)


def _word(text: str, start_us: int, duration_us: int) -> WireWord:
    if not (0 <= start_us <= MAX_DURATION_US and 0 <= duration_us <= MAX_DURATION_US):
        raise DataError(
            f"word {text!r:.30}: got {start_us} us for {duration_us} us, expected 0..{MAX_DURATION_US}", clause=CLAUSE
        )
    if len(text.encode()) > WORD_BYTES:
        raise DataError(f"word {text!r:.30}: got {len(text.encode())} bytes, expected 0..{WORD_BYTES}", clause=CLAUSE)
    return WireWord(text, start_us, duration_us)


def _phone(label: str, start_us: int, duration_us: int, flags: int, weight: float) -> WirePhone:
    if not (0 <= start_us <= MAX_DURATION_US and 0 <= duration_us <= MAX_DURATION_US):
        raise DataError(
            f"phone {label!r:.30}: got {start_us} us for {duration_us} us, expected 0..{MAX_DURATION_US}", clause=CLAUSE
        )
    return WirePhone(label, start_us, duration_us, flags, weight)
