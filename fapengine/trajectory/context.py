"""Targets of a phone between its neighbours: tokens, their features, and the sums of a context model.

Theory of operation
-------------------
A phone track is split into *tokens*, each with a name of the profile and the IPA that was spoken. A token's targets at
a few fractions of its duration are a sum over named *features* of it and of three neighbours to either side. What each
feature adds was learned (:mod:`fapengine.laboratory.context_fit`). An IPA letter has :func:`ways`: numbers for how it
is articulated, from the chart (:class:`fapengine.speech.ipa.Sound`) and from the table of articulation
(:mod:`fapengine.speech.articulation`). The features of a token, by kind:

- ``phone``: which one it is, and that times its length; ``length``: its own, and those of the nearest four;
- ``letter``: the letter some steps away: the last one of a token before, the first one of a token after;
- ``way``: the ways of that letter, at step 0 the token's own;
- ``cross``: each of its own ways times each way of its two neighbours, so that a phone never recorded beside another,
  or never recorded at all, is still moved by it as similar phones are;
- ``pair``, ``triple``: which two or three stand beside each other. They absorb what single words do, so that the other
  features need not fit it.

Names of letters are said with more force than words, so a vowel in one (:data:`NAMES`) is a phone of its own, with
:data:`IN_NAME` before its name; it shares the letter and the ways of the others.

A sum cannot say "only if", so recorded tokens that are kept as *examples* add what they say to tokens that are alike in
all: in the ways of eight letters (:func:`letters_around`) and in three lengths. How alike, 0 to 1, is a Gaussian of
their differences (:class:`Likeness`); together this is regression by a Gaussian process (Rasmussen and Williams 2006).

So lips anticipate: the same /s/ is round before /u/ and spread before /i/. A sound without a gesture of its own, such
as h, takes the shape of the next one (:data:`NEXT_FROM`). The sums are kept for each kind of token, because a stream
needs them whenever a phone comes.
"""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.profiles import ContextModel
from fapengine.speech import ipa
from fapengine.speech.articulation import ARTICULATIONS, AXES, SIBILANTS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack

LABELS = 4096
"""Remembered; a sender may make up any number."""
SpelledPart = tuple[str, tuple[str, ...]]
"""Name in the profile, and the IPA letters as they were spoken."""


class Token(NamedTuple):
    """A phone, or a part of one, under a name that the profile knows."""

    phone: Phone
    name: str
    """Name in the profile, or :data:`SILENCE`."""
    heard: tuple[str, ...]
    """IPA letters as they were spoken; the profile may know only similar ones."""
    start_s: float
    end_s: float


def tokens_of(track: PhoneTrack, known: Mapping[str, object]) -> tuple[list[Token], list[str]]:
    """Split a track into tokens that a profile knows.

    A label that it lacks is split into letters that share the time, each under the name of the most similar one.

    Returns
    -------
    tokens : list of Token
    strange : list of str
        Labels that are not IPA; the neutral vowel is used for them.
    """
    names = tuple(known)
    tokens, strange = [], []
    for phone in track.phones:
        start_s, end_s = phone.start_s, phone.end_s
        if phone.is_silence:
            tokens.append(Token(phone, SILENCE, (), start_s, end_s))
            continue
        parts, is_strange = spelled(phone.label, names)
        if is_strange:
            strange.append(phone.label)
        if len(parts) == 1:
            tokens.append(Token(phone, *parts[0], start_s, end_s))
            continue
        share = (end_s - start_s) / len(parts)
        for index, (name, heard) in enumerate(parts):
            tokens.append(Token(phone, name, heard, start_s + index * share, start_s + (index + 1) * share))
    return tokens, strange


@lru_cache(maxsize=LABELS)
def spelled(label: str, known: tuple[str, ...]) -> tuple[tuple[SpelledPart, ...], bool]:
    """Split a label into known names, with the characters that were spoken; true if it is not IPA."""
    letters = ipa.letters(label) or ("ə",)
    is_unknown = not ipa.letters(label)
    if "".join(letters) in known:
        return (("".join(letters), letters),), is_unknown
    single = tuple(name for name in known if len(name) == 1)
    return tuple((ipa.nearest(letter, single), (letter,)) for letter in letters), is_unknown


REACH = 3
"""Neighbours to either side."""
LENGTHS = (-2, -1, 1, 2)
"""Steps to the neighbours with lengths that count."""
TYPICAL_S, MIN_DURATION_S, MAX_DURATION_S = 0.1, 0.03, 0.4
"""Durations count as their logarithm against the first, cut at the others. The longest that was captured is 0.35 s; a
vowel that is held for a minute opened the mouth by 33 mm when its length went on to count."""
PAUSE_S = 0.3
"""Length of every silence as a neighbour, so that when speech began does not matter to its targets."""
_MANNERS = {value: name for name, value in ipa.MANNERS.items()}
RIDGE, POSTALVEOLAR = (0.05, 0.15), (0.3, 0.35)
"""Places of :class:`fapengine.speech.ipa.Sound`: dental and alveolar; postalveolar and retroflex."""
SCALE = 10.0
"""Millimetres of the table of articulation that count as 1."""


NAMES = {
    letter: vowels
    for letters, vowels in (
        ("bcdgptv", ("i",)), ("flmnsx", ("ɛ",)), ("hjk", ("eɪ",)), ("qw", ("u",)), ("r", ("ɑ",)), ("z", ("ɛ", "i")),
    )
    for letter in letters
}  # fmt: skip
"""Words that are names of letters, and their vowels in English: an m that is read as metres is no name. Names of vowels
are not among them: they are common words of many languages."""
AROUND = " .,;:!?…'\"‘’“”„«»()[]"
"""What stands around a word where a sender's words have their punctuation."""
IN_NAME = "+"
"""Before the name of a vowel in the name of a letter."""
GESTURELESS = frozenset(letter for letter, row in ARTICULATIONS.items() if max(row.insists) <= 0.05)
"""h and its like have no gesture of lips or tongue, so they have no ways: nothing is learned from where they stood."""


class Part(NamedTuple):
    """Features of a token that its neighbours use."""

    name: str
    """IPA as it was spoken; the profile may know only a similar phone, which behaves differently."""
    letter: str


@cache
def ways(letter: str) -> dict[str, float]:
    """How a letter is articulated; zeros are left out.

    Examples
    --------
    >>> sorted(ways("m")), ways("_"), ways("h")
    (['lips', 'nasal'], {'silent': 1.0}, {})
    """
    if letter == SILENCE:
        return {"silent": 1.0}
    if letter in GESTURELESS:
        return {}
    sound, row = ipa.SOUNDS[letter], ARTICULATIONS[letter]
    if sound.vowel:
        found = {
            "vowel": 1.0, "opening": sound.opening, "opening^2": sound.opening**2, "back": sound.place,
            "rounded": sound.rounding,
        }  # fmt: skip
    else:
        found = {
            _MANNERS[sound.manner]: 1.0, "lips": sound.lips, "teeth": float(sound.lips == 0.5), "place": sound.place,
            "ridge": float(sound.place in RIDGE),
            "postalveolar": float(POSTALVEOLAR[0] <= sound.place <= POSTALVEOLAR[1]),
            "sibilant": float(letter in SIBILANTS),
        }  # fmt: skip
    scale = {"round": 1.0}
    found |= {axis: value / scale.get(axis, SCALE) for axis, value in zip(AXES, row.values, strict=True)}
    return {way: value for way, value in found.items() if value}


def features(tokens: Sequence[Token], index: int) -> dict[str, float]:
    """Describe one token between its neighbours: feature names and values."""
    token = tokens[index]
    first, last = parts_of(token.heard, names_vowels(token.phone))
    length = log_length(token.end_s - token.start_s)
    found = {name: length * value for name, value in lengthened(first).items()}
    for step in LENGTHS:
        found[f"length {step}"] = log_length(_seconds(tokens, index + step))
    for step in range(-REACH, REACH + 1):
        if step:
            found |= beside(step, part_at(tokens, index + step, step))
    before, after = part_at(tokens, index - 1, -1), part_at(tokens, index + 1, 1)
    return found | alone(first) | paired(first, -1, before) | paired(last, 1, after) | tripled(before, first, after)


def letters_around(tokens: Sequence[Token], index: int) -> str:
    """Eight letters: the last ones of the three before, the first and last of the token, the first ones of the next."""
    first, last = parts_of(tokens[index].heard)
    before = [part_at(tokens, index + step, step) for step in range(-REACH, 0)]
    after = [part_at(tokens, index + step, step) for step in range(1, REACH + 1)]
    return "".join(part.letter for part in (*before, first, last, *after))


def lengths_around(tokens: Sequence[Token], index: int) -> tuple[float, float, float]:
    """Lengths of the token before, of this one and of the next, as they count."""
    before, own, after = (log_length(_seconds(tokens, index + step)) for step in (-1, 0, 1))
    return before, own, after


def names_vowels(phone: Phone) -> tuple[str, ...]:
    """Vowels of a phone's word if that is the name of a letter."""
    return NAMES.get(phone.word.strip(AROUND).lower(), ()) if phone.word else ()


def alone(own: Part) -> dict[str, float]:
    """Features of a token by itself, without its length; ``own`` has its first letter."""
    return {"bias": 1.0, f"phone {own.name}": 1.0} | {f"way 0 {way}": v for way, v in ways(own.letter).items()}


def lengthened(own: Part) -> dict[str, float]:
    """Features of a token's length, for a length that counts 1."""
    return {"length 0": 1.0, f"phone {own.name} length": 1.0}


def beside(step: int, other: Part) -> dict[str, float]:
    """Features that another token gives to a token ``steps`` away."""
    named = {f"way {step} {way}": value for way, value in ways(other.letter).items()}
    return named | {f"letter {step} {other.letter}": 1.0}


def paired(own: Part, step: int, other: Part) -> dict[str, float]:
    """Features of standing right after (-1) or before (1) another one; ``own`` has the letter on that side."""
    found = {
        f"cross {step} {mine} {way}": one * value
        for mine, one in ways(own.letter).items()
        for way, value in ways(other.letter).items()
    }
    return found | {f"pair {step} {other.name} {own.name}": 1.0}


def tripled(before: Part, own: Part, after: Part) -> dict[str, float]:
    """Feature of standing between two others."""
    return {f"triple {before.name} {own.name} {after.name}": 1.0}


def part_at(tokens: Sequence[Token], index: int, step: int) -> Part:
    """Return what a token ``step`` away sees at an index; silence beyond both ends."""
    inside = 0 <= index < len(tokens) and tokens[index].name != SILENCE
    first, last = parts_of(tokens[index].heard, names_vowels(tokens[index].phone)) if inside else parts_of(())
    return last if step < 0 else first


@cache
def parts_of(heard: tuple[str, ...], vowels: tuple[str, ...] = ()) -> tuple[Part, Part]:
    """First and last letter of a token, with its name; silence for no letters.

    ``vowels`` are those of the name of a letter, if the token is in one.
    """
    letters = heard or (SILENCE,)
    name = "".join(letters)
    name = IN_NAME * (name in vowels) + name
    return Part(name, letters[0]), Part(name, letters[-1])


def _seconds(tokens: Sequence[Token], index: int) -> float:
    if not 0 <= index < len(tokens) or tokens[index].name == SILENCE:
        return PAUSE_S
    return tokens[index].end_s - tokens[index].start_s


def log_length(duration_s: float) -> float:
    """Length as it counts."""
    return float(np.log(min(max(duration_s, MIN_DURATION_S), MAX_DURATION_S) / TYPICAL_S))


UNLIKE_WAYS = (0.01, 0.06, 0.075, 0.125, 0.125, 0.075, 0.06, 0.01)
"""What squared differences in :func:`ways` of the letters of :func:`letters_around` count."""
UNLIKE_LENGTHS = (0.19, 0.36, 0.19)
"""The same for lengths of the one before, of the token, and of the next. Both were found by leaving words out, and
sentences, within those of one speaker."""
Number = TypeVar("Number", int, NDArray[np.intp])

NEXT_FROM = 0.65
"""Weight of the next letter in the first keyframe of sounds without a gesture of their own, such as h; the rest is the
end of the letter before. In the last keyframe it is 1."""
AT_ONCE = 64
"""Tokens that are compared with examples at a time: what is computed of them stays in the processor's cache."""
FIRST_KINDS = 64
"""Rows that tables begin with, of kinds and of pairs; they double when they are full."""
KIND_RADIX = 1 << 20
"""Kinds of tokens that three of make one number; labels are remembered up to 4,096
(:data:`.context.LABELS`)."""


_STEPS, _LENGTHS = np.arange(-REACH, REACH + 1), np.arange(-2, 3)
_STEP_PLACES, _PAIRED = _STEPS + REACH, REACH + np.array([[-1, 0], [0, 1]])
_UNLIKE_LENGTHS = np.array(UNLIKE_LENGTHS)


class Likeness:
    """How much tokens are like each of a model's examples: Gaussian in the ways of their letters and in lengths."""

    def __init__(self, letters: Sequence[str], lengths: Array) -> None:
        """Take letters and lengths of M examples, as :class:`fapengine.profiles.Examples` has them."""
        self._known = sorted(set("".join(letters)))
        rows = [self._known.index(letter) for one in letters for letter in one]
        self._letters = np.array(rows, np.intp).reshape(len(letters), len(UNLIKE_WAYS))
        """(M, 8): of the letters in ``_known``."""
        squares = lengths**2 @ _UNLIKE_LENGTHS
        self._of_lengths = np.vstack([(2.0 * _UNLIKE_LENGTHS * lengths).T, -squares, -np.ones(len(lengths))])
        """(5, M): for three lengths, 1, and their weighted squares."""

    def unlike(self, place: int, letter: str) -> Array:
        """(M,): how unlike a letter is to that of each example, of the eight of :func:`letters_around`."""
        apart = np.array([_apart(letter, other) for other in self._known])
        return UNLIKE_WAYS[place] * apart[self._letters[:, place]]

    def unlike_by_step(self, first: str, last: str) -> Array:
        """(steps, M): of a token with these letters, as the neighbour at each step, or at 0 as the token itself."""
        before = [self.unlike(place, last) for place in range(REACH)]
        behind = [self.unlike(place, first) for place in range(REACH + 2, 2 * REACH + 2)]
        return np.array([*before, self.unlike(REACH, first) + self.unlike(REACH + 1, last), *behind])

    def of(self, unlike: Array, lengths: Array) -> Array:
        """(..., M), 0..1: of (..., M) differences of letters, in all, and (..., 3) lengths."""
        own = np.ones((*lengths.shape[:-1], len(self._of_lengths)))
        own[..., :3] = lengths
        own[..., 4] = lengths**2 @ _UNLIKE_LENGTHS
        alike = own @ self._of_lengths
        alike -= unlike
        return np.asarray(np.exp(alike, out=alike))


@cache
def _apart(letter: str, other: str) -> float:
    ours, theirs = ways(letter), ways(other)
    return sum((ours.get(way, 0.0) - theirs.get(way, 0.0)) ** 2 for way in ours | theirs)


class ContextTables:
    """Sums for every kind of token that was met: what it adds to its own targets and to its neighbours'.

    Stateful: it grows, up to the square of the number of IPA's letters.
    """

    def __init__(self, model: ContextModel) -> None:
        self._shape = model.coefficients.shape[1:]
        flat = model.coefficients.reshape(len(model.features), -1)
        self._coefficients = np.vstack([flat, np.zeros(flat.shape[1])])
        """(F + 1, D); the last row is for features that the model lacks."""
        self._rows = model.rows
        examples = model.examples
        self._likeness = Likeness(examples.letters, examples.lengths)
        self._adds = examples.adds.reshape(len(examples.letters), flat.shape[1])
        self._unlike = np.zeros((2 * REACH + 1, FIRST_KINDS, len(examples.letters)))
        """(steps, kinds, M), steps as in ``_by_step``: how unlike it is to the letters of each example there."""
        self._lengths_beside = np.stack([self._sum({f"length {step}": 1.0} if step else {}) for step in _LENGTHS])
        """(5, D), per length of the neighbour at each of :data:`LENGTHS`; 0 for the token itself."""
        self._by_step = np.zeros((FIRST_KINDS, 2 * REACH + 1, flat.shape[1]))
        """(kinds, steps, D): as the neighbour at each step, and in the middle as the token itself."""
        self._by_length = np.zeros((FIRST_KINDS, flat.shape[1]))
        """(kinds, D), per length of the token itself."""
        self._idle = np.zeros(FIRST_KINDS, bool)
        """(kinds,): which have no gesture of their own."""
        self._parts: list[tuple[Part, Part]] = []
        self._kinds: dict[str, int] = {}
        self._letters: dict[str, Array] = {}
        self._pairs = np.full((FIRST_KINDS, FIRST_KINDS), -1)
        """(kinds, kinds): row in ``_pair_sums``, -1 before the two have met."""
        self._met = 0
        """Count of the rows of ``_pair_sums`` that are in use."""
        self._pair_sums = np.zeros((FIRST_KINDS, 2, flat.shape[1]))
        crosses = [name.split(" ") for name in model.features if name.startswith("cross ")]
        self._ways = {way: index for index, way in enumerate(sorted({way for _, _, *both in crosses for way in both}))}
        crossed = np.zeros((2, len(self._ways), len(self._ways), flat.shape[1]))
        places = [(int(step == "1"), self._ways[mine], self._ways[other]) for _, step, mine, other in crosses]
        crossed[*np.array(places, np.intp).reshape(-1, 3).T] = flat[[self._rows[" ".join(one)] for one in crosses]]
        self._crosses = crossed.reshape(2, len(self._ways), len(self._ways) * flat.shape[1])
        """(steps, ways, ways x D): of a token's own ways times those of the one before, and of the one after."""
        self.silence = self.kind(())
        triples, kind = [name for name in model.features if name.startswith("triple ")], cache(self._kind_named)
        codes = [(self._code(*map(kind, name.split(" ")[1:])), self._rows[name]) for name in triples]
        self._codes = np.array(sorted(codes), dtype=np.int64).reshape(-1, 2)
        """(triples, 2): three kinds as one number, rising, and the row of their coefficients."""

    def kind(self, heard: tuple[str, ...], vowels: tuple[str, ...] = ()) -> int:
        """Return the number of a token's letters, and for none that of silence.

        One of ``vowels``, those of letters' names, is a kind of its own if the model has heard it so.
        """
        parts = parts_of(heard, vowels)
        if f"phone {parts[0].name}" not in self._rows:
            parts = parts_of(heard)
        known = self._kinds.get(parts[0].name)
        return self._new_kind(heard, *parts) if known is None else known

    def _kind_named(self, name: str) -> int:
        letters = name.removeprefix(IN_NAME)
        return self.kind(() if name == SILENCE else ipa.letters(letters), (letters,) if letters != name else ())

    def targets(
        self, around: NDArray[np.intp], lengths_s: Array, own: NDArray[np.intp]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Targets of tokens between their neighbours.

        Parameters
        ----------
        around : (T,) int
            Kinds of tokens, in order, those of any number of tracks; three silences before and after each track.
        lengths_s : (T,) float64, s
            Of silences :data:`.context.PAUSE_S`.
        own : (N,) int
            Places of the tokens that are asked for, none of them silences.

        Returns
        -------
        targets : (N, keyframes, K) float64
        heard : (N,) bool
            Whether the recorded speaker said a token between the same neighbours.
        """
        lengths, count = np.log(np.minimum(np.maximum(lengths_s, MIN_DURATION_S), MAX_DURATION_S) / TYPICAL_S), len(own)
        idle = np.flatnonzero(self._idle[around[own]])
        if len(idle):
            own = np.concatenate([own, own[idle] - 1, own[idle] + 1])
        kinds = around.take(own[:, None] + _STEPS, mode="clip")
        if len(idle):  # none sees more of the track than other tokens do
            kinds[count : count + len(idle), 0] = kinds[count + len(idle) :, -1] = self.silence
        found, heard = self._sums(kinds, lengths[own[:, None] + _LENGTHS])
        if len(idle):
            before, behind = np.split(found[count:], 2)
            found[idle] = self._between(found[idle], kinds[idle], before[:, -1:], behind[:, :1])
        return found[:count], heard[:count]

    def _sums(self, kinds: NDArray[np.intp], lengths: Array) -> tuple[Array, NDArray[np.bool_]]:
        """What every feature adds to N tokens.

        Parameters
        ----------
        kinds : (N, steps) int
            Of the tokens, in the middle, and of the three before and after each.
        lengths : (N, 5) float64
            Of two before, of the tokens and of two after, as they count.

        Returns
        -------
        (N, keyframes, K) float64, and heard as in :meth:`targets`
        """
        total: Array = self._by_step[kinds, _STEP_PLACES].sum(axis=1)
        total += lengths @ self._lengths_beside
        total += lengths[:, 2:3] * self._by_length[kinds[:, REACH]]
        pairs = self._pair_rows(kinds[:, _PAIRED])
        total += self._pair_sums[pairs, _STEP_PLACES[:2]].sum(axis=1)
        heard, rows = self._triples(*kinds[:, REACH - 1 : REACH + 2].T)
        total[heard] += self._coefficients[rows[heard]]
        if len(self._adds):
            for start in range(0, len(kinds), AT_ONCE):
                part = slice(start, start + AT_ONCE)
                total[part] += self._added(kinds[part], lengths[part, 1:4])
        return total.reshape(len(kinds), *self._shape), heard

    def _added(self, kinds: NDArray[np.intp], lengths: Array) -> Array:
        """(N, D): what examples add, as :meth:`_sums`; ``lengths`` of the three in the middle."""
        unlike, beside = np.empty((2, len(kinds), len(self._adds)))
        self._unlike[0].take(kinds[:, 0], axis=0, out=unlike, mode="clip")
        for step in range(1, 2 * REACH + 1):
            unlike += self._unlike[step].take(kinds[:, step], axis=0, out=beside, mode="clip")
        return np.asarray(self._likeness.of(unlike, lengths) @ self._adds)

    def _between(self, alone: Array, kinds: NDArray[np.intp], before: Array, behind: Array) -> Array:
        """(N, keyframes, K): tokens without a gesture, which go from how the one before ends to how the next begins.

        ``alone`` is taken where neither neighbour has a gesture.
        """
        shares = np.linspace(NEXT_FROM, 1.0, self._shape[0])[:, None]
        goes = ~self._idle
        goes[self.silence] = False
        led, leads = goes[kinds[:, REACH - 1]][:, None, None], goes[kinds[:, REACH + 1]][:, None, None]
        both = (1.0 - shares) * before + shares * behind
        either = np.where(led & leads, both, np.where(leads, behind, before))
        return np.where(led | leads, either, alone)

    def _triples(
        self, before: NDArray[np.intp], mine: NDArray[np.intp], behind: NDArray[np.intp]
    ) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
        """Which of three kinds beside each other were heard so, and the rows of their coefficients, if so."""
        if not len(self._codes):
            return np.zeros(len(mine), bool), np.zeros(len(mine), np.intp)
        codes = self._code(before, mine, behind)
        at = np.minimum(np.searchsorted(self._codes[:, 0], codes), len(self._codes) - 1)
        known = self._codes[at]
        return known[:, 0] == codes, known[:, 1]

    def _pair_rows(self, pairs: NDArray[np.intp]) -> NDArray[np.intp]:
        """(N, 2): rows of ``_pair_sums`` of (N, 2, 2) kinds, as first and second."""
        rows = self._pairs[pairs[..., 0], pairs[..., 1]]
        for at in zip(*(rows < 0).nonzero(), strict=True):
            rows[at] = self._pair(*pairs[at].tolist())
        return rows

    def _pair(self, first: int, second: int) -> int:
        row = int(self._pairs[first, second])
        if row < 0:
            row = self._pairs[first, second] = self._met
            self._met += 1
            if row == len(self._pair_sums):
                self._pair_sums = np.concatenate([self._pair_sums, np.zeros_like(self._pair_sums)])
            one, other = self._parts[first][1], self._parts[second][0]
            self._pair_sums[row] = self._paired(other, -1, one), self._paired(one, 1, other)
        return row

    def _paired(self, own: Part, step: int, other: Part) -> Array:
        """(D,): what :func:`paired` adds."""
        crossed = (self._ways_of(own.letter) @ self._crosses[int(step > 0)]).reshape(
            len(self._ways), self._coefficients.shape[1]
        )
        named = self._coefficients[self._rows.get(f"pair {step} {other.name} {own.name}", -1)]
        return np.asarray(self._ways_of(other.letter) @ crossed + named)

    def _new_kind(self, heard: tuple[str, ...], first: Part, last: Part) -> int:
        kind = self._kinds[first.name] = len(self._parts)
        self._parts.append((first, last))
        if kind == len(self._pairs):
            self._pairs = np.pad(self._pairs, (0, kind), constant_values=-1)
            self._idle, self._by_length = np.pad(self._idle, (0, kind)), np.pad(self._by_length, ((0, kind), (0, 0)))
            self._by_step = np.pad(self._by_step, ((0, kind), (0, 0), (0, 0)))
            self._unlike = np.pad(self._unlike, ((0, 0), (0, kind), (0, 0)))
        self._idle[kind] = bool(heard) and GESTURELESS.issuperset(heard)
        for place, step in enumerate(_STEPS.tolist()):
            own = beside(step, last if step < 0 else first) if step else alone(first)
            self._by_step[kind, place] = self._sum(own)
        self._unlike[:, kind] = self._likeness.unlike_by_step(first.letter, last.letter)
        self._by_length[kind] = self._sum(lengthened(first))
        return kind

    @staticmethod
    def _code(first: Number, second: Number, third: Number) -> Number:
        return (first * KIND_RADIX + second) * KIND_RADIX + third

    def _ways_of(self, letter: str) -> Array:
        """(ways,): :func:`ways` of a letter."""
        if letter not in self._letters:
            found = ways(letter)
            self._letters[letter] = np.array([found.get(way, 0.0) for way in self._ways])
        return self._letters[letter]

    def _sum(self, named: Mapping[str, float]) -> Array:
        rows = [self._rows.get(name, -1) for name in named]
        return np.array(list(named.values())) @ self._coefficients[rows]


@lru_cache(maxsize=16)
def tables_of(model: ContextModel) -> ContextTables:
    """Return the tables of a model, which all planners share."""
    return ContextTables(model)
