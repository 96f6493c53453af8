"""ARKit's 52 blend shapes, FAPs in and out; the order is that of Live Link Face and Azure, 0 to 51.

Theory of operation
-------------------
The way to FAPs is a sum of measured rows. The way back has many answers that look alike on the measured face, and only
one that a rigger would give, which then also looks right on other avatars: the jaw opens the mouth, ``mouthClose``
shuts lips over it, and no shape works against another. It is found in four steps:

1. Moods (:mod:`.moods`) are told from the upper face and become shapes of their own: a smile is ``mouthSmile``. Steps
   2 and 3 see what is left, speech and life.
2. Bounded least squares (:mod:`.blend`): shapes that are no business of speech cost :data:`RELUCTANCE_MM`, small
   helpers give way to the jaw (:data:`STIFFNESS_MM`), and the opening between the inner lips counts thrice. It is done
   twice: a shape that is large the first time is meant, and costs nothing the second; so a smile keeps its size. What
   an avatar does by itself does not count: a jaw that opens swings back (30 mm of FAP 14 and 20 mm of FAP 16), which
   speech does not tell and ``jawForward`` would make good; eyes that turn and brows that rise take
   lids along.
3. ``mouthClose`` is sought as *a jaw that is open behind shut lips*, the sum of both shapes, so that it cannot pass
   ``jawOpen``.
4. Of two opposites (:data:`OPPOSITES`) only the difference is shown. Where lips are nearly shut and shapes would open
   them wider, these are made smaller, and ``jawOpen`` is kept behind ``mouthClose``: lips that are shut stay shut, on
   any avatar, whatever else is asked for. Where the mouth is open, the jaw takes what then lacks.

Every step is continuous in the FAPs.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.mpeg4 import fap
from fapengine.retarget.blend import BlendMap, weights_mm
from fapengine.retarget.moods import cost_share, find_moods, without_moods
from fapengine.retarget.shape_rows import ALL_MOODS, ARKIT_NAMES, shape_rows

Array = NDArray[np.float64]

JAW, CLOSE = ARKIT_NAMES.index("jawOpen"), ARKIT_NAMES.index("mouthClose")
SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
SIDEWAYS_MM = 0.8
"""Reluctance of :data:`SIDEWAYS` in plain least squares (:func:`arkit_map`): left and right together narrow a mouth."""
RELUCTANCE_MM = {
    "jawForward": 3.0, "jawLeft": 3.0, "jawRight": 3.0, "mouthLeft": 3.0, "mouthRight": 3.0, "mouthFrown": 3.0,
    "cheekPuff": 3.5, "noseSneer": 2.0, "mouthSmile": 1.6, "mouthDimple": 0.7, "mouthStretch": 0.8, "mouthPress": 0.6,
    "mouthLowerDown": 0.5, "mouthUpperUp": 0.5, "mouthShrugUpper": 2.0, "mouthShrugLower": 0.8, "mouthFunnel": 0.6,
    "mouthRollUpper": 0.4, "mouthRollLower": 0.3, "mouthClose": 0.3, "cheekSquint": 0.6, "eyeSquint": 0.9,
    "eyeWide": 0.3, "browDown": 0.8,
}  # fmt: skip
"""A shape is used only where it brings the face so much nearer to what is wanted; both sides alike, others cost 0."""
STIFFNESS_MM = {
    "mouthLowerDown": 6.0, "mouthUpperUp": 7.0, "mouthShrugUpper": 4.0, "mouthShrugLower": 3.0, "mouthFunnel": 6.0,
    "mouthRollUpper": 3.0, "mouthRollLower": 3.0, "mouthPress": 3.0, "mouthStretch": 3.0, "mouthDimple": 3.0,
}  # fmt: skip
"""A shape at full weight is as bad as being off by so much; it shares its work with others."""
COUNTED = {
    (3,): 0.5, (4, 5, 8, 9, 10, 11, 51, 52, 55, 56, 57, 58): 0.8, (12, 13, 59, 60): 0.35, (14,): 0.7, (16, 17): 0.6,
    (18,): 0.3,
}  # fmt: skip
"""Share of a FAP's millimetres that counts; others count wholly. Jaws, corners and depth differ between avatars."""
INNER_PAIRS, OUTER_PAIRS = ((4, 5), (8, 10), (9, 11)), ((51, 52), (55, 57), (56, 58))
"""Upper and lower lip, middle first; minus their sum is the opening."""
INNER_COUNTED, OUTER_COUNTED, SIDE_COUNTED = 3.0, 0.7, 0.6
"""Weight of the opening of inner and of outer pairs besides, and of pairs at the side against the middle."""
SWING = 933.5 / 1360.6
"""FAP 16 by FAP 3 of jawOpen: the lower lip goes back with a jaw that opens; if no farther, it is the jaw's doing."""
OPPOSITES = (
    ("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"), ("mouthSmileLeft", "mouthFrownLeft"),
    ("mouthSmileRight", "mouthFrownRight"), ("eyeBlinkLeft", "eyeWideLeft"), ("eyeBlinkRight", "eyeWideRight"),
    ("eyeLookUpLeft", "eyeLookDownLeft"), ("eyeLookUpRight", "eyeLookDownRight"),
    ("eyeLookInLeft", "eyeLookOutLeft"), ("eyeLookInRight", "eyeLookOutRight"),
)  # fmt: skip
"""Pairs of which never both are at work."""
OPENERS = (
    "mouthFunnel", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight",
    "mouthShrugUpper", "noseSneerLeft", "noseSneerRight",
)  # fmt: skip
"""Shapes that part lips, beside the jaw."""
PARTED_MM = 3.0
"""Opening from which on only the fit counts; below, nothing opens lips farther than they are."""
SHUT_MM = 0.1
"""Opening that counts as none."""
MOOD_RELUCTANCE_MM = {"browDown": 2.0, "jawForward": 2.0, "mouthPucker": 1.0, "mouthRollUpper": 1.0}
"""Reluctance of shapes in a full mood: sad brows are raised inside, not drawn down outside, as angry ones are."""
MAX_MOOD_WEIGHT = 3.0
"""Full expressions may be larger than full shapes."""


@cache
def arkit_map() -> BlendMap:
    """Make the map of the 52 shapes, by which they become FAPs.

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
    """Make the map by which weights of speech and life are sought; its ``mouthClose`` is a jaw behind shut lips."""
    return BlendMap(
        ARKIT_NAMES,
        _sought(),
        reluctance_mm=_by_name(RELUCTANCE_MM),
        stiffness_mm=_by_name(STIFFNESS_MM),
        lengths_mm=_lengths_mm(),
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
        0..1, in the order of :data:`ARKIT_NAMES`. ``mouthClose`` never goes past ``jawOpen``, and of
        :data:`OPPOSITES` never both are at work.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    moods, _ = find_moods(values, ALL_MOODS)
    asked = ask(values, moods)
    first = speech_map().approximate_weights(asked)
    return join_shapes(values, moods, speech_map().approximate_weights(asked, cost=spoken_cost(first)))


def arkit_to_faps(weights: ArrayLike) -> Array:
    """(..., 52) weights -> (..., 68) FAPU; lips that would pass through each other touch, half way between."""
    faps = arkit_map().to_faps(weights).copy()
    for (upper, lower), (outer_upper, outer_lower) in zip(INNER_PAIRS, OUTER_PAIRS, strict=True):
        passed = 0.5 * np.maximum(faps[..., fap.column(upper)] + faps[..., fap.column(lower)], 0.0)
        for number in (upper, lower, outer_upper, outer_lower):
            faps[..., fap.column(number)] -= passed
    return faps


def ask(faps: Array, moods: Array) -> Array:
    """Take what moods, (..., 6), do and a jaw's swing from FAPs, (..., 68): what is left for :func:`speech_map`."""
    asked = without_moods(faps, moods, ALL_MOODS)
    opened, forward, lip = (asked[..., fap.column(number)] for number in (3, 14, 16))
    lip += np.minimum(np.maximum(-lip, 0.0), SWING * np.maximum(opened, 0.0))
    forward[...] = np.maximum(forward, 0.0)
    return asked


def spoken_cost(first: Array) -> Array:
    """(..., 52) weights found first -> share of its reluctance that each shape bears then; helpers bear it all."""
    share = cost_share(first)
    share[..., _helpers()] = 1.0
    return share


def join_shapes(faps: Array, moods: Array, spoken: Array) -> Array:
    """Put shapes together, (T, 52): FAPs (T, 68), their moods (T, 6), and the rest as :func:`speech_map` has it."""
    weights = spoken + moods @ _mood_weights()
    weights[:, JAW] += weights[:, CLOSE]
    for one, other in _opposites():
        common = np.minimum(weights[:, one], weights[:, other])
        weights[:, one] -= common
        weights[:, other] -= common
    return _fit_opening(np.clip(weights, 0.0, 1.0), faps)


def _fit_opening(weights: Array, faps: Array) -> Array:
    """Open lips as far as FAPs do, (T, 68), and in closures by no shape at all; changes and returns ``weights``."""
    openings_mm, openers = _openings()
    inner = [fap.column(number) for number in INNER_PAIRS[0]]
    wanted_mm = np.maximum(-(faps[:, inner] * weights_mm()[inner]).sum(axis=1), 0.0)
    ajar = weights[:, JAW] - np.minimum(weights[:, CLOSE], weights[:, JAW])
    shown_mm = ajar * openings_mm[JAW] + weights[:, openers] @ openings_mm[openers]
    share = np.minimum((wanted_mm + SHUT_MM) / np.maximum(shown_mm, SHUT_MM), 1.0)
    share = 1.0 - (1.0 - share) * np.maximum(1.0 - wanted_mm / PARTED_MM, 0.0)
    weights[:, CLOSE] = weights[:, JAW] - share * ajar
    weights[:, openers] *= share[:, None]
    parted_mm = _openings_mm(faps)
    lacking = (parted_mm - weights @ openings_mm) / openings_mm[JAW] * np.minimum(wanted_mm / PARTED_MM, 1.0)
    weights[:, JAW] = np.clip(weights[:, JAW] + lacking, weights[:, CLOSE], 1.0)
    return weights


@cache
def _sought() -> Array:
    """(52, 68) FAPU, read-only: rows without what an avatar does by itself."""
    rows = shape_rows(ARKIT_NAMES)
    rows[np.ix_([JAW, CLOSE], [fap.column(number) for number in (14, 16)])] = 0.0
    rows[CLOSE] += rows[JAW]
    lids_and_brows = [fap.column(number) for number in (*range(19, 23), *range(31, 43))]
    looks = [index for index, name in enumerate(ARKIT_NAMES) if name.startswith("eyeLook")]
    rows[np.ix_(looks, lids_and_brows)] = 0.0
    brows = [index for index, name in enumerate(ARKIT_NAMES) if name.startswith("brow")]
    rows[np.ix_(brows, [fap.column(number) for number in (19, 20, 21, 22, 41, 42)])] = 0.0
    rows.flags.writeable = False
    return rows


@cache
def _mood_weights() -> Array:
    """(6, 52): the shapes of each full mood; they may be more than 1. As :func:`speech_map`'s."""
    cost = _by_name(MOOD_RELUCTANCE_MM)
    shapes = BlendMap(ARKIT_NAMES, _sought(), limit=MAX_MOOD_WEIGHT, reluctance_mm=cost, lengths_mm=_lengths_mm())
    rows = ask(shape_rows(ALL_MOODS), np.zeros(len(ALL_MOODS)))
    return np.array([shapes.solve_weights(row) for row in rows])


@cache
def _openings() -> tuple[Array, list[int]]:
    """(52,) mm that each shape parts the lips, and the shapes that do it beside the jaw."""
    return _openings_mm(shape_rows(ARKIT_NAMES)), [ARKIT_NAMES.index(name) for name in OPENERS]


def _openings_mm(faps: Array) -> Array:
    """(..., 68) FAPU -> (...) mm between the lips in the middle: three parts inner edges, one part outer."""
    inner, outer = ([fap.column(number) for number in pairs[0]] for pairs in (INNER_PAIRS, OUTER_PAIRS))
    moved_mm = faps * weights_mm()
    parted: Array = -0.75 * moved_mm[..., inner].sum(axis=-1) - 0.25 * moved_mm[..., outer].sum(axis=-1)
    return parted


@cache
def _opposites() -> tuple[tuple[int, int], ...]:
    return tuple((ARKIT_NAMES.index(one), ARKIT_NAMES.index(other)) for one, other in OPPOSITES)


@cache
def _helpers() -> NDArray[np.intp]:
    return np.flatnonzero(_by_name(STIFFNESS_MM))


def _by_name(values: dict[str, float]) -> Array:
    """(52,): values of shapes by their names without a side."""
    return np.array(
        [values.get(name.removesuffix("Left").removesuffix("Right"), values.get(name, 0.0)) for name in ARKIT_NAMES]
    )


def _lengths_mm() -> Array:
    """(68, 74) mm a FAPU: each FAP as far as it counts, and the openings of the six pairs of points."""
    counted = weights_mm().copy()
    for numbers, share in COUNTED.items():
        counted[[fap.column(number) for number in numbers]] *= share
    columns = [np.diag(counted)]
    for pairs, share in ((INNER_PAIRS, INNER_COUNTED), (OUTER_PAIRS, OUTER_COUNTED)):
        for place, pair in enumerate(pairs):
            column = np.zeros((fap.FAP_COUNT, 1))
            at = [fap.column(number) for number in pair]
            column[at, 0] = -weights_mm()[at] * share * (SIDE_COUNTED if place else 1.0) / np.sqrt(2.0)
            columns.append(column)
    return np.hstack(columns)
