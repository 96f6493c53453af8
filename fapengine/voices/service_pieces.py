"""Pieces of a streaming voice, and a whole utterance made of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UsageError
from fapengine.speech.formats.entries import Entry, track_of, with_words
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.protocol import Speech

MAX_S = 3600.0
"""Length of sound of one utterance; more is refused."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Sound, and the words and phones that became known with it."""

    samples: NDArray[np.int16]
    """(N,) int16, mono; the next samples, possibly none."""
    rate_hz: int
    words: tuple[Entry, ...] = ()
    """Times in s from the first sample of the utterance."""
    phones: tuple[Entry, ...] = ()
    """IPA; times likewise."""


@dataclass(slots=True)
class Gathered:
    """The pieces of one utterance.

    Stateful.
    """

    most_s: float = MAX_S
    """Length of sound in s; more is refused."""
    sound: list[NDArray[np.int16]] = field(default_factory=list)
    words: list[Entry] = field(default_factory=list)
    phones: list[Entry] = field(default_factory=list)
    rate_hz: int = 0
    _samples: int = 0

    @property
    def duration_s(self) -> float:
        """Length of the sound so far."""
        return self._samples / self.rate_hz if self.rate_hz else 0.0

    def add(self, piece: Piece) -> None:
        """Take a piece."""
        if self.rate_hz not in (0, piece.rate_hz):
            raise DataError(f"sound: got {piece.rate_hz} Hz behind {self.rate_hz} Hz, expected one rate")
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
            Spelled words with times to phones; used where the service gave no phones.
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
        whole = PhoneTrack.of(phones, level=track.level, reading=track.reading)
        return Speech(samples=np.concatenate(self.sound), sample_rate_hz=self.rate_hz, phones=whole)


def _ordered(entries: Sequence[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: entry.start_s)


def pcm(data: bytes, carried: bytes = b"") -> tuple[NDArray[np.int16], bytes]:
    """Read little-endian 16-bit samples that may be cut anywhere: (N,) int16, and the odd byte left over."""
    whole = carried + data
    even = len(whole) // 2 * 2
    return np.frombuffer(whole[:even], "<i2").astype(np.int16), whole[even:]


def entry(start_s: float, end_s: float, label: str, where: str) -> Entry:
    """Make an entry from times of a service."""
    if not (math.isfinite(start_s) and math.isfinite(end_s) and -1.0 <= start_s <= end_s <= MAX_S):
        raise DataError(f"{label!r:.40}: got times {start_s} to {end_s}, expected 0 to {MAX_S:.0f} s", where=where)
    return Entry(max(start_s, 0.0), max(end_s, 0.0), label, where)


def check_text(text: str) -> str:
    """Refuse a text without anything to speak."""
    if not any(letter.isalnum() for letter in text):
        raise UsageError(f"text: {text!r:.40} contains nothing to speak")
    return text
