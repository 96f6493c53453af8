"""Prosody: loudness of phones relative to the speaker's usual loudness, and the stressed vowels.

Theory of operation
-------------------
*Usual*: the speaker's median level and pitch over all vowels, weighted by their length. Only vowels count, for
consonants are quieter at any effort. So a recording that is loud as a whole is not shouted; a shout is louder than the
rest of its recording.

*Effort*: the mean level of the vowels around a phone (Gaussian, :data:`AROUND_S`), relative to the usual level. Levels
within :data:`USUAL_DB` of it are normal speech, and do not show how far a mouth opens: scaling each vowel by its own
level lowers the similarity to filmed lips (docs/how-to/sound.md). The rest is the phone's ``loudness_db``. A vowel that
was recognized with low confidence also gets a part of its own level (:data:`UNSURE_SHARE`).

*Stress*, for phones without it: a vowel is stressed that is louder, higher and longer than those around it
(:data:`SHARES`; Fry 1958, doi:10.1177/002383095800100207, has all three as cues). Of vowels within :data:`APART_S` the
most prominent one is chosen.

All is a function of the phones given; for a stream, :class:`RunningProsody` keeps the past.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fapengine.speech import ipa
from fapengine.speech.phone_track import LOUDNESS_DB, Phone

Array = NDArray[np.float64]

SILENT_DB = -90.0
"""Level, dB below full scale, under which nothing was measured."""
AROUND_S = 0.3
"""Standard deviation of the time over which effort is measured: about a word."""
USUAL_DB = 4.0
"""Half of the range of usual effort. In 60 filmed sentences of even effort it costs .0003 of the mean similarity
(r .8456, with 3 dB .8446, with none .8352)."""
UNSURE_SHARE = 0.5
"""Fraction of its own level that a vowel of confidence 0 gets."""
SHARES = (1 / 4.0, 1 / 3.0, 1.0)
"""Weights of a vowel's level (per dB), pitch (per semitone) and length (per doubling) above those around it."""
STANDS_OUT = 0.6
"""Least weighted sum of a vowel that is stressed."""
NEAR_S, APART_S = 1.0, 0.35
"""Time to either side within which vowels are compared, and least time between stressed ones."""


@dataclass(frozen=True, slots=True)
class Sounding:
    """Measured loudness and pitch of a phone."""

    loudness_db: float
    """Highest level in it, dB below full scale."""
    pitch_hz: float
    """Median of its voiced frames; 0 without any."""


@dataclass(frozen=True, slots=True)
class Usual:
    """Usual loudness and pitch of a speaker."""

    loudness_db: float
    """Median level of vowels, dB below full scale."""
    pitch_hz: float
    """Median pitch; 0 if nothing was voiced."""


@dataclass(frozen=True, slots=True, eq=False)
class _Vowels:
    """Vowels of some phones, in order; (N,) each."""

    index: NDArray[np.int64]
    """Number among the phones."""
    at_s: Array
    length_s: Array
    level_db: Array
    pitch_hz: Array

    @classmethod
    def of(cls, phones: Sequence[Phone], soundings: Sequence[Sounding]) -> "_Vowels":
        rows = [
            (number, (phone.start_s + phone.end_s) / 2, phone.duration_s, sounding.loudness_db, sounding.pitch_hz)
            for number, (phone, sounding) in enumerate(zip(phones, soundings, strict=True))
            if is_vowel(phone) and sounding.loudness_db > SILENT_DB
        ]
        index, *columns = np.array(rows, dtype=np.float64).reshape(len(rows), 5).T
        return cls(index.astype(np.int64), *columns)


def is_vowel(phone: Phone) -> bool:
    """Whether a phone has a vowel in it.

    Examples
    --------
    >>> is_vowel(Phone("aɪ", 0, 0.1)), is_vowel(Phone("m", 0, 0.1))
    (True, False)
    """
    return not phone.is_silence and any(ipa.SOUNDS[letter].vowel for letter in ipa.letters(phone.label))


def _usual(vowels: _Vowels) -> Usual:
    voiced = vowels.pitch_hz > 0
    pitch_hz = _median(vowels.pitch_hz[voiced], vowels.length_s[voiced]) if voiced.any() else 0.0
    return Usual(_median(vowels.level_db, vowels.length_s), pitch_hz)


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


def with_prosody(
    phones: Sequence[Phone], soundings: Sequence[Sounding], usual: Usual | None = None, *, first: int = 0
) -> list[Phone]:
    """Add loudness relative to the speaker's usual one to phones, and stress if none of them has any.

    Parameters
    ----------
    phones : sequence of Phone
        In order; if one of them has a stress, all keep theirs.
    soundings : sequence of Sounding
        One for each phone.
    usual : Usual, optional
        By default that of these phones.
    first : int
        Number of the first phone to return.

    Returns
    -------
    list of Phone
        The same ones, from ``first`` on, with ``loudness_db`` and ``stress``.

    Examples
    --------
    >>> words = [Phone("a", n, n + 0.2) for n in range(5)]
    >>> sounds = [Sounding(level_db, 120.0) for level_db in (-20, -20, -20, -40, -8)]
    >>> [round(phone.loudness_db) for phone in with_prosody(words, sounds)]
    [0, 0, 0, -12, 8]
    """
    vowels = _Vowels.of(phones, soundings)
    if not len(vowels.index):
        return list(phones[first:])
    usual = usual or _usual(vowels)
    effort = _effort(phones[first:], vowels, usual)
    is_marked = any(phone.stress for phone in phones)
    stressed = frozenset() if is_marked else frozenset(vowels.index[_standing_out(vowels)].tolist())
    own = dict(zip(vowels.index.tolist(), (vowels.level_db - usual.loudness_db).tolist(), strict=True))
    low, high = LOUDNESS_DB
    found: list[Phone] = []
    for number, phone in enumerate(phones[first:], first):
        if phone.is_silence:
            found.append(phone)
            continue
        around = float(effort[number - first])
        level_db = float(np.sign(around)) * max(abs(around) - USUAL_DB, 0.0)
        if number in own:
            level_db += UNSURE_SHARE * (1.0 - phone.confidence) * (own[number] - around)
        loudness_db = round(min(max(level_db, low), high), 2)
        found.append(replace(phone, loudness_db=loudness_db, stress=1 if number in stressed else phone.stress))
    return found


def _effort(phones: Sequence[Phone], vowels: _Vowels, usual: Usual) -> Array:
    """(N,) dB: mean level of the vowels around each phone, against the usual one."""
    at_s = np.array([(phone.start_s + phone.end_s) / 2 for phone in phones])
    first = np.searchsorted(vowels.at_s, at_s - 4 * AROUND_S)
    behind = np.searchsorted(vowels.at_s, at_s + 4 * AROUND_S)
    effort = np.zeros(len(phones))
    for number, (a, b) in enumerate(zip(first.tolist(), behind.tolist(), strict=True)):
        if b > a:
            weights = vowels.length_s[a:b] * np.exp(-0.5 * ((vowels.at_s[a:b] - at_s[number]) / AROUND_S) ** 2)
            effort[number] = weights @ vowels.level_db[a:b] / weights.sum() - usual.loudness_db
    return effort


def _middle(values: Array) -> float:
    """Median; NumPy's own takes ten times as long for a few numbers."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def _standing_out(vowels: _Vowels) -> list[int]:
    """Numbers of the vowels that stand out among those around them."""
    score = np.zeros(len(vowels.index))
    first = np.searchsorted(vowels.at_s, vowels.at_s - NEAR_S)
    behind = np.searchsorted(vowels.at_s, vowels.at_s + NEAR_S, side="right")
    for number, (a, b) in enumerate(zip(first.tolist(), behind.tolist(), strict=True)):
        around = slice(a, b)
        higher_st = 0.0
        voiced = vowels.pitch_hz[around] > 0
        if vowels.pitch_hz[number] > 0:
            higher_st = 12 * np.log2(vowels.pitch_hz[number] / _middle(vowels.pitch_hz[around][voiced]))
        louder_db = vowels.level_db[number] - _middle(vowels.level_db[around])
        longer = np.log2(vowels.length_s[number] / _middle(vowels.length_s[around]))
        score[number] = np.dot(SHARES, np.clip((louder_db, higher_st, longer), (-8.0, -6.0, -1.0), (8.0, 6.0, 1.0)))
    chosen: list[int] = []
    for number in np.argsort(-score, kind="stable").tolist():
        if score[number] < STANDS_OUT:
            break
        if all(abs(vowels.at_s[number] - vowels.at_s[other]) >= APART_S for other in chosen):
            chosen.append(number)
    return sorted(chosen)


@dataclass(slots=True)
class RunningProsody:
    """Prosody of a stream of phones: each is compared with those before. Stateful.

    The usual loudness and pitch are those of the last :data:`KEPT_S`; during the first :data:`KNOWN_S` of vowels,
    nothing is louder or quieter than usual.
    """

    _phones: list[Phone] = field(default_factory=list)
    _soundings: list[Sounding] = field(default_factory=list)

    def push(self, phones: Sequence[Phone], soundings: Sequence[Sounding]) -> list[Phone]:
        """Add prosody to the next phones; see :func:`with_prosody`."""
        if not phones:
            return []
        found = self.look(phones, soundings)
        self._phones += phones
        self._soundings += soundings
        too_old = next((n for n, phone in enumerate(self._phones) if phone.end_s > phones[-1].end_s - KEPT_S), 0)
        del self._phones[:too_old], self._soundings[:too_old]
        return found

    def look(self, phones: Sequence[Phone], soundings: Sequence[Sounding]) -> list[Phone]:
        """Add prosody to phones that may still change; they are not kept."""
        known = [*self._phones, *phones]
        if not phones or sum(phone.duration_s for phone in known if is_vowel(phone)) < KNOWN_S:
            return list(phones)
        return with_prosody(known, [*self._soundings, *soundings], first=len(self._phones))


KEPT_S = 30.0
"""Length of the past that a stream is compared with."""
KNOWN_S = 0.4
"""Least length of vowels that makes a speaker's usual loudness known."""
