"""Words with times, as a TTS reports them: their phones, and the inline cues between them.

Theory of operation
-------------------
A word's phones are a voice's, fitted into the word's time; so what is shown is what is written. The recognizer says
*when* each phone is spoken: its phones are aligned with the word's by edit distance, with visual distance as the cost
(:func:`fapengine.speech.ipa.distance`). A phone that was recognized is moved to within :data:`SURE_S` of the
recognized time, if that is no farther than :data:`MAX_MOVE_S`; the others follow in proportion. Before, after and
between words the recognizer's own phones are shown: a laugh, or sounds for which the TTS has no word.

On 20 sentences of GRID, word times that are 20 ms off (standard deviation) put the onsets of p b m f v 18 ms off
without the recognizer and 11 ms with it; 40 ms off, 28 and 18; those of the aligner that also made the reference, 5
and 8 (``python -m design.word_times``).

Inline cues of a text are applied when their words come: the TTS has the words, the face the cues.

Phones of a recognizer, the last of which may still change, go to the engine likewise: :class:`ChangingPhones`.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from fapengine.engine.commands import Append, Command, End
from fapengine.engine.gestures import commands_of
from fapengine.speech import ipa
from fapengine.speech.marks import BRIEF_S, Feel, MarkedText, TimedMark, read_marks
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.speech.text.normal_form import same_word

MAX_MOVE_S = 0.08
"""Time by which the recognizer moves a phone at most."""
SURE_S = 0.015
"""Uncertainty of the recognizer: no reason to move."""
ALIKE = 1.6
"""Largest distance of two phonemes that count as the same."""
LEFT_OUT = 1.2
"""Cost of a phone that has no counterpart."""
MIN_PHONE_S = 0.015
NEAR_S = 0.06
"""Gap between two words that belongs to the word before."""
CHARACTER_S = 0.065
"""Duration of a character if no word has a time: 160 words per minute of six characters each."""


@dataclass(frozen=True, slots=True)
class TimedWord:
    """A word with its time."""

    text: str
    start_s: float
    """Time from the utterance's first sample."""
    end_s: float | None = None
    """None if the TTS does not report it: until the next word, but no longer than it takes to say."""


@dataclass(slots=True)
class WordQueue:
    """The words of one utterance that are not shown yet. Stateful."""

    end_s: float = 0.0
    """Time up to which words are known."""
    _words: list[list[Phone]] = field(default_factory=list)
    """Phones of each word, in order."""

    def add(
        self,
        words: Sequence[TimedWord],
        pronounce: Callable[[Sequence[tuple[str, float, float]]], Sequence[Phone]],
        told_s: float,
    ) -> None:
        """Add words that follow; those that come too late, before ``told_s``, are not shown."""
        now_s = max(self.end_s, told_s)
        timed: list[tuple[str, float, float]] = []
        for word, following in zip(words, [*words[1:], None], strict=True):
            start_s = max(word.start_s, now_s)
            end_s = word.end_s
            if end_s is None:
                said_s = 0.08 * max(len(word.text), 2)
                end_s = start_s + said_s if following is None else min(start_s + 2 * said_s, following.start_s)
            if end_s - start_s >= MIN_PHONE_S and word.text.strip():
                timed.append((word.text, start_s, end_s))
                now_s = end_s
        for phone in pronounce(timed) if timed else ():
            if not phone.is_silence:
                first = timed[bisect_left([start_s for _, start_s, _ in timed], phone.start_s + 1e-6) - 1][1]
                if self._words and phone.start_s > first and self._words[-1][-1].end_s > first:
                    self._words[-1].append(phone)
                else:
                    self._words.append([phone])
        self.end_s = now_s if timed else self.end_s

    def phones(self, heard: Sequence[Phone], from_s: float, until_s: float) -> list[Phone]:
        """Return the phones to be shown next.

        Parameters
        ----------
        heard : sequence of Phone
            The recognizer's, in order.
        from_s : float
            Time up to which phones were chosen before.
        until_s : float
            Phones that begin earlier are chosen.

        Returns
        -------
        list of Phone
            In order, without overlap; gaps are silence.
        """
        chosen: list[Phone] = []
        now_s = from_s
        while now_s < until_s:
            word = self._words[0] if self._words else None
            begins_s = word[0].start_s if word else np.inf
            between = self.before_next(heard, now_s, until_s)
            if between:
                chosen += between
                now_s = between[-1].end_s
                continue
            if word is None or begins_s >= until_s:
                break
            self._words.pop(0)
            moved = adjusted(word, heard)
            chosen += [replace(p, start_s=max(p.start_s, now_s)) for p in moved if p.end_s > now_s]
            now_s = max(now_s, moved[-1].end_s)
        return chosen

    def before_next(self, heard: Sequence[Phone], from_s: float, until_s: float) -> list[Phone]:
        """Return phones of the recognizer between ``from_s`` and the next word that begin before ``until_s``."""
        begins_s = self._words[0][0].start_s if self._words else np.inf
        if begins_s <= from_s + NEAR_S:
            return []
        return [
            replace(phone, start_s=max(phone.start_s, from_s), end_s=min(phone.end_s, begins_s))
            for phone in heard
            if phone.end_s > from_s and phone.start_s < min(begins_s - NEAR_S, until_s)
        ]


def adjusted(word: Sequence[Phone], heard: Sequence[Phone]) -> list[Phone]:
    """Move the phones of a word to where a recognizer has heard them.

    Parameters
    ----------
    word : sequence of Phone
        At least one; without gaps.
    heard : sequence of Phone
        Phones of the recognizer around it; without any, nothing is moved.

    Returns
    -------
    list of Phone
        The word's phones, without gaps, at least :data:`MIN_PHONE_S` long if there is room.

    Examples
    --------
    >>> word = [Phone("m", 0.1, 0.2), Phone("a", 0.2, 0.3)]
    >>> moved = adjusted(word, [Phone("m", 0.12, 0.24), Phone("ɑ", 0.24, 0.31)])
    >>> [(phone.label, round(phone.start_s, 2), round(phone.end_s, 2)) for phone in moved]
    [('m', 0.1, 0.22), ('a', 0.22, 0.3)]
    """
    first_s, last_s = word[0].start_s - MAX_MOVE_S, word[-1].end_s + MAX_MOVE_S
    near = [phone for phone in heard if not phone.is_silence and phone.end_s > first_s and phone.start_s < last_s]
    if not near or near[-1].end_s < word[-1].end_s - MAX_MOVE_S:
        return list(word)  # the recognizer is not that far
    edges_s = [phone.start_s for phone in word] + [word[-1].end_s]
    moved: dict[int, float] = {}
    pairs = _counterparts(word, near)
    for index, other in pairs:
        for edge, heard_s in ((index, near[other].start_s), (index + 1, near[other].end_s)):
            away_s = heard_s - edges_s[edge]
            if edge in (index, len(word)) and abs(away_s) <= MAX_MOVE_S:
                moved[edge] = edges_s[edge] + np.sign(away_s) * max(abs(away_s) - SURE_S, 0.0)
    known = sorted(moved)
    shifts_s = [moved[index] - edges_s[index] for index in known]
    if not known:
        return list(word)
    placed = np.asarray(edges_s) + np.interp(range(len(edges_s)), known, shifts_s)
    room_s = min(MIN_PHONE_S, (placed[-1] - placed[0]) / len(word))
    if room_s <= 0:
        return list(word)
    for index in range(1, len(placed)):
        placed[index] = max(placed[index], placed[index - 1] + room_s)
    return [
        replace(phone, start_s=max(float(start_s), 0.0), end_s=float(end_s))
        for phone, start_s, end_s in zip(word, placed, placed[1:], strict=False)
    ]


def _counterparts(word: Sequence[Phone], heard: Sequence[Phone]) -> list[tuple[int, int]]:
    """Pair phones of a word with recognized ones; those around it belong to other words."""
    starts_s, heard_s = ([phone.start_s for phone in phones] for phones in (word, heard))
    unlike = np.array([[_unlike(phone.label, other.label) for other in heard] for phone in word])
    changes = unlike + 0.3 * np.abs(np.subtract.outer(starts_s, heard_s)) / MAX_MOVE_S
    return [pair for pair in ipa.counterparts(changes.tolist(), LEFT_OUT, 0.3) if unlike[pair] <= ALIKE]


@lru_cache(maxsize=4096)
def _unlike(label: str, other: str) -> float:
    """Visual distance of two labels; of their nearest phonemes if there are several."""
    letters, others = ipa.letters(label) or ("ə",), ipa.letters(other) or ("ə",)
    return min(ipa.distance(one, another) for one in letters for another in others)


@dataclass(slots=True)
class MarkTimer:
    """Texts in, then their words with times; commands out with times. Stateful.

    Examples
    --------
    >>> timer = MarkTimer()
    >>> timer.expect("Well, [nod] yes.")
    'Well, yes.'
    >>> timer.word("Well,", 0.1), [at_s for at_s, _ in timer.word("yes.", 0.5)]
    ([], [0.5, 0.7])
    """

    _texts: deque[MarkedText] = field(default_factory=deque)
    _cursor: int = 0
    """Character of the first text up to which words have come."""
    _given: int = 0
    """Number of cues of the first text that were applied."""

    def expect(self, text: str) -> str:
        """Add the next text that will be spoken; return it without its cues."""
        marked = read_marks(text)
        self._texts.append(marked)
        return marked.text

    def word(self, word: str, start_s: float) -> list[tuple[float, Command]]:
        """Add the time of the next word; return the commands that are due with it, with their times."""
        wanted, told = same_word(word), []
        while self._texts:
            marked = self._texts[0]
            found = marked.text.casefold().find(wanted, self._cursor)
            if found >= 0 or len(self._texts) == 1:
                until = max(found, self._cursor)
                told += self._due(marked, until, start_s)
                self._cursor = found + len(wanted) if found >= 0 else self._cursor
                break
            told += self.over(start_s)  # a word of the next text
        return told

    def over(self, end_s: float) -> list[tuple[float, Command]]:
        """End a text; return the commands after its last word, with their times."""
        if not self._texts:
            return []
        marked = self._texts[0]
        told = self._due(marked, len(marked.text), end_s)
        self._texts.popleft()
        self._cursor = self._given = 0
        return told

    def estimated(self) -> list[tuple[float, Command]]:
        """Stop waiting for words; return the commands of all texts, at times estimated from their characters."""
        told, start_s = [], 0.0
        while self._texts:
            marked = self._texts[0]
            for mark in marked.marks[self._given :]:
                told += self._due(marked, mark.at, start_s + CHARACTER_S * mark.at)
            start_s += CHARACTER_S * len(marked.text)
            self.over(start_s)
        return told

    def clear(self) -> None:
        """Drop all texts."""
        self._texts.clear()
        self._cursor = self._given = 0

    def _due(self, marked: MarkedText, until: int, at_s: float) -> list[tuple[float, Command]]:
        """Return the commands of the cues up to a character."""
        timed = []
        while self._given < len(marked.marks) and marked.marks[self._given].at <= until:
            mark = marked.marks[self._given]
            self._given += 1
            lasting = (
                later.at
                for later in marked.marks[self._given :]
                if isinstance(later.act, Feel) and not later.act.is_brief
            )
            is_brief = not isinstance(mark.act, Feel) or mark.act.is_brief
            letters = next(lasting, len(marked.text)) - mark.at
            shown_s = BRIEF_S if is_brief else max(CHARACTER_S * letters, BRIEF_S)
            timed.append(TimedMark(at_s, mark.act, at_s + shown_s))
        return commands_of(timed)


OPEN_S = 0.01
"""Time by which a phone that is not over is taken to last longer: of 0, 10, 20 and 40 ms the best for 32 recordings of
flite by the small network, 0.25 s after the sound (mean r .897, .899, .896, .888)."""


@dataclass(slots=True)
class ChangingPhones:
    """Phones of one utterance. Stateful: it remembers which of them the engine has.

    Examples
    --------
    >>> phones = ChangingPhones(1)
    >>> phones.append([], [Phone("m", 0.0, 0.1)]).revision
    0
    >>> changed = phones.append([Phone("b", 0.0, 0.08)], [Phone("a", 0.08, 0.2)])
    >>> changed.first_index, changed.revision, [phone.label for phone in changed.phones]
    (0, 1, ['b', 'a'])
    """

    utterance: int
    """The engine's number."""
    count: int = 0
    """Number of its final phones."""
    partial: tuple[Phone, ...] = ()
    """Phones after these, as the engine has them."""
    revision: int = 0

    def append(self, final: Sequence[Phone], partial: Sequence[Phone] = ()) -> Append | None:
        """Add final phones, and replace those that may have changed.

        Parameters
        ----------
        final, partial : sequence of Phone
            In the utterance's time: the next final phones, and those after them that may still change.

        Returns
        -------
        Append or None
            What the engine does not have yet.
        """
        if partial and not partial[-1].is_silence:  # it is not over yet
            partial = [*partial[:-1], replace(partial[-1], end_s=partial[-1].end_s + OPEN_S)]
        phones, known = (*final, *partial), self.partial
        if not phones and any(not phone.is_silence for phone in known):  # all of them were taken back
            phones = (Phone(SILENCE, known[0].start_s, known[-1].end_s),)
        if not phones:
            return None
        is_longer = phones[: len(known)] == known
        first = len(known) if is_longer else 0
        first_index = self.count + first
        self.count += len(final)
        self.partial = phones[len(final) :]
        if not phones[first:]:
            return None
        self.revision += not is_longer
        return Append(self.utterance, first_index, phones[first:], self.revision, keeps_earlier=True)

    def end(self, duration_s: float) -> End:
        """Return the command that ends the utterance, with its length in s."""
        return End(self.utterance, self.count + len(self.partial), duration_s, self.revision)
