"""Messages between the web page and the server over the WebSocket, without the socket.

The server sends one JSON text (``hello``) first, then frames as binary messages (:data:`FRAME`, little-endian) and
everything else as JSON texts with a ``type``. The page sends its microphone's audio as binary messages
(:data:`SOUND_HEAD`) and JSON texts, listed by :func:`structs`: those for commands are generated from the list of
commands (:mod:`fapengine.engine.commands`), the others are defined here. Times are seconds of the engine's clock, which
the page learns from ``ping`` and ``pong``.
"""

import json
import re
import struct
from collections.abc import Callable
from functools import cache
from math import isfinite
from typing import Annotated, Any, Literal, cast, get_args

import msgspec
import numpy as np
from msgspec import Meta, Struct, defstruct, field
from numpy.typing import NDArray

from fapengine.engine import commands
from fapengine.engine.command_table import Choice, Command, FieldSpec, defaults_of, fields_of
from fapengine.errors import DataError
from fapengine.mpeg4 import fap
from fapengine.speaking import RATES_WPM

PROTOCOL = "fapengine-web/1"
FRAME = struct.Struct(f"<IId{fap.FAP_COUNT}i")
"""A frame: kind, number, engine time in s, FAP 1 to 68 in FAPU. Numbers increase by one; gaps are dropped frames."""
FRAME_KIND = 1
SOUND_HEAD = struct.Struct("<II")
"""Header of a piece of audio: kind and sample rate in Hz; int16 samples follow, little-endian, mono."""
SOUND_KIND = 2
SOUND_RATES_HZ = (8_000, 48_000)
MAX_SAMPLES = 9_600
"""Samples of one piece: 0.2 s at the highest rate."""
MAX_MESSAGE = 16_384
"""Bytes of one JSON text from a page."""
MAX_TEXT = 2000
"""Characters of one text to speak."""
PINNABLE = {str(number): number for number in range(3, fap.FAP_COUNT + 1)}
"""FAP numbers by their names in messages."""
MAX_FAP = 1 << 24
"""FAPU: far beyond what a face can do, and exact in the shaders' floats."""


class Say(Struct, frozen=True, forbid_unknown_fields=True):
    """Speak a text."""

    text: Annotated[str, Meta(max_length=MAX_TEXT)]
    voice: Annotated[str, Meta(max_length=64)] = ""
    """Language code; empty: the server's voice."""
    rate_wpm: Annotated[int, Meta(ge=RATES_WPM[0], le=RATES_WPM[1])] = field(default=0, name="rate")
    """Words per minute; 0, if the message has none: the server's rate."""


Seconds = Annotated[float, Meta(ge=-commands.MAX_TIME_S, le=commands.MAX_TIME_S)]
Number = Annotated[int, Meta(ge=0, le=2**31 - 1)]


class _Timed(Struct, frozen=True, forbid_unknown_fields=True):
    """Speech with known times; its audio is played by the page or elsewhere."""

    at_s: Seconds | None = None
    """Engine time of its beginning; null: now, or after the current speech."""
    audio: bool = False
    """True if its beginning waits for a message ``audio``."""
    utterance: Number | None = None
    """Number of the utterance that it continues; null: a new one."""
    last: bool = True
    """False if more of the utterance follows."""

    @property
    def anchor(self) -> commands.Anchor:
        """Time reference of its beginning."""
        return "audio" if self.audio else "now" if self.at_s is None else "at"


class Words(_Timed, frozen=True, kw_only=True):
    """Say words with known times."""

    words: Annotated[list[tuple[Annotated[str, Meta(max_length=64)], float, float]], Meta(max_length=200)]
    """Word, start and end in s from the utterance's beginning."""
    voice: Annotated[str, Meta(max_length=64)] = ""
    """Language code; empty: the server's voice."""


class Phones(_Timed, frozen=True, kw_only=True):
    """Say phones with known times."""

    phones: Annotated[list[tuple[Annotated[str, Meta(max_length=16)], float, float]], Meta(max_length=400)]
    """Label, start and end in s from the utterance's beginning."""
    set: Annotated[str, Meta(max_length=32)] = "ipa"
    """Alphabet of the labels; same names as in OSC's ``hello``."""


class Pin(Struct, frozen=True, forbid_unknown_fields=True):
    """Hold FAPs at values, instead of the engine's; None releases one."""

    values: dict[Any, Any]
    """FAP number 3..68 to FAPU; in the message the numbers are strings."""


class Perform(Struct, frozen=True, forbid_unknown_fields=True):
    """Move the face by FAPs, for example from a camera; they hold until the next such message, for 0.3 s at most."""

    values: dict[Any, Any]
    """FAP number 3..68 to FAPU; in the message the numbers are strings."""


class Release(Struct, frozen=True, forbid_unknown_fields=True):
    """Release every FAP."""


class Ping(Struct, frozen=True, forbid_unknown_fields=True):
    """Request the engine's time."""

    number: Annotated[int, Meta(ge=0, le=2**53)]


class Plays(Struct, frozen=True, forbid_unknown_fields=True):
    """Set whether this page plays audio, and reports its position."""

    on: bool


class Watch(Struct, frozen=True, forbid_unknown_fields=True):
    """Set whether this page is visible; a hidden one is sent no frames."""

    on: bool


class Tell(Struct, frozen=True):
    """A command for the session's face."""

    command: Command


Request = Say | Words | Phones | Pin | Perform | Release | Ping | Plays | Watch | Tell
_PAGE_MESSAGES: dict[str, type[Struct]] = {kind.__name__.lower(): kind for kind in get_args(Request)[:-1]}


@cache
def structs() -> dict[str, type[Struct]]:
    """Return the messages that a page may send, its own and those of commands: ``type`` to the fields."""
    return _PAGE_MESSAGES | {
        kind.SPEC.json: defstruct(kind.__name__, _json_fields(kind), forbid_unknown_fields=True)
        for kind in commands.COMMANDS
        if kind.SPEC.json
    }


def _json_fields(kind: type[Command]) -> list[tuple[str, Any] | tuple[str, Any, Any]]:
    specs = {name: spec for name, spec in fields_of(kind).items() if spec.json}
    defaults = defaults_of(kind)
    return [
        (spec.json, _json_type(spec), defaults[name]) if name in defaults else (spec.json, _json_type(spec))
        for name, spec in specs.items()
    ]


def _json_type(spec: FieldSpec) -> Any:
    if isinstance(spec, Choice):
        return Literal[tuple(spec.values)]
    return Annotated[int if spec.is_whole else float, Meta(ge=spec.low, le=spec.high)]


def parse_request(text: str) -> Request:
    """Read one message of a page.

    Raises DataError if it is not a message of :func:`structs` with exactly its fields (``where`` names the message).
    """
    if len(text) > MAX_MESSAGE:
        raise DataError(f"message: got {len(text)} characters, expected at most {MAX_MESSAGE}")
    try:
        message = msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise DataError(f"message: got {_shown(text)}, expected JSON ({error})") from error
    kind = message.pop("type", None) if isinstance(message, dict) else None
    if not isinstance(kind, str) or kind not in structs():
        raise DataError(f"message: got {_shown(text)}, expected an object of type {', '.join(structs())}")
    whole = {name: int(value) if isinstance(value, float) and value.is_integer() else value
             for name, value in message.items()}  # fmt: skip
    try:
        request = msgspec.convert(whole, structs()[kind])
    except msgspec.ValidationError as error:
        raise _complaint(str(error), message, kind) from error
    if isinstance(request, Pin | Perform):
        return type(request)(_faps_of(request.values, kind))
    return Tell(_command(kind, request)) if kind not in _PAGE_MESSAGES else cast("Request", request)


def parse_sound(data: bytes) -> tuple[int, NDArray[np.int16]]:
    """Read a piece of audio.

    Raises DataError if it is not valid.

    Returns
    -------
    rate_hz : int
    samples : (N,) int16

    Examples
    --------
    >>> rate_hz, samples = parse_sound(SOUND_HEAD.pack(SOUND_KIND, 16_000) + bytes(4))
    >>> rate_hz, samples.tolist()
    (16000, [0, 0])
    """
    length = len(data) - SOUND_HEAD.size
    if not 0 < length <= 2 * MAX_SAMPLES or length % 2:
        raise DataError(f"sound: got {len(data)} bytes, expected 8 and 2 for each of 1 to {MAX_SAMPLES} samples")
    kind, rate_hz = SOUND_HEAD.unpack_from(data)
    if kind != SOUND_KIND or not SOUND_RATES_HZ[0] <= rate_hz <= SOUND_RATES_HZ[1]:
        expected = f"kind {SOUND_KIND} at {SOUND_RATES_HZ[0]} to {SOUND_RATES_HZ[1]} Hz"
        raise DataError(f"sound: got kind {kind} at {rate_hz} Hz, expected {expected}")
    return rate_hz, np.frombuffer(data, "<i2", offset=SOUND_HEAD.size).astype(np.int16)


def _command(kind: str, struct: Struct) -> Command:
    command = next(each for each in commands.COMMANDS if each.SPEC.json == kind)
    specs = {name: spec for name, spec in fields_of(command).items() if spec.json}
    make: Callable[..., Command] = command
    return make(**{name: spec.from_json(getattr(struct, spec.json)) for name, spec in specs.items()})


def _faps_of(values: dict[str, Any], kind: str) -> dict[int, int | None]:
    where, may_be_none = f"message {kind!r}", kind == "pin"
    for name, value in values.items():
        if name not in PINNABLE:
            raise DataError(f"values: got FAP {_shown(name)}, expected 3 to {fap.FAP_COUNT}", where=where)
        is_number = isinstance(value, int) and not isinstance(value, bool) and abs(value) <= MAX_FAP
        if not is_number and not (value is None and may_be_none):
            expected = "whole FAPU" + " or null" * may_be_none
            raise DataError(f"FAP {name}: got {_shown(value)}, expected {expected}", where=where)
    return {PINNABLE[name]: value for name, value in values.items()}


def _complaint(reason: str, message: dict[str, Any], kind: str) -> DataError:
    """Translate an error of msgspec."""
    where = f"message {kind!r}"
    if unknown := re.search(r"unknown field `(.*)`", reason, re.DOTALL):
        return DataError(f"fields: got unknown {_shown(unknown[1])}", where=where)
    struct = cast("msgspec.inspect.StructType", msgspec.inspect.type_info(structs()[kind]))
    for each in struct.fields:
        if re.search(rf"`(\$\.)?{each.encode_name}`", reason):
            got = _shown(message.get(each.encode_name))
            return DataError(f"{each.encode_name}: got {got}, expected {_expected(each.type)}", where=where)
    return DataError(f"message: got {_shown(message)}, expected its fields ({reason})", where=where)


def _expected(kind: msgspec.inspect.Type) -> str:
    match kind:
        case msgspec.inspect.FloatType(ge=low, le=high):
            return f"a number, {low:g} to {high:g}"
        case msgspec.inspect.IntType(ge=low, le=high):
            return f"a whole number, {low} to {high}"
        case msgspec.inspect.StrType(max_length=longest):
            return f"up to {longest} characters"
        case msgspec.inspect.LiteralType(values=values):
            return f"one of {', '.join(map(str, values))}"
        case msgspec.inspect.BoolType():
            return "true or false"
    return "an object"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def pack_frame(number: int, time_s: float, faps: NDArray[np.int32]) -> bytes:
    """Write a frame: :data:`FRAME`.

    Parameters
    ----------
    number : int
        Frame number; written modulo 2**32.
    time_s : float
        Engine time.
    faps : (68,) int32, FAPU
    """
    return FRAME.pack(FRAME_KIND, number & 0xFFFFFFFF, time_s, *faps.tolist())


def text_of(kind: str, /, **fields: object) -> str:
    """Write a JSON message. Numbers that are not finite become null."""
    cleaned = {
        name: None if isinstance(value, float) and not isfinite(value) else value for name, value in fields.items()
    }
    return json.dumps({"type": kind, **cleaned}, separators=(",", ":"), allow_nan=False)
