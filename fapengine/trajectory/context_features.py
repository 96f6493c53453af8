"""What is said of a phone between its neighbours, as named numbers: what the context model adds up.

Theory of operation
-------------------
A letter has :func:`ways`: numbers for how it is articulated, from the chart (:class:`fapengine.speech.ipa.Sound`) and
from the table of articulation (:mod:`fapengine.speech.articulation`). The features of a token, by kind:

- ``phone``: which one it is, and that times its length; ``length``: its own, and those of the nearest four;
- ``letter``: the letter that stands so many steps away, the last one of those before, the first one of those behind;
- ``way``: the ways of that letter, at step 0 the token's own;
- ``cross``: each of its own ways times each way of its two neighbours, so that a phone never heard beside another, or
  never at all, is still moved by it as its likes are;
- ``pair``, ``triple``: which two or three stand beside each other. They remember what was heard, and so the others need
  not bend to it: what is true of one word alone stays out of what is said of all.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from fapengine.speech import ipa
from fapengine.speech.articulation import ARTICULATIONS, AXES, SIBILANTS
from fapengine.speech.phone_track import SILENCE
from fapengine.trajectory.tokens import Token

REACH = 3
"""Neighbours to either side."""
LENGTHS = (-2, -1, 1, 2)
"""Steps to the neighbours whose lengths count."""
TYPICAL_S, MIN_DURATION_S, MAX_DURATION_S = 0.1, 0.03, 0.4
"""Durations count as their logarithm against the first, cut at the others. The longest that was captured is 0.35 s; a
vowel that is held for a minute opened the mouth by 33 mm when its length went on to count."""
PAUSE_S = 0.3
"""Length of every silence as a neighbour, so that when speech began does not matter to its targets."""
MANNERS = {0.0: "stop", 0.3: "fricative", 0.6: "approximant", 0.8: "nasal"}
"""Names of :attr:`fapengine.speech.ipa.Sound.manner`."""
RIDGE, POSTALVEOLAR = (0.05, 0.15), (0.3, 0.35)
"""Places of :class:`fapengine.speech.ipa.Sound`: dental and alveolar; postalveolar and retroflex."""
SCALE = 10.0
"""Millimetres of the table of articulation that count as 1."""


GESTURELESS = frozenset(letter for letter, row in ARTICULATIONS.items() if max(row.insists) <= 0.05)
"""h and its like have no gesture of lips or tongue, so they have no ways: nothing is learned from where they stood."""


class Part(NamedTuple):
    """What a neighbour sees of a token."""

    name: str
    """Its letters as they were spoken; a profile may know only its likes, whose habits are not its own."""
    letter: str


@cache
def ways(letter: str) -> dict[str, float]:
    """Describe how a letter is articulated; what is 0 is left out.

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
            MANNERS[sound.manner]: 1.0, "lips": sound.lips, "teeth": float(sound.lips == 0.5), "place": sound.place,
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
    first, last = parts_of(token.heard)
    length = log_length(token.end_s - token.start_s)
    found = {name: length * value for name, value in lengthened(first).items()}
    for step in LENGTHS:
        found[f"length {step}"] = log_length(_seconds(tokens, index + step))
    for step in range(-REACH, REACH + 1):
        if step:
            found |= beside(step, part_at(tokens, index + step, step))
    before, after = part_at(tokens, index - 1, -1), part_at(tokens, index + 1, 1)
    return found | alone(first) | paired(first, -1, before) | paired(last, 1, after) | tripled(before, first, after)


def alone(own: Part) -> dict[str, float]:
    """Features of a token by itself, but for its length; ``own`` has its first letter."""
    return {"bias": 1.0, f"phone {own.name}": 1.0} | {f"way 0 {way}": v for way, v in ways(own.letter).items()}


def lengthened(own: Part) -> dict[str, float]:
    """Features of a token's length, for a length that counts 1."""
    return {"length 0": 1.0, f"phone {own.name} length": 1.0}


def beside(step: int, other: Part) -> dict[str, float]:
    """Features that another one gives to a token from so many steps away."""
    named = {f"way {step} {way}": value for way, value in ways(other.letter).items()}
    return named | {f"letter {step} {other.letter}": 1.0}


def paired(own: Part, step: int, other: Part) -> dict[str, float]:
    """Features of standing right behind (-1) or before (1) another one; ``own`` has the letter on that side."""
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
    first, last = parts_of(tokens[index].heard if inside else ())
    return last if step < 0 else first


@cache
def parts_of(heard: tuple[str, ...]) -> tuple[Part, Part]:
    """Return the first and the last letter of a token, with its name; of nothing heard, silence."""
    letters = heard or (SILENCE,)
    name = "".join(letters)
    return Part(name, letters[0]), Part(name, letters[-1])


def _seconds(tokens: Sequence[Token], index: int) -> float:
    if not 0 <= index < len(tokens) or tokens[index].name == SILENCE:
        return PAUSE_S
    return tokens[index].end_s - tokens[index].start_s


def log_length(duration_s: float) -> float:
    """Length as it counts."""
    return float(np.log(min(max(duration_s, MIN_DURATION_S), MAX_DURATION_S) / TYPICAL_S))
