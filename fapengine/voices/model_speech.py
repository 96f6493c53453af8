"""Shared by the voices of models: their names and files, and an utterance from labels with lengths in samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import DataError, UsageError
from fapengine.speech.formats.entries import Entry, track_of, with_words
from fapengine.speech.marks import MarkedText
from fapengine.speech.phone_track import PhoneTrack
from fapengine.voices.protocol import Speech
from fapengine.voices.sounding import Mark, SoundLevel, sounding

PAUSE = "_"
"""Label of a pause; blanks and punctuation are pauses too."""
KEPT = 2
"""Models that stay loaded."""
Joined = Callable[[Iterable[tuple[str, float, str]]], list[Entry]]
"""Function that makes entries of consecutive labels with lengths in s, and joins modifiers to their phones."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """A piece of audio, and its labels."""

    samples: NDArray[np.int16]
    """(N,) int16, mono."""
    lengths: tuple[tuple[str, int], ...]
    """Each label with its samples, N in all."""


def changed_ns(files: Sequence[Path], hint: str) -> tuple[int, ...]:
    """Check that files exist, and return when each was changed, as a key of a cache."""
    for file in files:
        if not file.is_file():
            raise UsageError(f"voice: file not found: {file}; {hint}")
    return tuple(file.stat().st_mtime_ns for file in files)


def choices_of(name: str, keys: Sequence[str]) -> tuple[Path, dict[str, str]]:
    """Read the name of a model with its choices, such as ``piper:/path/voice.onnx?speaker=anna``."""
    kind, _, rest = name.partition(":")
    path, _, query = rest.partition("?")
    choices = dict(parse_qsl(query, keep_blank_values=True))
    if not path or (set(choices) - set(keys)) or (query and not choices):
        expected = "&".join(f"{key}=…" for key in keys)
        raise UsageError(f"voice: got {name!r:.200}, expected {kind}:/path/model.onnx?{expected}")
    return Path(path), choices


def speaker_number(speaker: str, names: Mapping[str, int], count: int, where: str) -> int | None:
    """Find a speaker of a model by name or number; None for the model's first."""
    if not speaker:
        return None
    number = names.get(speaker)
    if number is None and speaker.isdecimal() and int(speaker) < count:
        number = int(speaker)
    if number is None:
        known = ", ".join(list(names)[:8]) or f"a number less than {count}"
        raise UsageError(f"voice: got speaker {speaker!r:.60}, expected one of {where}: {known}")
    return int(number)


def spoken(sound: ArrayLike, lengths: Iterable[tuple[str, float]], *, where: str) -> Spoken:
    """Check a model's audio, (N,) in -1..1, and fit the lengths, in samples, to it.

    Labels after the end of the audio are cut; time left over is a pause.
    """
    wave, pairs = np.asarray(sound, dtype=np.float64).reshape(-1), list(lengths)
    counts = np.array([count for _, count in pairs], dtype=np.float64)
    if not np.isfinite(wave).all():
        raise DataError(f"{where}: the model's sound has values that are not finite")
    if not np.isfinite(counts).all() or (counts < 0).any():
        raise DataError(f"{where}: the model gives a phone {counts.min():g} samples, expected 0 or more")
    ends = np.minimum(np.round(np.cumsum(counts)), len(wave)).astype(int)
    fitted = [(label, int(count)) for (label, _), count in zip(pairs, np.diff(ends, prepend=0), strict=True)]
    rest = len(wave) - (int(ends[-1]) if len(ends) else 0)
    samples = np.round(np.clip(wave, -1.0, 1.0) * 32767).astype(np.int16)
    return Spoken(samples, (*fitted, (PAUSE, rest)) if rest else tuple(fitted))


def speech_of(
    pieces: Sequence[Spoken], rate_hz: int, marked: MarkedText, joined: Joined, alphabet: str, what: str
) -> Speech:
    """Join the pieces of an utterance."""
    lengths = [each for piece in pieces for each in piece.lengths]
    if not any(label[:1].isalpha() for label, _ in lengths):
        raise UsageError(f"text: {marked.text!r:.60} contains nothing to speak ({what} finds nothing in it)")
    entries = joined(
        (PAUSE if label == " " else label, count / rate_hz, f"phone {n}") for n, (label, count) in enumerate(lengths, 1)
    )
    words = _words(lengths, rate_hz, marked.text)
    track = track_of(with_words(entries, words), what, alphabet=alphabet)
    samples = np.concatenate([piece.samples for piece in pieces])
    marks = [  # pauses are where it is quiet, because blanks are not pauses
        Mark(each.start_s, "" if each.is_silence else each.label, each.stress, each.word) for each in track.phones
    ]
    heard = sounding(marks, SoundLevel(samples, rate_hz))
    phones = PhoneTrack.from_phones(heard, tolerance_s=0.0, level=track.level, reading=track.reading)
    speech = Speech(samples=samples, sample_rate_hz=rate_hz, phones=phones)
    if marked.marks and not words:
        speech = replace(speech, remarks=("text: the voice gives no times of words; all marks come at the start",))
    return speech.marked(marked)


def check_length(samples: int, rate_hz: int, most_s: float, text: str) -> None:
    """Refuse audio that is longer than ``most_s``."""
    if samples > most_s * rate_hz:
        raise UsageError(f"text: got {text!r:.60}, whose sound is too long, expected at most {most_s:.0f} s more")


def _words(lengths: Sequence[tuple[str, int]], rate_hz: int, text: str) -> list[Entry]:
    """Find the words' times between the blanks; none if their number is not that of the text's words."""
    entries: list[Entry] = []
    now = 0
    for is_word, group in groupby(lengths, key=lambda each: each[0] not in ("^", "$", " ", PAUSE)):
        members = list(group)
        begin, now = now, now + sum(count for _, count in members)
        if is_word and any(label[:1].isalpha() for label, _ in members):
            entries.append(Entry(begin / rate_hz, now / rate_hz, "", f"word {len(entries) + 1}"))
    words = [word.strip("\"'“”‘’.,;:!?…()[]") for word in text.split() if any(letter.isalnum() for letter in word)]
    if len(words) != len(entries):
        return []
    return [replace(entry, label=word) for entry, word in zip(entries, words, strict=True)]
