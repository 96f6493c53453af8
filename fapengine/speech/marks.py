"""Marks: inline cues of a text for expressions, gestures and loudness; without them the text is for any voice.

Theory of operation
-------------------
Language models are instructed to write how a sentence should be said. Four notations are read:

- the marker of LiveKit Agents: ``<expr type="expression" label="say playfully"/>``, also ``sound``, ``break`` and
  ``prosody`` (around words);
- words in brackets, as for ElevenLabs and Fish: ``[laughs]``, ``[whispering]``, ``[nod]``; unknown ones stay text;
- emoji with a face;
- ``<mark name="joy:0.6"/>``, and in SSML also ``break``, ``emphasis`` and ``prosody``.

``[word]{IPA}`` gives the sounds of a word; for a voice it is SSML's ``phoneme``. Braces that hold anything but IPA,
arguments of a command of LaTeX, and an index after a name (``a[i]{x}``) are text.

:func:`read_marks` removes them and keeps the character of the remaining text before which each stood. Once the words
are spoken, :func:`timed_marks` finds the times. A delivery ("happy") lasts until the next one; a laugh, an emoji and a
gesture have their own duration.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape, unescape
from itertools import groupby, pairwise
from operator import attrgetter

from fapengine._arrays import read_tables
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.speech import ipa
from fapengine.speech.phone_track import LOUDNESS_DB, Phone
from fapengine.speech.text.normal_form import same_word

GESTURES = ("nod", "shake", "blink", "left", "right", "up", "down")
"""A nod, a shake of the head, a blink, glances to the subject's left and right, up and down."""
BRIEF_S = 1.6
"""Duration of a laugh or an emoji."""
MAX_LEVEL = 2.0

_TABLES = read_tables("fapengine.speech", "marks.toml")
_FEELINGS = tuple((stem, Expression[name.upper()], level) for stem, (name, level) in _TABLES["feelings"].items())
_LOUDNESS_DB: dict[str, float] = _TABLES["loudness"]
_EMOJI = {
    face: (Expression[name.upper()], level) for faces, (name, level) in _TABLES["emoji"].items() for face in faces
}
_SMALLER = re.compile(r"\b(slight|a little|a bit|mild|somewhat)")
_GREATER = re.compile(r"\b(really|very|extreme|so)\b")
_SOUNDS = ("laugh", "chuckl", "giggl", "sigh", "gasp", "sob", "cry", "smil", "smirk", "grin")
"""Stems of brief expressions."""
_TAG = r"<(?P<close>/?)(?P<tag>[A-Za-z][\w:-]*)(?P<rest>(?:[^<>\"']|\"[^\"<]*\"|'[^'<]*')*?)(?P<empty>/?)>"
_GIVEN = r"\[(?P<said>[^\[\]{}<>]{1,80})\]\{(?P<ipa>[^{}<>]{0,200})\}"
_MARKS = re.compile(rf"{_TAG}|{_GIVEN}|\[(?P<word>[A-Za-z][A-Za-z ,-]{{1,40}})\]|(?P<emoji>[{''.join(_EMOJI)}])\ufe0f?")
_CODE = re.compile(r"\\[A-Za-z]+\*?(?:\{[^{}]*\})?$|[A-Za-z0-9_)\]]$")
"""A command of LaTeX before its argument in brackets; a name before an index."""
_ATTRIBUTE = re.compile(r"([\w:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_PLAIN_TAGS, _SSML_TAGS = ("expr", "mark"), ("expr", "mark", "emphasis", "prosody")


@dataclass(frozen=True, slots=True)
class Feel:
    """Show an expression; ``NEUTRAL`` removes all."""

    expression: Expression
    level: float
    is_brief: bool = False
    """True for a laugh or an emoji, False for a delivery, which lasts."""


@dataclass(frozen=True, slots=True)
class Gesture:
    """Make one of :data:`GESTURES`."""

    name: str


@dataclass(frozen=True, slots=True)
class Loudness:
    """Open the mouth as for speech that is louder by some dB."""

    db: float


Act = Feel | Gesture | Loudness


@dataclass(frozen=True, slots=True)
class Mark:
    """An act at a place of a text."""

    at: int
    """Index of the character of the plain text after it."""
    act: Act


@dataclass(frozen=True, slots=True)
class TimedMark:
    """An act at a time."""

    at_s: float
    act: Act
    until_s: float
    """End of an expression; gestures have a duration of their own."""


@dataclass(frozen=True, slots=True)
class MarkedText:
    """A text without its marks, and the marks."""

    text: str
    """Text for any voice."""
    marks: tuple[Mark, ...] = ()
    """Marks in order."""
    ssml: str | None = None
    """The text for a voice that speaks SSML, if a mark is for the voice: a pause, emphasis."""
    unknown: tuple[str, ...] = ()
    """Labels without a visible meaning."""
    sounds: tuple[tuple[int, int, str], ...] = ()
    """Start and stop of a word of the plain text, and its sounds in IPA."""
    remarks: tuple[str, ...] = ()
    """Remarks on what looks like a mark and is text."""

    @property
    def with_sounds(self) -> str:
        """The plain text with ``[word]{IPA}``."""
        pieces: list[str] = []
        done = 0
        for start, stop, sounds in self.sounds:
            pieces += [self.text[done:start], f"[{self.text[start:stop]}]{{{sounds}}}"]
            done = stop
        return "".join([*pieces, self.text[done:]])


def read_marks(text: str, *, ssml: bool = False) -> MarkedText:
    """Remove the marks from a text.

    Parameters
    ----------
    ssml : bool
        True for SSML; otherwise tags except ``expr`` and ``mark`` are text.

    Returns
    -------
    MarkedText
        The same text where there is no mark.

    Examples
    --------
    >>> marked = read_marks('[laughs] Oh <expr type="break" label="1s"/> no 😢')
    >>> marked.text, [mark.at for mark in marked.marks], marked.ssml
    ('Oh no', [0, 5], 'Oh <break time="1s"/> no')
    """
    return _Reader(ssml).read(text)


class _Reader:
    """Reads one text. Stateful."""

    def __init__(self, ssml: bool) -> None:
        self._is_ssml = ssml
        self._plain = ""
        self._ssml = ""
        self._marks: list[Mark] = []
        self._unknown: list[str] = []
        self._remarks: list[str] = []
        self._sounds: list[tuple[int, int, str]] = []
        self._is_for_voice = ssml
        self._open: list[tuple[str, str, Loudness | None]] = []
        """Open stretches: name, closing tag for the voice, loudness that ends with it."""

    def read(self, text: str) -> MarkedText:
        last, is_changed = 0, self._is_ssml
        for match in _MARKS.finditer(text):
            before = len(self._marks), len(self._ssml), self._plain
            self._text(text[last : match.start()])
            if self._mark(match):
                last, is_changed = match.end(), True
            else:
                del self._marks[before[0] :]
                self._plain, self._ssml = before[2], self._ssml[: before[1]]
        self._text(text[last:])
        plain = self._plain.strip() if is_changed else text
        if not plain and not self._is_ssml and any(letter.isalnum() for letter in text):
            return MarkedText(text, remarks=tuple(self._remarks))  # words in brackets alone are meant to be said
        voice = self._ssml.strip() if self._is_for_voice else None
        marks = tuple(Mark(min(mark.at, len(plain)), mark.act) for mark in self._marks)
        unknown = tuple(dict.fromkeys(self._unknown))
        return MarkedText(plain, marks, voice, unknown, tuple(self._sounds), tuple(self._remarks))

    def _text(self, piece: str) -> None:
        shown = unescape(piece) if self._is_ssml else piece
        if self._plain.endswith((" ", "\n")) or not self._plain:
            shown = shown.lstrip(" ")
        self._plain += shown
        spoken = piece if self._is_ssml else escape(piece, quote=False)
        self._ssml += spoken.lstrip(" ") if self._ssml.endswith(" ") else spoken

    def _mark(self, match: re.Match[str]) -> bool:
        """Apply a mark; False if it is text."""
        if match["emoji"]:
            self._add(Feel(*_EMOJI[match["emoji"]], is_brief=True))
            return True
        if match["said"]:
            if _CODE.search(match.string, max(match.start() - 40, 0), match.start()):
                return False
            try:
                sounds = check_sounds(match["said"], match["ipa"])
            except UsageError as error:
                self._remarks.append(f"{error}; it was spoken as it stands")
                return False
            start = len(self._plain)
            self._plain += unescape(match["said"]) if self._is_ssml else match["said"]
            self._sounds.append((start, len(self._plain), sounds))
            spoken = match["said"] if self._is_ssml else escape(match["said"], quote=False)
            self._ssml += f'<phoneme alphabet="ipa" ph="{sounds}">{spoken}</phoneme>'
            return True
        if match["word"]:
            return self._describe(match["word"], is_strict=True)
        name = match["tag"].lower()
        if name not in (_SSML_TAGS if self._is_ssml else _PLAIN_TAGS):
            self._ssml += match[0] if self._is_ssml else ""
            return self._is_ssml
        if match["close"]:
            return self._close(name)
        given = {key.lower(): unescape(one or other) for key, one, other in _ATTRIBUTE.findall(match["rest"])}
        if name == "mark":
            self._named(given.get("name", ""))
        elif name == "expr":
            self._expr(given, is_empty=bool(match["empty"]))
        else:
            self._stretch(name, given, match[0], f"</{name}>", is_empty=bool(match["empty"]))
        return True

    def _expr(self, given: dict[str, str], *, is_empty: bool) -> None:
        kind, label = given.get("type", "expression").lower(), given.get("label", given.get("name", ""))
        if kind == "break" and (pause := re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(ms|s)\s*", label)):
            self._is_for_voice = True
            self._ssml += f'<break time="{pause[1]}{pause[2]}"/>'
        elif kind == "prosody":
            tag = _voice_tag(label)
            self._is_for_voice |= bool(tag) and not is_empty
            closing = f"</{tag.split()[0][1:]}>" if tag else ""
            self._stretch("expr", {"level": label, "volume": label}, tag, closing, is_empty=is_empty)
        elif kind in ("expression", "sound"):
            if not self._describe(label, is_strict=False):
                self._unknown.append(label)
        elif not is_empty:
            self._open.append(("expr", "", None))

    def _stretch(self, name: str, given: dict[str, str], opening: str, closing: str, *, is_empty: bool) -> None:
        """Emphasis is a nod, loudness lasts to the end of the stretch."""
        level = given.get("level", "moderate" if name == "emphasis" else "")
        if (name == "emphasis" and level not in ("none", "reduced")) or level in ("emphasis", "emphasized"):
            self._add(Gesture("nod"))
        loudness = next(
            (Loudness(db) for stem, db in _LOUDNESS_DB.items() if stem in given.get("volume", "").lower()), None
        )
        if loudness:
            self._add(loudness)
        if is_empty:
            self._ssml += opening if self._is_ssml and name != "expr" else ""
            return
        self._ssml += opening
        self._open.append((name, closing, loudness))

    def _close(self, name: str) -> bool:
        if not self._open or self._open[-1][0] != name:
            return name == "expr"  # one too many is ignored
        _, closing, loudness = self._open.pop()
        self._ssml += closing
        if loudness:
            self._add(Loudness(0.0))
        return True

    def _named(self, name: str) -> None:
        """Apply ``joy:0.6``, ``nod``, ``look:left``."""
        what, _, level = name.lower().partition(":")
        what, level = (level, "") if what in ("look", "glance") else (what, level)
        expression = next((each for each in Expression if each.label == what), None)
        if what in GESTURES:
            self._add(Gesture(what))
        elif expression is not None and re.fullmatch(r"(\d+(\.\d+)?)?", level):
            self._add(Feel(expression, min(float(level or 1.0), MAX_LEVEL)))
        elif not self._describe(name, is_strict=True):
            self._unknown.append(name)

    def _describe(self, label: str, *, is_strict: bool) -> bool:
        """Apply a description in words; a strict one must be short, so that brackets of a text are not read as one."""
        words = label.lower().strip()
        if is_strict and len(words.split()) > 3:
            return False
        starts = re.findall(r"[a-z]+", words)
        if gesture := next((name for name in ("nod", "shake") if any(word.startswith(name) for word in starts)), None):
            self._add(Gesture(gesture))
            return True
        felt = next((each for each in _FEELINGS if any(word.startswith(each[0]) for word in starts)), None)
        if felt is not None:
            stem, expression, level = felt
            level *= 0.6 if _SMALLER.search(words) else 1.2 if _GREATER.search(words) else 1.0
            self._add(Feel(expression, round(min(level, MAX_LEVEL), 2), is_brief=stem in _SOUNDS))
        loudness = next(
            (db for stem, db in _LOUDNESS_DB.items() if any(word.startswith(stem) for word in starts)), None
        )
        if loudness is not None:
            self._add(Loudness(loudness))
        return felt is not None or loudness is not None

    def _add(self, act: Act) -> None:
        self._marks.append(Mark(len(self._plain), act))


def check_sounds(word: str, sounds: str) -> str:
    """Return the sounds of a word, without the space around them; raise a UsageError if they are not IPA."""
    foreign = ipa.foreign_symbol(sounds)
    if foreign is not None or not any(ipa.letters(char) for char in sounds):
        raise UsageError(
            f"text: got {foreign or sounds!r} in the sounds of {word!r}, expected IPA, as in [tomato]{{təˈmɑːtoʊ}}"
        )
    return sounds.strip()


def _voice_tag(label: str) -> str:
    """SSML tag for a style of speaking; empty if voices do not have it."""
    words = label.lower()
    if "emphas" in words:
        return '<emphasis level="strong">'
    if "slow" in words or "fast" in words:
        return f'<prosody rate="{"slow" if "slow" in words else "fast"}">'
    if "pitch" in words:
        return f'<prosody pitch="{"low" if "low" in words else "high"}">'
    return ""


def words_of(phones: Iterable[Phone]) -> list[tuple[str, float, float]]:
    """Words of phones, with their times.

    Examples
    --------
    >>> words_of([Phone("h", 0.0, 0.1, word="hi"), Phone("aɪ", 0.1, 0.3, word="hi"), Phone("_", 0.3, 0.4)])
    [('hi', 0.0, 0.3)]
    """
    grouped = ((word, list(group)) for word, group in groupby(phones, key=attrgetter("word")))
    return [(word, group[0].start_s, group[-1].end_s) for word, group in grouped if word]


def timed_marks(marked: MarkedText, words: Sequence[tuple[str, float, float]], end_s: float) -> list[TimedMark]:
    """Find the times of marks.

    Parameters
    ----------
    words : sequence of (str, float, float)
        Words as they were spoken, in order, with start and end in s; words that are not in the text are skipped.
    end_s : float
        End of the speech.

    Returns
    -------
    list of TimedMark
        In order; each at the start of the next word, those after the last word at its end.

    Examples
    --------
    >>> marked = read_marks("Well [laughs] that is it.")
    >>> [(mark.at_s, mark.until_s) for mark in timed_marks(marked, [("Well", 0.1, 0.4), ("that", 0.5, 0.8)], 1.0)]
    [(0.5, 2.1)]
    """
    if not marked.marks:
        return []
    places, cursor = [], 0
    text = marked.text.casefold()
    for word, start_s, stop_s in words:
        found = text.find(same_word(word), cursor)
        if found >= 0:
            places.append((found, start_s, stop_s))
            cursor = found + len(word)
    last_s = places[-1][2] if places else 0.0
    timed = [
        (next((start_s for place, start_s, _ in places if place >= mark.at), last_s), mark.act) for mark in marked.marks
    ]
    lasting = [at_s for at_s, act in timed if isinstance(act, Feel) and not act.is_brief]
    until = dict(pairwise([*lasting, max(end_s, last_s)]))
    return [
        TimedMark(at_s, act, until.get(at_s, at_s) if isinstance(act, Feel) and not act.is_brief else at_s + BRIEF_S)
        for at_s, act in timed
    ]


def with_loudness(phones: Sequence[Phone], marks: Iterable[TimedMark]) -> tuple[Phone, ...]:
    """Add the loudness of marks to phones, each from its time on.

    Examples
    --------
    >>> said = with_loudness([Phone("a", 0.0, 0.5), Phone("a", 0.5, 1.0)], [TimedMark(0.5, Loudness(5.0), 1.0)])
    >>> [phone.loudness_db for phone in said]
    [0.0, 5.0]
    """
    changes = [(mark.at_s, mark.act.db) for mark in marks if isinstance(mark.act, Loudness)]
    if not changes:
        return tuple(phones)
    low_db, high_db = LOUDNESS_DB
    louder = []
    for phone in phones:
        db = next((db for at_s, db in reversed(changes) if at_s <= phone.start_s + 1e-6), 0.0)
        louder.append(replace(phone, loudness_db=min(max(phone.loudness_db + db, low_db), high_db)))
    return tuple(louder)
