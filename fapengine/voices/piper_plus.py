"""A voice of piper-plus, an ONNX model of the user's with its description, by the package ``piper-plus``.

MIT, without espeak-ng. The package turns text into symbols; the model is run here, because it gives the length of each
symbol in frames (output ``durations``, before they are rounded up), which the package misplaces in short texts. 2.0.2
was tried.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._late import Late
from fapengine.errors import DataError, ResourceError, UsageError, any_error_as
from fapengine.speaking import DEFAULT_RATE_WPM
from fapengine.speech.alphabets.phone_sets import PHONE_SETS
from fapengine.speech.formats.synthesizers import piper_entries
from fapengine.speech.marks import read_marks
from fapengine.voices import model_speech
from fapengine.voices.protocol import Speech

_USE = "piper-plus", "a voice of piper-plus"
onnxruntime = Late("onnxruntime", *_USE)
nltk_data = Late("nltk.data", *_USE)
text_splitter = Late("piper_plus.text_splitter", *_USE)
multilingual = Late("piper_plus.phonemize.multilingual", *_USE)
token_mapper = Late("piper_plus.phonemize.token_mapper", *_USE)

BEGIN, FILL, END = "^", "_", "$"
"""Symbols before an utterance, after each other symbol, and after the utterance."""
LANGUAGES = ("en", "es", "fr", "ja", "pt", "zh")
"""Languages whose text the package turns into symbols."""
NLTK_DATA = {
    "cmudict": "corpora/cmudict.zip",
    "averaged_perceptron_tagger": "taggers/averaged_perceptron_tagger.zip",
    "averaged_perceptron_tagger_eng": "taggers/averaged_perceptron_tagger_eng/",
}
"""What English needs of NLTK, each with its place."""
_OTHERS = {"rr": "r", "y_vowel": "y", "N_m": "m", "N_n": "n", "N_ng": "ŋ", "N_uvular": "ɴ"}
_JAPANESE = {**PHONE_SETS["openjtalk"].table, **_OTHERS}
_UNAMBIGUOUS = {label: sound for label, sound in _JAPANESE.items() if len(label) > 1 or label.isupper()}
"""Labels that mean the same in every language of the package."""
_ACCENTS = "[]#"
TONE = "˥"
"""Label of any tone or accent: it adds its time to the sound before it."""
EMBEDDING_SIZE = 192
"""Width of a speaker's embedding where a model does not say it."""


@dataclass(frozen=True, slots=True)
class PiperPlusVoice:
    """A voice of piper-plus, as :class:`~fapengine.voices.protocol.Voice`."""

    model: Path
    """ONNX; its description is next to it: the same name with ``.json`` after it, or ``config.json``."""
    language: str
    """Language of texts in Latin letters, one of :data:`LANGUAGES`."""
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
    ) -> PiperPlusVoice:
        """Make a voice of ``piper-plus:/path/model.onnx?language=es&speaker=3``, and load its model.

        The language is by default English, if the model speaks it, or else the model's first.
        """
        path, choices = model_speech.choices_of(name, ["language", "speaker"])
        model = _load(path)
        language = choices.get("language") or ("en" if "en" in model.languages else next(iter(model.languages)))
        if language not in model.languages:
            known = ", ".join(model.languages)
            raise UsageError(f"voice: got language {language!r:.60}, expected one of {path}: {known}")
        voice = cls(path, language, choices.get("speaker", ""), rate_wpm, ssml, most_s)
        model.speaker(voice.speaker)
        if language == "en":
            _check_english()
        return voice

    def speak(self, text: str) -> Speech:
        """Speak a text; see :class:`fapengine.voices.protocol.Voice`."""
        model = _load(self.model)
        marked = read_marks(text, ssml=self.ssml)
        if self.language in ("ja", "zh") and any("a" <= letter <= "z" for letter in marked.text.lower()):
            _check_english()
        pieces: list[model_speech.Spoken] = []
        unknown: dict[str, None] = {}
        with any_error_as(DataError, f"{self.model}: the model failed"):
            for symbols in model.symbols(marked.text, self.language):
                unknown |= dict.fromkeys(symbol for symbol in symbols if symbol not in (*model.numbers, *_ACCENTS))
                sound, lengths = model.run(symbols, self.language, model.speaker(self.speaker), self.rate_wpm)
                pieces.append(model_speech.spoken(sound, lengths, where=str(self.model)))
                length = sum(len(each.samples) for each in pieces)
                model_speech.check_length(length, model.rate_hz, self.most_s, text)
        speech = model_speech.speech_of(pieces, model.rate_hz, marked, piper_entries, "ipa", self.model.name)
        remarks = [f"text: {self.model.name} has no symbol {symbol!r}, which is not spoken" for symbol in unknown]
        return replace(speech, remarks=(*speech.remarks, *remarks))


@dataclass(frozen=True, slots=True)
class _Model:
    """A model, loaded."""

    path: Path
    session: Any
    """Of onnxruntime."""
    rate_hz: int
    hop: int
    """Samples of a frame."""
    scales: tuple[float, float, float]
    """Noise, length, and noise of lengths."""
    numbers: Mapping[str, Sequence[int]]
    """Numbers of each symbol."""
    fills: bool
    """True if :data:`FILL` comes after each symbol."""
    languages: Mapping[str, int]
    """Each with its number."""
    speakers: Mapping[str, int]
    speaker_count: int
    embedding_size: int

    def speaker(self, name: str) -> int:
        """Number of a speaker by name or number; 0 without one."""
        return model_speech.speaker_number(name, self.speakers, self.speaker_count, str(self.path)) or 0

    def symbols(self, text: str, language: str) -> Iterator[list[str]]:
        """Symbols of each sentence."""
        latin = language if language not in ("ja", "zh") or "en" not in self.languages else "en"
        phonemizer = multilingual.MultilingualPhonemizer(list(self.languages), default_latin_language=latin)
        return (phonemizer.phonemize(sentence) for sentence in text_splitter.split_sentences(text))

    def run(
        self, symbols: Sequence[str], language: str, speaker: int, rate_wpm: int
    ) -> tuple[NDArray[np.float64], list[tuple[str, float]]]:
        """Speak symbols: sound, (N,) in -1..1, and each label with its samples."""
        known = [BEGIN, *(symbol for symbol in symbols if symbol in self.numbers), END]
        fill = [*self.numbers[FILL]] if self.fills else []
        rows = [[*self.numbers[symbol], *(fill if symbol not in (BEGIN, END) else ())] for symbol in known]
        sequence = np.array([[number for row in rows for number in row]], np.int64)
        noise, length, noise_of_lengths = self.scales
        given = {
            "input": sequence,
            "input_lengths": np.array([sequence.size], np.int64),
            "scales": np.array([noise, length * DEFAULT_RATE_WPM / rate_wpm, noise_of_lengths], np.float32),
            "sid": np.array([speaker], np.int64),
            "lid": np.array([self.languages[language]], np.int64),
            "prosody_features": np.zeros((1, sequence.size, 3), np.int64),
            # The mask chooses the speaker's number instead of the embedding.
            "speaker_embedding": np.zeros((1, self.embedding_size), np.float32),
            "speaker_embedding_mask": np.zeros((1, 1), np.int64),
        }
        inputs = {each.name: given[each.name] for each in self.session.get_inputs()}
        sound, durations = self.session.run(["output", "durations"], inputs)
        frames = np.ceil(np.maximum(np.asarray(durations, np.float64).reshape(-1), 0.0))
        if len(frames) != sequence.size:
            raise DataError(f"{self.path}: the model gives {len(frames)} durations, expected {sequence.size}")
        ends = np.cumsum([len(row) for row in rows])
        counts = [float(part.sum()) * self.hop for part in np.split(frames, ends[:-1])]
        # The last symbol often repeats the end of the last word; the package cuts it, too.
        spoken = np.asarray(sound).reshape(-1)[: int(sum(counts[:-1]))]
        return spoken, [
            (_label(symbol, language), count) for symbol, count in zip(known[:-1], counts[:-1], strict=True)
        ]


def _label(symbol: str, language: str) -> str:
    """IPA of a symbol."""
    label = _names().get(symbol, symbol)
    if label.startswith("tone") or label in _ACCENTS:
        return TONE
    if label == BEGIN:
        return model_speech.PAUSE
    return (_JAPANESE if language == "ja" else _UNAMBIGUOUS).get(label, label)


@cache
def _names() -> dict[str, str]:
    """Names of the symbols that are code points of the private use area."""
    return {chr(number): name for name, number in token_mapper.FIXED_PUA_MAPPING.items()}


def _check_english() -> None:
    """Refuse English without its data, which the package would otherwise download, in part, when it is imported."""
    missing = []
    for name, place in NLTK_DATA.items():
        try:
            nltk_data.find(place)
        except LookupError:
            missing.append(name)
    if missing:
        raise ResourceError(
            f"voice: the English of piper-plus needs data of NLTK that are not here: {', '.join(missing)}. Install them"
            f" once: python -m nltk.downloader {' '.join(missing)} (without a network, copy the folder nltk_data of"
            " another machine into the home folder)"
        )


def _load(path: Path) -> _Model:
    _ = multilingual.MultilingualPhonemizer, onnxruntime.InferenceSession  # a missing library is reported first
    beside = path.with_name("config.json")
    description = beside if beside.is_file() and not Path(f"{path}.json").is_file() else Path(f"{path}.json")
    files = path, description
    return _loaded(*files, *model_speech.changed_ns(files, "a voice of piper-plus needs its description next to it"))


@lru_cache(model_speech.KEPT)
def _loaded(path: Path, description: Path, *_changed_ns: int) -> _Model:
    with any_error_as(DataError, f"{path}: cannot be read as a voice of piper-plus"):
        config = json.loads(description.read_text("utf-8"))
        inference, audio = config.get("inference", {}), config["audio"]
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        shapes = {each.name: each.shape for each in session.get_inputs()}
        width = shapes.get("speaker_embedding", [1, EMBEDDING_SIZE])[1]
        model = _Model(
            path=path,
            session=session,
            rate_hz=int(audio["sample_rate"]),
            hop=int(audio.get("hop_size", 256)),
            scales=(
                float(inference.get("noise_scale", 0.4)),
                float(inference.get("length_scale", 1.0)),
                float(inference.get("noise_w", 0.5)),
            ),
            numbers={symbol: tuple(map(int, numbers)) for symbol, numbers in config["phoneme_id_map"].items()},
            fills=config.get("phoneme_type") != "openjtalk",
            languages={
                name: int(number)
                for name, number in (config.get("language_id_map") or {"ja": 0}).items()
                if name in LANGUAGES
            },
            speakers=dict(config.get("speaker_id_map") or {}),
            speaker_count=int(config["num_speakers"]),
            embedding_size=width if isinstance(width, int) else EMBEDDING_SIZE,
        )
        lacking = {BEGIN, FILL, END} - set(model.numbers)
        outputs = {each.name for each in session.get_outputs()}
    if lacking or not model.languages:
        what = "symbol" if lacking else "language"
        expected = ", ".join(sorted(lacking) or LANGUAGES)
        raise DataError(f"{description}: got no {what} of piper-plus, expected one of {expected}")
    if not {"output", "durations"} <= outputs:
        raise DataError(f"{path}: got a model without an output 'durations', expected one with lengths of phones")
    return model
