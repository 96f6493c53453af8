"""The voices of espeak-ng by language code, in any spelling.

espeak-ng gives each voice one or more codes, each with a priority (1 is the best); several voices may list the same
code. A code is looked up whole, then without its last subtag, and so on: ``de-AT`` is spoken by ``de``.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

from fapengine._arrays import read_rows
from fapengine.errors import UsageError
from fapengine.speaking import DEFAULT_VOICE

_TAG = re.compile(r"[a-z0-9]{1,8}(-[a-z0-9]{1,8})*")
_OTHER_NAMES = {"jp": "ja", "iw": "he", "in": "id", "mo": "ro", "sh": "hbs", "tl": "fil", "tlh": "piqd"}
"""Codes that no voice lists: withdrawn ones of ISO 639-1 (iw, in, mo, sh; tl is fil in BCP 47), Klingon's, Japan's."""
_LAST_PRIORITY = 99
_TWO_LETTERS = {
    three: two for two, threes in read_rows("fapengine.voices", "language_codes.csv") for three in threes.split()
}
"""ISO 639-2 and 639-3 to 639-1, of languages that have a voice."""


@dataclass(frozen=True, slots=True)
class VoiceEntry:
    """One voice of espeak-ng."""

    code: str
    """Language code (BCP 47, lower case) of this voice only."""
    name: str
    """Language and region in English."""
    identifier: str
    """File of the voice below ``lang/``, such as ``roa/fr``: the name by which espeak-ng finds it."""
    codes: tuple[tuple[int, str], ...]
    """All its codes, each with its priority."""


@dataclass(frozen=True, slots=True)
class Catalogue:
    """All voices, by language code."""

    entries: tuple[VoiceEntry, ...]
    variants: tuple[str, ...] = ()
    """Names of speakers for any voice: ``f3`` is a woman, ``Andy`` a man."""

    @classmethod
    def of(
        cls, voices: Iterable[tuple[str, str, Sequence[tuple[int, str]]]], variants: Iterable[str] = ()
    ) -> "Catalogue":
        """Make a catalogue.

        Parameters
        ----------
        voices : iterable of (str, str, sequence of (int, str))
            Name, identifier, and codes with priorities. A voice's first code is its own, unless another voice has the
            same: then each is named after the last part of its identifier.
        variants : iterable of str
            Names of speakers for any voice.
        """
        listed = [
            (name.strip(), identifier, tuple((priority, code.lower()) for priority, code in codes))
            for name, identifier, codes in voices
        ]
        firsts = [codes[0][1] for _, _, codes in listed]
        entries = []
        for name, identifier, codes in listed:
            last_part = identifier.rpartition("/")[2].lower()
            own = codes[0][1] if firsts.count(codes[0][1]) == 1 else last_part
            known = {code for _, code in codes}
            extra = tuple((_LAST_PRIORITY, code) for code in dict.fromkeys((own, last_part)) if code not in known)
            entries.append(VoiceEntry(own, name, identifier, codes + extra))
        return cls(tuple(sorted(entries, key=lambda entry: entry.code)), tuple(sorted(variants)))

    def find(self, asked: str) -> VoiceEntry:
        """Find the voice for a code.

        Parameters
        ----------
        asked : str
            A language code in any spelling (``fr``, ``pt-PT``, ``en_US``, ``de_DE.UTF-8``), or an identifier
            (``roa/fr``); with the name of a speaker after a plus sign (``fr+f3``), that one speaks.
        """
        language, _, speaker = asked.partition("+")
        if speaker:
            entry = self.find(language)
            known = {variant.lower(): variant for variant in self.variants}
            if speaker.strip().lower() not in known:
                near = get_close_matches(speaker, self.variants, n=5, cutoff=0.3) or self.variants[:10]
                raise UsageError(f"voice: got {asked!r}, expected a speaker after the + such as {', '.join(near)}")
            return replace(entry, identifier=f"{entry.identifier}+{known[speaker.strip().lower()]}")
        wanted = asked.strip().lower()
        for entry in self.entries:
            if wanted in (entry.code, entry.identifier.lower()):
                return entry
        tag = re.split(r"[.@]", wanted.replace("_", "-"), maxsplit=1)[0]
        if _TAG.fullmatch(tag):
            language, _, rest = tag.partition("-")
            for candidate in (tag, f"{_OTHER_NAMES.get(language, language)}{'-' if rest else ''}{rest}"):
                if found := self._longest(candidate):
                    return found
        codes = [entry.code for entry in self.entries]
        near = get_close_matches(wanted, codes, n=5, cutoff=0.3) or codes[:10]
        raise UsageError(f"voice: got {asked!r}, expected a language code such as {', '.join(near)}")

    def of_language(self, named: str) -> str | None:
        """Code of the voice for a language as other programs name it; None if there is none.

        Parameters
        ----------
        named : str
            A code of ISO 639-1, -2 or -3, with or without a region, or an English name (``french``).
        """
        wanted = named.strip().lower()
        language, dash, region = wanted.replace("_", "-").partition("-")
        code = f"{_TWO_LETTERS.get(language, language)}{dash}{region}"
        if code in ("en", "english"):
            return DEFAULT_VOICE
        names = [entry for entry in self.entries if wanted in re.findall(r"[^\W\d_]+", entry.name.lower())]
        names.sort(key=lambda entry: not entry.name.lower().startswith(wanted))
        for candidate in (code, *(entry.code.partition("-")[0] for entry in names[:1])):
            try:
                self.find(candidate)
            except UsageError:
                continue
            return candidate
        return None

    def _longest(self, tag: str) -> VoiceEntry | None:
        while tag:
            ranks = [
                (priority, tag != entry.code, entry.code, entry)
                for entry in self.entries
                for priority, code in entry.codes
                if code == tag
            ]
            if ranks:
                exact = [rank for rank in ranks if not rank[1]]
                return min(exact or ranks, key=lambda rank: rank[:3])[3]
            tag = tag.rpartition("-")[0]
        return None
