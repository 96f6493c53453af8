"""Speech recognition: a recording to phones, with a transcript or without."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.paths import naming, read_bytes, write_bytes
from fapengine.files.sound import SOUND_SUFFIXES, inspect_sound, stream_sound
from fapengine.speaking import DEFAULT_VOICE
from fapengine.speech.formats.documents import decode_text
from fapengine.speech.formats.word_lists import subtitle_text
from fapengine.speech.formats.writing import WRITERS, check_writable, format_phone_json
from fapengine.speech.phone_track import Phone, PhoneTrack

if TYPE_CHECKING:
    from fapengine.recognition.recording import Mismatch
    from fapengine.recognition.sphinx import Neighbours
    from fapengine.recognition.sphinx_aligner import SphinxAligner
    from fapengine.speech.prosody import Sounding
    from fapengine.voices.protocol import Voice

MAX_UNHEARD = 0.5
"""Fraction of the words that may be missing in the recording; above, the transcript is that of another one."""


@dataclass(frozen=True, slots=True)
class Hearing:
    """Phones that were recognized in a recording."""

    phones: PhoneTrack
    soundings: "tuple[Sounding, ...]"
    """Loudness and pitch of each phone."""
    notes: tuple[str, ...]
    """Remarks: words that a voice pronounced, and places where transcript and recording differ."""
    mismatches: "tuple[Mismatch, ...]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognition:
    """How phones are found in a recording."""

    transcript: str | None = None
    """By default, phones are recognized without a transcript."""
    language: str | None = None
    """Language of the transcript, by default American English: a voice of espeak-ng, which pronounces words that are
    not in the dictionary of American English, and all words of other languages."""
    channel: int | None = None
    """Channel of the file, 1 for the first; by default the mean of all."""
    recognizer: Path | None = None
    """Recognizer without a transcript: a name of :mod:`fapengine.recognition.choice`, or an ONNX model. Default: the
    built-in network and PocketSphinx together, or the network alone if PocketSphinx is not installed."""
    trust_transcript: bool = False
    """Align all words of the transcript, without a check that they are in the recording."""


def is_sound(path: Path) -> bool:
    """Whether a name is that of audio or video."""
    return path.suffix.lower() in SOUND_SUFFIXES


def read_text(path: Path) -> str:
    """Read a transcript: a text file, or the text of subtitles.

    Raises ``UsageError`` if it cannot be read and ``DataError`` if it is not text.
    """
    with naming(path):
        text = decode_text(read_bytes(path), "text")
    return subtitle_text(text) or text


def hear(path: Path, how: Recognition, *, on_heard: Callable[[float], None] = lambda _: None) -> Hearing:
    """Find the phones of a recording.

    Parameters
    ----------
    path : Path
        Audio or video.
    how : Recognition
    on_heard : callable
        Called with the duration in s of each processed piece.
    """
    from fapengine.recognition.choice import BOTH, SPHINX, chosen, new_recognizer
    from fapengine.recognition.recording import follow, listen, listen_by

    of_sound: list[str] = []

    def sound() -> Iterator[NDArray[np.int16]]:
        heard = 0
        for piece in stream_sound(path, rate_hz=16_000, channel=how.channel, remark=of_sound.append):
            heard += len(piece)
            yield piece
        if not heard:
            raise DataError(f"{path}: contains no audio")

    transcript, recognizer = how.transcript, how.recognizer
    if how.trust_transcript and transcript is None:
        raise UsageError("trust_transcript: requires a transcript")
    inspect_sound(path)  # reports a bad file before models are loaded
    if recognizer is not None and str(recognizer) != SPHINX and transcript is not None:
        raise UsageError(
            f"recognizer: cannot be combined with a transcript, which always uses PocketSphinx; got {recognizer}"
        )
    if transcript is None:
        if str(chosen(recognizer)) == BOTH:
            recording = listen(sound(), on_heard=on_heard)
        else:
            recording = listen_by(new_recognizer(recognizer), sound(), on_heard=on_heard)
        unused = () if how.language is None else (f"language: {how.language!r} is used only with a transcript",)
        return Hearing(recording.phones, recording.soundings, (*of_sound, *unused), ())
    pronouncer = _Pronouncer(how.language or DEFAULT_VOICE)
    aligner = _aligner(transcript, pronouncer)
    recording = follow(sound(), aligner, is_trusted=how.trust_transcript, on_heard=on_heard)
    notes = [str(mismatch) for mismatch in recording.mismatches]
    if recording.unheard > MAX_UNHEARD and not how.trust_transcript:
        listed = "; ".join(notes[:3])
        raise DataError(
            f"text: {100 * recording.unheard:.0f} % of the words are not in the recording ({listed});"
            " trust_transcript=True aligns them unchecked;"
            f" the language is {pronouncer.language}, language=CODE is another",
            where=str(path),
        )
    if recording.doubted:
        listed = ", ".join(f"{start_s:.1f} s to {end_s:.1f} s" for start_s, end_s in recording.doubted[:3])
        more = ", ..." if len(recording.doubted) > 3 else ""
        unclear = "unclear audio (noise, telephone?) or other words, aligned with the transcript nevertheless"
        notes.insert(0, f"{unclear}: {listed}{more}")
    if aligner.pronounced:
        listed = ", ".join(aligner.pronounced[:12]) + (", ..." if len(aligner.pronounced) > 12 else "")
        notes.insert(0, f"not in the dictionary, pronounced by {pronouncer.by}: {listed}")
    return Hearing(recording.phones, recording.soundings, (*of_sound, *notes), recording.mismatches)


def with_loudness(phones: PhoneTrack, samples: NDArray[np.int16], rate_hz: int) -> PhoneTrack:
    """Add loudness, and where missing stress, of the recording to timings (:mod:`fapengine.speech.prosody`).

    Parameters
    ----------
    phones : PhoneTrack
        Timings with loudness keep it.
    samples : (N,) int16
    """
    from fapengine.recognition.loudness import soundings_at
    from fapengine.speech.prosody import with_prosody

    if any(phone.loudness_db for phone in phones.phones):
        return phones
    told = with_prosody(phones.phones, soundings_at(phones.phones, samples, rate_hz))
    return replace(phones, phones=tuple(told))


def write_phones(hearing: Hearing, path: Path) -> None:
    """Write phones in the format that the name asks for: TextGrid, CTM, JSON (with loudness and pitch), ``.pho``."""
    check_writable(path.suffix)
    if path.suffix.lower() == ".json":
        extra = [
            {"loudness_db": round(sounding.loudness_db, 1), "pitch_hz": round(sounding.pitch_hz, 1)}
            for sounding in hearing.soundings
        ]
        write_bytes(path, format_phone_json(hearing.phones, extra))
    else:
        write_bytes(path, WRITERS[path.suffix.lower()](hearing.phones))


def _aligner(transcript: str, pronouncer: "_Pronouncer") -> "SphinxAligner":
    from fapengine.recognition.sphinx import words_of
    from fapengine.recognition.sphinx_aligner import SphinxAligner

    words = words_of(transcript)
    if not words:
        raise UsageError(f"transcript: got {transcript[:40]!r}, expected words")
    return SphinxAligner(words, pronouncer, dictionary=_is_english(pronouncer.language))


def _is_english(language: str) -> bool:
    return language.lower().replace("_", "-").split("-")[0] == "en"


class _Pronouncer:
    """Pronounces words with a voice, or English ones like similar words of the dictionary. Stateful.

    The voice is loaded when the first word needs it.
    """

    def __init__(self, language: str) -> None:
        self.language = language
        self.by = "espeak-ng"
        """Description of the pronouncer."""
        self._voice: Voice | None = None
        self._neighbours: Neighbours | None = None

    def __call__(self, word: str) -> Sequence[Phone]:
        """Return the phones of a word; none if there is nothing to speak."""
        if self._voice is None and self._neighbours is None:
            self._load()
        if self._neighbours is not None:
            from fapengine.recognition.sphinx import ipa_of

            names = self._neighbours.pronounce(word)
            return [Phone(ipa_of(name), 0.1 * n, 0.1 * (n + 1)) for n, name in enumerate(names)]
        assert self._voice is not None
        try:
            return self._voice.speak(word).phones.phones
        except UsageError:  # nothing to speak
            return ()

    def _load(self) -> None:
        from fapengine.voices.choice import VoiceChoice, language_voice

        try:
            name = self.language if _is_english(self.language) else language_voice(self.language)
            self._voice = VoiceChoice(name).load()
        except UsageError as error:
            raise UsageError("language" + str(error).removeprefix("voice")) from error
        except ResourceError:
            from fapengine.recognition.sphinx import Neighbours, dictionary

            if not _is_english(self.language):
                raise
            self._neighbours = Neighbours(dictionary())
            self.by = "similar words of the dictionary (espeak-ng is not installed)"
