"""The phonetic layer: lips forward, corners, tongue, from :mod:`fapengine.speech.articulation`, on the same keyframes.

Theory of operation
-------------------
A profile's space holds what was recorded; :data:`~fapengine.speech.articulation.AXES` hold what was not. A keyframe's
target has their values after its weights, so one path carries both, and the properties of the path (C2, local, the
same offline and live) hold for them.

A letter's value at its keyframes is its own as far as it insists, and for the rest its neighbours': up to :data:`REACH`
letters ahead and back, each weighted by what those between leave, with :data:`AHEAD` of the weight ahead.
So t before u is round from its beginning, s half, and i not at all. A pause ends the view half.

:func:`layer_faps` makes FAPs of the axes, linearly: lips (16, 17), corners (6, 7, 53, 54), the points half way to them
(8 to 11, 55 to 58), the lips' middle (4, 5, 51, 52), tongue (44, 45, 46). FAP 43, to the side, and 47, rolled, stay 0.
Depth is the table's; width, which was recorded, gets :data:`NARROW_MM` more, since a mean over many phones is less than
any of them; and lips that are puckered for long go on narrowing, down to a hole (:func:`hold_long`), where the recorded
speaker did not say that sound between those neighbours.

While corners are held, an expression's pull on them gives way (:func:`give_way`): rounded lips are not drawn wide by a
smile, nor spread ones narrow by surprise.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.geometry.smooth import smoothstep, soft_positive
from fapengine.mpeg4 import fap
from fapengine.profiles import Profile
from fapengine.speech import ipa
from fapengine.speech.articulation import ARTICULATIONS, AXES, PUCKERED, SPREAD
from fapengine.trajectory.context import LABELS

LAYER = (*AXES, "hole")
"""Axes of the layer: those of the table, and by how much long puckered lips open in the middle alone, 0 to 1."""
WIDTH = len(LAYER)
"""Number of axes."""
ROUND, HOLE = LAYER.index("round"), LAYER.index("hole")
TONGUE = [LAYER.index(axis) for axis in ("tip_up", "tip_out", "body_up")]
REACH = 3
"""Neighbours to either side, as in :data:`.context.REACH`: what makes a stream equal its offline plan."""
AHEAD = 0.65
"""Weight of later letters in what a letter takes over; rounding is anticipated more than it lingers (Perkell and
Matthies 1992, J. Acoust. Soc. Am. 91, 2911; the number is ours)."""
PAUSE_S = 0.1
"""Least gap between phones that is a pause."""
PAUSE_INSISTS = 0.5
UPPER_SHARE, LOWER_SHARE = 0.87, 1.13
"""Upper and lower lip against their mean, in a pucker of ICT-FaceKit: 6.9 and 9.0 mm."""
NARROW_MM = 0.47
"""Distance of each corner towards the middle at ``round`` 1, beside what was recorded. The width's slope grows from
0.64 to 0.75, and its correlation loses 1.9 %; with 0.5 mm 2.1 %."""
PURSE_MM = 0.16
"""Distance of each lip's half-way points towards the other lip at ``round`` 1: those of a long u meet, so that it is a
hole and no slit as wide as the mouth. Heard words notice nothing (x y 1.110 mm without, 1.109 with)."""
PURSE_OUTER = 0.6
"""Share of it by which the outer lips follow."""
HOLE_MM = 0.9
"""Distance of the middle of each lip from the other at ``hole`` 1: a long u opens by 5.5 mm in place of 3.7, so that
its hole is seen. In short sounds too, the same would lose a twentieth of the closing lips that are found."""
LONG_S = 0.1, 0.2
"""Length of a phone from which on, and at which wholly, letters of
:data:`~fapengine.speech.articulation.PUCKERED` are held narrower."""
LONG_TIMES = 6.5
"""Greatest times ``round`` of a long puckered letter. Its corners come in by 3 mm each beside what was recorded, so
that a u is 12 mm narrower than rest; a pucker of ICT-FaceKit is 9. Sounds that last reach what short ones only point
at (Lindblom 1963, J. Acoust. Soc. Am. 35, 1773); how far is our choice. A phone that the speaker said between the same
neighbours is as he said it (:meth:`.context.ContextTables.targets`): his long u in "soon" is 5 mm narrower than
the neutral face."""
LONG_SPREAD_TIMES = 3.2
"""The same for :data:`~fapengine.speech.articulation.SPREAD`: an i alone is 2 mm wider than it would be."""
HALF_GAIN = 0.4
"""Size of a style's lips at which the layer is half of its greatest: mumbled speech keeps its contrasts longer than its
openings, shouted speech does not protrude for ever."""
HELD = 0.7
"""``round`` from which on corners are held wholly."""
CORNERS = fap.columns(6, 7, 53, 54)
"""Columns of the FAPs that draw corners to the side; positive is wide."""
PUSHED = fap.columns(16, 17)
_PULLED = [*CORNERS, *PUSHED]
_ROUND_LOSE, _SPREAD_LOSE = np.array([[1.0, 1.0, 1.0, 1.0, -1.0, -1.0], [-1.0, -1.0, -1.0, -1.0, 0.0, 0.0]])[..., None]
"""Signs of what rounded and spread lips do not follow, for these columns."""
SOFT_FAPU = 10.0
"""Half a millimetre."""
_INDEX = {letter: index for index, letter in enumerate(ARTICULATIONS)}
_VALUES = np.array([(*row.values, 0.0) for row in ARTICULATIONS.values()] + [(0.0,) * WIDTH] * 2)
_INSISTS = np.array(
    [(*row.insists, 1.0) for row in ARTICULATIONS.values()] + [(PAUSE_INSISTS,) * WIDTH, (0.0,) * WIDTH]
)
PAUSE, _NOTHING = len(ARTICULATIONS), len(ARTICULATIONS) + 1
NOTHING_BESIDE = (_NOTHING,) * REACH
"""Rows of the table before a track, and after its last pause."""
PAUSE_BEHIND = (PAUSE, *NOTHING_BESIDE)
_NEUTRAL = ("ə",)
_TIMES_MORE = np.array(
    [(LONG_TIMES - 1.0) * (letter in PUCKERED) + (LONG_SPREAD_TIMES - 1.0) * (letter in SPREAD)
     for letter in ARTICULATIONS] + [0.0] * 2
)  # fmt: skip
_PUCKERED = np.array([float(letter in PUCKERED) for letter in ARTICULATIONS] + [0.0] * 2)
_STEPS = np.array([[1, 2, 3], [-1, -2, -3]])[..., None]
_SHARES = np.array([AHEAD, 1.0 - AHEAD])[:, None, None, None]


@lru_cache(maxsize=LABELS)
def kinds_of(label: str) -> tuple[int, ...]:
    """Rows of the table of a label's letters."""
    return tuple(_INDEX[letter] for letter in ipa.letters(label) or _NEUTRAL)


@lru_cache(maxsize=16)
def values_of(profile: Profile) -> Array:
    """(letters + 2, axes): the table, with the tongue of letters that the profile's speaker was recorded with."""
    values = _VALUES.copy()
    for name, phone in profile.phones.items():
        if phone.tongue_mm is not None and name in _INDEX:
            values[_INDEX[name], TONGUE] = phone.tongue_mm
    values.setflags(write=False)
    return values


def in_context(kinds: NDArray[np.intp], at: NDArray[np.intp], values: Array) -> Array:
    """(N, axes): ``values`` of the letters ``at`` these places; ``kinds`` has :data:`REACH` more at both ends.

    Equal places side by side, keys of one letter, are computed once.
    """
    fresh = np.ones(len(at), bool)
    np.not_equal(at[1:], at[:-1], out=fresh[1:])
    at, place = at[fresh], fresh.cumsum() - 1
    around = kinds[at + _STEPS]
    insists = _INSISTS[around]
    past = 1.0 - insists[:, :-1]
    past[:, 1] *= past[:, 0]
    weights = insists * _SHARES
    weights[:, 1:] *= past
    wanted = (weights * values[around]).sum(axis=(0, 1))
    wanted /= weights.sum(axis=(0, 1)) + 1e-9
    mine = kinds[at]
    keeps = _INSISTS[mine]
    taken: Array = (keeps * values[mine] + (1.0 - keeps) * wanted)[place]
    return taken


def hold_long(layer: Array, letters: NDArray[np.intp], lengths_s: Array) -> None:
    """Narrow puckered letters of long phones, open them in the middle, and draw spread ones apart, in place.

    ``layer`` is (N, axes) of letters (N,) in phones that last (N,) s.

    What the speaker said between the same neighbours counts 0 s: it stays as narrow as he was.
    """
    long = smoothstep((lengths_s - LONG_S[0]) / (LONG_S[1] - LONG_S[0]))
    layer[:, ROUND] *= 1.0 + _TIMES_MORE[letters] * long
    layer[:, HOLE] = _PUCKERED[letters] * long


@lru_cache(maxsize=16)
def layer_faps(profile: Profile) -> Array:
    """(axes, 68) FAPU for a unit of each axis, in the profile's face. Read-only."""
    faps = np.zeros((WIDTH, fap.FAP_COUNT))
    for axis, number, size_mm in (
        ("push", 16, LOWER_SHARE), ("push", 17, UPPER_SHARE),
        ("round", 6, -NARROW_MM), ("round", 7, -NARROW_MM), ("round", 53, -NARROW_MM), ("round", 54, -NARROW_MM),
        *(("hole", number, -HOLE_MM) for number in (4, 5, 51, 52)),
        *(("round", number, PURSE_MM) for number in (8, 9, 10, 11)),
        *(("round", number, PURSE_OUTER * PURSE_MM) for number in (55, 56, 57, 58)),
        ("tip_up", 44, 1.0), ("tip_out", 45, 1.0), ("body_up", 46, 1.0),
    ):  # fmt: skip
        faps[LAYER.index(axis), fap.column(number)] = size_mm / profile.fapu.unit(fap.spec(number).unit)
    faps.setflags(write=False)
    return faps


def layer_gain(lips: Array | float) -> Array:
    """(N,) or a number: size of the layer for the size of a style's lips; 0 at 0, 1 at 1, never above 1.4."""
    size = np.asarray(lips, dtype=np.float64)
    return (1.0 + HALF_GAIN) * size / (size + HALF_GAIN)


def give_way(expression: Array, held: Array) -> Array:
    """Remove from an expression what pulls at held corners.

    Parameters
    ----------
    expression : (68, N) float64, FAPU
    held : (N,) float64
        The axis ``round``, in the style's size.

    Returns
    -------
    (68, N) float64, FAPU
        Of rounded lips nothing is drawn wide or back, of spread ones nothing narrow.
    """
    sign = np.where(held > 0.0, _ROUND_LOSE, _SPREAD_LOSE)
    lost = soft_positive(sign * expression[_PULLED], SOFT_FAPU)
    lost *= smoothstep(np.abs(held) / HELD)
    lost *= sign
    kept = expression.copy()
    kept[_PULLED] -= lost
    return kept
