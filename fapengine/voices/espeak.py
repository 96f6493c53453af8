"""espeak-ng as a voice: the library of the wheel ``espeakng-loader``, loaded at run time.

The library reports a phone's onset only, in samples, and not quite where it is heard; :mod:`.sounding` corrects that.
Words are reported by their place in the text, phones by a name (:mod:`.espeak_labels`). An empty name is a pause or
less. The library's state is global to the process, so one lock guards it.
GPL-3.0: the user installs it (``design/decisions.md, 0003``).
"""

import _ctypes
import ctypes
import re
import sys
import threading
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from html import unescape
from itertools import accumulate
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._late import needed
from fapengine._signals import signals_kept
from fapengine.errors import NothingToSpeakError, ResourceError, UsageError
from fapengine.speaking import DEFAULT_RATE_WPM, DEFAULT_VOICE, RATES_WPM
from fapengine.speech.marks import MarkedText, read_marks
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.text.normal_form import SpeakableText, check_ssml, find_tag, speakable
from fapengine.speech.text.words import (
    Stretch,
    attribute,
    bare,
    is_spelled,
    may_be_spelled,
    reads,
    scripts_in,
    spelled_remarks,
    unread_remarks,
    without_tags,
    words_of,
)
from fapengine.voices.catalogue import Catalogue, VoiceEntry
from fapengine.voices.espeak_labels import NAME_BYTES, in_context, language_after, read_label
from fapengine.voices.protocol import Speech
from fapengine.voices.sounding import Mark, SoundLevel, sounding
from fapengine.voices.spoken_form import ADDRESS, Edit, edited, spoken_form

# Numbers of speak_lib.h.
_SYNCHRONOUS, _PHONEME_EVENTS, _IPA_NAMES, _DO_NOT_EXIT = 2, 0x1, 0x2, 0x8000
_EVENT_LIST_END, _EVENT_WORD, _EVENT_PHONEME = 0, 1, 7
_CHARS_UTF8, _SSML, _PHONEMES, _PARAMETER_RATE = 0x1, 0x10, 0x100, 1
Event = tuple[int, int, int, int, bytes]
"""Sample, kind, position in the text from 1, length, name of the phone."""
_ENTITY = re.compile(r"<[^<>]*>|&(?:#\d+|#x[\da-fA-F]+|amp|lt|gt|quot|apos);")
"""A tag, which stays, or an entity."""
MAX_SHOWN = 60
"""Characters of a text that an error quotes."""

MAX_SECOND_DICTIONARIES = 500
"""Texts in two languages after which the library stays loaded; 92 MB are lost by then."""

_lock = threading.Lock()
_second_dictionaries: list[bytes] = []
"""Changes of language, one of each text that had any."""


class _Event(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("unique_identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("audio_position", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("name", ctypes.c_char * NAME_BYTES),
    )


class _VoiceRecord(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("languages", ctypes.POINTER(ctypes.c_char)),
        ("identifier", ctypes.c_char_p),
        ("gender", ctypes.c_ubyte),
        ("age", ctypes.c_ubyte),
        ("variant", ctypes.c_ubyte),
        ("xx1", ctypes.c_ubyte),
        ("score", ctypes.c_int),
        ("spare", ctypes.c_void_p),
    )


_Callback = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event))


@cache
def _library() -> tuple[ctypes.CDLL, int]:
    """Load and initialise espeak-ng; return it and its sample rate."""
    espeakng_loader = needed("espeakng_loader", "espeak-ng", "voice")
    try:
        library = ctypes.CDLL(espeakng_loader.get_library_path())
    except OSError as error:
        raise ResourceError(f"voice: espeak-ng cannot be loaded: {error}") from error
    library.espeak_TextToPhonemes.restype = ctypes.c_char_p
    library.espeak_ListVoices.restype = ctypes.POINTER(ctypes.POINTER(_VoiceRecord))
    options = _PHONEME_EVENTS | _IPA_NAMES | _DO_NOT_EXIT
    rate_hz = library.espeak_Initialize(_SYNCHRONOUS, 0, espeakng_loader.get_data_path().encode(), options)
    if rate_hz <= 0:
        raise ResourceError(f"voice: espeak-ng did not start (code {rate_hz}); its data may be damaged")
    # Rules may name phonemes that their voice lacks (å in Greenlandic); the last voice's is taken, or the process dies.
    _succeed(library.espeak_SetVoiceByName(b"gmw/en-US"), "the first voice")
    return library, rate_hz


def _fresh_library() -> tuple[ctypes.CDLL, int]:
    """Load the library again (0.4 ms), so that the same text always has the same sound.

    The pitch flutters by a counter of the library's, which only loading sets back: one Vietnamese sentence had 64,602,
    64,597 and 64,368 samples (espeak-ng 1.52.0). Unloading loses the dictionary of a second language, 0.2 MB, which the
    library never frees; after ``MAX_SECOND_DICTIONARIES`` of them it stays loaded.
    """
    if _library.cache_info().currsize and len(_second_dictionaries) < MAX_SECOND_DICTIONARIES:
        library, _ = _library()
        library.espeak_Terminate()
        _library.cache_clear()
        if sys.platform == "win32":  # ctypes never does it by itself
            _ctypes.FreeLibrary(library._handle)
        else:
            _ctypes.dlclose(library._handle)
    return _library()


def sample_rate_hz() -> int:
    """Return the sample rate of every sound that it makes."""
    with _lock:
        return _library()[1]


@cache
def catalogue() -> Catalogue:
    """All voices that can speak; a voice without its dictionary is left out, because it says nothing."""
    with _lock:
        library, _ = _library()
        records = library.espeak_ListVoices(None)
        listed = []
        index = 0
        while records[index]:
            record = records[index].contents
            listed.append((record.name.decode(), record.identifier.decode(), _codes(record)))
            index += 1
    import espeakng_loader

    data = Path(espeakng_loader.get_data_path())
    speakers = [path.name for path in (data / "voices" / "!v").iterdir()]
    dictionaries = {path.name for path in data.glob("*_dict")}
    return Catalogue.of((entry for entry in listed if _dictionary(data / "lang" / entry[1]) in dictionaries), speakers)


def _codes(record: _VoiceRecord) -> list[tuple[int, str]]:
    """Language codes of a voice: a byte of priority and a text, again and again, until a zero byte."""
    codes = []
    address = ctypes.addressof(record.languages.contents)
    while priority := ctypes.string_at(address, 1)[0]:
        code = ctypes.string_at(address + 1)
        codes.append((priority, code.decode()))
        address += len(code) + 2
    return codes


def _dictionary(voice: Path) -> str:
    """Name of the dictionary that a voice's file asks for, by its line ``dictionary`` or by its language."""
    lines = [line.split() for line in voice.read_text(encoding="utf-8").splitlines()]
    named = {line[0]: line[1] for line in reversed(lines) if len(line) > 1}  # the first of each counts
    language = named.get("language", "").partition("-")[0]
    return f"{named.get('dictionary', language)}_dict"


def voices() -> dict[str, str]:
    """All voices that can speak: language code (BCP 47) to name, for example ``{"en-us": "English (America)"}``."""
    return {entry.code: entry.name for entry in catalogue().entries}


@dataclass(frozen=True, slots=True)
class EspeakVoice:
    """An espeak-ng voice.

    Examples
    --------
    >>> speech = EspeakVoice("en-us").speak("Mama.")
    >>> [phone.label for phone in speech.phones.phones if not phone.is_silence]
    ['m', 'ɑː', 'm', 'ɐ']
    """

    name: str = DEFAULT_VOICE
    """Language code in any spelling: see :meth:`fapengine.voices.catalogue.Catalogue.find`."""
    rate_wpm: int = DEFAULT_RATE_WPM
    ssml: bool = False
    """Flag of texts that are SSML: see :mod:`fapengine.voices.spoken_form`."""
    most_s: float = field(default=inf, kw_only=True)
    """Length of a text's sound in seconds; a text that grows longer is given up."""

    def __post_init__(self) -> None:
        if not RATES_WPM[0] <= self.rate_wpm <= RATES_WPM[1]:
            raise UsageError(f"rate: must be {RATES_WPM[0]} to {RATES_WPM[1]} words a minute, got {self.rate_wpm}")
        catalogue().find(self.name)

    @property
    def entry(self) -> VoiceEntry:
        """The voice that speaks."""
        return catalogue().find(self.name)

    def speak(self, text: str) -> Speech:
        """Speak ``text``; see :class:`fapengine.voices.protocol.Voice`."""
        marked = read_marks(text, ssml=self.ssml)
        if marked.ssml is not None and not self.ssml:  # a pause or emphasis is wanted
            spoken = replace(self, ssml=True).speak(marked.ssml)
            return replace(spoken, marks=()).marked(replace(marked, sounds=()))
        formed = speakable(marked.text if marked.ssml is None else marked.ssml)
        if self.ssml:
            check_ssml(formed.text)
            formed = _without_entities(formed)
        words = without_tags(formed.text) if self.ssml else formed.text
        code = self.entry.code
        given: list[Edit] = []
        if marked.sounds or (self.ssml and "<phoneme" in formed.text):
            given = self._given_sounds(formed, marked)
        said = spoken_form(formed.text, code, given)
        events, samples, rate_hz = self._synthesise(said.text, has_phonemes=bool(given))
        events = _at_places_of(said, events)
        phones = _phones(with_whole_words(events, words), formed.text, samples, rate_hz, code)
        if all(phone.is_silence for phone in phones.phones):
            why = f"voice {self.name!r} finds nothing in it"
            raise NothingToSpeakError(f"text: {_shortened(text)} contains nothing to speak ({why})")
        speech = Speech(samples=samples, sample_rate_hz=rate_hz, phones=phones, remarks=self._remarks(formed, said))
        return speech.marked(replace(marked, sounds=()))

    def _given_sounds(self, formed: SpeakableText, marked: MarkedText) -> list[Edit]:
        """Edits of a text in normal form that give words the sounds that the caller wants."""
        from fapengine.voices.espeak_labels import elements_of, phonemes_of  # rare

        if self.ssml:
            sounds, tags = elements_of(formed.text)
        else:
            places = [
                (bisect_left(formed.starts, a), bisect_left(formed.starts, b), ipa) for a, b, ipa in marked.sounds
            ]
            sounds, tags = places, []
        voice = replace(self, ssml=False)
        edits = phonemes_of(formed.text, sounds, self.entry.code, voice._phones_of_text) if sounds else []
        return [*tags, *edits]

    def _phones_of_text(self, text: str) -> list[tuple[int, str]]:
        """Labels of a text in mnemonics, each with its place."""
        events, _, _ = self._synthesise(text, has_phonemes=True)
        named = (
            (place - 1, read_label(name, self.entry.code))
            for _, kind, place, _, name in events
            if kind == _EVENT_PHONEME
        )
        return [(place, label[0]) for place, label in named if label and label[0]]

    def transcribe(self, text: str) -> str:
        """Return the phonemes of a text in IPA, as the library writes them without speaking (espeak_TextToPhonemes)."""
        identifier = self.entry.identifier.encode()
        with _lock:
            library, _ = _library()
            _succeed(library.espeak_SetVoiceByName(identifier), f"voice {self.name!r}")
            buffer = ctypes.create_string_buffer(speakable(text).text.replace("\n", " ").encode())
            rest = ctypes.c_void_p(ctypes.addressof(buffer))
            clauses = []
            while rest.value:
                clauses.append(library.espeak_TextToPhonemes(ctypes.byref(rest), _CHARS_UTF8, _IPA_NAMES) or b"")
        return " ".join(clause.decode().strip() for clause in clauses).strip()

    def _remarks(self, formed: SpeakableText, said: SpeakableText) -> tuple[str, ...]:
        """Remarks on a text in normal form, and on what was said in its place."""
        remarks = []
        if not self.ssml and (tag := find_tag(formed.text)):
            remarks.append(f"text: {tag} looks like SSML and was spoken as it stands; ssml=True obeys it")
        if formed.replaced:
            remarks.append(f"text: got bytes that are no UTF-8 ({formed.replaced}); they were not spoken")
        code = self.entry.code
        words = without_tags(said.text) if self.ssml else said.text
        unread, spelled = [], []
        addresses = {index for match in ADDRESS.finditer(formed.text) for index in range(*match.span())}
        for place in words_of(words):
            word = words[place.start : place.stop]
            start = formed.starts[said.starts[place.start]]
            if not all(reads(code, script) for script in scripts_in(word)):
                unread.append((word, start))
            elif said.starts[place.start] in addresses or not may_be_spelled(word):
                continue
            elif bare(self.transcribe(word)) == bare(self.transcribe(" ".join(word))):
                spelled.append((word, start))
        known = {word: is_spelled(word, self.transcribe(word)) for word in dict(unread)}
        return (*remarks, *unread_remarks([each for each in unread if known[each[0]]], code), *spelled_remarks(spelled))

    def _synthesise(self, text: str, *, has_phonemes: bool = False) -> tuple[list[Event], NDArray[np.int16], int]:
        events: list[Event] = []
        pieces: list[bytes] = []
        count_so_far = 0

        def collect(wave, count, event) -> int:  # type: ignore[no-untyped-def]
            index = 0
            while event[index].type != _EVENT_LIST_END:
                entry = event[index]
                name = bytes(entry.name) if entry.type == _EVENT_PHONEME else b""
                events.append((entry.sample, entry.type, entry.text_position, entry.length, name))
                index += 1
            nonlocal count_so_far
            if wave and count > 0:
                pieces.append(ctypes.string_at(wave, 2 * count))
                count_so_far += count
            return int(bool(signals) or count_so_far > self.most_s * rate_hz)  # 1: stop

        identifier = self.entry.identifier.encode()
        encoded = text.encode()
        flags = _CHARS_UTF8 | (_SSML if self.ssml else 0) | (_PHONEMES if has_phonemes else 0)
        with _lock, signals_kept() as signals:
            library, rate_hz = _fresh_library()
            callback = _Callback(collect)
            library.espeak_SetSynthCallback(callback)
            _succeed(library.espeak_SetVoiceByName(identifier), f"voice {self.name!r}")
            _succeed(library.espeak_SetParameter(_PARAMETER_RATE, self.rate_wpm, 0), f"{self.rate_wpm} words a minute")
            _succeed(library.espeak_Synth(encoded, len(encoded) + 1, 0, 1, 0, flags, None, None), "a text")
            _succeed(library.espeak_Synchronize(), "a text")
            changes = [name for _, kind, _, _, name in events if kind == _EVENT_PHONEME and language_after(name)]
            _second_dictionaries.extend(changes[:1])
        if count_so_far > self.most_s * rate_hz:
            raise UsageError(
                f"text: got {_shortened(text)}, whose sound is too long, expected at most {self.most_s:.0f} s more"
            )
        return events, np.frombuffer(b"".join(pieces), dtype=np.int16), rate_hz


def _without_entities(formed: SpeakableText) -> SpeakableText:
    """Put characters for entities of SSML, whose places the library does not count; < and > are not spoken."""
    found = [(match, unescape(match[0])) for match in _ENTITY.finditer(formed.text) if match[0][0] == "&"]
    plain = edited(formed.text, [(*match.span(), " " if char in ("<", ">") else char) for match, char in found])
    starts, stops = (formed.starts[at] for at in plain.starts), (formed.stops[at - 1] for at in plain.stops)
    return replace(formed, text=plain.text, starts=tuple(starts), stops=tuple(stops))


def _shortened(text: str) -> str:
    return repr(text) if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]!r}…"


def _succeed(code: int, what: str) -> None:
    """Look at the code that a function of the library returned (``espeak_ERROR`` of speak_lib.h; 0 is success)."""
    if code != 0:
        raise ResourceError(f"voice: espeak-ng refuses {what} (code {code}); its data may be damaged")


def _phones(events: Sequence[Event], text: str, samples: NDArray[np.int16], rate_hz: int, code: str) -> PhoneTrack:
    """Turn events into phones that lie where they sound (:mod:`.sounding`)."""
    marks = in_context(_marks(events, text, rate_hz, code), code)
    return PhoneTrack.from_phones(sounding(marks, SoundLevel(samples, rate_hz)), tolerance_s=0.0)


def _marks(events: Sequence[Event], text: str, rate_hz: int, code: str) -> list[Mark]:
    marks: list[Mark] = []
    word, language = "", code
    for sample, kind, position, length, name in events:
        if kind == _EVENT_WORD:
            word = text[position - 1 : position - 1 + length]
        elif kind == _EVENT_PHONEME and (changed := language_after(name)) is not None:
            language = code if code.startswith(changed) else changed
        elif kind == _EVENT_PHONEME and (label := read_label(name, language)) is not None:
            marks.append(Mark(sample / rate_hz, *label, word))
    return marks


def _at_places_of(said: SpeakableText, events: Sequence[Event]) -> list[Event]:
    """Move events from places in what was said to those in the text."""
    places = [*said.starts, *said.stops[-1:], 0][: len(said.starts) + 1]  # also that of the end
    return [
        (sample, kind, places[min(max(place, 1), len(places)) - 1] + 1, length, name)
        for sample, kind, place, length, name in events
    ]


def with_whole_words(events: Sequence[Event], text: str) -> list[Event]:
    """Replace the word events by events of whole words, with more of them where the voice joined some.

    Parameters
    ----------
    events : sequence of Event
        As from the library.
    text : str
        What was spoken, with spaces in place of tags.
    """
    marks: list[tuple[int, int]] = []
    for event in events:
        if event[1] == _EVENT_WORD:
            marks.append((event[2] - 1, 0))
        elif marks and _is_phone(event):
            marks[-1] = (marks[-1][0], marks[-1][1] + 1)
    attributed = iter(attribute(text, marks))
    whole: list[Event] = []
    words: dict[int, Stretch] = {}
    """Words of the current mark that are still to come, by the number of its phones before each."""
    spoken = 0
    for event in events:
        is_word = event[1] == _EVENT_WORD
        if is_word:
            stretches = next(attributed)
            befores = accumulate((phones for _, phones in stretches), initial=0)
            words, spoken = {before: word for before, (word, _) in zip(befores, stretches, strict=False)}, 0
        if (is_word or _is_phone(event)) and (word := words.pop(spoken, None)):
            whole.append((event[0], _EVENT_WORD, word.start + 1, word.stop - word.start, b""))
        if not is_word:
            whole.append(event)
            spoken += _is_phone(event)
    return whole


def _is_phone(event: Event) -> bool:
    return event[1] == _EVENT_PHONEME and event[4][:1] not in (b"", b"\0", b"(")
