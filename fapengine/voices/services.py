"""Messages of streaming voices, both ways: texts in, requests out; answers in, pieces of sound with times out.

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
    no messages but callbacks: ``viseme_received`` (offset in ticks of 100 ns, id 0 to 21) and ``synthesizing``.

Sources: the services' documentation and SDKs; none of them was reached from here.
"""

import base64
import binascii
import json
from dataclasses import dataclass, field
from typing import Any, Protocol
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError
from fapengine.speech.alphabets.convert import to_ipa
from fapengine.speech.formats.documents import Node, same_length
from fapengine.speech.formats.entries import Entry
from fapengine.speech.formats.services import words_of
from fapengine.voices.service_pieces import Piece, check_text, entry, pcm

RATE_HZ = 24_000
TICKS_HZ = 1e7
"""Ticks of Azure's offsets a second."""
WAV_HEAD_BYTES = 44


class Service(Protocol):
    """A voice service: what to send, and how to read what comes.

    Stateful: one utterance.
    """

    over: bool
    """True once the last message was read."""

    @property
    def url(self) -> str:
        """Address to connect to."""
        ...

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the connection, the key among them."""
        ...

    def requests(self, text: str) -> list[str | bytes]:
        """Messages that ask for a text."""
        ...

    def feed(self, message: str | bytes) -> Piece:
        """Read one answer."""
        ...


@dataclass(slots=True)
class _OneUtterance:
    """Shared by all services: the voice, the key, and sound that may be cut within a sample.

    Stateful.
    """

    voice: str
    key: str
    over: bool = field(default=False, kw_only=True)
    _carried: bytes = field(default=b"", kw_only=True)

    def _sound(self, data: bytes) -> NDArray[np.int16]:
        """Read raw 16-bit sound, (N,) int16; an odd byte waits for the next."""
        samples, self._carried = pcm(data, self._carried)
        return samples


@dataclass(slots=True)
class ElevenLabs(_OneUtterance):
    """ElevenLabs over WebSocket.

    Stateful.
    """

    model: str = "eleven_flash_v2_5"
    base: str = "wss://api.elevenlabs.io"
    _samples: int = 0
    _waiting: list[Entry] = field(default_factory=list)
    """Characters of a word that may go on in the next message."""

    @property
    def url(self) -> str:
        """Address with voice, model and the form of the sound."""
        query = f"model_id={self.model}&output_format=pcm_{RATE_HZ}&sync_alignment=true"
        return f"{self.base}/v1/text-to-speech/{quote(self.voice, safe='')}/stream-input?{query}"

    @property
    def headers(self) -> dict[str, str]:
        """Header with the key."""
        return {"xi-api-key": self.key}

    def requests(self, text: str) -> list[str | bytes]:
        """Begin, speak, end."""
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
        for name in ("normalizedAlignment", "alignment"):
            if node.has(name):
                characters = characters + _characters(node[name], before_s)
                break
        self.over = self.over or (node.has("isFinal") and node["isFinal"].value is True)
        ends = len(characters) if self.over else _last_break(characters)
        self._waiting = characters[ends:]
        return Piece(samples, RATE_HZ, words=tuple(words_of(characters[:ends])))


def _characters(node: Node, before_s: float) -> list[Entry]:
    starts, lengths, texts = (
        node["charStartTimesMs"].numbers(),
        node["charDurationsMs"].numbers(),
        node["chars"].texts(),
    )
    same_length(starts, lengths, texts, where=node.where)
    return [
        entry(before_s + start / 1000, before_s + (start + length) / 1000, text, node.where)
        for start, length, text in zip(starts, lengths, texts, strict=True)
    ]


def _last_break(characters: list[Entry]) -> int:
    """Count the characters up to the last that ends a word."""
    for index in range(len(characters) - 1, -1, -1):
        if characters[index].label.isspace():
            return index + 1
    return 0


@dataclass(slots=True)
class Cartesia(_OneUtterance):
    """Cartesia over WebSocket.

    Stateful.
    """

    model: str = "sonic-3"
    base: str = "wss://api.cartesia.ai"
    version: str = "2025-04-16"
    context: str = "fapengine"

    @property
    def url(self) -> str:
        """Address with the version of the protocol."""
        return f"{self.base}/tts/websocket?cartesia_version={self.version}"

    @property
    def headers(self) -> dict[str, str]:
        """Header with the key."""
        return {"X-API-Key": self.key}

    def requests(self, text: str) -> list[str | bytes]:
        """Ask for sound with the times of words and phones."""
        output = {"container": "raw", "encoding": "pcm_s16le", "sample_rate": RATE_HZ}
        return [json.dumps({
            "model_id": self.model, "transcript": check_text(text), "voice": {"mode": "id", "id": self.voice},
            "output_format": output, "context_id": self.context, "continue": False, "add_timestamps": True,
            "add_phoneme_timestamps": True,
        })]  # fmt: skip

    def cancel(self) -> str:
        """Message that ends the context: an interruption."""
        return json.dumps({"context_id": self.context, "cancel": True})

    def feed(self, message: str | bytes) -> Piece:
        """Read one message."""
        node = _json(message, "Cartesia")
        kind = node["type"].text()
        if kind == "error":
            raise ResourceError(f"Cartesia: {node.first('error', 'message').text()[:200]}")
        self.over = self.over or kind == "done"
        samples = self._sound(_base64(node["data"]) if kind == "chunk" else b"")
        words = _timed(node["word_timestamps"], "words") if node.has("word_timestamps") else ()
        phones = _timed(node["phoneme_timestamps"], "phonemes") if node.has("phoneme_timestamps") else ()
        return Piece(samples, RATE_HZ, words, phones)


def _timed(node: Node, texts: str, start: str = "start", end: str = "end") -> tuple[Entry, ...]:
    starts, ends, labels = node[start].numbers(), node[end].numbers(), node[texts].texts()
    same_length(starts, ends, labels, where=node.where)
    return tuple(entry(*row, node.where) for row in zip(starts, ends, labels, strict=True) if row[2].strip())


@dataclass(slots=True)
class Inworld(_OneUtterance):
    """Inworld over HTTP, a line of JSON an answer.

    Stateful.
    """

    model: str = "inworld-tts-1.5-max"
    base: str = "https://api.inworld.ai"

    @property
    def url(self) -> str:
        """Address that the text is posted to."""
        return f"{self.base}/tts/v1/voice:stream"

    @property
    def headers(self) -> dict[str, str]:
        """Header with the key."""
        return {"Authorization": f"Basic {self.key}", "Content-Type": "application/json"}

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
        samples = self._sound(_without_wav_head(data))
        words: tuple[Entry, ...] = ()
        phones: list[Entry] = []
        if result.has("timestampInfo") and result["timestampInfo"].has("wordAlignment"):
            aligned = result["timestampInfo"]["wordAlignment"]
            words = _timed(aligned, "words", "wordStartTimeSeconds", "wordEndTimeSeconds")
            for detail in aligned["phoneticDetails"].items() if aligned.has("phoneticDetails") else ():
                for phone in detail["phones"].items():
                    start_s = phone["startTimeSeconds"].number()
                    end_s = start_s + phone["durationSeconds"].number()
                    phones.append(entry(start_s, end_s, phone["phoneSymbol"].text(), phone.where))
        return Piece(samples, RATE_HZ, words, tuple(phones))


def _without_wav_head(data: bytes) -> bytes:
    """Remove the header of a piece of LINEAR16."""
    return data[WAV_HEAD_BYTES:] if data[:4] == b"RIFF" else data


@dataclass(slots=True)
class Fish(_OneUtterance):
    """Fish Audio over WebSocket, in MessagePack.

    Stateful.
    """

    model: str = "s1"
    base: str = "wss://api.fish.audio"

    @property
    def url(self) -> str:
        """Address of speech with times."""
        return f"{self.base}/v1/tts/live/with-timestamp"

    @property
    def headers(self) -> dict[str, str]:
        """Headers with key and model."""
        return {"Authorization": f"Bearer {self.key}", "model": self.model}

    def requests(self, text: str) -> list[str | bytes]:
        """Begin, speak, end."""
        request = {
            "text": "",
            "reference_id": self.voice,
            "format": "pcm",
            "sample_rate": RATE_HZ,
            "latency": "balanced",
        }
        events: tuple[dict[str, Any], ...] = (
            {"event": "start", "request": request}, {"event": "text", "text": f"{check_text(text)} "},
            {"event": "flush"}, {"event": "stop"},
        )  # fmt: skip
        pack = _msgpack()
        return [pack.encode(event) for event in events]

    def feed(self, message: str | bytes) -> Piece:
        """Read one event."""
        pack = _msgpack()
        try:
            value = pack.decode(message.encode() if isinstance(message, str) else message)
        except Exception as error:  # the library's own kinds
            raise DataError(f"Fish: no MessagePack here ({error})") from error
        node = Node(value)
        kind = node["event"].text()
        if kind == "finish":
            self.over = True
            if node.has("reason") and node["reason"].value == "error":
                raise ResourceError("Fish: the voice ended with an error")
        data = node["audio"].value if kind == "audio" and node.has("audio") else b""
        if not isinstance(data, bytes):
            raise DataError(f"Fish: got {ascii(data)[:40]}, expected bytes of sound", where="audio")
        samples = self._sound(data)
        words: list[Entry] = []
        if node.has("alignment") and node["alignment"].has("segments"):
            offset_s = node["chunk_audio_offset_sec"].number() if node.has("chunk_audio_offset_sec") else 0.0
            for segment in node["alignment"]["segments"].items():
                start_s, end_s = segment["start"].number(), segment["end"].number()
                words.append(entry(offset_s + start_s, offset_s + end_s, segment["text"].text().strip(), segment.where))
        return Piece(samples, RATE_HZ, tuple(word for word in words if any(map(str.isalnum, word.label))))


def _msgpack() -> Any:
    import msgspec

    return msgspec.msgpack


@dataclass(slots=True)
class AzureEvents:
    """Azure's Speech SDK: give its callbacks' values to :meth:`viseme` and :meth:`sound`.

    Stateful.

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
    _carried: bytes = b""
    _sound: list[np.ndarray[tuple[int], np.dtype[np.int16]]] = field(default_factory=list)
    _onsets: list[tuple[float, int]] = field(default_factory=list)

    def viseme(self, audio_offset: int, viseme_id: int) -> None:
        """Take a ``viseme_received`` event."""
        start_s = audio_offset / TICKS_HZ
        if not 0 <= viseme_id <= 21 or (self._onsets and start_s < self._onsets[-1][0]):
            raise DataError(f"Azure: got viseme {viseme_id} at {start_s} s, expected 0 to 21 in the order of time")
        self._onsets.append((start_s, viseme_id))

    def sound(self, data: bytes) -> None:
        """Take sound, 16-bit and raw."""
        samples, self._carried = pcm(data, self._carried)
        self._sound.append(samples)

    def piece(self, *, end: bool = False) -> Piece:
        """Return what came since the last call; a viseme lasts until the next one, the last one 0.1 s."""
        sound, self._sound = self._sound, []
        onsets = self._onsets
        ends = [start_s for start_s, _ in onsets[1:]] + ([onsets[-1][0] + 0.1] if onsets and end else [])
        self._onsets = onsets[len(ends) :]
        phones = [
            entry(start_s, end_s, to_ipa(str(viseme), "azure-visemes")[0], "viseme")
            for (start_s, viseme), end_s in zip(onsets, ends, strict=False)
        ]
        joined = np.concatenate(sound) if sound else np.zeros(0, np.int16)
        return Piece(joined, self.rate_hz, phones=tuple(phones))


def _json(message: str | bytes, what: str) -> Node:
    try:
        text = message if isinstance(message, str) else message.decode()
        return Node(json.loads(text))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{what}: no JSON here ({error})") from error


def _base64(node: Node) -> bytes:
    try:
        return base64.b64decode(node.text(), validate=True)
    except (binascii.Error, ValueError) as error:
        raise DataError(f"not base64 ({error})", where=node.where) from error


SERVICES: dict[str, type[ElevenLabs] | type[Cartesia] | type[Inworld] | type[Fish]] = {
    "elevenlabs": ElevenLabs, "cartesia": Cartesia, "inworld": Inworld, "fish": Fish,
}  # fmt: skip
"""Services that :mod:`.service_client` can reach, by the name before the voice: ``cartesia:VOICE``."""
