"""Expressions over time: weighted addition in the viseme space (paper 001, section 5.2) with an envelope."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.geometry.smooth import bump
from fapengine.mpeg4 import fap
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import Profile

ATTACK_S = 0.35
RELEASE_S = 0.5
MAX_WEIGHT = 2.0


def blend(
    expressions: Mapping[Expression, float], profile: Profile, times_s: NDArray[np.float64], end_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights in the space and FAPs beyond it, for expressions that come with the speech and go with it.

    Parameters
    ----------
    expressions : mapping of Expression to float
        Strength of each, 0..2; 1 is the profile's full expression. Several add up.
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
        If the profile lacks an expression, or a strength is out of range.
    """
    weights = np.zeros((len(times_s), profile.space.mode_count))
    faps = np.zeros((len(times_s), fap.FAP_COUNT))
    hold_s = max(end_s - RELEASE_S, ATTACK_S)
    envelope = bump(times_s, ATTACK_S, hold_s, ATTACK_S, RELEASE_S)[:, None]
    for expression, strength in expressions.items():
        if expression not in profile.expressions:
            raise UsageError(f"expression: got {expression.name.lower()}, profile {profile.id!r} does not have it")
        if not 0 <= strength <= MAX_WEIGHT:
            raise UsageError(f"expression {expression.name.lower()}: got strength {strength}, expected 0..{MAX_WEIGHT}")
        weights += strength * envelope * profile.expressions[expression].target
        faps += strength * envelope * profile.expressions[expression].fap
    return weights, faps
