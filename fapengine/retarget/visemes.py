"""Visemes of Oculus, presets of VRM avatars and mouth shapes of Rhubarb, from FAPs; the first two also to FAPs.

The 15 visemes of Oculus (OVR LipSync), also used by Ready Player Me, VRChat and others, are MPEG-4's visemes, number
for number, and ``sil``. Weights are fractions: none is negative, they add up to 1, and ``sil`` is the remainder. The
FAPs of each viseme come from ``design/fit_visemes.py``; of several sounds that look alike (t, k, n), one represents the
others.

Theory of operation: VRM, version 0 and 1
-----------------------------------------
An avatar has five vowels for the mouth, a few moods, and blinks. Moods come first (:mod:`.moods`); their effect on the
mouth is removed, and the vowels are fitted to the remainder.
Both eyes closed together are ``blink``; ``blinkLeft`` and ``blinkRight`` show the difference. ``relaxed`` (``Fun``)
corresponds to none of MPEG-4's expressions and stays 0, as does ``neutral``; fear and disgust are shown by the nearest
moods. Looks are for avatars without eye bones; full weight is 30 degrees.

Theory of operation: Rhubarb
----------------------------
Four lengths on an adult's face decide, in mm relative to the neutral face: the opening of the lips, the narrowing of
the mouth, the height of the lower lip, and the drop of the jaw. Lips that touch are A; those of the neutral face touch
as well, so a closed mouth with its jaw up is X, unless the lips part within :data:`PAUSE_S` before and after. A lower
lip at the teeth is G. An open mouth is F or E if it is narrow, else B, C or D by its opening. Thresholds are between
the medians of the shapes in planned speech of the shipped profile (106 to 21 cues of a shape; opening of B 6.7, C 7.6,
D 11.4, E 7.5, F 4.5, G 1.2 mm; narrowing of E and F 5.3, of B, C, D 3.0 mm). H is a tongue behind the teeth, which
these lengths do not show, so it is never returned.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, frozen
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.blend import BlendMap, fractions, shape_rows, weights_mm
from fapengine.retarget.moods import MOODS, find_moods, without_moods

OCULUS_NAMES = tuple(viseme.label for viseme in VISEMES)
"""Names in the order of the API, 0..14."""
CHANGE_MM = 8.0
"""Error as which a weight counts that changes by 1 in 1/60 s: less, and weights jump; more, and vowels flatten."""
PLAIN = ("PP", "FF", "aa", "E", "ih", "oh", "ou")
"""Visemes that can be recognized by sight; others are used where they gain more than :data:`RELUCTANCE_MM`."""
DEPTH = (16, 17)
"""FAPs that hardly distinguish visemes: a p next to u is as far forward as the u."""
RELUCTANCE_MM = 0.2
"""Reluctance with which every vowel is shown as its own viseme; it causes half of the error (0.1 mm)."""


@cache
def oculus_map() -> BlendMap:
    """Return the map of the 14 visemes that move; ``sil`` is the neutral face."""
    names = OCULUS_NAMES[1:]
    cost = np.array([0.0 if name in PLAIN else RELUCTANCE_MM for name in names])
    return BlendMap(names, shape_rows(names), reluctance_mm=cost, ignored=DEPTH, change_mm=CHANGE_MM, is_fractions=True)


def approximate_visemes(faps: ArrayLike, rate_hz: float = 60.0) -> Array:
    """Find the visemes that reproduce FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU
        Of one face over time. Jaw and lips count; the contribution of moods (:mod:`.moods`) is removed.
    rate_hz : float
        Frame rate.

    Returns
    -------
    (T, 15) float64
        In the order of :data:`OCULUS_NAMES`; each row adds up to 1.

    Examples
    --------
    >>> import numpy as np
    >>> rest = approximate_visemes(np.zeros((1, 68)))
    >>> OCULUS_NAMES[int(rest[0].argmax())], float(rest.sum())
    ('sil', 1.0)
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    spoken = without_moods(values, find_moods(values)[0])
    return shares(oculus_map().approximate_weights(spoken, rate_hz=rate_hz))


def shares(parts: Array) -> Array:
    """Add the remainder of the 14 fractions, (..., 14), in front, as ``sil``: (..., 15)."""
    rest = np.maximum(1.0 - parts.sum(axis=-1, keepdims=True), 0.0)
    return np.concatenate([rest, parts], axis=-1)


def visemes_to_faps(weights: ArrayLike) -> Array:
    """(..., 15) weights -> (..., 68) FAPU; sums below 1 are filled with silence, sums above 1 are scaled down.

    Raises
    ------
    UsageError
        If a weight is negative.
    """
    values = frozen(weights, "weights", ("...", len(OCULUS_NAMES)), np.float64)
    if (values < 0).any():
        raise UsageError(f"weights: got {values.min():g}, expected none below 0")
    return oculus_map().to_faps(fractions(values)[..., 1:])


VRM1_NAMES = (
    "happy", "angry", "sad", "relaxed", "surprised", "aa", "ih", "ou", "ee", "oh", "blink", "blinkLeft", "blinkRight",
    "lookUp", "lookDown", "lookLeft", "lookRight", "neutral",
)  # fmt: skip
VRM0_NAMES = (
    "Joy", "Angry", "Sorrow", "Fun", "Surprised", "A", "I", "U", "E", "O", "Blink", "Blink_L", "Blink_R",
    "LookUp", "LookDown", "LookLeft", "LookRight", "Neutral",
)  # fmt: skip
"""Names in the order of version 1. ``Surprised`` is not a preset of version 0, but many of its models have it."""
SHOWN = VRM1_NAMES.index("lookUp")
"""Number of presets before the looks, for receivers that turn the eyes themselves."""
VOWELS = {"aa": "aa", "ih": "ih", "ou": "ou", "ee": "E", "oh": "oh"}
LOOK_RAD = np.deg2rad(30.0)
LOOKS = {"lookLeft": ((23, 24), 1), "lookRight": ((23, 24), -1), "lookDown": ((25, 26), 1), "lookUp": ((25, 26), -1)}
"""FAPs of both eyes by look, and their sign."""


@cache
def vowel_map() -> BlendMap:
    """Return the map of the five vowels."""
    return BlendMap(tuple(VOWELS), shape_rows([*VOWELS.values()]), ignored=DEPTH, change_mm=CHANGE_MM)


def approximate_presets(faps: ArrayLike, rate_hz: float = 60.0) -> Array:
    """Find the presets that show FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU
        Of one face over time.
    rate_hz : float
        Frame rate.

    Returns
    -------
    (T, 18) float64
        0 to 1, in the order of :data:`VRM1_NAMES` and of :data:`VRM0_NAMES`.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    moods, lids = find_moods(values)
    spoken = without_moods(values, moods)
    return join_presets(values, moods, lids, vowel_map().approximate_weights(spoken, rate_hz=rate_hz))


def join_presets(faps: Array, moods: Array, lids: Array, vowels: Array) -> Array:
    """Combine moods (T, 4), lids (T, 2) and vowels (T, 5) of FAPs (T, 68) into presets (T, 18)."""
    both = lids.min(axis=1)
    named = dict(zip(MOODS, moods.T, strict=True)) | dict(zip(VOWELS, vowels.T, strict=True))
    named |= {"blink": both, "blinkLeft": lids[:, 0] - both, "blinkRight": lids[:, 1] - both}
    yaw, pitch = gaze_of(faps)
    for name, angle in {"lookLeft": yaw, "lookRight": -yaw, "lookDown": pitch, "lookUp": -pitch}.items():
        named[name] = np.clip(angle / LOOK_RAD, 0.0, 1.0)
    return np.stack([named.get(name, np.zeros(len(faps))) for name in VRM1_NAMES], axis=1)


def gaze_of(faps: Array) -> tuple[Array, Array]:
    """(T, 68) FAPU -> yaw to the left and pitch down, (T,) rad each: mean of both eyes."""
    yaw, pitch = (faps[:, fap.columns(*numbers)].mean(axis=1) * AU_RAD for numbers in ((23, 24), (25, 26)))
    return yaw, pitch


def presets_to_faps(weights: ArrayLike) -> Array:
    """(..., 18) weights, in the order of :data:`VRM1_NAMES` -> (..., 68) FAPU; ``relaxed`` is a weak joy."""
    values = frozen(weights, "weights", ("...", len(VRM1_NAMES)), np.float64)
    return values @ _rows()


@cache
def _rows() -> Array:
    """(18, 68) FAPU at full weight."""
    named = {name: shape_rows([shape])[0] for name, shape in (MOODS | VOWELS).items()}
    named["relaxed"] = 0.4 * named["happy"]
    named["blinkLeft"], named["blinkRight"] = shape_rows(["eyeBlinkLeft", "eyeBlinkRight"])
    named["blink"] = named["blinkLeft"] + named["blinkRight"]
    for name, (numbers, sign) in LOOKS.items():
        named[name] = np.zeros(fap.FAP_COUNT)
        named[name][fap.columns(*numbers)] = sign * LOOK_RAD / AU_RAD
    return np.stack([named.get(name, np.zeros(fap.FAP_COUNT)) for name in VRM1_NAMES])


SHUT_MM = 0.7
"""Opening relative to the neutral face below which lips touch; closures of the planner leave 0.3 mm at most."""
BITTEN_OPENING_MM, BITTEN_LOWER_MM, BITTEN_UPPER_MM = 2.8, -0.7, 0.0
"""Largest opening of G, least height of its lower lip, and lowest upper lip: on p b m it comes down."""
NARROW_MM = 4.5
"""Narrowing from which lips are rounded."""
PUCKERED_OPENING_MM = 6.0
"""Largest opening of F; rounder lips that are wider open are E."""
OPEN_MM, WIDE_OPEN_MM = 7.0, 9.5
"""Least opening of C and of D."""
JAW_UP_MM = 1.0
"""Jaws of closed lips in speech are lower than this (4 mm, median)."""
PAUSE_S = 0.15
"""Closures of speech are shorter."""


def approximate_shapes(faps: ArrayLike, rate_hz: float) -> list[str]:
    """Find the shape of each frame.

    Parameters
    ----------
    faps : (T, 68) FAPU
        The contribution of moods (:mod:`.moods`) is removed.
    rate_hz : float
        Frame rate.

    Returns
    -------
    list of str
        T characters.

    Examples
    --------
    >>> import numpy as np
    >>> approximate_shapes(np.zeros((2, 68)), 30.0)
    ['X', 'X']
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    if not len(values):
        return []
    moved = without_moods(values, find_moods(values)[0]) * weights_mm()
    upper, lower, left, right = (moved[:, fap.column(number)] for number in (4, 5, 6, 7))
    jaw = values[:, fap.column(3)] * weights_mm()[fap.column(3)]  # brows that move make a little surprise, and its jaw
    opening, round_lips = -(upper + lower), left + right < -NARROW_MM
    shut, jaw_up = opening < SHUT_MM, jaw < JAW_UP_MM
    speaking = ~jaw_up | _near(~shut, round(PAUSE_S * rate_hz))
    bitten = (opening < BITTEN_OPENING_MM) & (lower > BITTEN_LOWER_MM) & (upper < BITTEN_UPPER_MM) & ~jaw_up
    names = np.select(
        [bitten, shut & speaking, shut, round_lips & (opening < PUCKERED_OPENING_MM), round_lips,
         opening < OPEN_MM, opening < WIDE_OPEN_MM],
        ["G", "A", "X", "F", "E", "B", "C"],
        "D",
    )  # fmt: skip
    return [str(name) for name in names]


def _near(parted: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Whether lips are parted both within ``reach`` frames before and within ``reach`` after each frame."""
    count = np.concatenate([[0], np.cumsum(parted)])
    here = np.arange(len(parted))
    before = count[here + 1] - count[np.maximum(here - reach, 0)]
    after = count[np.minimum(here + reach + 1, len(parted))] - count[here]
    both: NDArray[np.bool_] = (before > 0) & (after > 0)
    return both
