"""Messages of the robust mode, ``/fap/1/...``, as values.

One class a message; its fields are the arguments, in order. ``TAGS`` gives the types that are sent, the first
``REQUIRED`` of them are needed to understand the message; the rest has defaults. Times are integers in microseconds.
:mod:`.codec` writes and reads them.

Commands that are the same for every sender have no class here: :class:`SessionCommand` carries them, and
:mod:`fapengine.engine.commands` describes their arguments. What has a class here speaks of one sender's
utterances, in its numbers and on its clock, or is part of the protocol itself.
"""

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal, get_args

from fapengine.engine import commands
from fapengine.engine.command_table import Command
from fapengine.errors import UsageError

PROTOCOL = 1
MAX_DATAGRAM = 1200
"""Bytes; passes any path of the internet in one piece."""
SESSION_BYTES = 32
LABEL_BYTES = 15
"""Bytes of a phone's label. A longer one is shown as unknown."""
TEXT_BYTES = 4000
MAX_PHONES = 256
"""Phones in one message."""
MAX_DURATION_US = 3_600_000_000 // 2
"""Half an hour; times of an utterance lie in it. (An int32 of microseconds ends at 35 minutes.)"""
NOW = -1
"""Number that means, as a time: at once; as an utterance: all."""

WireAnchor = Literal["now", "at", "audio", "sound"]
"""Ways in which the beginning of an utterance is set."""
WANT_ACK, TCP, WILL_SEND_AUDIO, FOLLOWS = 1, 2, 4, 8
"""Flags of :class:`Hello`."""
PRIMARY_STRESS, SECONDARY_STRESS, WORD_INITIAL, PHRASE_FINAL = 1, 2, 4, 8
"""Flags of :class:`WirePhone`."""
MAX_SAMPLES = 480
"""Samples in one message: 30 ms at 16 kHz, and room for a begin beside them in a datagram."""
MAX_FIRST_SAMPLE = 48_000 * 3600
PHONE_TAGS = "siiif"
"""Type tags of each phone, behind those of :class:`Phones`."""
MAX_WORDS = 64
"""Words in one message."""
WORD_BYTES = 64
WORD_TAGS = "sii"
"""Type tags of each word, behind those of :class:`WordTimes`."""


@dataclass(frozen=True, slots=True)
class WirePhone:
    """One phone as it is sent."""

    label: str
    """Label in the utterance's phone set."""
    start_us: int
    """Start from the utterance's beginning."""
    duration_us: int
    flags: int = 0
    weight: float = 1.0
    """0 silences it."""


@dataclass(frozen=True, slots=True)
class Hello:
    """Open or join a session; answered by :class:`Welcome`."""

    ADDRESS: ClassVar[str] = "/fap/1/hello"
    TAGS: ClassVar[str] = "sissisii"
    REQUIRED: ClassVar[int] = 1
    session: str
    protocol: int = PROTOCOL
    phone_set: str = ""
    language: str = ""
    flags: int = 0
    token: str = ""
    instance: int = 0
    """Another one than before: the sender was restarted, and what it had begun is cancelled. 0 is not compared."""
    cookie: int = 0
    """Number that the welcome told: the sender really is where its packets say that they come from."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """What the engine is and takes."""

    ADDRESS: ClassVar[str] = "/fap/1/welcome"
    TAGS: ClassVar[str] = "shiiiii"
    REQUIRED: ClassVar[int] = 2
    session: str
    engine_us: int
    """The engine's clock."""
    lookahead_us: int = 0
    """Lead at which phones should come for the face to be at its best."""
    max_datagram: int = MAX_DATAGRAM
    max_utterances: int = 0
    """Queued at once."""
    instance: int = 0
    """Another one than before: the engine was restarted and knows nothing."""
    cookie: int = 0
    """Number to be said in another hello; until then little is answered. 0: nothing is asked."""


@dataclass(frozen=True, slots=True)
class Moved:
    """Answer to a hello: the session is elsewhere; greet there, and tell everything there."""

    ADDRESS: ClassVar[str] = "/fap/1/moved"
    TAGS: ClassVar[str] = "ssii"
    REQUIRED: ClassVar[int] = 4
    session: str
    host: str
    """Empty: the same host."""
    port: int
    instance: int
    """The instance of the hello, so that nobody else can send a sender away."""


@dataclass(frozen=True, slots=True)
class Bye:
    """Leave the session: what is being said is cancelled."""

    ADDRESS: ClassVar[str] = "/fap/1/bye"
    TAGS: ClassVar[str] = "s"
    REQUIRED: ClassVar[int] = 1
    session: str


@dataclass(frozen=True, slots=True)
class Ping:
    """Ask for the engine's clock; tell what was found out about it."""

    ADDRESS: ClassVar[str] = "/fap/1/ping"
    TAGS: ClassVar[str] = "ihhfi"
    REQUIRED: ClassVar[int] = 2
    number: int
    sent_us: int
    """The sender's clock."""
    offset_us: int = 0
    """Engine's clock minus sender's, as known now; counts if ``rtt_us`` is given."""
    skew_ppm: float = 0.0
    """Rate at which the engine's clock gains on the sender's."""
    rtt_us: int = -1
    """Round trip of the ping that the offset comes from."""


@dataclass(frozen=True, slots=True)
class Pong:
    """Four time stamps, with the one at which it comes back."""

    ADDRESS: ClassVar[str] = "/fap/1/pong"
    TAGS: ClassVar[str] = "ihhhi"
    REQUIRED: ClassVar[int] = 4
    number: int
    sent_us: int
    received_us: int
    """The engine's clock, as the next."""
    answered_us: int
    instance: int = 0


@dataclass(frozen=True, slots=True)
class BeginUtterance:
    """Open an utterance."""

    ADDRESS: ClassVar[str] = commands.Begin.SPEC.osc
    TAGS: ClassVar[str] = "siishss"
    REQUIRED: ClassVar[int] = 2
    session: str
    utterance: int
    revision: int = 0
    anchor: str = "now"
    """``now``, ``at`` or ``audio``; ``sound``: the engine's ear says when, for its sound comes."""
    anchor_us: int = 0
    """Start for ``at``, in the sender's clock."""
    phone_set: str = ""
    language: str = ""


@dataclass(frozen=True, slots=True)
class Phones:
    """Phones of an utterance, by index. On the wire, their count and 5 arguments each stand before the revision."""

    ADDRESS: ClassVar[str] = commands.Append.SPEC.osc
    TAGS: ClassVar[str] = "siiii"
    REQUIRED: ClassVar[int] = 5
    session: str
    utterance: int
    sequence: int
    """Number of the sender's datagram in this utterance: shows what was lost."""
    first_index: int
    phones: tuple[WirePhone, ...]
    revision: int | None = None
    """None: that of the last begin."""


@dataclass(frozen=True, slots=True)
class WireWord:
    """One word as it is sent."""

    text: str
    start_us: int
    """Start from the utterance's beginning."""
    duration_us: int


@dataclass(frozen=True, slots=True)
class WordTimes:
    """Words of an utterance, by index, whose phones the server finds. On the wire, count and words before the voice."""

    ADDRESS: ClassVar[str] = "/fap/1/words"
    TAGS: ClassVar[str] = "siii"
    REQUIRED: ClassVar[int] = 4
    session: str
    utterance: int
    first_index: int
    words: tuple[WireWord, ...]
    voice: str = ""
    """Language; empty: the server's voice."""


@dataclass(frozen=True, slots=True)
class EndUtterance:
    """Say that an utterance is complete, and let that be checked."""

    ADDRESS: ClassVar[str] = commands.End.SPEC.osc
    TAGS: ClassVar[str] = "siiiii"
    REQUIRED: ClassVar[int] = 3
    session: str
    utterance: int
    phone_count: int
    duration_us: int = -1
    """-1: to the end of the last phone."""
    checksum: int = 0
    """:func:`checksum` of all phones as a signed int32; 0: not checked."""
    revision: int = -1
    """-1: that of the last begin."""


@dataclass(frozen=True, slots=True)
class CancelUtterance:
    """Stop speaking."""

    ADDRESS: ClassVar[str] = commands.Cancel.SPEC.osc
    TAGS: ClassVar[str] = "siiiii"
    REQUIRED: ClassVar[int] = 1
    session: str
    utterance: int = NOW
    """-1: all."""
    at_us: int = NOW
    """Moment in the utterance's time; -1: at once."""
    fade_ms: int = 200
    below: int = -1
    """Number below which utterances are cancelled: a repeat does not stop what was begun meanwhile. -1: all."""
    number: int = 0
    """Number of this cancel: the same again is a repeat. 0: what comes again within 0.25 s is a repeat."""


@dataclass(frozen=True, slots=True)
class SeekUtterance:
    """Go on from another place."""

    ADDRESS: ClassVar[str] = commands.Seek.SPEC.osc
    TAGS: ClassVar[str] = "sii"
    REQUIRED: ClassVar[int] = 3
    session: str
    utterance: int
    position_us: int


@dataclass(frozen=True, slots=True)
class AudioPosition:
    """Where the sound is."""

    ADDRESS: ClassVar[str] = commands.Audio.SPEC.osc
    TAGS: ClassVar[str] = "sihif"
    REQUIRED: ClassVar[int] = 4
    session: str
    utterance: int
    sender_us: int
    """Moment in the sender's clock."""
    position_us: int
    rate: float = 1.0
    """0: it stands still."""


@dataclass(frozen=True, slots=True)
class Sound:
    """Sound of an utterance, whose phones an ear finds."""

    ADDRESS: ClassVar[str] = "/fap/1/sound"
    TAGS: ClassVar[str] = "siiib"
    REQUIRED: ClassVar[int] = 5
    session: str
    utterance: int
    first_sample: int
    """Number of its first sample in the utterance."""
    rate_hz: int
    """The same in all of an utterance."""
    samples: bytes
    """int16, little-endian, mono."""


@dataclass(frozen=True, slots=True)
class SpeakText:
    """Have a text spoken by the server's voice."""

    ADDRESS: ClassVar[str] = "/fap/1/text"
    TAGS: ClassVar[str] = "sss"
    REQUIRED: ClassVar[int] = 2
    session: str
    text: str
    voice: str = ""


@dataclass(frozen=True, slots=True)
class Ack:
    """What has come of an utterance."""

    ADDRESS: ClassVar[str] = "/fap/1/ack"
    TAGS: ClassVar[str] = "siihiii"
    REQUIRED: ClassVar[int] = 4
    session: str
    utterance: int
    next_index: int
    """All phones, or words, below it are there."""
    bitmap64: int
    """Bit n, counted from the least: phone ``next_index + 1 + n`` is there."""
    slack_us: int = 0
    """Lead of the phones that came last; negative: late."""
    is_ended: int = 0
    """1: its end is known."""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Nack:
    """What is missing."""

    ADDRESS: ClassVar[str] = "/fap/1/nack"
    TAGS: ClassVar[str] = "siii"
    REQUIRED: ClassVar[int] = 4
    session: str
    utterance: int
    first: int
    stop: int
    """Behind the last that is missing."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something happened."""

    ADDRESS: ClassVar[str] = "/fap/1/event"
    TAGS: ClassVar[str] = "sisiihs"
    REQUIRED: ClassVar[int] = 3
    session: str
    utterance: int
    """-1: of none."""
    kind: str
    """``started``, ``underrun``, ``late``, ``concealed``, ``finished``, ``cancelled``, ``error``, or ``unknown``:
    the session or utterance was never begun here, begin again."""
    position_us: int = 0
    """Position in the utterance's time."""
    count: int = 1
    """Number of phones, for ``late`` and ``concealed``."""
    engine_us: int = 0
    """The engine's clock."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class SessionCommand:
    """A command whose arguments are its fields."""

    session: str
    command: Command
    """Command; its times count from the arrival."""


Described = (
    Hello | Bye | Ping | BeginUtterance | Phones | EndUtterance | CancelUtterance | SeekUtterance | AudioPosition
    | Sound | SpeakText | WordTimes
)  # fmt: skip
"""Messages of a sender that are described here."""
FromSender = Described | SessionCommand
FromEngine = Welcome | Moved | Pong | Ack | Nack | Notice
Wire = FromSender | FromEngine
Kind = type[Described] | type[FromEngine] | type[Command]
"""Class that describes a message."""

FROM_ENGINE: dict[str, Kind] = {kind.ADDRESS: kind for kind in get_args(FromEngine)}
_FROM_SENDER: dict[str, Kind] = {kind.ADDRESS: kind for kind in get_args(Described)}


def from_sender() -> dict[str, Kind]:
    """Give the class of each address that senders use."""
    return _from_sender(commands.COMMANDS)


@lru_cache(maxsize=4)
def _from_sender(listed: tuple[type[Command], ...]) -> dict[str, Kind]:
    return {**_FROM_SENDER, **{kind.SPEC.osc: kind for kind in listed if kind.SPEC.is_direct}}


def checksum(phones: Iterable[WirePhone]) -> int:
    """CRC-32 (zlib) as a signed int32: of each phone in order, label in UTF-8, NUL, start and duration, big-endian.

    Examples
    --------
    >>> checksum([WirePhone("m", 0, 80_000), WirePhone("a", 80_000, 120_000)])
    -1866647319
    """
    crc = 0
    for phone in phones:
        crc = zlib.crc32(phone.label.encode() + b"\0" + struct.pack(">ii", phone.start_us, phone.duration_us), crc)
    return crc - (1 << 32) if crc >= 1 << 31 else crc


def check_session(session: str) -> str:
    """Return the name of a session.

    Raises
    ------
    UsageError
        If it is empty or too long.
    """
    if not 1 <= len(session.encode()) <= SESSION_BYTES:
        raise UsageError(f"session: got {session!r:.50}, expected 1..{SESSION_BYTES} bytes")
    return session
