"""OSC packets: encode messages and bundles, and decode any bytes or raise ``DataError``.

Layout (OSC 1.0). Everything is big-endian and a multiple of 4 bytes long::

    message   address string, type-tag string ",...", arguments
    string    UTF-8, at least one NUL, NUL up to a multiple of 4
    i f r c m 4 bytes    h d t  8 bytes    T F N [ ]  none    b  int32 length, bytes, NUL up to a multiple of 4
    bundle    "#bundle" NUL, time tag (uint32 seconds since 1900, uint32 fractions; 1 = immediately),
              then elements: int32 length, message or bundle

python-osc encodes the messages (:mod:`.fap_osc` encodes frames of many faces at once). The decoder is here, because
that of python-osc takes several times as long for phones and frames, drops the time tags of bundles, and does not
terminate for some packets (design/decisions.md, 0008, ``python -m bench.osc``).
"""

import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from fapengine._late import Late
from fapengine.errors import DataError, TruncatedError, UnsupportedError, UsageError

osc_message_builder = Late("pythonosc.osc_message_builder", "python-osc", "OSC")

Argument = int | float | str | bytes | bool | None

IMMEDIATELY = 1
"""Time tag for "on arrival"."""
MAX_DEPTH = 8
"""Largest nesting of bundles; no known sender uses more than 2."""
BUNDLE = b"#bundle\0"
BUNDLE_HEAD = BUNDLE + struct.pack(">Q", IMMEDIATELY)
CLAUSE = "OSC 1.0"
REMEMBERED_TAGS = 2048
"""Longest type tags, in arguments, whose reader is cached: longer ones would let a peer fill the memory."""


@dataclass(frozen=True, slots=True)
class Message:
    """One decoded message."""

    address: str
    tags: str
    """Type tags without comma and array brackets: one character per argument."""
    arguments: tuple[Argument, ...]
    time_tag: int = IMMEDIATELY
    """Time tag of the innermost bundle around it: NTP, 32 bits of seconds since 1900 and 32 of fractions."""


def message(address: str, tags: str = "", *arguments: Argument) -> bytes:
    """Build one message.

    Parameters
    ----------
    address : str
        Begins with ``/``.
    tags : str
        One OSC type tag (``ihfdsbTFN``) per argument.
    arguments
        Values.

    Raises
    ------
    UsageError
        If an argument does not fit its tag.

    Examples
    --------
    >>> message("/fap/3", "i", 200).hex(" ", 4)
    '2f666170 2f330000 2c690000 000000c8'
    """
    if not address.startswith("/") or "\0" in address:
        raise UsageError(f"OSC address: got {address!r:.40}, expected /... without NUL")
    if len(tags) != len(arguments):
        raise UsageError(f"{address}: got {len(arguments)} arguments, expected {len(tags)} for tags {tags!r}")
    builder = osc_message_builder.OscMessageBuilder(address)
    try:
        for tag, value in zip(tags, arguments, strict=True):
            if isinstance(value, str) and "\0" in value:
                raise ValueError("a NUL inside a string")
            builder.add_arg(value, tag)
        checked: bytes = builder.build().dgram
    except (osc_message_builder.BuildError, ValueError, TypeError, OverflowError) as error:
        raise UsageError(f"{address}: got {arguments!r:.80}, expected values for tags {tags!r}: {error}") from error
    return checked


@lru_cache(maxsize=4096)
def head(address: str, tags: str, *arguments: Argument) -> bytes:
    """Build a message without the 4 bytes of its last argument, an int or a float, which the caller appends."""
    return message(address, tags, *arguments, 0)[:-4]


def bundles(messages: Sequence[bytes], *, limit: int) -> list[bytes]:
    """Pack messages, in order, into as few immediate bundles as possible.

    Raises UsageError if a single message does not fit.

    Parameters
    ----------
    messages : sequence of bytes
        Encoded messages.
    limit : int, bytes
        Largest datagram.
    """
    packed: list[bytes] = []
    parts, size = [BUNDLE_HEAD], len(BUNDLE_HEAD)
    for each in messages:
        if len(BUNDLE_HEAD) + 4 + len(each) > limit:
            raise UsageError(f"datagram: got a message of {len(each)} bytes, expected room for it within {limit}")
        if size + 4 + len(each) > limit:
            packed.append(b"".join(parts))
            parts, size = [BUNDLE_HEAD], len(BUNDLE_HEAD)
        parts += (struct.pack(">i", len(each)), each)
        size += 4 + len(each)
    if len(parts) > 1:
        packed.append(b"".join(parts))
    return packed


def parse_packet(data: bytes) -> tuple[Message, ...]:
    """Decode one datagram or TCP frame: its messages, in order.

    Raises TruncatedError if it ends inside a value; UnsupportedError for a type tag that is not in the list above, or
    bundles nested deeper than 8; DataError if it is not OSC (``where`` is the byte).
    """
    messages: list[Message] = []
    _packet(data, 0, IMMEDIATELY, 0, messages)
    return tuple(messages)


def _packet(data: bytes, at: int, time_tag: int, depth: int, messages: list[Message]) -> None:
    if data[:1] == b"/":
        messages.append(_message(data, at, time_tag))
        return
    if data[:8] != BUNDLE:
        raise DataError(f"OSC: got {data[:8]!r}, expected / or #bundle", where=f"byte {at}", clause=CLAUSE)
    if depth == MAX_DEPTH:
        raise UnsupportedError(f"OSC: got bundles nested deeper than {MAX_DEPTH}", where=f"byte {at}")
    if len(data) < 16:
        raise TruncatedError(f"OSC bundle: got {len(data)} bytes, expected 16 or more", where=f"byte {at}")
    (time_tag,) = struct.unpack_from(">Q", data, 8)
    here = 16
    while here < len(data):
        if len(data) - here < 4:
            raise TruncatedError("OSC bundle: ends inside the length of an element", where=f"byte {at + here}")
        (size,) = struct.unpack_from(">i", data, here)
        if size <= 0 or size % 4:
            raise DataError(
                f"OSC element: got {size} bytes, expected a multiple of 4", where=f"byte {at + here}", clause=CLAUSE
            )
        here += 4
        if size > len(data) - here:
            raise TruncatedError(f"OSC element: got {len(data) - here} bytes of {size}", where=f"byte {at + here}")
        _packet(data[here : here + size], at + here, time_tag, depth + 1, messages)
        here += size


def _message(data: bytes, at: int, time_tag: int) -> Message:
    address, here = _string(data, 0, at)
    if here == len(data):  # some old senders omit the type tags of a message without arguments
        return Message(address, "", (), time_tag)
    spelled, here = _string(data, here, at)
    if not spelled.startswith(","):
        raise DataError(f"OSC type tags: got {spelled!r:.20}, expected ,...", where=f"byte {at}", clause=CLAUSE)
    tags = spelled[1:].replace("[", "").replace("]", "")
    values: list[Argument] = []
    for step in _steps(tags) if len(tags) <= REMEMBERED_TAGS else _steps.__wrapped__(tags):
        if isinstance(step, struct.Struct):
            if len(data) - here < step.size:
                raise TruncatedError(
                    f"OSC arguments: got {len(data) - here} bytes, expected {step.size}", where=f"byte {at + here}"
                )
            values += step.unpack_from(data, here)
            here += step.size
        elif isinstance(step, str):
            readable = "".join((*_LAYOUTS, *_READERS))
            raise UnsupportedError(f"OSC type tag: got {step!r}, expected one of {readable}", where=f"byte {at}")
        else:
            value, here = step(data, here, at)
            values.append(value)
    if here != len(data):
        raise DataError(f"OSC message: {len(data) - here} bytes follow its arguments", where=f"byte {at + here}")
    return Message(address, tags, tuple(values), time_tag)


def _string(data: bytes, here: int, at: int) -> tuple[str, int]:
    stop = data.find(b"\0", here)
    end = here + (stop - here) // 4 * 4 + 4
    if stop < 0 or end > len(data):
        raise TruncatedError("OSC string: ends before its NUL", where=f"byte {at + here}", clause=CLAUSE)
    try:
        return data[here:stop].decode(), end
    except UnicodeDecodeError as error:
        raise DataError(
            f"OSC string: invalid UTF-8: {error.reason}", where=f"byte {at + here + error.start}"
        ) from error


def _blob(data: bytes, here: int, at: int) -> tuple[bytes, int]:
    if len(data) - here < 4:
        raise TruncatedError("OSC blob: ends before its length", where=f"byte {at + here}", clause=CLAUSE)
    (size,), begin = struct.unpack_from(">i", data, here), here + 4
    if size < 0:
        raise DataError(f"OSC blob: got a length of {size!r}", where=f"byte {at + here}", clause=CLAUSE)
    end = begin + (size + 3) // 4 * 4
    if end > len(data):
        raise TruncatedError(f"OSC blob: got {len(data) - begin} bytes of {size}", where=f"byte {at + begin}")
    return data[begin : begin + size], end


Reader = Callable[[bytes, int, int], tuple[Argument, int]]


def _constant(value: Argument) -> Reader:
    return lambda data, here, at: (value, here)


_LAYOUTS = {"i": "i", "f": "f", "h": "q", "d": "d", "t": "Q", "c": "i", "r": "4s", "m": "4s"}
_READERS: dict[str, Reader] = {
    "s": _string, "S": _string, "b": _blob, "T": _constant(True), "F": _constant(False), "N": _constant(None),
}  # fmt: skip


@lru_cache(maxsize=256)
def _steps(tags: str) -> tuple[struct.Struct | Reader | str, ...]:
    """Return the readers of the arguments, one struct for each run of numbers; unknown tags as they are."""
    steps: list[struct.Struct | Reader | str] = []
    for run in re.findall(f"[{''.join(_LAYOUTS)}]+|.", tags, re.DOTALL):
        if run[0] in _LAYOUTS:
            steps.append(struct.Struct(">" + "".join(_LAYOUTS[tag] for tag in run)))
        else:
            steps.append(_READERS.get(run, run))
    return tuple(steps)
