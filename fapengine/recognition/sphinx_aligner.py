"""The aligner, which knows the text: PocketSphinx finds the times of its phones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.recognition import sphinx
from fapengine.recognition.loudness import HOP, loudness_db

BEAMS = (1e-48, 1e-300)
"""Beams of the first try and, if it fails, of the second, which cuts off nothing (as 1e-120 still did)."""
SILENCES = (0.005, 1e-6, 1e-10)
"""Probabilities of a pause between two words: of the first try, and in another language of others if its pauses are not
quiet. Sounds that the model does not know are taken for pauses otherwise."""
NOISES = {True: 1e-8, False: 1e-100}
"""Probabilities of a noise, with the dictionary and without: noises fit any audio, also that of other languages."""
PAUSE_DB, SOUND_DB = 20.0, 35.0
"""Ranges below the loud frames (their 95th percentile): no pause is within the first, no sound below the second."""
MAX_STOP = 12
"""Frames of the longest stop, in which it may be quiet."""
MAX_AGAINST = 6
"""Frames that may be against loudness before other tries are made: 60 ms."""
LOUD_DB = 25.0
"""Range below the loudest frames in which a frame counts as speech, where words are placed by loudness."""
TINY = 1e-300
"""Lower bound of a word's likelihood, so that its logarithm is finite."""
_OWN = "fapengine_"
"""Prefix of names outside any dictionary."""


@dataclass(frozen=True, slots=True)
class Aligned:
    """One phone of a word of the text."""

    word: int
    """Index of the word."""
    label: str
    """IPA."""
    stress: int
    first: int
    """First frame of 10 ms."""
    end: int
    """Frame after its last."""
    model: str
    """Phones of the model that it was aligned as."""


class SphinxAligner:
    """Finds the phones of a text in its audio. Stateful: it has learned the text's words.

    Parameters
    ----------
    words : sequence of str
        The text, as of :func:`.sphinx.words_of`.
    pronounce : callable, optional
        Speaks words that the dictionary lacks.
    dictionary : bool
        Look words up in the model's dictionary (American English); otherwise ``pronounce`` speaks all.
    """

    def __init__(
        self, words: Sequence[str], pronounce: sphinx.Pronounce | None = None, *, dictionary: bool = True
    ) -> None:
        if not words:
            raise UsageError("text: contains no words")
        self.words = tuple(words)
        self.dictionary = dictionary
        """Whether words come from the model's dictionary, which is of its own language."""
        self._decoders = {(SILENCES[0], BEAMS[0]): self._new_decoder(SILENCES[0], BEAMS[0])}
        self._first = self._decoders[SILENCES[0], BEAMS[0]]
        self._own: dict[str, tuple[str, sphinx.Pronunciation]] = {}
        self.pronounced: tuple[str, ...] = ()
        """Words that the dictionary lacks, which ``pronounce`` spoke; of English alone."""
        for word in dict.fromkeys(self.words):
            if not (dictionary and self._lookup(word)):
                spoken = sphinx.of_voice(pronounce(word)) if pronounce else sphinx.Pronunciation((), ())
                self._own[word] = f"{_OWN}{len(self._own)}", spoken
        if strange := [word for word, (_, spoken) in self._own.items() if not spoken.spelling]:
            raise UsageError(f"text: got {', '.join(map(repr, strange[:10]))}, expected words that can be pronounced")
        if dictionary:
            self.pronounced = tuple(self._own)
        self._learn(self._first)

    def take(self, words: Sequence[str]) -> None:
        """Change the text to words that the dictionary has."""
        self.words = tuple(words)

    def model_phones(self, index: int) -> list[str]:
        """Phones of the model for one word."""
        return self._pronunciation(index).spelling.split()

    def align(self, samples: NDArray[np.int16], first: int, end: int) -> list[Aligned]:
        """Find the phones of some words in a piece of sound.

        Parameters
        ----------
        samples : (N,) int16
            At :data:`.protocol.RATE_HZ`.
        first, end : int
            First of the words, and the one after the last.

        Returns
        -------
        list of Aligned
            In order; between them is silence. Where the model fails twice, words are placed by loudness.
        """
        if first >= end:
            return []
        keys = [self._key(word) for word in self.words[first:end]]
        best: tuple[int, list[Aligned]] | None = None
        for silence in SILENCES[:1] if self.dictionary else SILENCES:
            found = self._aligned(samples, keys, first, silence)
            if found is not None:
                found = found if self.dictionary else without_quiet(found, samples)
                against = against_loudness(found, samples)
                if best is None or against < best[0]:
                    best = against, found
            if best is None or best[0] <= MAX_AGAINST:
                break
        return best[1] if best else self.placed(samples, first, end)

    def misfit(self, samples: NDArray[np.int16], first: int, end: int) -> float:
        """Compare how badly some words fit a piece of sound with how badly they do in other orders.

        Noise and a telephone make both worse. Parameters are those of :meth:`align`: mono samples, (N,) int16.

        Returns
        -------
        float
            Negative logarithm of the acoustic likelihood over its mean in three other orders, at most 1. 1 without
            another order.
        """
        keys = [self._key(word) for word in self.words[first:end]]
        mixed = keys[1::2] + keys[::2]
        others = [order for order in (keys[::-1], mixed, mixed[::-1]) if order != keys]
        own = self._cost(samples, keys)
        costs = [cost for cost in (self._cost(samples, order) for order in others) if isfinite(cost)]
        return min(own / float(np.mean(costs)), 1.0) if costs else 1.0

    def _cost(self, samples: NDArray[np.int16], keys: Sequence[str]) -> float:
        decoder = self._decoder(SILENCES[0], BEAMS[-1])
        try:
            decoder.set_align_text(" ".join(keys))
            sphinx.decode(decoder, samples)
        except RuntimeError:
            return inf
        if decoder.hyp() is None:
            return inf
        return -sum(log(max(segment.ascore, TINY)) for segment in decoder.seg())

    def _aligned(
        self, samples: NDArray[np.int16], keys: Sequence[str], first: int, silence: float
    ) -> list[Aligned] | None:  # fmt: skip
        for beam in BEAMS:
            found = self._try(self._decoder(silence, beam), samples, keys, first)
            if found is not None:
                return found
        return None

    def _decoder(self, silence: float, beam: float) -> Any:
        """Decoder that has learned the words, made when it is needed first."""
        if (silence, beam) not in self._decoders:
            self._decoders[silence, beam] = self._new_decoder(silence, beam)
            self._learn(self._decoders[silence, beam])
        return self._decoders[silence, beam]

    def placed(self, samples: NDArray[np.int16], first: int, end: int) -> list[Aligned]:
        """Spread words evenly over the loud parts of a piece, (N,) int16, if they cannot be aligned."""
        levels = loudness_db(samples)
        loud = np.flatnonzero(levels >= levels.max(initial=-100.0) - LOUD_DB)
        units = [
            (index, label, stress, names)
            for index, spoken in ((index, self._pronunciation(index)) for index in range(first, end))
            for (label, stress), names in zip(spoken.phones, spoken.model, strict=True)
        ]
        if not len(loud) or len(loud) < len(units):
            return []
        edges = loud[np.linspace(0, len(loud) - 1, len(units) + 1).round().astype(int)].tolist()
        return [
            Aligned(index, label, stress, start, stop, " ".join(names))
            for (index, label, stress, names), start, stop in zip(units, edges, edges[1:], strict=False)
            if stop > start
        ]

    def _pronunciation(self, index: int) -> sphinx.Pronunciation:
        word = self.words[index]
        return self._own[word][1] if word in self._own else sphinx.of_dictionary(self._lookup(word).split())

    def _try(self, decoder: Any, samples: NDArray[np.int16], keys: Sequence[str], first: int) -> list[Aligned] | None:
        try:
            decoder.set_align_text(" ".join(keys))
            sphinx.decode(decoder, samples)  # words first
            if decoder.hyp() is None:
                return None
            decoder.set_alignment()
            sphinx.decode(decoder, samples)  # then the phones inside them
            alignment = decoder.get_alignment()
        except RuntimeError:  # its only word for everything
            return None
        spoken = [
            (word.name, [(phone.name, phone.start, phone.start + phone.duration) for phone in word])
            for word in alignment
            if not word.name.startswith(("<", "+", "["))
        ]
        if [name.split("(")[0] for name, _ in spoken] != list(keys):
            return None
        return [
            aligned
            for index, (_, phones) in enumerate(spoken, start=first)
            for aligned in self._phones(index, phones, -(-len(samples) // HOP))
        ]

    def _phones(self, index: int, phones: Sequence[tuple[str, int, int]], frames: int) -> list[Aligned]:
        word = self.words[index]
        if word not in self._own:
            return [Aligned(index, sphinx.ipa_of(name), 0, a, min(b, frames), name) for name, a, b in phones]
        spoken = self._own[word][1]
        found: list[Aligned] = []
        at = 0
        for (label, stress), names in zip(spoken.phones, spoken.model, strict=True):
            if names:  # a glottal stop has none, and is a part of the next phone
                end = min(phones[at + len(names) - 1][2], frames)
                found.append(Aligned(index, label, stress, phones[at][1], end, " ".join(names)))
                at += len(names)
        return found

    def _new_decoder(self, silence: float, beam: float) -> Any:
        return sphinx.new_aligner(
            beam=beam, silence=silence, noise=NOISES[self.dictionary], is_comparable=beam == BEAMS[-1]
        )

    def _lookup(self, word: str) -> str:
        return self._first.lookup_word(sphinx.dictionary_key(word)) or ""

    def _key(self, word: str) -> str:
        return self._own[word][0] if word in self._own else sphinx.dictionary_key(word)

    def _learn(self, decoder: Any) -> None:
        for number, (key, spoken) in enumerate(self._own.values(), start=1):
            decoder.add_word(key, spoken.spelling, number == len(self._own))  # the last one rebuilds the search


def against_loudness(aligned: Sequence[Aligned], samples: NDArray[np.int16]) -> int:
    """Count the frames with a loudness that contradicts an alignment of a piece, (N,) int16.

    They are aligned as a pause and are loud, or as a phone in a quiet that is longer than any stop.
    """
    levels = loudness_db(samples)
    top = np.percentile(levels, 95)
    pause = np.ones(len(levels), dtype=bool)
    for phone in aligned:
        pause[phone.first : phone.end] = False
    quiet = sum(int((~pause[a:b]).sum()) for a, b in _quiet(levels))
    return int((pause & (levels > top - PAUSE_DB)).sum()) + quiet


def without_quiet(aligned: Sequence[Aligned], samples: NDArray[np.int16]) -> list[Aligned]:
    """Cut quiet that is longer than any stop from phones; ``samples`` are (N,) int16."""
    phones = list(aligned)
    for first, end in _quiet(loudness_db(samples)):
        for index, phone in enumerate(phones):
            before, after = max(first - phone.first, 0), max(phone.end - end, 0)
            if phone.first >= end or phone.end <= first or not before + after:
                continue
            if before >= after:
                phones[index] = replace(phone, end=first)
            else:
                phones[index] = replace(phone, first=end)
    return phones


def _quiet(levels: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Parts of a piece, first frame and the one after the last, that are quiet for longer than a stop is."""
    quiet = levels < np.percentile(levels, 95) - SOUND_DB
    edges = np.flatnonzero(np.diff(quiet, prepend=False, append=False))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= MAX_STOP]
