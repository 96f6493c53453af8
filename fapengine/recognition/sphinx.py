"""PocketSphinx: its model, phones and decoders, and words of a text as its model can recognize them.

The model (US English, 16 kHz; 39 phones of the CMU dictionary) is inside the wheel, so nothing is downloaded.
PocketSphinx 5: Huggins-Daines and others, BSD; "Pocketsphinx: a free, real-time continuous speech recognition system
for hand-held devices", ICASSP 2006.

Words come from the model's dictionary, or from a voice's phones. A phone of another language is recognized as the most
similar one of the 39 (:data:`SOUNDS_LIKE`, otherwise :func:`fapengine.speech.ipa.nearest`), and reported as itself.

Theory of operation: words that the dictionary lacks
----------------------------------------------------
A word is covered by the fewest runs of letters that words of the dictionary have, and by the longest of these; its
beginning and end count as letters, so that a beginning is taken from a beginning. Runs overlap by a letter where they
can. Letters and phones of a word of the dictionary are aligned by which letter may spell which phone
(:data:`SPELLED_BY`), so a run of letters has phones. Pronouncing by analogy is of Dedina and Nusbaum, "PRONOUNCE: a
program for pronunciation by analogy", Computer Speech and Language 5, 1991; theirs weighs many words, this takes one
for a run.
"""

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import read_rows
from fapengine._late import needed
from fapengine.speech import ipa
from fapengine.speech.alphabets.convert import from_arpabet
from fapengine.speech.phone_track import SILENCE, Phone

Frames = tuple[str, int, int]
"""A phone of the model or a silence, its first frame and the one after its last, 100 a second."""

_PHONES = read_rows("fapengine.recognition", "sphinx_phones.csv")
MODEL_PHONES = tuple(name for name, _, _ in _PHONES)
"""Phones that the model knows, in ARPAbet."""
VOWELS = frozenset(name for name in MODEL_PHONES if name[0] in "AEIOU")
_DICTIONARY = "cmudict-en-us.dict"
_LOOP = {"lw": 2.0, "beam": 1e-20, "pbeam": 1e-20}
"""Weight of the phone language model, beams of the phone loop (``bench/recognizers.py``: 1 to 4 differ by .02 of r)."""


def new_decoder(**options: Any) -> Any:
    """Make a decoder with the shipped acoustic model."""
    sphinx = _library()
    return sphinx.Decoder(sphinx.Config(hmm=_model("en-us"), loglevel="FATAL", **options))


def new_word_decoder() -> Any:
    """Make a decoder of any English words, weighed by a model of word sequences."""
    return new_decoder(lm=_model("en-us.lm.bin"), dict=_model(_DICTIONARY))


def new_phone_loop() -> Any:
    """Make a decoder of any phone after any other, weighed by a model of phone sequences."""
    return new_decoder(allphone=_model("en-us-phone.lm.bin"), **_LOOP)


def new_aligner(*, beam: float, silence: float, noise: float, is_comparable: bool) -> Any:
    """Make a decoder for texts that are known, with the shipped dictionary. Raises as :func:`new_decoder`.

    ``silence`` and ``noise`` are the probabilities of a pause and of a noise between two words. Scores of different
    texts are comparable if each frame is scored relative to the best of all states, which takes longer.
    """
    words = {"beam": beam, "pbeam": beam, "wbeam": beam**0.75, "silprob": silence, "fillprob": noise}
    return new_decoder(dict=_model(_DICTIONARY), lm=None, bestpath=False, compallsen=is_comparable, **words)


def dictionary() -> Iterator[tuple[str, list[str]]]:
    """Words of the shipped dictionary, in lower case, with the model's phones."""
    for line in Path(_model(_DICTIONARY)).read_text().splitlines():
        word, *phones = line.split()
        yield word, phones


def ipa_of(name: str) -> str:
    """IPA of a phone of the model; a silence or a noise is :data:`SILENCE`.

    Examples
    --------
    >>> ipa_of("AY"), ipa_of("SIL"), ipa_of("+SPN+")
    ('aɪ', '_', '_')
    """
    return SILENCE if name not in MODEL_PHONES else from_arpabet(name) or SILENCE


def frames_of(segments: Iterable[Any]) -> list[Frames]:
    """Segments of a hypothesis."""
    return [(segment.word, segment.start_frame, segment.end_frame + 1) for segment in segments]


def decode(decoder: Any, samples: NDArray[np.int16]) -> None:
    """Decode a whole utterance, (N,) int16, at once: its mean spectrum is then known from its start."""
    decoder.start_utt()
    decoder.process_raw(samples.tobytes(), full_utt=True)
    decoder.end_utt()


def _library() -> Any:
    return needed("pocketsphinx", "PocketSphinx", "recognizer")


def _model(name: str) -> str:
    """Path of a file of the shipped model."""
    return str(Path(_library().get_model_path()) / "en-us" / name)


Pronounce = Callable[[str], Sequence[Phone]]
"""Function that speaks a word: its phones in IPA, none if there is nothing to speak."""

MODEL_NAMES: Mapping[str, str] = {ipa_of(name): name for name in MODEL_PHONES}
"""IPA of the model's phones."""
SOUNDS_LIKE: Mapping[str, str] = {letter: name for name, letters, _ in _PHONES for letter in letters}
"""The model's phone for IPA letters that it lacks: vowels by their first two formants (Handbook of the IPA, 1999;
Peterson and Barney 1952 for the model's own), consonants by manner, then by where their noise lies."""
_LETTERS = tuple(label for label in MODEL_NAMES if len(label) == 1)


@dataclass(frozen=True, slots=True)
class Pronunciation:
    """Phones of a word: as reported, and in the model's phones."""

    phones: tuple[tuple[str, int], ...]
    """IPA and stress of each phone."""
    model: tuple[tuple[str, ...], ...]
    """Phones of the model for each; none for a glottal stop."""

    @property
    def spelling(self) -> str:
        """The model's phones, separated by spaces as in its dictionary."""
        return " ".join(name for names in self.model for name in names)


def words_of(text: str) -> list[str]:
    """Words of a text, which spaces and dashes separate, without the punctuation around them.

    Examples
    --------
    >>> words_of("Well, “don't” — 3 times!")
    ['Well', "don't", '3', 'times']
    """
    words = []
    for piece in re.split(r"\s+|[–—]+|-{2,}|\.{2,}|…", text.replace("’", "'")):
        start, end = 0, len(piece)
        while start < end and not _speaks(piece[start]):
            start += 1
        while end > start and not _speaks(piece[end - 1]):
            end -= 1
        if start < end:
            words.append(piece[start:end])
    return words


def dictionary_key(word: str) -> str:
    """Spelling of a word in the dictionary: lower case, without accents.

    Examples
    --------
    >>> dictionary_key("Café")
    'cafe'
    """
    parted = unicodedata.normalize("NFD", word.lower())
    return "".join(letter for letter in parted if not unicodedata.combining(letter))


def heard_as(label: str) -> tuple[str, ...]:
    """Phones of the model that sound most like an IPA label; none for a glottal stop.

    Examples
    --------
    >>> heard_as("aɪ"), heard_as("ts"), heard_as("yː"), heard_as("ʔ")
    (('AY',), ('T', 'S'), ('IY',), ())
    """
    letters = ipa.letters(label) or ("ə",)
    whole = "".join(letters)
    if whole in MODEL_NAMES:
        return (MODEL_NAMES[whole],)
    return tuple(_heard(letter) for letter in letters if letter != "ʔ")


def of_voice(phones: Sequence[Phone]) -> Pronunciation:
    """Pronunciation of a word that a voice has spoken."""
    spoken = [phone for phone in phones if not phone.is_silence]
    return Pronunciation(
        tuple((phone.label, phone.stress) for phone in spoken), tuple(heard_as(phone.label) for phone in spoken)
    )


def of_dictionary(names: Sequence[str]) -> Pronunciation:
    """Pronunciation of a word from the model's own phones."""
    return Pronunciation(tuple((ipa_of(name), 0) for name in names), tuple((name,) for name in names))


def _heard(letter: str) -> str:
    if letter in MODEL_NAMES:
        return MODEL_NAMES[letter]
    return SOUNDS_LIKE.get(letter) or MODEL_NAMES[ipa.nearest(letter, _LETTERS)]


def _speaks(letter: str) -> bool:
    return letter.isalnum() or unicodedata.combining(letter) != 0 or letter in "%€$£&"


SPELLED_BY: Mapping[str, str] = {name: letters for name, _, letters in _PHONES}
"""Letters that may spell each phone, apart from :data:`VOWEL_LETTERS`, which spell all vowels."""
VOWEL_LETTERS = frozenset("aeiouy")
UNLIKELY, SILENT, DOUBLE = 3.0, 0.4, 0.5
"""Costs of a letter with a phone that it does not spell, without a phone, and with one more."""
EDGE = "#"
_MAX_LETTERS = 40


class Neighbours:
    """Speaks words by a dictionary. Stateful: it remembers the dictionary in the form that it looks for runs in.

    Parameters
    ----------
    dictionary : iterable of (word, phones)
        In lower case, with the model's phones.

    Examples
    --------
    >>> spoken = Neighbours([("lobster", "L AA B S T ER".split()), ("zone", "Z OW N".split())])
    >>> spoken.pronounce("zobster")
    ['Z', 'AA', 'B', 'S', 'T', 'ER']
    """

    def __init__(self, dictionary: Iterable[tuple[str, Sequence[str]]]) -> None:
        self._phones = {word: list(phones) for word, phones in dictionary if word.isalpha() and word.isascii()}

    @cached_property
    def _text(self) -> str:
        return "\n" + "\n".join(f"{EDGE}{word}{EDGE}" for word in self._phones) + "\n"

    def pronounce(self, word: str) -> list[str]:
        """Phones of the model for a word; none where it has characters other than letters, or too many."""
        letters = "".join(letter for letter in word.lower() if letter != "'")
        if not letters or len(letters) > _MAX_LETTERS or not (letters.isalpha() and letters.isascii()):
            return []
        edged = f"{EDGE}{letters}{EDGE}"
        runs = self._runs(edged)
        found: list[str] = []
        for index, (first, end) in enumerate(runs):
            until = end if index + 1 == len(runs) else max(runs[index + 1][0], first)
            found += self._spoken(edged[first:end])[: until - first]
        return " ".join(found).split()

    def _runs(self, edged: str) -> list[tuple[int, int]]:
        """Cover a word by runs: first letter, and the one after the last."""
        longest = []
        end = 0
        for first in range(len(edged)):
            end = max(end, first + 1)
            while end < len(edged) and edged[first : end + 1] in self._text:
                end += 1
            longest.append(end)
        runs = [(0, longest[0])]
        while runs[-1][1] < len(edged):
            first, end = runs[-1]
            # the run that reaches farthest, and of those the one that begins first, with most overlap
            start = max(range(first + 1, end + 1), key=lambda place: (longest[place], -place))
            runs.append((start, longest[start]))
        return runs

    def _place(self, run: str) -> int:
        """Places of a run in the dictionary; if possible not next to half of a double letter."""
        first = at = self._text.find(run)
        while at >= 0:
            if self._text[at - 1] != run[0] and self._text[at + len(run)] != run[-1]:
                return at
            at = self._text.find(run, at + 1)
        return first

    def _spoken(self, run: str) -> list[str]:
        """Phones of each letter of a run, with blanks between; an edge has none."""
        at = self._place(run)
        if at < 0:  # a letter that no word has
            return [""] * len(run)
        start = self._text.rfind("\n", 0, at) + 1
        word = self._text[start : self._text.find("\n", start)].strip(EDGE)
        shares = ["", *beside(word, self._phones[word]), ""]
        return shares[at - start : at - start + len(run)]


def beside(word: str, phones: Sequence[str]) -> list[str]:
    """Align the phones of a word with its letters: those of each letter, with blanks between.

    Examples
    --------
    >>> beside("lobsters", "L AA B S T ER Z".split())
    ['L', 'AA', 'B', 'S', 'T', 'ER', '', 'Z']
    """
    rows: list[list[tuple[float, int]]] = [[(0.0, 0)] + [(float("inf"), 0)] * len(phones)]
    for letter in word:
        row = []
        for count in range(len(phones) + 1):
            options = [(rows[-1][count][0] + SILENT, 0)]
            for own in (1, 2):
                if count >= own:
                    cost = sum(0.0 if _may_spell(letter, name) else UNLIKELY for name in phones[count - own : count])
                    options.append((rows[-1][count - own][0] + cost + DOUBLE * (own - 1), own))
            row.append(min(options))
        rows.append(row)
    shares: list[str] = []
    count = len(phones)
    for row in reversed(rows[1:]):
        own = row[count][1]
        shares.append(" ".join(phones[count - own : count]))
        count -= own
    return shares[::-1]


def _may_spell(letter: str, name: str) -> bool:
    return letter in SPELLED_BY.get(name, "") or (letter in VOWEL_LETTERS and name in VOWELS)
