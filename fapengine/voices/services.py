"""Messages of voice services: requests for a text, and answers as pieces of audio with times; whole utterances.

Nothing here opens a connection: :mod:`.service_client` does, or the user's own code. Messages as of 2026-11:

ElevenLabs, ``stream-input``
    ``{"audio", "isFinal", "alignment": {"chars", "charStartTimesMs", "charDurationsMs"}, "normalizedAlignment"}``;
    times from the first sample of the message's own sound. What was spoken (numbers in words) is the normalized one.
Cartesia, ``tts/websocket``
    ``{"type": "chunk", "data"}``, ``timestamps`` with ``word_timestamps``, ``phoneme_timestamps`` (IPA), ``done``,
    ``error``; times from the first sample of the context.
Inworld, ``voice:stream``
    a line of JSON each: ``{"result": {"audioContent", "timestampInfo": {"wordAlignment": {"words",
    "wordStartTimeSeconds", "wordEndTimeSeconds", "phoneticDetails": [{"phones": [{"phoneSymbol", "startTimeSeconds",
    "durationSeconds"}]}]}}}}``.
Fish, ``tts/live``
    MessagePack: ``{"event": "audio", "audio", "chunk_audio_offset_sec", "alignment": {"segments": [{"text", "start",
    "end"}]}}`` and ``{"event": "finish", "reason"}``; times of a segment from its chunk's offset.
Azure, Speech SDK
    callbacks: ``viseme_received`` (offset in ticks of 100 ns, id 0 to 21) and ``synthesizing``.

Sources: the services' documentation and SDKs; none of the services was called. Times and labels are read as in
:mod:`fapengine.speech.formats.services`.
"""

import base64
import binascii
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar
from urllib.parse import quote

import msgspec
import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.speech.alphabets.convert import to_ipa
from fapengine.speech.formats.documents import Node
from fapengine.speech.formats.entries import Entry, track_of, until_next, with_words
from fapengine.speech.formats.services import (
    TICKS_HZ,
    characters_of,
    fish_words,
    inworld_phones,
    inworld_words,
    timed,
    words_of,
)
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.protocol import Speech

RATE_HZ = 24_000
MAX_S = 3600.0
"""Longest audio of one utterance; more is refused."""
WAV_HEAD_BYTES = 44


@dataclass(frozen=True, slots=True)
class Piece:
    """Audio, and the words and phones that became known with it."""

    samples: NDArray[np.int16]
    """(N,) int16, mono; the next samples, possibly none."""
    rate_hz: int
    words: tuple[Entry, ...] = ()
    """Times in s from the first sample of the utterance."""
    phones: tuple[Entry, ...] = ()
    """IPA; times likewise."""


@dataclass(slots=True)
class Gathered:
    """The pieces of one utterance. Stateful."""

    most_s: float = MAX_S
    """Longest audio in s; more is refused."""
    sound: list[NDArray[np.int16]] = field(default_factory=list)
    words: list[Entry] = field(default_factory=list)
    phones: list[Entry] = field(default_factory=list)
    rate_hz: int = 0
    _samples: int = 0

    @property
    def duration_s(self) -> float:
        """Length of the audio so far."""
        return self._samples / self.rate_hz if self.rate_hz else 0.0

    def add(self, piece: Piece) -> None:
        """Add a piece."""
        if self.rate_hz not in (0, piece.rate_hz):
            raise DataError(f"sound: got {piece.rate_hz} Hz after {self.rate_hz} Hz, expected one rate")
        self.rate_hz = piece.rate_hz
        self.sound.append(piece.samples)
        self._samples += len(piece.samples)
        if self.duration_s > self.most_s:
            raise DataError(f"sound: got more than {self.most_s:g} s in one utterance")
        self.words += piece.words
        self.phones += piece.phones

    def speech(self, pronounce: Callable[[PhoneTrack], PhoneTrack]) -> Speech:
        """Make the whole utterance.

        Parameters
        ----------
        pronounce : callable
            Turns written words with times into phones; used if the service gave no phones.
        """
        if not self._samples:
            raise DataError("voice: sent no sound")
        if self.phones:
            track = track_of(with_words(_ordered(self.phones), _ordered(self.words)), "voice", alphabet="ipa")
        elif self.words:
            track = pronounce(track_of(_ordered(self.words), "voice", level="word", spelled=True))
        else:
            raise DataError("voice: got sound without times of words or phones")
        end_s = self.duration_s
        phones = [phone for phone in track.phones if phone.start_s < end_s]
        if phones and phones[-1].end_s < end_s:
            phones.append(Phone(SILENCE, phones[-1].end_s, end_s))
        whole = PhoneTrack.from_phones(phones, level=track.level, reading=track.reading)
        return Speech(samples=np.concatenate(self.sound), sample_rate_hz=self.rate_hz, phones=whole)


def _ordered(entries: Sequence[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: entry.start_s)


@dataclass(slots=True)
class Service(ABC):
    """One utterance of a voice service: its requests, and a reader of the answers. Stateful."""

    voice: str
    key: str
    model: str = ""
    base: str = ""
    over: bool = field(default=False, kw_only=True)
    """True once the last message was read."""
    _carried: bytes = field(default=b"", kw_only=True)
    path: ClassVar[str]
    """Of the address; ``{voice}`` and ``{model}`` stand for them."""
    fields: ClassVar[Mapping[str, str]]
    """Headers of the connection; ``{key}`` and ``{model}`` stand for them."""

    @property
    def url(self) -> str:
        """Address to connect to, or to post to."""
        return self.base + self.path.format(voice=quote(self.voice, safe=""), model=self.model)

    @property
    def headers(self) -> dict[str, str]:
        """Headers with the key."""
        return {name: text.format(key=self.key, model=self.model) for name, text in self.fields.items()}

    @abstractmethod
    def requests(self, text: str) -> list[str | bytes]:
        """Messages that ask for a text."""

    @abstractmethod
    def feed(self, message: str | bytes) -> Piece:
        """Read one answer."""

    def _sound(self, data: bytes) -> NDArray[np.int16]:
        """Read raw little-endian 16-bit audio, (N,) int16; an odd byte waits for the next."""
        whole = self._carried + data
        even = len(whole) // 2 * 2
        self._carried = whole[even:]
        return np.frombuffer(whole[:even], "<i2").astype(np.int16)


@dataclass(slots=True)
class ElevenLabs(Service):
    """ElevenLabs over WebSocket. Stateful."""

    model: str = "eleven_flash_v2_5"
    base: str = "wss://api.elevenlabs.io"
    _samples: int = 0
    _waiting: list[Entry] = field(default_factory=list)
    """Characters of a word that may go on in the next message."""

    path = (
        f"/v1/text-to-speech/{{voice}}/stream-input?model_id={{model}}&output_format=pcm_{RATE_HZ}&sync_alignment=true"
    )
    fields = MappingProxyType({"xi-api-key": "{key}"})

    def requests(self, text: str) -> list[str | bytes]:
        """Return the messages that begin, speak and end."""
        messages = ({"text": " "}, {"text": f"{check_text(text)} ", "flush": True}, {"text": ""})
        return [json.dumps(message) for message in messages]

    def feed(self, message: str | bytes) -> Piece:
        """Read one message."""
        node = _json(message, "ElevenLabs")
        if node.has("error"):
            raise ResourceError(f"ElevenLabs: {node.first('message', 'error').text()[:200]}")
        before_s = self._samples / RATE_HZ
        samples = self._sound(_base64(node["audio"]) if node.has("audio") else b"")
        self._samples += len(samples)
        characters = self._waiting
        if node.has("normalizedAlignment") or node.has("alignment"):
            aligned = node.first("normalizedAlignment", "alignment")
            characters = [*characters, *_checked(characters_of(aligned), before_s)]
        self.over = self.over or (node.has("isFinal") and node["isFinal"].value is True)
        blanks = [index for index, each in enumerate(characters, start=1) if each.label.isspace()]
        ends = len(characters) if self.over else max(blanks, default=0)
        self._waiting = characters[ends:]
        return Piece(samples, RATE_HZ, words=tuple(words_of(characters[:ends])))


@dataclass(slots=True)
class Cartesia(Service):
    """Cartesia over WebSocket. Stateful."""

    model: str = "sonic-3"
    base: str = "wss://api.cartesia.ai"
    context: str = "fapengine"
    path = "/tts/websocket?cartesia_version=2025-04-16"
    fields = MappingProxyType({"X-API-Key": "{key}"})

    def requests(self, text: str) -> list[str | bytes]:
        """Ask for sound with the times of words and phones."""
        output = {"container": "raw", "encoding": "pcm_s16le", "sample_rate": RATE_HZ}
        return [json.dumps({
            "model_id": self.model, "transcript": check_text(text), "voice": {"mode": "id", "id": self.voice},
            "output_format": output, "context_id": self.context, "continue": False, "add_timestamps": True,
            "add_phoneme_timestamps": True,
        })]  # fmt: skip

    def feed(self, message: str | bytes) -> Piece:
        """Read one message."""
        node = _json(message, "Cartesia")
        kind = node["type"].text()
        if kind == "error":
            raise ResourceError(f"Cartesia: {node.first('error', 'message').text()[:200]}")
        self.over = self.over or kind == "done"
        samples = self._sound(_base64(node["data"]) if kind == "chunk" else b"")
        words, phones = (
            _checked(timed(node[key], texts)) if node.has(key) else ()
            for key, texts in (("word_timestamps", "words"), ("phoneme_timestamps", "phonemes"))
        )
        return Piece(samples, RATE_HZ, words, phones)


@dataclass(slots=True)
class Inworld(Service):
    """Inworld over HTTP, a line of JSON an answer. Stateful."""

    model: str = "inworld-tts-1.5-max"
    base: str = "https://api.inworld.ai"

    path = "/tts/v1/voice:stream"
    fields = MappingProxyType({"Authorization": "Basic {key}", "Content-Type": "application/json"})

    def requests(self, text: str) -> list[str | bytes]:
        """Ask for sound with the times of words and phones."""
        return [json.dumps({
            "text": check_text(text), "voiceId": self.voice, "modelId": self.model, "timestampType": "WORD",
            "audioConfig": {"audioEncoding": "LINEAR16", "sampleRateHertz": RATE_HZ},
        })]  # fmt: skip

    def feed(self, message: str | bytes) -> Piece:
        """Read one line."""
        node = _json(message, "Inworld")
        if node.has("error"):
            raise ResourceError(f"Inworld: {node['error'].first('message', 'code').value!s:.200}")
        result = node["result"]
        data = _base64(result["audioContent"]) if result.has("audioContent") else b""
        samples = self._sound(data[WAV_HEAD_BYTES:] if data[:4] == b"RIFF" else data)
        if not (result.has("timestampInfo") and result["timestampInfo"].has("wordAlignment")):
            return Piece(samples, RATE_HZ)
        aligned = result["timestampInfo"]["wordAlignment"]
        return Piece(samples, RATE_HZ, _checked(inworld_words(aligned)), _checked(inworld_phones(aligned)))


@dataclass(slots=True)
class Fish(Service):
    """Fish Audio over WebSocket, in MessagePack. Stateful."""

    model: str = "s1"
    base: str = "wss://api.fish.audio"

    path = "/v1/tts/live/with-timestamp"
    fields = MappingProxyType({"Authorization": "Bearer {key}", "model": "{model}"})

    def requests(self, text: str) -> list[str | bytes]:
        """Return the messages that begin, speak and end."""
        audio = {"format": "pcm", "sample_rate": RATE_HZ, "latency": "balanced"}
        request = {"text": "", "reference_id": self.voice, **audio}
        events: tuple[dict[str, Any], ...] = (
            {"event": "start", "request": request}, {"event": "text", "text": f"{check_text(text)} "},
            {"event": "flush"}, {"event": "stop"},
        )  # fmt: skip
        return [msgspec.msgpack.encode(event) for event in events]

    def feed(self, message: str | bytes) -> Piece:
        """Read one event."""
        try:
            node = Node(msgspec.msgpack.decode(message.encode() if isinstance(message, str) else message))
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise DataError(f"Fish: no MessagePack here ({error})") from error
        kind = node["event"].text()
        if kind == "finish":
            self.over = True
            if node.has("reason") and node["reason"].value == "error":
                raise ResourceError("Fish: the voice ended with an error")
        data = node["audio"].value if kind == "audio" and node.has("audio") else b""
        if not isinstance(data, bytes):
            raise DataError(f"Fish: got {ascii(data)[:40]}, expected bytes of sound", where="audio")
        samples = self._sound(data)
        has_words = node.has("alignment") and node["alignment"].has("segments")
        words = _checked(fish_words(node)) if has_words else ()
        return Piece(samples, RATE_HZ, tuple(word for word in words if any(map(str.isalnum, word.label))))


@dataclass(slots=True)
class AzureEvents:
    """Azure's Speech SDK: pass the values of its callbacks to :meth:`viseme` and :meth:`sound`. Stateful.

    Examples
    --------
    >>> events = AzureEvents(16_000)
    >>> events.viseme(500_000, 21), events.viseme(1_500_000, 2)
    (None, None)
    >>> piece = events.piece(end=True)
    >>> [(phone.label, round(phone.start_s, 2), round(phone.end_s, 2)) for phone in piece.phones]
    [('p', 0.05, 0.15), ('ɑ', 0.15, 0.25)]
    """

    rate_hz: int
    _data: bytes = b""
    _onsets: list[tuple[float, str, str]] = field(default_factory=list)

    def viseme(self, audio_offset: int, viseme_id: int) -> None:
        """Add a ``viseme_received`` event."""
        start_s = audio_offset / TICKS_HZ
        if not 0 <= viseme_id <= 21 or (self._onsets and start_s < self._onsets[-1][0]):
            raise DataError(f"Azure: got viseme {viseme_id} at {start_s} s, expected 0 to 21 in the order of time")
        self._onsets.append((start_s, to_ipa(str(viseme_id), "azure-visemes")[0], "viseme"))

    def sound(self, data: bytes) -> None:
        """Add raw 16-bit audio."""
        self._data += data

    def piece(self, *, end: bool = False) -> Piece:
        """Return what came since the last call; a viseme lasts until the next one, the last one 0.1 s."""
        even = len(self._data) // 2 * 2
        samples, self._data = np.frombuffer(self._data[:even], "<i2").astype(np.int16), self._data[even:]
        phones = until_next(self._onsets)[: None if end else -1]
        self._onsets = self._onsets[len(phones) :]
        return Piece(samples, self.rate_hz, phones=_checked(phones))


def _checked(entries: Iterable[Entry], shift_s: float = 0.0) -> tuple[Entry, ...]:
    """Check the times of a service, moved by ``shift_s``."""
    found: list[Entry] = []
    for each in entries:
        start_s, end_s = each.start_s + shift_s, each.end_s + shift_s
        if not (math.isfinite(start_s) and math.isfinite(end_s) and -1.0 <= start_s <= end_s <= MAX_S):
            message = f"{each.label!r:.40}: got times {start_s} to {end_s}, expected 0 to {MAX_S:.0f} s"
            raise DataError(message, where=each.where)
        found.append(replace(each, start_s=max(start_s, 0.0), end_s=max(end_s, 0.0)))
    return tuple(found)


def check_text(text: str) -> str:
    """Refuse a text without anything to speak."""
    if not any(letter.isalnum() for letter in text):
        raise UsageError(f"text: {text!r:.40} contains nothing to speak")
    return text


def _json(message: str | bytes, what: str) -> Node:
    try:
        text = message if isinstance(message, str) else message.decode()
        return Node(json.loads(text))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{what}: invalid JSON ({error})") from error


def _base64(node: Node) -> bytes:
    try:
        return base64.b64decode(node.text(), validate=True)
    except (binascii.Error, ValueError) as error:
        raise DataError(f"not base64 ({error})", where=node.where) from error


SERVICES: dict[str, type[Service]] = {
    "elevenlabs": ElevenLabs, "cartesia": Cartesia, "inworld": Inworld, "fish": Fish,
}  # fmt: skip
"""Services of :mod:`.service_client`, by the name before the voice: ``cartesia:VOICE``."""
