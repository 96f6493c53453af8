"""Expressions over time: weighted addition in the viseme space (paper 001, section 5.2) with envelopes."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.geometry.smooth import bump
from fapengine.mpeg4 import fap
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import Profile
from fapengine.speech.phone_track import PhoneTrack

ATTACK_S = 0.35
RELEASE_S = 0.5
MAX_WEIGHT = 2.0


@dataclass(frozen=True, slots=True)
class Mood:
    """An expression that comes, holds and goes."""

    expression: Expression
    strength: float = 1.0
    """0..2; 1 is the profile's full expression."""
    start_s: float = 0.0
    """When it begins to come."""
    stop_s: float = inf
    """When it is gone, at the latest at the end of the speech."""
    attack_s: float = ATTACK_S
    release_s: float = RELEASE_S

    def __post_init__(self) -> None:
        name = self.expression.name.lower()
        if not 0 <= self.strength <= MAX_WEIGHT:
            raise UsageError(f"expression {name}: got strength {self.strength}, expected 0..{MAX_WEIGHT:g}")
        if not 0 <= self.start_s < self.stop_s:
            raise UsageError(f"expression {name}: got {self.start_s} to {self.stop_s} s, expected 0 <= start < stop")
        if not (0 < self.attack_s < inf and 0 < self.release_s < inf):
            times = f"attack {self.attack_s} s and release {self.release_s} s"
            raise UsageError(f"expression {name}: got {times}, expected positive times")

    def envelope(self, times_s: NDArray[np.float64], end_s: float) -> NDArray[np.float64]:
        """(T,) in 0..1, C2: up over the attack, down over the release; lower where there is no time for both."""
        stop_s = min(self.stop_s, end_s)
        up_s = self.start_s + self.attack_s
        return bump(times_s, up_s, max(stop_s - self.release_s, up_s), self.attack_s, self.release_s)


def during_word(
    expression: Expression, strength: float, word: str, phones: PhoneTrack, *, attack_s: float = ATTACK_S
) -> list[Mood]:
    """Let an expression follow a word: fully there while it is spoken, each time that it is.

    Raises
    ------
    UsageError
        If the word is not spoken, or its phones do not tell their words.
    """
    spans: list[tuple[float, float]] = []
    last = None
    for phone in phones.phones:
        if phone.word is not None and phone.word.casefold() == word.casefold():
            start_s = spans.pop()[0] if last == phone.word and spans else phone.start_s
            spans.append((start_s, phone.end_s))
        last = phone.word
    if not spans:
        known = ", ".join(dict.fromkeys(phone.word for phone in phones.phones if phone.word)) or "no words at all"
        raise UsageError(f"expression {expression.name.lower()}: got word {word!r}, expected one of: {known}")
    return [
        Mood(expression, strength, max(start_s - attack_s, 0.0), stop_s + RELEASE_S, attack_s)
        for start_s, stop_s in spans
    ]


def blend(
    moods: Sequence[Mood], profile: Profile, times_s: NDArray[np.float64], end_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights in the space and FAPs beyond it; all moods add up.

    Parameters
    ----------
    moods : sequence of Mood
    profile : Profile
        Where the expressions lie.
    times_s : (T,) float64, s
        When to sample.
    end_s : float
        When the last release ends.

    Returns
    -------
    weights : (T, K) float64
    faps : (T, 68) float64, FAPU

    Raises
    ------
    UsageError
        If the profile lacks an expression.
    """
    weights = np.zeros((len(times_s), profile.space.mode_count))
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    for mood in moods:
        if mood.expression not in profile.expressions:
            name = mood.expression.name.lower()
            raise UsageError(f"expression: got {name}, profile {profile.id!r} does not have it")
        face = profile.expressions[mood.expression]
        strength = mood.strength * mood.envelope(times_s, end_s)[:, None]
        weights += strength * face.target
        faps += strength * face.fap
    return weights, faps
