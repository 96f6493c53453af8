"""A voice of Kokoro, an ONNX model of the user's and its file of voices, by the package ``kokoro-onnx``.

kokoro-onnx is MIT; the phonemizer and espeak-ng that it uses are GPL-3.0: the user installs it. The model must be one
with durations (an output ``duration``: counts of 600 samples at 24 kHz, one for each character). 0.6.1 was tried.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any

from fapengine._late import Late
from fapengine.errors import DataError, UsageError, any_error_as
from fapengine.speaking import DEFAULT_RATE_WPM
from fapengine.speech.formats.synthesizers import kokoro_entries
from fapengine.speech.marks import read_marks
from fapengine.voices import model_speech
from fapengine.voices.protocol import Speech

kokoro_onnx = Late("kokoro_onnx", "kokoro-onnx", "a voice of Kokoro")

LANGUAGES = {"a": "en-us", "b": "en-gb", "e": "es", "f": "fr-fr", "h": "hi", "i": "it", "j": "ja", "p": "pt-br",
             "z": "cmn"}  # fmt: skip
"""espeak-ng's languages by the first character of a voice's name."""
DEFAULT_LANGUAGE = "en-us"
SPEEDS = 0.5, 2.0
"""Lowest and highest speed of the model."""


@dataclass(frozen=True, slots=True)
class KokoroVoice:
    """A voice of Kokoro, as :class:`~fapengine.voices.protocol.Voice`."""

    model: Path
    voices: Path
    """Style of each voice by its name, as kokoro-onnx reads it (NumPy's ``.npz``, called ``voices-v1.0.bin``)."""
    voice: str
    """Name, such as af_heart."""
    language: str
    """Language, as espeak-ng names it."""
    rate_wpm: int = DEFAULT_RATE_WPM
    """Words a minute: 160 is the model's own rate; 80 to 320."""
    ssml: bool = False
    most_s: float = inf
    """Longest audio of one text, s; more is refused."""

    @classmethod
    def named(
        cls, name: str, rate_wpm: int = DEFAULT_RATE_WPM, ssml: bool = False, *, most_s: float = inf
    ) -> KokoroVoice:
        """Make a voice of ``kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart``, and load its model.

        ``language`` follows by default from the first character of the voice.
        """
        path, choices = model_speech.choices_of(name, ["voices", "voice", "language"])
        if not choices.get("voices") or not choices.get("voice"):
            raise UsageError(f"voice: got {name!r:.200}, expected ?voices=/path/voices.bin&voice=NAME after the model")
        language = choices.get("language") or LANGUAGES.get(choices["voice"][0], DEFAULT_LANGUAGE)
        voice = cls(path, Path(choices["voices"]), choices["voice"], language, rate_wpm, ssml, most_s)
        if not SPEEDS[0] <= voice.speed <= SPEEDS[1]:
            least, most = (round(speed * DEFAULT_RATE_WPM) for speed in SPEEDS)
            raise UsageError(f"rate: must be {least} to {most} words a minute for a Kokoro voice, got {rate_wpm}")
        known = voice._load().get_voices()
        if voice.voice not in known:
            raise UsageError(
                f"voice: unknown value {voice.voice!r:.60}; use one of {voice.voices}: {', '.join(known[:12])}"
            )
        return voice

    @property
    def speed(self) -> float:
        """Speed of the model; 1 is its own."""
        return self.rate_wpm / DEFAULT_RATE_WPM

    def speak(self, text: str) -> Speech:
        """Speak a text; see :class:`fapengine.voices.protocol.Voice`."""
        marked, model = read_marks(text, ssml=self.ssml), self._load()
        if not any(letter.isalnum() for letter in marked.text):
            raise UsageError(f"text: {text!r:.60} contains nothing to speak")
        with any_error_as(DataError, f"{self.model}: the model failed"):
            sound, rate_hz, timings = model.create_timed(marked.text, self.voice, self.speed, self.language)
        model_speech.check_length(len(sound), rate_hz, self.most_s, text)
        times = ((each.phoneme, each.start, each.end) for each in timings)
        piece = model_speech.spoken(sound, lengths_of(times, rate_hz), where=str(self.model))
        return model_speech.speech_of([piece], rate_hz, marked, kokoro_entries, "misaki", self.model.name)

    def _load(self) -> Any:
        _ = kokoro_onnx.Kokoro  # a missing library is reported before a missing file
        files = self.model, self.voices
        return _loaded(*files, *model_speech.changed_ns(files, "a Kokoro voice needs a model and a voices file"))


def lengths_of(times: Iterable[tuple[str, float, float]], rate_hz: int) -> list[tuple[str, float]]:
    """Turn characters with start and end in s into lengths in samples; gaps between them are pauses.

    Examples
    --------
    >>> lengths_of([("m", 0.1, 0.2), ("A", 0.2, 0.5)], 100)
    [('_', 10), ('m', 10), ('A', 30)]
    """
    lengths: list[tuple[str, float]] = []
    now = 0
    for letter, start_s, end_s in times:
        start, end = round(start_s * rate_hz), round(end_s * rate_hz)
        if start < now or end < start:
            raise DataError(
                f"timings: {letter!r} lasts from {start_s:g} to {end_s:g} s, expected {now / rate_hz:g} or later"
            )
        if start > now:
            lengths.append((model_speech.PAUSE, start - now))
        lengths.append((letter, end - start))
        now = end
    return lengths


@lru_cache(model_speech.KEPT)
def _loaded(path: Path, voices: Path, *_changed_ns: int) -> Any:
    with any_error_as(DataError, f"{path}: cannot be read as a model of Kokoro"):
        model = kokoro_onnx.Kokoro(str(path), str(voices))
        known = [len(model.get_voice_style(name)) for name in model.get_voices()]
    if not known:
        raise DataError(f"{voices}: contains no voice")
    if not model.has_timings:
        raise DataError(f"{path}: got a model without an output 'duration', expected one with lengths of phones")
    return model
