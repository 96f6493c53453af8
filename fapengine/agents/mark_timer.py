"""Marks of texts that a voice is about to speak, told when their words come: the TTS has one, the face the other."""

from collections import deque
from dataclasses import dataclass, field

from fapengine.live.engine.commands import Command
from fapengine.live.engine.marked import commands_of
from fapengine.speech.marks import BRIEF_S, Feel, MarkedText, TimedMark, read_marks
from fapengine.speech.text.normal_form import same_word

CHARACTER_S = 0.065
"""Time that a character takes to be said, where no word's time is known: 160 words a minute of six characters each."""


@dataclass(slots=True)
class MarkTimer:
    """Texts in, then their words as they are told; commands out with times. Stateful.

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
    """Character of the first text up to which words were told."""
    _given: int = 0
    """Marks of the first text that were given."""

    def expect(self, text: str) -> str:
        """Take the next text that will be spoken; returns it without its marks."""
        marked = read_marks(text)
        self._texts.append(marked)
        return marked.text

    def word(self, word: str, start_s: float) -> list[tuple[float, Command]]:
        """Learn when the next word begins; returns what is told with it: time and command."""
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
        """Learn that a text was said; returns what stood behind its last word."""
        if not self._texts:
            return []
        marked = self._texts[0]
        told = self._due(marked, len(marked.text), end_s)
        self._texts.popleft()
        self._cursor = self._given = 0
        return told

    def estimated(self) -> list[tuple[float, Command]]:
        """Give up waiting for words, and tell the marks of all texts at times that their characters suggest."""
        told, start_s = [], 0.0
        while self._texts:
            marked = self._texts[0]
            for mark in marked.marks[self._given :]:
                told += self._due(marked, mark.at, start_s + CHARACTER_S * mark.at)
            start_s += CHARACTER_S * len(marked.text)
            self.over(start_s)
        return told

    def clear(self) -> None:
        """Forget all texts: they will not be said."""
        self._texts.clear()
        self._cursor = self._given = 0

    def _due(self, marked: MarkedText, until: int, at_s: float) -> list[tuple[float, Command]]:
        """Give the marks up to a character."""
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
