"""Tokens: a phone track taken apart into what a profile knows."""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

LABELS = 4096
"""Remembered; a sender may make up any number."""
Part = tuple[str, tuple[str, ...]]
"""Name in the profile, and the IPA letters as they were spoken."""


class Token(NamedTuple):
    """A phone, or a part of one, under a name that the profile knows."""

    phone: Phone
    name: str
    """Name in the profile, or :data:`SILENCE`."""
    heard: tuple[str, ...]
    """IPA letters as they were spoken; the profile may know only their likes."""
    start_s: float
    end_s: float


def tokens_of(track: PhoneTrack, known: Mapping[str, object]) -> tuple[list[Token], list[str]]:
    """Take a track apart into what a profile knows.

    A label that it lacks is split into letters that share the time, each under the name of its likest.

    Returns
    -------
    tokens : list of Token
    strange : list of str
        Labels that are no IPA; the neutral vowel stands in.
    """
    parts_of = speller(tuple(known))
    tokens, strange = [], []
    for phone in track.phones:
        start_s, end_s = phone.start_s, phone.end_s
        if phone.is_silence:
            tokens.append(Token(phone, SILENCE, (), start_s, end_s))
            continue
        parts, is_strange = parts_of(phone.label)
        if is_strange:
            strange.append(phone.label)
        if len(parts) == 1:
            tokens.append(Token(phone, *parts[0], start_s, end_s))
            continue
        share = (end_s - start_s) / len(parts)
        for index, (name, heard) in enumerate(parts):
            tokens.append(Token(phone, name, heard, start_s + index * share, start_s + (index + 1) * share))
    return tokens, strange


@lru_cache(maxsize=16)
def speller(known: tuple[str, ...]) -> Callable[[str], tuple[tuple[Part, ...], bool]]:
    """Make what takes a label apart into known names, and tells whether it is no IPA; it remembers what it has met."""
    letters_known = tuple(name for name in known if len(name) == 1)

    @lru_cache(maxsize=LABELS)
    def parts_of(label: str) -> tuple[tuple[Part, ...], bool]:
        spelled = ipa.letters(label)
        letters = spelled or ("ə",)
        whole = "".join(letters)
        if whole in known:
            return ((whole, letters),), not spelled
        return tuple((ipa.nearest(letter, letters_known), (letter,)) for letter in letters), not spelled

    return parts_of
