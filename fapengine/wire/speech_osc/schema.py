"""Messages of the robust mode, ``/fap/1/...``, as values.

One class per message; its fields are the arguments, in order. ``TAGS`` are the OSC types that are sent. Fields without
a default are required. Times are integers in microseconds. :mod:`.codec` writes and reads the messages.

Commands that are the same for every sender have no class here: :class:`SessionCommand` carries them, and
:mod:`fapengine.engine.commands` describes their arguments. The messages here concern one sender's utterances, in its
numbering and on its clock, or are part of the protocol itself.
"""

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Literal, NamedTuple, get_args

from fapengine.engine import commands
from fapengine.engine.command_table import Command
from fapengine.errors import UsageError

PROTOCOL = 1
MAX_DATAGRAM = 1200
"""Bytes; passes any internet path without fragmentation."""
INT32 = 2**31 - 1
SESSION_BYTES = 32
LABEL_BYTES = 15
"""Bytes of a phone's label. A longer one is shown as unknown."""
TEXT_BYTES = 4000
MAX_DURATION_US = 3_600_000_000 // 2
"""Half an hour, the longest utterance. (An int32 of microseconds ends at 35 minutes.)"""
NOW = -1
"""Number that means "at once" for a time, and "all" for an utterance."""

WireAnchor = Literal["now", "at", "audio", "sound"]
"""Ways to set the start of an utterance."""
WANT_ACK, TCP, WILL_SEND_AUDIO, FOLLOWS = 1, 2, 4, 8
"""Flags of :class:`Hello`."""
PRIMARY_STRESS, SECONDARY_STRESS, WORD_INITIAL, PHRASE_FINAL = 1, 2, 4, 8
"""Flags of :class:`WirePhone`."""
MAX_SAMPLES = 480
"""Samples in one message: 30 ms at 16 kHz, which leaves room for a begin in the same datagram."""
RATES_HZ = (8_000, 48_000)
"""Lowest and highest sample rate."""
MAX_FIRST_SAMPLE = 48_000 * 3600
WORD_BYTES = 64


class WirePhone(NamedTuple):
    """One phone as it is sent: the checksum covers the label and the whole microseconds."""

    label: str
    """Label in the utterance's phone set."""
    start_us: int
    """Start, from the beginning of the utterance."""
    duration_us: int
    flags: int = 0
    weight: float = 1.0
    """A weight of 0 silences the phone."""


class WireWord(NamedTuple):
    """One word as it is sent."""

    text: str
    start_us: int
    """Start, from the beginning of the utterance."""
    duration_us: int


class Message:
    """A message: its OSC address, and the type tags of its fields."""

    __slots__ = ()
    ADDRESS: ClassVar[str]
    TAGS: ClassVar[str]

    def __init_subclass__(cls, *, address: str = "", tags: str = "") -> None:
        if address:  # not so when a dataclass makes the class again, with slots
            cls.ADDRESS, cls.TAGS = address, tags


@dataclass(frozen=True, slots=True)
class OfSession(Message):
    """A message that names its session first."""

    session: str


@dataclass(frozen=True, slots=True)
class OfUtterance(OfSession):
    """A message that names its utterance next, in the sender's numbering."""

    utterance: int


@dataclass(frozen=True, slots=True)
class Hello(OfSession, address="/fap/1/hello", tags="sissisii"):
    """Open or join a session; the engine answers with :class:`Welcome`."""

    protocol: int = PROTOCOL
    phone_set: str = ""
    language: str = ""
    flags: int = 0
    token: str = ""
    instance: int = 0
    """A new value means that the sender was restarted: its utterances are cancelled. 0 is not compared."""
    cookie: int = 0
    """Number from the welcome: proves that the sender receives at the address of its packets."""


@dataclass(frozen=True, slots=True)
class Welcome(OfSession, address="/fap/1/welcome", tags="shiiiii"):
    """Answer to a hello: the engine's clock and limits."""

    engine_us: int
    """The engine's clock."""
    lookahead_us: int = 0
    """Time before they are heard at which phones should arrive for the best animation."""
    max_datagram: int = MAX_DATAGRAM
    max_utterances: int = 0
    """Utterances that may be queued."""
    instance: int = 0
    """A new value means that the engine was restarted and has no state."""
    cookie: int = 0
    """Number to return in another hello; until then the engine limits its answers. 0: not needed."""


@dataclass(frozen=True, slots=True)
class Moved(OfSession, address="/fap/1/moved", tags="ssii"):
    """Answer to a hello: the session is on another port. Send a hello and everything else there."""

    host: str
    """Empty: the same host."""
    port: int
    instance: int
    """The instance of the hello, so that nobody else can redirect a sender."""


@dataclass(frozen=True, slots=True)
class Bye(OfSession, address="/fap/1/bye", tags="s"):
    """Leave the session: its utterances are cancelled."""


@dataclass(frozen=True, slots=True)
class Ping(Message, address="/fap/1/ping", tags="ihhfi"):
    """Ask for the engine's clock, and report the current estimate of it."""

    number: int
    sent_us: int
    """The sender's clock."""
    offset_us: int = 0
    """Engine's clock minus sender's, as estimated now; valid if ``rtt_us`` is given."""
    skew_ppm: float = 0.0
    """Rate at which the engine's clock gains on the sender's."""
    rtt_us: int = -1
    """Round trip of the ping from which the offset comes."""


@dataclass(frozen=True, slots=True)
class Pong(Message, address="/fap/1/pong", tags="ihhhi"):
    """Answer to a ping: three of the four time stamps; the fourth is its arrival."""

    number: int
    sent_us: int
    received_us: int
    """The engine's clock, as in the next field."""
    answered_us: int
    instance: int = 0


@dataclass(frozen=True, slots=True)
class BeginUtterance(OfUtterance, address=commands.Begin.SPEC.osc, tags="siishss"):
    """Begin an utterance."""

    revision: int = 0
    anchor: str = "now"
    """``now``, ``at``, ``audio``; or ``sound``: the recognizer sets the start, from the audio that is sent."""
    anchor_us: int = 0
    """Start for ``at``, on the sender's clock."""
    phone_set: str = ""
    language: str = ""


@dataclass(frozen=True, slots=True)
class Phones(OfUtterance, address=commands.Append.SPEC.osc, tags="siiii"):
    """Phones of an utterance, by index. On the wire: their count, 5 arguments per phone, the revision."""

    ROW: ClassVar[type[WirePhone]] = WirePhone
    ROW_TAGS: ClassVar[str] = "siiif"
    LAST_TAG: ClassVar[str] = "i"
    MAX_ROWS: ClassVar[int] = 256
    sequence: int
    """Number of the sender's datagram in this utterance; gaps are lost datagrams."""
    first_index: int
    phones: tuple[WirePhone, ...]
    revision: int | None = None
    """None: the revision of the last begin."""


@dataclass(frozen=True, slots=True)
class WordTimes(OfUtterance, address="/fap/1/words", tags="siii"):
    """Words of an utterance, by index; the server finds their phones. On the wire: count, words, voice."""

    ROW: ClassVar[type[WireWord]] = WireWord
    ROW_TAGS: ClassVar[str] = "sii"
    LAST_TAG: ClassVar[str] = "s"
    MAX_ROWS: ClassVar[int] = 64
    first_index: int
    words: tuple[WireWord, ...]
    voice: str = ""
    """Language; empty: that of the server's voice."""


@dataclass(frozen=True, slots=True)
class EndUtterance(OfUtterance, address=commands.End.SPEC.osc, tags="siiiii"):
    """End of an utterance, with what the engine needs to check that it is complete."""

    phone_count: int
    duration_us: int = -1
    """-1: until the end of the last phone."""
    checksum: int = 0
    """:func:`checksum` of all phones as a signed int32; 0: not checked."""
    revision: int = -1
    """-1: the revision of the last begin."""


@dataclass(frozen=True, slots=True)
class CancelUtterance(OfSession, address=commands.Cancel.SPEC.osc, tags="siiiii"):
    """Stop speaking."""

    utterance: int = NOW
    """-1: all."""
    at_us: int = NOW
    """Time in the utterance; -1: at once."""
    fade_ms: int = 200
    below: int = -1
    """Number below which utterances are cancelled, so that a repeat does not stop later ones. -1: all."""
    number: int = 0
    """Number of this cancel: the same number again is a repeat. 0: the same cancel within 0.25 s is a repeat."""


@dataclass(frozen=True, slots=True)
class SeekUtterance(OfUtterance, address=commands.Seek.SPEC.osc, tags="sii"):
    """Continue from another position."""

    position_us: int


@dataclass(frozen=True, slots=True)
class AudioPosition(OfUtterance, address=commands.Audio.SPEC.osc, tags="sihif"):
    """Position of the audio."""

    sender_us: int
    """Time on the sender's clock."""
    position_us: int
    rate: float = 1.0
    """0: the audio is paused."""


@dataclass(frozen=True, slots=True)
class Sound(OfUtterance, address="/fap/1/sound", tags="siiib"):
    """Audio of an utterance; the recognizer finds its phones."""

    first_sample: int
    """Index of its first sample in the utterance."""
    rate_hz: int
    """The same for a whole utterance."""
    samples: bytes
    """int16, little-endian, mono."""


@dataclass(frozen=True, slots=True)
class SpeakText(OfSession, address="/fap/1/text", tags="sss"):
    """Text that the server's voice is to speak."""

    text: str
    voice: str = ""


@dataclass(frozen=True, slots=True)
class Ack(OfUtterance, address="/fap/1/ack", tags="siihiii"):
    """The part of an utterance that has arrived."""

    next_index: int
    """All phones, or words, below this index have arrived."""
    bitmap64: int
    """Bit n, from the least significant: phone ``next_index + 1 + n`` has arrived."""
    slack_us: int = 0
    """Time by which the latest phones came early; negative: late."""
    is_ended: int = 0
    """1: its end has arrived."""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Nack(OfUtterance, address="/fap/1/nack", tags="siii"):
    """Request for missing phones."""

    first: int
    stop: int
    """Index after the last missing phone."""


@dataclass(frozen=True, slots=True)
class Notice(OfUtterance, address="/fap/1/event", tags="sisiihs"):
    """Event of an utterance; of the session, if its number is -1."""

    kind: str
    """``started``, ``underrun``, ``late``, ``concealed``, ``finished``, ``cancelled``, ``error``, ``remark``
    (what looks wrong in the phones: ``reason``), or ``unknown``: the session or utterance is not known here, begin it
    again."""
    position_us: int = 0
    """Position in the utterance."""
    count: int = 1
    """Number of phones, for ``late`` and ``concealed``."""
    engine_us: int = 0
    """The engine's clock."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class SessionCommand(OfSession):
    """A command whose arguments are its fields."""

    command: Command
    """Its times count from the arrival."""


Described = (
    Hello | Bye | Ping | BeginUtterance | Phones | EndUtterance | CancelUtterance | SeekUtterance | AudioPosition
    | Sound | SpeakText | WordTimes
)  # fmt: skip
"""Messages from a sender that are described here."""
FromSender = Described | SessionCommand
FromEngine = Welcome | Moved | Pong | Ack | Nack | Notice
Wire = FromSender | FromEngine
Kind = type[Described] | type[FromEngine] | type[Command]
"""A class that describes a message."""

FROM_ENGINE: dict[str, Kind] = {kind.ADDRESS: kind for kind in get_args(FromEngine)}


@cache
def from_sender() -> dict[str, Kind]:
    """Return the class of each address that senders use."""
    described: dict[str, Kind] = {kind.ADDRESS: kind for kind in get_args(Described)}
    return described | {kind.SPEC.osc: kind for kind in commands.COMMANDS if kind.SPEC.is_direct}


def checksum(phones: Iterable[WirePhone]) -> int:
    """CRC-32 (zlib) as a signed int32 over all phones in order: label in UTF-8, NUL, start, duration (big-endian).

    Examples
    --------
    >>> checksum([WirePhone("m", 0, 80_000), WirePhone("a", 80_000, 120_000)])
    -1866647319
    """
    crc = 0
    for phone in phones:
        crc = zlib.crc32(phone.label.encode() + b"\0" + struct.pack(">ii", phone.start_us, phone.duration_us), crc)
    return crc - (1 << 32) if crc >= 1 << 31 else crc


def runs(indices: Iterable[int]) -> list[tuple[int, int]]:
    """Group rising indices into runs: first index, index after the last.

    Examples
    --------
    >>> runs([0, 1, 2, 5])
    [(0, 3), (5, 6)]
    """
    found: list[tuple[int, int]] = []
    for index in indices:
        if found and found[-1][1] == index:
            found[-1] = (found[-1][0], index + 1)
        else:
            found.append((index, index + 1))
    return found


def check_session(session: str) -> str:
    """Return the name of a session. Raises UsageError if it is empty or too long."""
    if not 1 <= len(session.encode()) <= SESSION_BYTES:
        raise UsageError(f"session: got {session!r:.50}, expected 1 to {SESSION_BYTES} bytes")
    return session
