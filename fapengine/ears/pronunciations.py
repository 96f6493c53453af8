"""Words of a text as the acoustic model can hear them: from its dictionary, or from a voice's phones.

The model knows 39 phones of American English. A phone of another language is heard as the one that sounds most like it
(:data:`SOUNDS_LIKE`, otherwise :func:`fapengine.speech.ipa.nearest`), and told as itself.
"""

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fapengine.ears.sphinx import MODEL_PHONES, ipa_of
from fapengine.speech import ipa
from fapengine.speech.phone_track import Phone

Pronounce = Callable[[str], Sequence[Phone]]
"""Speaker of single words: phones in IPA, none where there is nothing to speak."""

MODEL_NAMES: Mapping[str, str] = {ipa_of(name): name for name in MODEL_PHONES}
"""IPA to the model's phone, where it has just that."""
# fmt: off
SOUNDS_LIKE: Mapping[str, str] = {
    # Vowels by their first two formants (Handbook of the IPA, 1999; Peterson and Barney 1952 for the model's own).
    "ə": "AH", "ɐ": "AH", "a": "AA", "ɒ": "AO", "e": "EY", "o": "OW", "y": "IY", "ʏ": "IH", "ø": "EH", "œ": "EH",
    "ɨ": "IH", "ʉ": "UW", "ɯ": "UW", "ɤ": "AH", "ɜ": "ER", "ɚ": "ER", "ɵ": "UH", "ɘ": "AH", "ɞ": "AH", "ɶ": "AE",
    # Consonants by manner, then by where their noise lies.
    "r": "R", "ɾ": "D", "ʀ": "R", "ʁ": "R", "ɽ": "R", "x": "HH", "χ": "HH", "ç": "SH", "ɣ": "G", "β": "V", "ɸ": "F",
    "ʋ": "V", "ɲ": "N", "ɳ": "N", "ɴ": "NG", "ʎ": "L", "ɭ": "L", "ɫ": "L", "ɥ": "Y", "c": "K", "ɟ": "G", "q": "K",
    "ʂ": "SH", "ɕ": "SH", "ʐ": "ZH", "ʑ": "ZH", "ʈ": "T", "ɖ": "D", "ɬ": "L", "ħ": "HH", "ʕ": "AA", "ɦ": "HH",
}
# fmt: on
_LETTERS = tuple(label for label in MODEL_NAMES if len(label) == 1)


@dataclass(frozen=True, slots=True)
class Pronunciation:
    """How a word is heard, and what is told of it."""

    phones: tuple[tuple[str, int], ...]
    """IPA and stress of each phone."""
    model: tuple[tuple[str, ...], ...]
    """Phones of the model that each is heard as; a glottal stop is heard as none."""

    @property
    def spelling(self) -> str:
        """The model's phones with blanks between, as its dictionary has them."""
        return " ".join(name for names in self.model for name in names)


def words_of(text: str) -> list[str]:
    """Words of a text: what stands between blanks and dashes, without the signs around it.

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
    """Spelling of a word in the dictionary: small letters, accents off.

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
