"""Prosody: loudness of phones relative to the speaker's usual loudness, and the stressed vowels.

Theory of operation
-------------------
*Usual*: the speaker's median level over all vowels, weighted by their length. Only vowels count, for consonants are
quieter at any effort. So a recording that is loud as a whole is not shouted; a shout is louder than the rest of it.

*Effort*: the mean level of the vowels around a phone (Gaussian, :data:`AROUND_S`), relative to the usual level. Levels
within :data:`USUAL_DB` of it are normal speech, and do not show how far a mouth opens: scaling each vowel by its own
level lowers the similarity to filmed lips (docs/how-to/sound.md). The rest is the phone's ``loudness_db``. A vowel that
was recognized with low confidence also gets a part of its own level (:data:`UNSURE_SHARE`).

*Stress*, for phones without it: a vowel is stressed that is louder, higher and longer than those around it
(:data:`SHARES`; Fry 1958, doi:10.1177/002383095800100207, has all three as cues). Of vowels within :data:`APART_S` the
most prominent one is chosen.

All is a function of the phones given; for a stream, :class:`RunningProsody` keeps the past.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import copysign, exp, log2
from operator import attrgetter, itemgetter
from statistics import median

from fapengine.speech import ipa
from fapengine.speech.phone_track import LOUDNESS_DB, Phone

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
MAX_CUES = (8.0, 6.0, 1.0)
"""Most that each of them counts, dB, semitones and doublings."""
STANDS_OUT = 0.6
"""Least weighted sum of a vowel that is stressed."""
NEAR_S, APART_S = 1.0, 0.35
"""Time to either side within which vowels are compared, and least time between stressed ones."""
SAME_S = 1e-9
"""Lengths that differ by less are the same, in whatever order they were added."""


@dataclass(frozen=True, slots=True)
class Sounding:
    """Measured loudness and pitch of a phone."""

    loudness_db: float
    """Highest level in it, dB below full scale."""
    pitch_hz: float
    """Median of its voiced frames; 0 without any."""


@dataclass(frozen=True, slots=True)
class _Vowel:
    number: int
    """Place among the phones that get prosody; less than 0 before them."""
    at_s: float
    length_s: float
    level_db: float
    pitch_hz: float


def is_vowel(phone: Phone) -> bool:
    """Whether a phone has a vowel in it.

    Examples
    --------
    >>> is_vowel(Phone("aɪ", 0, 0.1)), is_vowel(Phone("m", 0, 0.1))
    (True, False)
    """
    return not phone.is_silence and any(ipa.SOUNDS[letter].vowel for letter in ipa.letters(phone.label))


def _vowels_of(phones: Sequence[Phone], soundings: Sequence[Sounding]) -> list[_Vowel]:
    return [
        _Vowel(number, (phone.start_s + phone.end_s) / 2, phone.duration_s, sounding.loudness_db, sounding.pitch_hz)
        for number, (phone, sounding) in enumerate(zip(phones, soundings, strict=True))
        if sounding.loudness_db > SILENT_DB and is_vowel(phone)
    ]


def _usual_level(vowels: Sequence[_Vowel]) -> float:
    """Median level of vowels, weighted by their length."""
    half_s = sum(vowel.length_s for vowel in vowels) / 2 - SAME_S
    below_s = 0.0
    for vowel in sorted(vowels, key=lambda vowel: vowel.level_db):
        below_s += vowel.length_s
        if below_s >= half_s:
            break
    return vowel.level_db


def with_prosody(phones: Sequence[Phone], soundings: Sequence[Sounding]) -> list[Phone]:
    """Add loudness relative to the speaker's usual one to phones, and stress if none of them has any.

    Parameters
    ----------
    phones : sequence of Phone
        In order; if one of them has a stress, all keep theirs.
    soundings : sequence of Sounding
        One for each phone.

    Returns
    -------
    list of Phone
        The same ones with ``loudness_db`` and ``stress``.

    Examples
    --------
    >>> words = [Phone("a", n, n + 0.2) for n in range(5)]
    >>> sounds = [Sounding(level_db, 120.0) for level_db in (-20, -20, -20, -40, -8)]
    >>> [round(phone.loudness_db) for phone in with_prosody(words, sounds)]
    [0, 0, 0, -12, 8]
    """
    return _compared(phones, _vowels_of(phones, soundings))


def _compared(phones: Sequence[Phone], vowels: Sequence[_Vowel]) -> list[Phone]:
    """Phones with prosody, among vowels: theirs, and those before them."""
    if not vowels or not phones:
        return list(phones)
    usual_db = _usual_level(vowels)
    is_marked = any(phone.stress for phone in phones)
    stressed = frozenset() if is_marked else _standing_out(vowels, phones[0].start_s - SETTLED_S)
    own_db = {vowel.number: vowel.level_db - usual_db for vowel in vowels}
    low, high = LOUDNESS_DB
    found: list[Phone] = []
    for number, phone in enumerate(phones):
        if phone.is_silence:
            found.append(phone)
            continue
        around_db = _effort(phone, vowels, usual_db)
        level_db = copysign(max(abs(around_db) - USUAL_DB, 0.0), around_db)
        if number in own_db:
            level_db += UNSURE_SHARE * (1.0 - phone.confidence) * (own_db[number] - around_db)
        loudness_db = round(min(max(level_db, low), high), 2)
        found.append(replace(phone, loudness_db=loudness_db, stress=1 if number in stressed else phone.stress))
    return found


def _within(vowels: Sequence[_Vowel], at_s: float, reach_s: float) -> Sequence[_Vowel]:
    """Vowels within a time to either side of a moment."""
    first = bisect_left(vowels, at_s - reach_s, key=_at_s)
    return vowels[first : bisect_right(vowels, at_s + reach_s, lo=first, key=_at_s)]


def _effort(phone: Phone, vowels: Sequence[_Vowel], usual_db: float) -> float:
    """Mean level of the vowels around a phone, dB against the usual one; 0 without any."""
    at_s = (phone.start_s + phone.end_s) / 2
    total_db = total = 0.0
    for vowel in _within(vowels, at_s, 4 * AROUND_S):
        weight = vowel.length_s * exp(-0.5 * ((vowel.at_s - at_s) / AROUND_S) ** 2)
        total_db, total = total_db + weight * vowel.level_db, total + weight
    return total_db / total - usual_db if total else 0.0


def _standing_out(vowels: Sequence[_Vowel], from_s: float) -> frozenset[int]:
    """Numbers of the vowels from a time on that stand out among those around them."""
    scores = [(-_prominence(vowel, vowels), vowel) for vowel in vowels[bisect_left(vowels, from_s, key=_at_s) :]]
    chosen: list[_Vowel] = []
    for score, vowel in sorted(scores, key=itemgetter(0)):
        if -score < STANDS_OUT:
            break
        if all(abs(vowel.at_s - other.at_s) >= APART_S for other in chosen):
            chosen.append(vowel)
    return frozenset(vowel.number for vowel in chosen)


def _prominence(vowel: _Vowel, vowels: Sequence[_Vowel]) -> float:
    """How much louder, higher and longer a vowel is than those around it."""
    around = _within(vowels, vowel.at_s, NEAR_S)
    louder_db = vowel.level_db - median(other.level_db for other in around)
    higher_st = 0.0
    if vowel.pitch_hz > 0:
        higher_st = 12 * log2(vowel.pitch_hz / median(other.pitch_hz for other in around if other.pitch_hz > 0))
    longer = log2(vowel.length_s / median(other.length_s for other in around))
    cues = zip(SHARES, (louder_db, higher_st, longer), MAX_CUES, strict=True)
    return sum(share * min(max(cue, -most), most) for share, cue, most in cues)


@dataclass(slots=True)
class RunningProsody:
    """Prosody of a stream of phones: each is compared with those before. Stateful.

    The usual loudness is that of the last :data:`KEPT_S`; during the first :data:`KNOWN_S` of vowels, nothing is louder
    or quieter than usual.
    """

    _vowels: list[_Vowel] = field(default_factory=list)

    def push(
        self,
        phones: Sequence[Phone],
        soundings: Sequence[Sounding],
        partial: Sequence[Phone] = (),
        partial_soundings: Sequence[Sounding] = (),
    ) -> tuple[list[Phone], list[Phone]]:
        """Add prosody to the next phones, and to those after them that may still change; see :func:`with_prosody`."""
        new = [*phones, *partial]
        vowels = self._vowels + _vowels_of(new, [*soundings, *partial_soundings])
        if phones:
            kept = (vowel for vowel in vowels if vowel.number < len(phones))
            self._vowels = [replace(one, number=-1) for one in kept if one.at_s > phones[-1].end_s - KEPT_S]
        if sum(vowel.length_s for vowel in vowels) >= KNOWN_S - SAME_S:
            new = _compared(new, vowels)
        return new[: len(phones)], new[len(phones) :]


KEPT_S = 30.0
"""Length of the past that a stream is compared with."""
KNOWN_S = 0.4
"""Least length of vowels that makes a speaker's usual loudness known."""
SETTLED_S = 3 * APART_S
"""Time before new phones from which on vowels may decide which of the new ones is stressed."""
_at_s = attrgetter("at_s")
