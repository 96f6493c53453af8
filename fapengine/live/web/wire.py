"""What the page and the server say to each other over the WebSocket; nothing here knows a socket.

From the server comes one JSON text (``hello``) first, then frames as binary messages (:data:`FRAME`, little-endian)
and everything else as JSON texts with a ``type``. From the page come JSON texts alone, listed in :data:`REQUESTS`.
Times are seconds of the engine's clock; the page learns that clock from ``ping`` and ``pong``.
"""

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.live.engine import commands
from fapengine.live.engine.commands import Command
from fapengine.live.fap_osc import MAX_SESSION_BYTES
from fapengine.mpeg4 import fap
from fapengine.mpeg4.visemes import Expression
from fapengine.voices.espeak import DEFAULT_RATE_WPM, DEFAULT_VOICE, RATES_WPM

PROTOCOL = "fapengine-web/1"
FRAME = struct.Struct(f"<IId{fap.FAP_COUNT}i")
"""A frame: kind, number, engine time in s, FAP 1 to 68 in FAPU. Numbers rise by one; what is missing was left out."""
FRAME_KIND = 1
MAX_MESSAGE = 16_384
"""Bytes of one JSON text from a page."""
MAX_TEXT = 2000
"""Letters of one sentence to speak."""
PINNABLE = {str(number): number for number in range(3, fap.FAP_COUNT + 1)}
"""FAPs by the one name that each has in a message."""
MAX_FAP = 1 << 24
"""FAPU: beyond anything that a face can do, and exact in the shaders' floats."""
MAX_ANGLE_RAD = 1.6


@dataclass(frozen=True, slots=True)
class Say:
    """Speak a text."""

    text: str
    voice: str = DEFAULT_VOICE
    rate_wpm: int = DEFAULT_RATE_WPM


@dataclass(frozen=True, slots=True)
class Pin:
    """Hold FAPs at values, whatever the engine says; None lets one go."""

    values: Mapping[int, int | None]
    """FAP number 3..68 to FAPU."""


@dataclass(frozen=True, slots=True)
class ReleaseAll:
    """Let every FAP go."""


@dataclass(frozen=True, slots=True)
class Ping:
    """Ask for the engine's time."""

    number: int


@dataclass(frozen=True, slots=True)
class Plays:
    """Say whether this page plays sounds and tells where they are."""

    on: bool


@dataclass(frozen=True, slots=True)
class Tell:
    """A command for the session's face."""

    command: Command


Request = Say | Pin | ReleaseAll | Ping | Plays | Tell


@dataclass(slots=True)
class _Fields:
    """Stateful: takes the fields of one message, in whatever order, and complains of what is left."""

    message: dict[str, Any]
    taken: set[str] = field(default_factory=lambda: {"type"})

    def number(self, name: str, low: float, high: float, default: float | None = None) -> float:
        value = self._take(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not (low <= value <= high):
            raise DataError(f"{name}: got {_shown(value)}, expected a number in {low:g}..{high:g}", where=self._kind)
        return float(value)

    def whole(self, name: str, low: int, high: int, default: int | None = None) -> int:
        value = self.number(name, low, high, default)
        if not value.is_integer():
            raise DataError(f"{name}: got {value}, expected a whole number", where=self._kind)
        return int(value)

    def text(self, name: str, longest: int, default: str | None = None) -> str:
        value = self._take(name, default)
        if not isinstance(value, str) or len(value) > longest:
            raise DataError(f"{name}: got {_shown(value)}, expected up to {longest} letters", where=self._kind)
        if any("\ud800" <= letter <= "\udfff" for letter in value):  # halves of letters, which no encoding knows
            raise DataError(f"{name}: got {_shown(value)}, expected letters of Unicode", where=self._kind)
        return value

    def choice(self, name: str, known: tuple[str, ...]) -> str:
        value = self.text(name, 64)
        if value not in known:
            raise DataError(f"{name}: got {_shown(value)}, expected one of {', '.join(known)}", where=self._kind)
        return value

    def switch(self, name: str) -> bool:
        value = self._take(name, None)
        if not isinstance(value, bool):
            raise DataError(f"{name}: got {_shown(value)}, expected true or false", where=self._kind)
        return value

    def table(self, name: str) -> dict[str, Any]:
        value = self._take(name, None)
        if not isinstance(value, dict):
            raise DataError(f"{name}: got {_shown(value)}, expected an object", where=self._kind)
        return value

    def finish(self) -> None:
        if unknown := sorted(set(self.message) - self.taken):
            raise DataError(f"fields: got unknown {', '.join(map(_shown, unknown))}", where=self._kind)

    def _take(self, name: str, default: Any) -> Any:
        self.taken.add(name)
        return self.message.get(name, default)

    @property
    def _kind(self) -> str:
        return f"message {self.message['type']!r}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _say(fields: _Fields) -> Request:
    return Say(
        text=fields.text("text", MAX_TEXT),
        voice=fields.text("voice", 64, DEFAULT_VOICE),
        rate_wpm=fields.whole("rate", *RATES_WPM, DEFAULT_RATE_WPM),
    )


def _pin(fields: _Fields) -> Request:
    values: dict[int, int | None] = {}
    for name, value in fields.table("values").items():
        number = PINNABLE.get(name)
        if number is None:
            raise DataError(f"values: got FAP {_shown(name)}, expected 3..{fap.FAP_COUNT}", where="message 'pin'")
        if value is not None and (isinstance(value, bool) or not isinstance(value, int) or abs(value) > MAX_FAP):
            raise DataError(f"FAP {name}: got {_shown(value)}, expected whole FAPU or null", where="message 'pin'")
        values[number] = value
    return Pin(values)


def _express(fields: _Fields) -> Request:
    names = tuple(expression.name.lower() for expression in Expression if expression)
    expression = Expression[fields.choice("name", names).upper()]
    return Tell(commands.Express(expression, fields.number("level", 0.0, 2.0)))


def _look(fields: _Fields) -> Request:
    yaw_rad, pitch_rad = (fields.number(name, -MAX_ANGLE_RAD, MAX_ANGLE_RAD) for name in ("yaw", "pitch"))
    return Tell(commands.Look(yaw_rad, pitch_rad, fields.number("over", 0.01, 10.0, 0.1)))


def _manner(fields: _Fields) -> Request:
    return Tell(commands.Manner(fields.choice("setting", commands.MANNERS), fields.number("value", -20.0, 20.0)))


def _audio(fields: _Fields) -> Request:
    return Tell(
        commands.Audio(
            utterance=fields.whole("utterance", 0, 2**32 - 1),
            at_s=fields.number("at_s", -1e12, 1e12),
            position_s=fields.number("position_s", -60.0, 86_400.0),
            rate=fields.number("rate", 0.0, 4.0, 1.0),
        )
    )


REQUESTS: dict[str, Callable[[_Fields], Request]] = {
    "say": _say,
    "pin": _pin,
    "release": lambda fields: ReleaseAll(),
    "express": _express,
    "look": _look,
    "blink": lambda fields: Tell(commands.Blink()),
    "manner": _manner,
    "audio": _audio,
    "cancel": lambda fields: Tell(commands.Cancel()),
    "pause": lambda fields: Tell(commands.Pause()),
    "resume": lambda fields: Tell(commands.Resume()),
    "ping": lambda fields: Ping(fields.whole("number", 0, 2**53)),
    "plays": lambda fields: Plays(fields.switch("on")),
}
"""What a page may say: ``type`` to how its fields are read."""


def parse_request(text: str) -> Request:
    """Read one message of a page.

    Raises
    ------
    DataError
        For anything but a known message with exactly its fields; ``where`` names the message.
    """
    if len(text) > MAX_MESSAGE:
        raise DataError(f"message: got {len(text)} letters, expected at most {MAX_MESSAGE}")
    try:
        message = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise DataError(f"message: got {_shown(text)}, expected JSON ({error})") from error
    kind = message.get("type") if isinstance(message, dict) else None
    if not isinstance(kind, str) or kind not in REQUESTS:
        raise DataError(f"message: got {_shown(text)}, expected an object of type {', '.join(REQUESTS)}")
    fields = _Fields(message)
    request = REQUESTS[kind](fields)
    fields.finish()
    return request


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")


def pack_frame(number: int, time_s: float, faps: NDArray[np.int32]) -> bytes:
    """Write a frame: :data:`FRAME`.

    Parameters
    ----------
    number : int
        Its count, modulo 2**32.
    time_s : float
        Engine time.
    faps : (68,) int32, FAPU
    """
    return FRAME.pack(FRAME_KIND, number & 0xFFFFFFFF, time_s, *faps.tolist())


def text_of(kind: str, /, **fields: object) -> str:
    """Write a JSON message. Numbers that JSON cannot say become null."""
    cleaned = {
        name: None if isinstance(value, float) and not isfinite(value) else value for name, value in fields.items()
    }
    return json.dumps({"type": kind, **cleaned}, separators=(",", ":"), allow_nan=False)


def session_name(text: str) -> str:
    """Check the name of a session that a page asks for.

    Raises
    ------
    DataError
        If it is empty, too long, or has anything but printable letters.
    """
    if not (text and text.isprintable() and len(text.encode("utf-8", "replace")) <= MAX_SESSION_BYTES):
        raise DataError(f"session: got {_shown(text)}, expected 1..{MAX_SESSION_BYTES} bytes of printable letters")
    return text
