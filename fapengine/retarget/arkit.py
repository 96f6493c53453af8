"""ARKit's 52 blendshapes, from FAPs and to FAPs; the order is that of Live Link Face and Azure, 0 to 51.

Theory of operation
-------------------
Conversion to FAPs is a sum of measured rows. Conversion to weights has many solutions that look alike on the measured
face, but only one that a rigger would choose, which also looks right on other avatars: the jaw opens the mouth,
``mouthClose`` closes the lips over it, and no shape works against another. It is found in four steps:

1. Moods (:mod:`.moods`) are recognized on the upper face and become shapes of their own: a smile is ``mouthSmile``.
   Steps 2 and 3 see the remainder, speech and idle motion.
2. Bounded least squares (:mod:`.blend`): shapes that speech does not need cost :data:`RELUCTANCE_MM`, small helper
   shapes give way to the jaw (:data:`STIFFNESS_MM`), and the opening between the inner lips counts three times. It is
   solved twice: a shape that is large the first time costs nothing the second time, so a smile keeps its size. What an
   avatar does by itself does not count: an opening jaw swings back (30 mm of FAP 14 and 20 mm of FAP 16), which speech
   does not state and ``jawForward`` would compensate; turning eyes and rising brows take lids along.
3. ``mouthClose`` is sought as *a jaw that is open behind closed lips*, the sum of both shapes, so that it cannot exceed
   ``jawOpen``.
4. Of two opposites (:data:`OPPOSITES`) only the difference is shown. Where lips are nearly closed and shapes would open
   them wider, these are scaled down, and ``jawOpen`` is hidden behind ``mouthClose``: closed lips stay closed on any
   avatar, whatever else is requested. Where the mouth is open, the jaw adds the missing opening.

Every step is continuous in the FAPs.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen, read_rows
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import ALL_MOODS, ARKIT_NAMES, BlendMap, shape_rows, weights_mm
from fapengine.retarget.moods import cost_share, find_moods, without_moods

JAW, CLOSE = ARKIT_NAMES.index("jawOpen"), ARKIT_NAMES.index("mouthClose")
SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
SIDEWAYS_MM = 0.8
"""Reluctance of :data:`SIDEWAYS` in plain least squares (:func:`arkit_map`): left and right together narrow a mouth."""
RELUCTANCE_MM, STIFFNESS_MM, MOOD_RELUCTANCE_MM = np.array(
    [costs for _, *costs in read_rows("fapengine.retarget", "arkit_costs.csv")], float
).T
"""(52,) each. Reluctance: a shape is used only where it brings the face this much closer to the target. Stiffness: a
shape at full weight counts as this error, so that it shares its work with others; less, and pucker jumps at w.
Reluctance in a full mood: sad brows rise at the inner ends instead of being drawn down outside."""
HELPERS = np.flatnonzero(STIFFNESS_MM)
"""Small shapes that give way to the jaw."""
COUNTED = {
    (3,): 0.5, (4, 5, 8, 9, 10, 11, 51, 52, 55, 56, 57, 58): 0.8, (12, 13, 59, 60): 0.35, (14,): 0.7, (16, 17): 0.6,
    (18,): 0.3,
}  # fmt: skip
"""Fraction of a FAP's millimetres that counts; others count fully. Jaws, corners and depth differ between avatars."""
INNER_PAIRS, OUTER_PAIRS = ((4, 5), (8, 10), (9, 11)), ((51, 52), (55, 57), (56, 58))
"""Upper and lower lip, middle first; minus their sum is the opening."""
INNER_COUNTED, OUTER_COUNTED, SIDE_COUNTED = 3.0, 0.7, 0.6
"""Additional weight of the opening of inner and outer pairs, and of side pairs relative to the middle."""
SWING = 933.5 / 1360.6
"""FAP 16 per FAP 3 of jawOpen: the lower lip moves back with an opening jaw; up to this, the jaw causes it."""
OPPOSITES = (
    ("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"), ("mouthSmileLeft", "mouthFrownLeft"),
    ("mouthSmileRight", "mouthFrownRight"), ("eyeBlinkLeft", "eyeWideLeft"), ("eyeBlinkRight", "eyeWideRight"),
    ("eyeLookUpLeft", "eyeLookDownLeft"), ("eyeLookUpRight", "eyeLookDownRight"),
    ("eyeLookInLeft", "eyeLookOutLeft"), ("eyeLookInRight", "eyeLookOutRight"),
)  # fmt: skip
"""Pairs of shapes of which at most one is used."""
OPENERS = (
    "mouthFunnel", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight",
    "mouthShrugUpper", "noseSneerLeft", "noseSneerRight",
)  # fmt: skip
"""Shapes that open the lips, in addition to the jaw."""
_OPPOSITES = [(ARKIT_NAMES.index(one), ARKIT_NAMES.index(other)) for one, other in OPPOSITES]
_OPENERS = [ARKIT_NAMES.index(name) for name in OPENERS]
PARTED_MM = 3.0
"""Opening from which only the fit counts; below, no shape opens the lips farther than the FAPs do."""
SHUT_MM = 0.1
"""Opening that counts as closed."""
MAX_MOOD_WEIGHT = 3.0
"""Full expressions may be larger than full shapes."""


@cache
def arkit_map() -> BlendMap:
    """Return the map of the 52 shapes that converts them to FAPs.

    Examples
    --------
    >>> shapes = arkit_map()
    >>> smile = shapes.to_faps(np.eye(52)[[ARKIT_NAMES.index("mouthSmileLeft")]])
    >>> bool(smile[0, fap.column(12)] > 100)  # raise_l_cornerlip
    True
    """
    cost = np.array([SIDEWAYS_MM if name in SIDEWAYS else 0.0 for name in ARKIT_NAMES])
    return BlendMap(ARKIT_NAMES, shape_rows(ARKIT_NAMES), reluctance_mm=cost)


@cache
def speech_map() -> BlendMap:
    """Return the map for weights of speech and idle motion; its ``mouthClose`` is a jaw behind closed lips."""
    return BlendMap(
        ARKIT_NAMES, _sought(), reluctance_mm=RELUCTANCE_MM, stiffness_mm=STIFFNESS_MM, lengths_mm=_lengths_mm()
    )


def approximate_arkit(faps: ArrayLike) -> Array:
    """Find the shapes that show FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU
        As :attr:`fapengine.mpeg4.track.FapTrack.values`. Many frames at once, of one session or of many, cost less.

    Returns
    -------
    (T, 52) float64
        0 to 1, in the order of :data:`ARKIT_NAMES`. ``mouthClose`` never exceeds ``jawOpen``, and at most one of two
        :data:`OPPOSITES` is above 0.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    moods, _ = find_moods(values, ALL_MOODS)
    asked = ask(values, moods)
    first = speech_map().approximate_weights(asked)
    return join_shapes(values, moods, speech_map().approximate_weights(asked, cost=spoken_cost(first)))


def arkit_to_faps(weights: ArrayLike) -> Array:
    """(..., 52) weights -> (..., 68) FAPU; lips that would pass through each other touch half way."""
    faps = arkit_map().to_faps(weights).copy()
    for (upper, lower), (outer_upper, outer_lower) in zip(INNER_PAIRS, OUTER_PAIRS, strict=True):
        passed = 0.5 * np.maximum(faps[..., fap.column(upper)] + faps[..., fap.column(lower)], 0.0)
        for number in (upper, lower, outer_upper, outer_lower):
            faps[..., fap.column(number)] -= passed
    return faps


def ask(faps: Array, moods: Array) -> Array:
    """Subtract the effect of moods, (..., 6), and a jaw's swing from FAPs, (..., 68), for :func:`speech_map`."""
    asked = without_moods(faps, moods, ALL_MOODS)
    opened, forward, lip = (asked[..., fap.column(number)] for number in (3, 14, 16))
    lip += np.minimum(np.maximum(-lip, 0.0), SWING * np.maximum(opened, 0.0))
    forward[...] = np.maximum(forward, 0.0)
    return asked


def spoken_cost(first: Array) -> Array:
    """(..., 52) weights found first -> fraction of each shape's reluctance in the second solution; all for helpers."""
    share = cost_share(first)
    share[..., HELPERS] = 1.0
    return share


def join_shapes(faps: Array, moods: Array, spoken: Array) -> Array:
    """Combine FAPs (T, 68), their moods (T, 6) and weights of :func:`speech_map` (T, 52) into shapes (T, 52)."""
    weights = spoken + moods @ _mood_weights()
    weights[:, JAW] += weights[:, CLOSE]
    for one, other in _OPPOSITES:
        common = np.minimum(weights[:, one], weights[:, other])
        weights[:, one] -= common
        weights[:, other] -= common
    return _fit_opening(np.clip(weights, 0.0, 1.0), faps)


def _fit_opening(weights: Array, faps: Array) -> Array:
    """Open lips as far as FAPs do, (T, 68), and close them fully in closures; changes and returns ``weights``."""
    openings_mm, openers = _shape_openings_mm(), _OPENERS
    inner = fap.columns(*INNER_PAIRS[0])
    wanted_mm = np.maximum(-(faps[:, inner] * weights_mm()[inner]).sum(axis=1), 0.0)
    ajar = weights[:, JAW] - np.minimum(weights[:, CLOSE], weights[:, JAW])
    shown_mm = ajar * openings_mm[JAW] + weights[:, openers] @ openings_mm[openers]
    share = np.minimum((wanted_mm + SHUT_MM) / np.maximum(shown_mm, SHUT_MM), 1.0)
    share = 1.0 - (1.0 - share) * np.maximum(1.0 - wanted_mm / PARTED_MM, 0.0)
    weights[:, CLOSE] = weights[:, JAW] - share * ajar
    weights[:, openers] *= share[:, None]
    parted_mm = _openings_mm(faps)
    missing = (parted_mm - weights @ openings_mm) / openings_mm[JAW] * np.minimum(wanted_mm / PARTED_MM, 1.0)
    weights[:, JAW] = np.clip(weights[:, JAW] + missing, weights[:, CLOSE], 1.0)
    return weights


@cache
def _sought() -> Array:
    """(52, 68) FAPU, read-only: rows without the motion that an avatar adds by itself."""
    rows = shape_rows(ARKIT_NAMES)
    rows[np.ix_([JAW, CLOSE], fap.columns(14, 16))] = 0.0
    rows[CLOSE] += rows[JAW]
    lids_and_brows = fap.columns(*range(19, 23), *range(31, 43))
    looks = [index for index, name in enumerate(ARKIT_NAMES) if name.startswith("eyeLook")]
    rows[np.ix_(looks, lids_and_brows)] = 0.0
    brows = [index for index, name in enumerate(ARKIT_NAMES) if name.startswith("brow")]
    rows[np.ix_(brows, fap.columns(19, 20, 21, 22, 41, 42))] = 0.0
    rows.flags.writeable = False
    return rows


@cache
def _mood_weights() -> Array:
    """(6, 52): weights of :func:`speech_map` of each full mood; they may exceed 1."""
    shapes = BlendMap(
        ARKIT_NAMES, _sought(), limit=MAX_MOOD_WEIGHT, reluctance_mm=MOOD_RELUCTANCE_MM, lengths_mm=_lengths_mm()
    )
    rows = ask(shape_rows(ALL_MOODS), np.zeros(len(ALL_MOODS)))
    return np.array([shapes.solve_weights(row) for row in rows])


@cache
def _shape_openings_mm() -> Array:
    return _openings_mm(shape_rows(ARKIT_NAMES))


def _openings_mm(faps: Array) -> Array:
    """(..., 68) FAPU -> (...) mm between the lips in the middle: three quarters inner edges, one quarter outer."""
    inner, outer = (fap.columns(*pairs[0]) for pairs in (INNER_PAIRS, OUTER_PAIRS))
    moved_mm = faps * weights_mm()
    opening: Array = -0.75 * moved_mm[..., inner].sum(axis=-1) - 0.25 * moved_mm[..., outer].sum(axis=-1)
    return opening


def _lengths_mm() -> Array:
    """(68, 74) mm per FAPU: each FAP as far as it counts, and the openings of the six pairs of points."""
    counted = weights_mm().copy()
    for numbers, share in COUNTED.items():
        counted[fap.columns(*numbers)] *= share
    columns = [np.diag(counted)]
    for pairs, share in ((INNER_PAIRS, INNER_COUNTED), (OUTER_PAIRS, OUTER_COUNTED)):
        for place, pair in enumerate(pairs):
            column = np.zeros((fap.FAP_COUNT, 1))
            at = fap.columns(*pair)
            column[at, 0] = -weights_mm()[at] * share * (SIDE_COUNTED if place else 1.0) / np.sqrt(2.0)
            columns.append(column)
    return np.hstack(columns)
