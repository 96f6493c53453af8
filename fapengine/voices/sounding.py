"""Phones where they sound: the marks of a voice, corrected by its samples.

Theory of operation
-------------------
A voice marks when each phone begins; what it calls the beginning is not always what is heard. espeak-ng, for one, puts
the silence of a stop before its mark (``Generate`` of its ``synthesize.c`` pauses for ``prepause`` and marks then),
and marks a vowel behind a nasal or a liquid when its first part has been spoken. So the marks are a first guess, and
the sound decides, in this order:

1. Marks are put in order of time, and none lies outside the sound.
2. A mark that only adds to the phone before (ʲ, a length) joins its label; its time is the next vowel's if one follows.
3. A mark without a name is a pause where its samples are quiet, and only there: what sounds before the quiet belongs to
   the phone before, what sounds behind it to the phone behind. A quiet shorter than :data:`MIN_PAUSE_S` is none,
   and before a stop a quiet shorter than :data:`MAX_GAP_S` is the stop's closure.
4. A stop or affricate begins where the quiet begins that ends at its mark: there the lips or the tongue close.
5. A vowel behind a nasal or a liquid begins where the sound gets bright (:meth:`SoundLevel.brightens`): there it opens.
6. No phone is lost: one without time of its own takes the quiet around it if it is a stop, else a share of a neighbour.

The phones cover the sound from its beginning to its end.
"""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.voices.sound_level import SoundLevel

MAX_CLOSURE_S = 0.09
"""Farthest that the closure of a stop reaches back from its mark. 9 of 10 measured are shorter than 71 ms (Italian, 160
words a minute); Italian pp takes up to 128, of which the vowel before it keeps the rest."""
CLOSURE_IN_PAUSE_S = 0.06
"""Time that a stop takes of the pause before it; nothing in the sound says when the lips close there."""
MAX_GAP_S = 0.06
"""A nameless quiet that is shorter is the closure of the stop behind it."""
MIN_PAUSE_S = 0.02
"""A shorter quiet between two phones is heard as neither's pause; the phone before keeps it."""
MAX_RISE_S = {"nasal": 0.045, "liquid": 0.02}
"""Farthest that the mark of a vowel lies behind its beginning. Behind nasals 11 to 49 ms were measured (English, 160
words a minute). A liquid or a glide has no sharp end; at least 20 ms of the vowel were spoken before its mark."""
MIN_PHONE_S = 0.005
"""A phone with less time than this has none of its own."""
KEPT = 0.3
"""Share of its time that a phone keeps, whatever its neighbour takes."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Where a voice says that a phone begins."""

    at_s: float
    label: str
    """IPA; empty where the voice marks something without a name."""
    stress: int = 0
    """Stress as of :class:`Phone`."""
    word: str = ""


def sounding(marks: Sequence[Mark], sound: SoundLevel) -> list[Phone]:
    """Turn the marks of a voice into phones that begin where they are heard.

    Parameters
    ----------
    marks : sequence of Mark
        As the voice gave them; each phone lasts until the next mark, the last one until the sound ends.
    sound : SoundLevel
        What was spoken.

    Returns
    -------
    list of Phone
        Without gap or overlap, from 0 to the end of the sound; every named mark has its phone.
    """
    if not sound.duration_s:
        return []
    found = _pauses(_joined(_in_order(marks, sound.duration_s)), sound)
    for index in range(1, len(found)):
        found[index] = replace(found[index], at_s=_heard_s(found, index, sound))
    found = _with_time(found, sound.duration_s)
    ends = [*(mark.at_s for mark in found[1:]), sound.duration_s]
    return [
        Phone(mark.label or SILENCE, mark.at_s, end_s, mark.stress, mark.word if mark.label else "")
        for mark, end_s in zip(found, ends, strict=True)
    ]


def is_addition(label: str) -> bool:
    """Whether a label only adds to the phone before: a length, a palatalisation, a nasality.

    Examples
    --------
    >>> is_addition("ʲ"), is_addition("̃"), is_addition("j"), is_addition("")
    (True, True, False, False)
    """
    return bool(label) and all(unicodedata.category(letter) in ("Mn", "Lm") for letter in label)


def is_stop(label: str) -> bool:
    """Whether the phone begins with a closure: stops, affricates, clicks.

    Examples
    --------
    >>> is_stop("p"), is_stop("tʃ"), is_stop("s"), is_stop("m")
    (True, True, False, False)
    """
    first = _letter(label, 0)
    return first is not None and not first.vowel and first.manner == 0.0


def is_vowel(label: str) -> bool:
    """Whether the phone begins as a vowel."""
    first = _letter(label, 0)
    return first is not None and first.vowel


def ends_as(label: str) -> str:
    """``"nasal"`` or ``"liquid"`` for a phone that ends so, glides with the liquids; empty for all others.

    Behind these a vowel is heard by its brightness.

    Examples
    --------
    >>> ends_as("m"), ends_as("l"), ends_as("s")
    ('nasal', 'liquid', '')
    """
    last = _letter(label, -1)
    if last is None or last.vowel or last.manner < 0.6:
        return ""
    return "nasal" if last.manner == 0.8 else "liquid"


def _letter(label: str, index: int) -> ipa.Sound | None:
    letters = ipa.letters(label) if label and label != SILENCE else ()
    return ipa.SOUNDS[letters[index]] if letters else None


def _in_order(marks: Sequence[Mark], end_s: float) -> list[Mark]:
    """Step 1; what lies before the first mark is nameless."""
    ordered = [Mark(0.0, "")]
    for mark in marks:
        ordered.append(replace(mark, at_s=min(max(mark.at_s, ordered[-1].at_s), end_s)))
    return ordered


def _joined(marks: list[Mark]) -> list[Mark]:
    """Step 2."""
    joined: list[Mark] = []
    begins_s: float | None = None
    for mark in marks:
        if joined and joined[-1].label and is_addition(mark.label):
            joined[-1] = replace(joined[-1], label=joined[-1].label + mark.label)
            begins_s = mark.at_s
            continue
        joined.append(replace(mark, at_s=begins_s) if begins_s is not None and is_vowel(mark.label) else mark)
        begins_s = None
    return joined


def _pauses(marks: list[Mark], sound: SoundLevel) -> list[Mark]:
    """Step 3."""
    found: list[Mark] = []
    starts_s: float | None = None
    for mark in [*marks, None]:
        if mark and not mark.label:
            starts_s = mark.at_s if starts_s is None else starts_s
            continue
        if starts_s is None:
            found += [mark] if mark else []
            continue
        found += _pause_before(mark, found[-1] if found else None, starts_s, sound)
        starts_s = None
    return found


def _pause_before(mark: Mark | None, before: Mark | None, starts_s: float, sound: SoundLevel) -> list[Mark]:
    """Find the pause in a nameless time, if there is one, and the phone behind it, if there is one."""
    quiet_s, loud_s = sound.longest_quiet(starts_s, mark.at_s if mark else sound.duration_s)
    if before and before.at_s == starts_s and is_stop(before.label):  # not released: the quiet is its closure
        quiet_s = min(quiet_s + MAX_CLOSURE_S, loud_s)
    length_s = loud_s - quiet_s
    if mark is None:
        return [Mark(quiet_s if before else 0.0, "")] if length_s or before is None else []
    if before is None:
        return [Mark(0.0, ""), replace(mark, at_s=loud_s)] if loud_s and not quiet_s else [replace(mark, at_s=0.0)]
    if length_s and length_s < MAX_GAP_S and is_stop(mark.label):
        return [replace(mark, at_s=quiet_s)]
    return [mark] if length_s < MIN_PAUSE_S else [Mark(quiet_s, ""), replace(mark, at_s=loud_s)]


def _heard_s(marks: Sequence[Mark], index: int, sound: SoundLevel) -> float:
    """Find where a phone begins: steps 4 and 5."""
    before, mark = marks[index - 1 : index + 1]
    length_s = mark.at_s - before.at_s
    if is_stop(mark.label):
        if not before.label:
            earliest_s = max(before.at_s, mark.at_s - CLOSURE_IN_PAUSE_S)
        else:
            kept = 0.5 if is_stop(before.label) else KEPT
            earliest_s = max(before.at_s + kept * length_s, mark.at_s - MAX_CLOSURE_S)
        return sound.quiet_until(mark.at_s, earliest_s)
    if is_vowel(mark.label) and (sonorant := ends_as(before.label)):
        end_s = marks[index + 1].at_s if index + 1 < len(marks) else sound.duration_s
        earliest_s = before.at_s + KEPT * length_s
        bright_s = sound.brightens(earliest_s, mark.at_s + 0.6 * (end_s - mark.at_s))
        if bright_s is not None:
            return min(max(bright_s, mark.at_s - MAX_RISE_S[sonorant]), mark.at_s)
    return mark.at_s


def _with_time(marks: Sequence[Mark], end_s: float) -> list[Mark]:
    """Step 6: a run of phones without time shares the time of its longer neighbour with it."""
    found: list[Mark] = []
    for index, mark in enumerate(marks):  # pauses without time are none
        if mark.label or (marks[index + 1].at_s if index + 1 < len(marks) else end_s) > mark.at_s:
            found.append(mark)
    onsets = [*(mark.at_s for mark in found), end_s]
    first = 0
    while first < len(found):
        last = first
        while last < len(found) and found[last].label and onsets[last + 1] - onsets[last] < MIN_PHONE_S:
            last += 1
        if last > first:
            _share(onsets, first, last, found)
        first = max(last, first + 1)
    return [replace(mark, at_s=at_s) for mark, at_s in zip(found, onsets, strict=False)]


def _share(onsets: list[float], first: int, last: int, marks: Sequence[Mark]) -> None:
    """Give the phones ``first`` to ``last - 1`` equal parts of a neighbour's time; a pause is asked after a phone."""
    count = last - first
    lengths = {
        index: (bool(marks[index].label), onsets[index + 1] - onsets[index])
        for index in (first - 1, last)
        if 0 <= index < len(marks)
    }
    giver = max(lengths, key=lambda index: lengths[index], default=None)
    taken_s = lengths[giver][1] * count / (count + 2) if giver is not None else 0.0
    begins_s = onsets[first] - (taken_s if giver == first - 1 else 0.0)
    ends_s = onsets[last] + (taken_s if giver == last else 0.0)
    for place in range(count + 1):
        onsets[first + place] = begins_s + (ends_s - begins_s) * place / count
