"""When phones sound: the marks of a voice, corrected by the loudness and brightness of its samples.

Theory of operation
-------------------
A voice marks when each phone begins, but the mark is not always where the phone is heard. espeak-ng, for one, puts
the silence of a stop before its mark (``Generate`` of its ``synthesize.c`` pauses for ``prepause`` and marks then),
and marks a vowel after a nasal or a liquid when its first part has been spoken. So the marks are a first guess, and
the samples decide, in this order:

1. Marks are put in order of time, and none lies outside the sound.
2. A mark that only adds to the phone before (ʲ, a length) joins its label; its time is the next vowel's if one follows.
3. A mark without a name is a pause where its samples are quiet, and only there: sound before the quiet belongs to the
   phone before, sound after it to the phone after. A quiet shorter than :data:`MIN_PAUSE_S` is not a pause, and before
   a stop a quiet shorter than :data:`MAX_GAP_S` is the stop's closure.
4. A stop or affricate begins where the quiet begins that ends at its mark: there the lips or the tongue close.
5. A vowel after a nasal or a liquid begins where the sound gets bright (:meth:`SoundLevel.brightens`): there it opens.
6. No phone is lost: one without time of its own takes the quiet around it if it is a stop, else part of a neighbour.

The phones cover the sound from its beginning to its end.
"""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE, Phone

STEP_S = 0.001
"""Resolution of all answers."""
WINDOW_S = 0.004
"""Time over which loudness is taken; a period of a man's voice is 10 ms, but it is never silent for 4 of them."""
QUIET = 0.03
"""Level below which a closure is silent, as a fraction of the RMS of the whole sound."""
PAUSE = 0.1
"""Level below which a stretch is a pause; breath and room may be in it."""
BRIGHT_HZ = (900.0, 4000.0)
"""Band that a mouth lets out and a nose or a tongue does not: the second and third formants of vowels."""
BRIGHT_SHARE = 0.3
"""A vowel begins at this fraction of the range from the darkest to the brightest."""
_BRIGHT_WINDOW_S = 0.01


class SoundLevel:
    """A sound that is asked where it is quiet, and where it gets bright; it never changes.

    Parameters
    ----------
    samples : (N,) number
        Mono, any scale.
    rate_hz : int
        Samples a second.
    """

    def __init__(self, samples: ArrayLike, rate_hz: int) -> None:
        self._samples = frozen(samples, "samples", ("N",), np.float64)
        if rate_hz <= 0:
            raise UsageError(f"rate_hz: must be a positive number, got {rate_hz}")
        self._rate_hz = rate_hz

    @property
    def duration_s(self) -> float:
        """Length of the sound."""
        return len(self._samples) / self._rate_hz

    @cached_property
    def _energy(self) -> NDArray[np.float64]:
        """(N + 1,): sum of squares up to each sample."""
        return np.concatenate([[0.0], np.cumsum(np.square(self._samples))])

    @cached_property
    def _whole(self) -> float:
        """RMS of the whole sound; 1 for a silent one, so that all of it is quiet."""
        return float(np.sqrt(self._energy[-1] / max(len(self._samples), 1))) or 1.0

    def level(self, start_s: ArrayLike, end_s: ArrayLike) -> NDArray[np.float64]:
        """(...): RMS between two times, (...) each, as a fraction of that of the whole sound."""
        last = len(self._samples)
        first = np.clip(np.rint(np.asarray(start_s) * self._rate_hz).astype(int), 0, last)
        behind = np.clip(np.rint(np.asarray(end_s) * self._rate_hz).astype(int), 0, last)
        mean = (self._energy[behind] - self._energy[first]) / np.maximum(behind - first, 1)
        level: NDArray[np.float64] = np.sqrt(np.maximum(mean, 0.0)) / self._whole
        return level

    def quiet_until(self, at_s: float, earliest_s: float) -> float:
        """Start of the quiet that ends at a time, give or take :data:`SLACK_S`; the time itself without such quiet."""
        times = at_s - STEP_S * np.arange(int(max(at_s - earliest_s, 0.0) / STEP_S) + 1)
        quiet = self.level(times - WINDOW_S / 2, times + WINDOW_S / 2) <= QUIET
        last = int(np.argmax(quiet))
        if not quiet[last] or times[last] < at_s - SLACK_S:
            return at_s
        loud = np.flatnonzero(~quiet[last:])
        return float(times[last + loud[0] - 1] if len(loud) else times[-1])

    def stays_quiet(self, start_s: float, end_s: float) -> bool:
        """Whether no moment between two times is louder than a closure."""
        times = np.arange(start_s, end_s, STEP_S)
        return bool((self.level(times, times + STEP_S) <= QUIET).all())

    def longest_quiet(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Start and end of the longest stretch that is quiet as a pause is; twice ``start_s`` if there is none."""
        edges = np.append(np.arange(start_s, end_s, STEP_S), end_s)
        quiet = np.concatenate([[False], self.level(edges[:-1], edges[1:]) <= PAUSE, [False]])
        turns = np.flatnonzero(quiet[1:] != quiet[:-1])
        if not len(turns):
            return start_s, start_s
        longest = int(np.argmax(turns[1::2] - turns[::2]))
        return float(edges[turns[2 * longest]]), float(edges[turns[2 * longest + 1]])

    def brightens(self, start_s: float, end_s: float) -> float | None:
        """Time at which the sound gets bright between two times, as where a vowel begins after a nasal; None if not.

        Brightness is the energy between 0.9 and 4 kHz; the place is where its root first passes :data:`BRIGHT_SHARE` of
        the range from its 5th to its 90th percentile; nowhere, if it does not double or is as low as in a closure.
        """
        margin = round(_BRIGHT_WINDOW_S * self._rate_hz)
        first, last = round(start_s * self._rate_hz), round(end_s * self._rate_hz)
        piece = self._samples[max(first - margin, 0) : last + margin]
        if last - first < margin:
            return None
        spectrum = np.fft.rfft(piece * np.hanning(len(piece)) ** 0.1)
        hertz = np.fft.rfftfreq(len(piece), 1.0 / self._rate_hz)
        band = np.fft.irfft(np.where((hertz >= BRIGHT_HZ[0]) & (hertz <= BRIGHT_HZ[1]), spectrum, 0.0), len(piece))
        power = np.convolve(np.square(band), np.hanning(margin) / np.hanning(margin).sum(), mode="same")
        root = np.sqrt(power[first - max(first - margin, 0) :][: last - first])
        dark, bright = np.percentile(root, (5, 90))
        if bright < max(2.0 * dark, QUIET * self._whole):
            return None
        return float(start_s + int(np.argmax(root > dark + BRIGHT_SHARE * (bright - dark))) / self._rate_hz)


SLACK_S = 0.01
"""Time by which a quiet stretch may end before the boundary that it belongs to."""
MAX_CLOSURE_S = 0.09
"""Farthest that the closure of a stop reaches back from its mark. 9 of 10 measured are shorter than 71 ms (Italian, 160
words a minute); Italian pp takes up to 128, of which the vowel before it keeps the rest."""
CLOSURE_IN_PAUSE_S = 0.06
"""Time that a stop takes of the pause before it; nothing in the sound says when the lips close there."""
MAX_GAP_S = 0.06
"""A shorter nameless quiet is the closure of the stop after it."""
MIN_PAUSE_S = 0.02
"""A shorter quiet between two phones is not a pause; it belongs to the phone before."""
MAX_RISE_S = {"nasal": 0.045, "liquid": 0.02}
"""Longest delay of a vowel's mark after its beginning. After nasals 11 to 49 ms were measured (English, 160
words a minute). A liquid or a glide has no sharp end; at least 20 ms of the vowel were spoken before its mark."""
MIN_PHONE_S = 0.005
"""A phone with less time than this has none of its own."""
KEPT = 0.3
"""Share of its time that a phone keeps, whatever its neighbour takes."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Start of a phone according to a voice."""

    at_s: float
    label: str
    """IPA; empty where the voice marks something without a name."""
    stress: int = 0
    """Stress as of :class:`Phone`."""
    word: str = ""


def sounding(marks: Sequence[Mark], sound: SoundLevel) -> list[Phone]:
    """Turn the marks of a voice into phones that begin where they sound.

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

    After these, the brightness of the sound shows where a vowel begins.

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
        named = next((place for place in range(len(joined) - 1, -1, -1) if joined[place].label), None)
        if named is not None and is_addition(mark.label):
            joined[named] = replace(joined[named], label=joined[named].label + mark.label)
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
    """Find the pause in a nameless time, and the phone after it; either may be None."""
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
    for index, mark in enumerate(marks):  # a pause without time is left out
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
    """Assign equal parts of a neighbour's time to phones ``first`` to ``last - 1``; a pause is asked after a phone."""
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
