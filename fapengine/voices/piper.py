"""A voice of Piper, an ONNX model of the user's with its ``.onnx.json``, by the package ``piper-tts``.

GPL-3.0: the user installs it (``design/decisions.md, 0003``). The model gives the length of each of its symbols in
samples; the symbols are code points of espeak-ng's IPA, each with the padding after it. Piper 1.3 and later
(``docs/ALIGNMENTS.md``); 1.8 was tried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError, any_error_as
from fapengine.speaking import DEFAULT_RATE_WPM
from fapengine.speech.formats.synthesizers import piper_entries
from fapengine.speech.marks import read_marks
from fapengine.voices import model_speech
from fapengine.voices.protocol import Speech

piper = Late("piper", "piper-tts", "a voice of Piper")
onnx = Late("onnx", "onnx", "the times of a voice of Piper")

BEGIN, FILL, END = "^", "_", "$"
"""Symbols that Piper puts before an utterance, after each other symbol, and after the utterance."""


@dataclass(frozen=True, slots=True)
class PiperVoice:
    """A voice of Piper, as :class:`~fapengine.voices.protocol.Voice`."""

    model: Path
    """ONNX; its description is next to it, with ``.json`` after the name."""
    speaker: str = ""
    """Name or number, for a model with several; by default its first."""
    rate_wpm: int = DEFAULT_RATE_WPM
    """Words a minute: 160 is the model's own rate, 320 twice as fast."""
    ssml: bool = False
    most_s: float = inf
    """Longest audio of one text, s; more is refused."""

    @classmethod
    def named(
        cls, name: str, rate_wpm: int = DEFAULT_RATE_WPM, ssml: bool = False, *, most_s: float = inf
    ) -> PiperVoice:
        """Make a voice of ``piper:/path/voice.onnx``, and load its model."""
        path, choices = model_speech.choices_of(name, ["speaker"])
        voice = cls(path, choices.get("speaker", ""), rate_wpm, ssml, most_s)
        voice._speaker_number(_load(path).config)
        return voice

    def speak(self, text: str) -> Speech:
        """Speak a text; see :class:`fapengine.voices.protocol.Voice`."""
        model = _load(self.model)
        config = model.config
        marked = read_marks(text, ssml=self.ssml)
        length_scale = config.length_scale * DEFAULT_RATE_WPM / self.rate_wpm
        options = piper.SynthesisConfig(speaker_id=self._speaker_number(config), length_scale=length_scale)
        pieces: list[model_speech.Spoken] = []
        with any_error_as(DataError, f"{self.model}: the model failed"):
            try:
                for chunk in model.synthesize(marked.text, options, include_alignments=True):
                    pieces.append(_spoken(chunk, config.phoneme_id_map, str(self.model)))
                    length = sum(len(each.samples) for each in pieces)
                    model_speech.check_length(length, config.sample_rate, self.most_s, text)
            except ImportError as error:
                raise ResourceError(f"voice: {self.model} needs {error.name}, which is not installed") from error
        return model_speech.speech_of(pieces, config.sample_rate, marked, piper_entries, "ipa", self.model.name)

    def _speaker_number(self, config: Any) -> int | None:
        return model_speech.speaker_number(self.speaker, config.speaker_id_map, config.num_speakers, str(self.model))


def lengths_of(
    symbols: Sequence[str], counts: ArrayLike, numbers: Mapping[str, Sequence[int]]
) -> list[tuple[str, int]]:
    """Sum up the samples of each symbol, with the padding after it.

    Parameters
    ----------
    symbols : sequence of str
        Code points of a sentence; Piper leaves out those that the model does not have.
    counts : (N,) int
        Samples of each number of the model's input.
    numbers : mapping
        Numbers of each symbol.

    Examples
    --------
    >>> numbers = {"_": [0], "^": [1], "$": [2], "m": [3], "a": [4]}
    >>> lengths_of("mxa", [10, 1, 20, 2, 30, 3, 40], numbers)
    [('^', 11), ('m', 22), ('a', 33), ('$', 40)]
    """
    counts = np.asarray(counts).reshape(-1)
    fill = len(numbers.get(FILL, ()))
    known = [BEGIN, *(symbol for symbol in symbols if symbol in numbers), END]
    widths = [len(numbers.get(symbol, ())) + (fill if symbol != END else 0) for symbol in known]
    if sum(widths) != len(counts):
        raise DataError(f"alignments: got {len(counts)} counts of samples, expected {sum(widths)}")
    ends = np.cumsum(widths)
    return [
        (symbol, int(counts[end - width : end].sum())) for symbol, end, width in zip(known, ends, widths, strict=True)
    ]


def _spoken(chunk: Any, numbers: Mapping[str, Sequence[int]], where: str) -> model_speech.Spoken:
    """Read an ``AudioChunk``."""
    if chunk.phoneme_alignments is not None:
        lengths = [(each.phoneme, each.num_samples) for each in chunk.phoneme_alignments]
    elif chunk.phoneme_id_samples is not None:
        lengths = lengths_of(chunk.phonemes, chunk.phoneme_id_samples, numbers)
    else:
        raise DataError(f"{where}: the model gives no lengths of phones; piper.patch_voice_with_alignment adds them to"
                        " most")  # fmt: skip
    return model_speech.spoken(chunk.audio_float_array, lengths, where=where)


def _load(path: Path) -> Any:
    _ = piper.PiperVoice, onnx.load  # a missing library is reported before a missing file
    files = path, Path(f"{path}.json")
    return _loaded(path, *model_speech.changed_ns(files, "a Piper voice needs its description next to it"))


@lru_cache(model_speech.KEPT)
def _loaded(path: Path, *_changed_ns: int) -> Any:
    with any_error_as(DataError, f"{path}: cannot be read as a voice of Piper"):
        return piper.PiperVoice.load(path, include_alignments=True)
