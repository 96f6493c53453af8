"""Expressions over time: each at a level that glides along ramps; they add up (paper 001, section 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import check_fields
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS, Expression, Mix
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.speech.marks import words_of
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.text.normal_form import same_word
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.ramps import Ramp

ATTACK_S = 0.35
RELEASE_S = 0.5
MAX_WEIGHT = 2.0


RAISED, STRETCHED, WITH_CHEEK, UPPER_LIDS = (12, 59), (6, 53), (41, 39, 21, 61), (19, 20)
"""FAPs of the left half; those of the right are one more."""
WITH_CORNER = {  # FAPs of the lips: share of the corner's height by which they go up with it; inner lips stay shut
    False: {8: -0.45, 10: 0.45, 4: -0.12, 5: 0.12},
    True: {55: -0.45, 57: 0.45, 51: -0.12, 52: 0.12},
}
IN_THE_MIDDLE = (4, 5, 51, 52)


@dataclass(frozen=True, slots=True)
class Mood:
    """An expression that comes, holds and goes."""

    expression: Expression
    strength: float = 1.0
    """0..2; 1 is the profile's full expression."""
    start_s: float = 0.0
    """Time at which it begins to come."""
    end_s: float = inf
    """Time at which it is gone, at the latest at the end of the speech."""
    attack_s: float = ATTACK_S
    release_s: float = RELEASE_S

    def __post_init__(self) -> None:
        check_fields(self)
        name = self.expression.label
        if not 0 <= self.strength <= MAX_WEIGHT:
            raise UsageError(f"expression {name}: must be 0 to {MAX_WEIGHT:g}, got strength {self.strength}")
        if not 0 <= self.start_s < self.end_s:
            raise UsageError(f"expression {name}: got {self.start_s} to {self.end_s} s, expected 0 <= start < stop")
        if not (0 < self.attack_s < inf and 0 < self.release_s < inf):
            times = f"attack {self.attack_s} s and release {self.release_s} s"
            raise UsageError(f"expression {name}: got {times}, expected positive times")


def during_word(
    expression: Expression, strength: float, word: str, phones: PhoneTrack, *, attack_s: float = ATTACK_S
) -> list[Mood]:
    """Show an expression with a word: at full strength while it is spoken, each time that it is."""
    spans = _spans(words_of(phones.phones), same_word(word))
    if not spans:
        spoken = ", ".join(dict.fromkeys(phone.word for phone in phones.phones if phone.word)) or "no words at all"
        raise UsageError(f"expression {expression.label}: got word {word!r}, expected one of: {spoken}")
    return [
        Mood(expression, strength, max(start_s - attack_s, 0.0), stop_s + RELEASE_S, attack_s)
        for start_s, stop_s in spans
    ]


def _spans(words: list[tuple[str, float, float]], wanted: str) -> list[tuple[float, float]]:
    """Find when a word is spoken, or several one after the other that are it together."""
    keys = ["".join(same_word(word).split()) for word, _, _ in words]
    wanted = "".join(wanted.split())
    spans = []
    for first in range(len(words)):
        together = ""
        for last in range(first, len(words)):
            together += keys[last]
            if wanted and together == wanted:
                spans.append((words[first][1], words[last][2]))
            if not wanted.startswith(together):
                break
    return spans


def mood_ramps(moods: Sequence[Mood], profile: Profile, end_s: float) -> list[Ramp]:
    """Turn expressions with their times into ramps of their levels, in time order.

    Each comes over its attack and goes over its release. Different expressions add up; where several moods of the same
    one overlap, its level is the sum of their strengths, at most :data:`MAX_WEIGHT`.

    Parameters
    ----------
    profile : Profile
        Where the expressions lie.
    end_s : float
        When the last release ends.

    Returns
    -------
    list of Ramp
        Channels are indices of :data:`fapengine.expressions.EXPRESSIONS`, goals 0..:data:`MAX_WEIGHT`.
    """
    ramps: list[Ramp] = []
    by_expression: dict[Expression, list[tuple[float, float, Mood]]] = {}
    for mood in moods:
        if not has_expression(profile, mood.expression):
            name = mood.expression.label
            raise UsageError(f"expression: got {name}, profile {profile.id!r} does not have it")
        release_s = max(min(mood.end_s, end_s) - mood.release_s, mood.start_s + mood.attack_s)
        by_expression.setdefault(mood.expression, []).append((mood.start_s, release_s, mood))
    for expression, spans in by_expression.items():
        comes = [(start_s, mood.attack_s) for start_s, _, mood in spans]
        goes = [(release_s, mood.release_s) for _, release_s, mood in spans]
        for at_s, over_s in sorted(comes + goes):
            level = sum(mood.strength for start_s, release_s, mood in spans if start_s <= at_s < release_s)
            ramps.append(Ramp(at_s, EXPRESSIONS.index(expression), min(level, MAX_WEIGHT), over_s))
    return sorted(ramps, key=lambda ramp: ramp.at_s)


def has_expression(profile: Profile, expression: Expression) -> bool:
    """Whether a profile has an expression, or the joy that it is mixed from."""
    return expression in profile.expressions or (expression.mix is not None and Expression.JOY in profile.expressions)


def _mixed(mix: Mix, joy: NDArray[np.float64]) -> NDArray[np.float64]:
    """(68,) FAPU of a mix, from those of joy, (68,)."""
    faps = np.zeros(fap.FAP_COUNT)
    side = 0 if mix.is_left else 1
    for numbers, share in ((RAISED, mix.corner), (STRETCHED, mix.stretch), (WITH_CHEEK, mix.cheek)):
        columns = [fap.column(number + side) for number in numbers]
        faps[columns] = share * joy[columns]
    for number, is_outer in zip(RAISED, WITH_CORNER, strict=True):
        height = faps[fap.column(number + side)]
        for lip, share in WITH_CORNER[is_outer].items():
            faps[fap.column(lip if lip in IN_THE_MIDDLE else lip + side)] = share * height
    faps[fap.columns(*UPPER_LIDS)] += mix.lids
    return faps


@lru_cache(maxsize=16)
def expression_faps(profile: Profile) -> NDArray[np.float64]:
    """(68, E) FAPU: every one of the expressions at full level; what a profile lacks is 0. Read-only.

    An expression is a pose in the viseme space (paper 001, section 5.2) and FAPs beyond it. FAPs are linear in the
    space, so adding these is adding there. Our own expressions are mixed from its joy.
    """
    faps = np.zeros((fap.FAP_COUNT, len(EXPRESSIONS)))
    for column, expression in enumerate(EXPRESSIONS):
        if expression in profile.expressions:
            face = profile.expressions[expression]
            moved_mm = profile.space.to_points_mm(face.target[None])
            faps[:, column] = displacements_to_faps(moved_mm, profile.space.points, profile.fapu)[0] + face.fap
        elif expression.mix is not None and Expression.JOY in profile.expressions:
            faps[:, column] = _mixed(expression.mix, faps[:, EXPRESSIONS.index(Expression.JOY)])
    faps.setflags(write=False)
    return faps
