"""Marks of words as espeak-ng gives them, made marks of whole words of the text."""

from collections.abc import Sequence

from fapengine.speech.text.words import attribute

Event = tuple[int, int, int, int, bytes]
"""Sample, kind, position in the text from 1, length, name of the phone."""
WORD, PHONEME = 1, 7
"""Kinds of events (speak_lib.h)."""


def with_whole_words(events: Sequence[Event], text: str) -> list[Event]:
    """Return the events with marks of words that are whole words, more of them where the voice joined some.

    Parameters
    ----------
    events : sequence of Event
        As the library gave them.
    text : str
        What was spoken, with spaces in the place of tags.
    """
    marks: list[tuple[int, int]] = []
    for _, kind, position, _, name in events:
        if kind == WORD:
            marks.append((position - 1, 0))
        elif marks and _is_phone(kind, name):
            marks[-1] = (marks[-1][0], marks[-1][1] + 1)
    attributed = iter(attribute(text, marks))
    whole: list[Event] = []
    waiting: list[tuple[int, int, int]] = []  # phones until then, position, length
    for event in events:
        if event[1] == WORD:
            waiting, before = [], 0
            for word, phones in next(attributed):
                waiting.append((before, word.start + 1, word.stop - word.start))
                before = phones
            _, position, length = waiting.pop(0)
            whole.append((event[0], WORD, position, length, b""))
            continue
        if waiting and _is_phone(event[1], event[4]):
            left, position, length = waiting[0]
            if left == 0:
                whole.append((event[0], WORD, position, length, b""))
                waiting.pop(0)
                if waiting:
                    waiting[0] = (waiting[0][0] - 1, *waiting[0][1:])
            else:
                waiting[0] = (left - 1, position, length)
        whole.append(event)
    return whole


def _is_phone(kind: int, name: bytes) -> bool:
    return kind == PHONEME and name[:1] not in (b"", b"\0", b"(")
