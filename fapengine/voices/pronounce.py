"""Timed words to timed phones: a voice speaks them, and the phones of each word are fitted into the word's time.

Theory of operation
-------------------
1. The words between two silences are spoken together, so that each is said as in running speech: ``a`` is not the
   letter's name, ``of`` is weak. Each word is also spoken alone; the cheapest edit of those phones into those of the
   phrase assigns its phones to words. A voice that cannot speak the phrase speaks its words one by one.
2. The lengths of a voice are its own, not the speaker's. Each is moved towards the usual length of its kind of phone,
   by :data:`USUAL_SHARE` (on a logarithmic scale).
3. They are scaled until they fill the word, vowels more than consonants: each is multiplied by
   ``exp(k e)``, ``e`` being 1 for a vowel and :data:`CONSONANTS_YIELD` for a consonant.

Words without a letter or digit are silent; hm and mmm are hummed, because a voice would spell them. The track keeps its
``level``, so that it does not count as measured.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from math import exp

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.voices.protocol import Voice
from fapengine.voices.sounding import is_vowel

MIN_PHONE_S = 1e-4
WORDS_OVERLAP_S = 0.05
"""Overlap of words that is taken for rounding."""
MAX_WORDS = 30
"""Words that are spoken together at most; more are taken in portions."""
MAX_KNOWN_WORDS = 5_000
"""Words that a pronouncer caches before it starts again. About 5 MB."""
USUAL_SHARE = 0.5
"""Share of the usual length in that of a phone, 0..1. Against flite's times, any from 0.5 to 0.7 serves alike."""
CONSONANTS_YIELD = 0.85
"""Yielding of a consonant to stretching, against 1 of a vowel."""
USUAL_S = {
    "vowel": 0.055, "long vowel": 0.095, "stop": 0.067, "affricate": 0.094, "fricative": 0.087, "nasal": 0.079,
    "approximant": 0.054,
}  # fmt: skip
"""Length of a phone by its kind: geometric means over 520 sentences of one speaker of GRID, aligned by pocketsphinx
(``python -m design.phone_lengths``)."""
KIND_OF = {
    letter: "vowel" if sound.vowel else {0.0: "stop", 0.3: "fricative", 0.6: "approximant", 0.8: "nasal"}[sound.manner]
    for letter, sound in ipa.SOUNDS.items()
}
"""Kind of each letter of IPA."""
_HUM = re.compile(r"(h?)m+", re.IGNORECASE)


def pronounce(track: PhoneTrack, voice: Voice) -> PhoneTrack:
    """Replace the words of a track by their phones.

    Parameters
    ----------
    track : PhoneTrack
        Words; a track of phones is returned unchanged.
    voice : Voice
        Speaks each different word once, and each stretch of words between two silences.

    Returns
    -------
    PhoneTrack
        IPA, with the word of each phone. A word without anything to speak stays as its own label, a sign becomes
        silence.
    """
    return Pronouncer(voice).track(track)


def _is_spoken(word: Phone) -> bool:
    return not word.is_silence and any(letter.isalnum() for letter in word.label)


def _portions(words: Sequence[Phone]) -> Iterator[Sequence[Phone]]:
    """Words that are spoken together, and the silences between them."""
    for _, together in groupby(words, key=lambda word: word.is_silence):
        stretch = list(together)
        for first in range(0, len(stretch), MAX_WORDS):
            yield stretch[first : first + MAX_WORDS]


class Pronouncer:
    """A voice with a cache of the words that it has spoken alone, for streams of words. Stateful.

    Results do not depend on earlier words. Several threads may use it if they may use the voice.

    Examples
    --------
    >>> from fapengine.voices.espeak import EspeakVoice
    >>> pronouncer = Pronouncer(EspeakVoice("en-us"))
    >>> [phone.label for phone in pronouncer.words([("my", 0.0, 0.2), ("mama", 0.2, 0.6)])]
    ['m', 'aɪ', 'm', 'ɑː', 'm', 'ɐ']
    """

    def __init__(self, voice: Voice) -> None:
        self._voice = voice
        self._alone: dict[str, list[Phone]] = {}

    def track(self, track: PhoneTrack) -> PhoneTrack:
        """Replace the words of a spelled track by their phones: see :func:`pronounce`."""
        if not track.spelled:
            return track
        phones: list[Phone] = []
        for words in _portions(track.phones):
            parts = iter(self._read([word.label for word in words if _is_spoken(word)]))
            for word in words:
                if not _is_spoken(word):
                    phones.append(Phone(SILENCE, word.start_s, word.end_s))
                else:
                    phones += _fitted(next(parts), word) or [word]
        return PhoneTrack.from_phones(phones, tolerance_s=MIN_PHONE_S, level=track.level, reading=track.reading)

    def words(self, words: Sequence[tuple[str, float, float]]) -> list[Phone]:
        """Turn words with times, as a TTS gives them with its audio, into phones.

        Parameters
        ----------
        words : sequence of (str, float, float)
            Word, start and end in s; in order, up to :data:`WORDS_OVERLAP_S` of overlap.

        Returns
        -------
        list of Phone
            From the first word on, without gaps.
        """
        spelled = [
            Phone(label.strip() or SILENCE, start_s, end_s) for label, start_s, end_s in words if start_s != end_s
        ]
        track = PhoneTrack.from_phones(spelled, tolerance_s=WORDS_OVERLAP_S, level="word", spelled=True)
        first_s = spelled[0].start_s if spelled else 0.0
        return [phone for phone in self.track(track).phones if phone.start_s >= first_s - MIN_PHONE_S]

    def _read(self, words: Sequence[str]) -> list[list[Phone]]:
        """Speak words together; return the phones of each, none where the voice finds nothing to speak."""
        alone = [self._word(word) for word in words]
        together = [index for index, phones in enumerate(alone) if phones and not _HUM.fullmatch(words[index])]
        if len(together) < 2:
            return alone
        phrase = self._speak(" ".join(words[index] for index in together))
        for index, phones in zip(together, shared_out(phrase, [alone[index] for index in together]), strict=True):
            alone[index] = phones or alone[index]
        return alone

    def _word(self, word: str) -> list[Phone]:
        known = self._alone.get(word)
        if known is None:
            hum = _HUM.fullmatch(word)
            h = [Phone("h", 0.0, USUAL_S["fricative"])] if hum and hum[1] else []
            known = [*h, Phone("m", 0.0, 3 * USUAL_S["nasal"])] if hum else self._speak(word)
            if len(self._alone) >= MAX_KNOWN_WORDS:
                self._alone.clear()
            self._alone[word] = known
        return known

    def _speak(self, text: str) -> list[Phone]:
        try:
            return [phone for phone in self._voice.speak(text).phones.phones if not phone.is_silence]
        except UsageError:  # nothing to speak: a foreign script
            return []


def shared_out(phrase: Sequence[Phone], alone: Sequence[Sequence[Phone]]) -> list[list[Phone]]:
    """Share the phones of a phrase out among its words.

    Parameters
    ----------
    phrase : sequence of Phone
        As the words are spoken together.
    alone : sequence of sequence of Phone
        Each word as it is spoken alone.

    Returns
    -------
    list of list of Phone
        Phones of the phrase, a list for each word, in order; one that has no counterpart goes with the one before.

    Examples
    --------
    >>> one, other = [Phone("eɪ", 0, 1)], [Phone("p", 0, 1), Phone("ɑ", 1, 2)]
    >>> [[phone.label for phone in word] for word in shared_out([Phone("ə", 0, 1), *other], [one, other])]
    [['ə'], ['p', 'ɑ']]
    """
    owners = [(index, phone.label) for index, word in enumerate(alone) for phone in word]
    shared: list[list[Phone]] = [[] for _ in alone]
    changes = [[_change(phone.label, known) for _, known in owners] for phone in phrase]
    found, last = dict(ipa.counterparts(changes, lost=1.0, around=1.0)), 0
    for place, phone in enumerate(phrase):
        last = owners[found[place]][0] if place in found else last
        shared[last].append(phone)
    return shared


@lru_cache(maxsize=4096)
def _change(label: str, other: str) -> float:
    """Cost of one phone for another: less than one lost and one gained, if both are vowels or neither is."""
    if label == other:
        return 0.0
    return 0.6 if is_vowel(label) == is_vowel(other) else 1.4


def _fitted(parts: Sequence[Phone], word: Phone) -> list[Phone]:
    """Fill the time of a word with phones."""
    lengths_s = stretched([_drawn_s(part) for part in parts], [is_vowel(part.label) for part in parts], word.duration_s)
    fitted: list[Phone] = []
    now_s = word.start_s
    for index, (part, length_s) in enumerate(zip(parts, lengths_s, strict=True)):
        end_s = word.end_s if index + 1 == len(parts) else min(now_s + length_s, word.end_s)
        if end_s > now_s:
            fitted.append(replace(part, start_s=now_s, end_s=end_s, word=word.label))
            now_s = end_s
    return fitted


def stretched(lengths_s: Sequence[float], vowels: Sequence[bool], total_s: float) -> list[float]:
    """Stretch or press lengths until their sum is ``total_s``, those of vowels more.

    Examples
    --------
    >>> [round(length_s, 3) for length_s in stretched([0.1, 0.1], [True, False], 0.4)]
    [0.211, 0.189]
    """
    if not lengths_s:
        return []
    yields = [1.0 if vowel else CONSONANTS_YIELD for vowel in vowels]
    low, high = -200.0, 200.0
    for _ in range(60):
        middle = (low + high) / 2
        longer = sum(length_s * exp(middle * e) for length_s, e in zip(lengths_s, yields, strict=True)) > total_s
        low, high = (low, middle) if longer else (middle, high)
    filled = [length_s * exp(low * e) for length_s, e in zip(lengths_s, yields, strict=True)]
    return [length_s * total_s / sum(filled) for length_s in filled]


def _drawn_s(phone: Phone) -> float:
    """Length of a phone, moved towards the usual one of its kinds."""
    usual_s = sum(USUAL_S[kind] for kind in kinds(phone.label))
    return float(phone.duration_s ** (1.0 - USUAL_SHARE) * usual_s**USUAL_SHARE)


@lru_cache(maxsize=4096)
def kinds(label: str) -> tuple[str, ...]:
    """Kinds of the sounds in a label, keys of :data:`USUAL_S`; anything that is not IPA counts as a vowel.

    Examples
    --------
    >>> kinds("aɪ"), kinds("tʃ"), kinds("ɔːɹ"), kinds("m")
    (('long vowel',), ('affricate',), ('long vowel', 'approximant'), ('nasal',))
    """
    found: list[str] = []
    for letter in ipa.letters(label) or ("ə",):
        kind = KIND_OF[letter]
        if kind == "vowel" and found and found[-1].endswith("vowel"):
            found[-1] = "long vowel"
        elif kind == "vowel":
            found.append("long vowel" if "ː" in label else "vowel")
        elif kind == "fricative" and found and found[-1] == "stop":
            found[-1] = "affricate"
        else:
            found.append(kind)
    return tuple(found)
