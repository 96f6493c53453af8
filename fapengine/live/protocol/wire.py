"""Messages of :mod:`.schema` to OSC, and back.

Readers are lenient where nothing can be misunderstood: a number is taken from any numeric type (not every OSC library
can send ``h``), surplus arguments are ignored.
"""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any, cast

from fapengine.errors import DataError
from fapengine.live import osc
from fapengine.live.protocol.schema import (
    LONGEST_US,
    MOST_PHONES,
    PHONE_TAGS,
    SESSION_BYTES,
    Phones,
    Wire,
    WirePhone,
)

CLAUSE = "docs/osc.md"
_RANGES = {"i": (-(2**31), 2**31 - 1), "h": (-(2**63), 2**63 - 1)}


def encode(wire: Wire) -> bytes:
    """Write one message.

    Raises
    ------
    UsageError
        If a value does not fit its type.
    """
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
    return osc.message(wire.ADDRESS, wire.TAGS, *(getattr(wire, field.name) for field in fields(wire)))


def parse(kind: type[Wire], message: osc.Message) -> Wire:
    """Read a message of a known address: ``FROM_SENDER[address]`` or ``FROM_ENGINE[address]``.

    Raises
    ------
    DataError
        If an argument is missing, of a wrong type, or out of range.
    """
    given = message.arguments
    if len(given) < kind.REQUIRED:
        raise DataError(f"{kind.ADDRESS}: got {len(given)} arguments, expected {kind.REQUIRED} or more", clause=CLAUSE)
    values = [_value(value, tag, kind.ADDRESS) for value, tag in zip(given, kind.TAGS, strict=False)]
    make: Callable[..., Wire] = kind
    wire = _phones(values, message) if kind is Phones else make(*values)
    session = getattr(wire, "session", "-")
    if not 1 <= len(session.encode()) <= SESSION_BYTES:
        raise DataError(f"session: got {session!r:.50}, expected 1..{SESSION_BYTES} bytes", clause=CLAUSE)
    return wire


def surplus(kind: type[Wire], message: osc.Message) -> int:
    """Count the arguments behind those that the schema knows."""
    known = len(kind.TAGS)
    if kind is Phones and len(message.arguments) > 4 and isinstance(message.arguments[4], int):
        known += 5 * message.arguments[4] + 1
    return max(len(message.arguments) - known, 0)


def _value(value: osc.Argument, tag: str, where: str) -> str | int | float:
    """Take an argument for what the schema says it is."""
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


def _phones(values: list[str | int | float], message: osc.Message) -> Phones:
    given = message.arguments
    session, (utterance, sequence, first, count) = str(values[0]), map(int, values[1:])
    if not 1 <= count <= MOST_PHONES or not 0 <= first <= 1_000_000:
        raise DataError(
            f"{Phones.ADDRESS}: got {count} phones from {first}, expected 1..{MOST_PHONES} from 0..1000000",
            clause=CLAUSE,
        )
    stop = 5 + 5 * count
    if len(given) < stop:
        raise DataError(f"{Phones.ADDRESS}: got {len(given)} arguments, expected {stop}", clause=CLAUSE)
    tags = PHONE_TAGS * count
    flat = given[5:stop]
    if message.tags[5:stop] != tags or not all(map(math.isfinite, cast("tuple[float, ...]", flat[4::5]))):
        flat = tuple(_value(value, tag, Phones.ADDRESS) for value, tag in zip(flat, tags, strict=True))
    phones = tuple(map(_phone, *(cast("tuple[Any, ...]", flat[part::5]) for part in range(5))))
    revision = _value(given[stop], "i", Phones.ADDRESS) if len(given) > stop else None
    return Phones(session, utterance, sequence, first, phones, None if revision is None else int(revision))


def _phone(label: str, start_us: int, duration_us: int, flags: int, weight: float) -> WirePhone:
    if not (0 <= start_us <= LONGEST_US and 0 <= duration_us <= LONGEST_US):
        raise DataError(
            f"phone {label!r:.30}: got {start_us} us for {duration_us} us, expected 0..{LONGEST_US}", clause=CLAUSE
        )
    return WirePhone(label, start_us, duration_us, flags, weight)
