"""The presets of VRM avatars, version 0 and 1: FAPs in and out.

Theory of operation
-------------------
An avatar has five vowels for the mouth, a few moods, and blinks. Moods come first (:mod:`.moods`); what they do to the
mouth is taken away, and the vowels are fitted to what is left, no wider than it is open: a mouth that is shut is no
vowel at all. Both eyes shut together are ``blink``; what one does more is its own. ``relaxed`` (``Fun``) has no
counterpart among MPEG-4's expressions and stays 0, as does ``neutral``; fear and disgust are shown by the nearest
moods. Looks are given for avatars without eye bones; full weight is 30 degrees.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.moods import MOODS, find_moods, without_moods
from fapengine.retarget.oculus import DEPTH
from fapengine.retarget.shape_rows import ARKIT_NAMES, shape_rows

Array = NDArray[np.float64]

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
"""Presets before the looks, for receivers that turn the eyes themselves."""
VOWELS = {"aa": "aa", "ih": "ih", "ou": "ou", "ee": "E", "oh": "oh"}
MIN_OPENING = 1.0
"""Opening between the lips, MNS: 0.02 mm."""
LOOK_RAD = np.deg2rad(30.0)


@cache
def vowel_map() -> BlendMap:
    """Make the map of the five vowels."""
    return BlendMap(tuple(VOWELS), shape_rows([*VOWELS.values()]), ignored=DEPTH)


def approximate_presets(faps: ArrayLike) -> Array:
    """Find the presets that show FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU

    Returns
    -------
    (T, 18) float64
        0..1, in the order of :data:`VRM1_NAMES` and of :data:`VRM0_NAMES`.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    moods, lids = find_moods(values)
    spoken = without_moods(values, moods)
    return join_presets(values, moods, lids, vowel_map().approximate_weights(spoken))


def join_presets(faps: Array, moods: Array, lids: Array, vowels: Array) -> Array:
    """Put presets together, (T, 18): FAPs (T, 68), moods (T, 4), lids (T, 2), vowels (T, 5) of the rest."""
    shown = no_wider(vowels, without_moods(faps, moods))
    presets = np.zeros((len(faps), len(VRM1_NAMES)))
    for names, weights in ((tuple(MOODS), moods), (tuple(VOWELS), shown)):
        for name, weight in zip(names, weights.T, strict=True):
            presets[:, VRM1_NAMES.index(name)] = weight
    both = lids.min(axis=1)
    presets[:, VRM1_NAMES.index("blink")] = both
    presets[:, [VRM1_NAMES.index("blinkLeft"), VRM1_NAMES.index("blinkRight")]] = lids - both[:, None]
    for name, angle in zip(("lookLeft", "lookDown"), _looks(faps), strict=True):
        opposite = {"lookLeft": "lookRight", "lookDown": "lookUp"}[name]
        presets[:, VRM1_NAMES.index(name)] = np.clip(angle, 0.0, 1.0)
        presets[:, VRM1_NAMES.index(opposite)] = np.clip(-angle, 0.0, 1.0)
    return presets


def no_wider(vowels: Array, spoken: Array) -> Array:
    """Make vowels, (T, 5), smaller where they would open lips wider than FAPs, (T, 68), do: shut stays shut."""
    shown, wanted = opening(vowel_map().to_faps(vowels)), opening(spoken)
    share = np.clip(wanted / np.maximum(shown, MIN_OPENING), 0.0, 1.0)
    return np.where(shown > MIN_OPENING, share, 1.0)[:, None] * vowels


def opening(faps: Array) -> Array:
    """(T, 68) FAPU -> (T,) MNS: between the lips in the middle, inner and outer edges averaged."""
    lips = [fap.column(number) for number in (4, 5, 51, 52)]
    between: Array = -0.5 * faps[..., lips].sum(axis=-1)
    return between


def presets_to_faps(weights: ArrayLike) -> Array:
    """(..., 18) weights, in the order of :data:`VRM1_NAMES` -> (..., 68) FAPU; ``relaxed`` is a faint joy."""
    values = frozen(weights, "weights", ("...", len(VRM1_NAMES)), np.float64)
    faps: Array = values @ _rows()
    return faps


@cache
def _rows() -> Array:
    """(18, 68) FAPU at full weight."""
    rows = np.zeros((len(VRM1_NAMES), fap.FAP_COUNT))
    arkit = arkit_map()

    def shape(name: str) -> Array:
        row: Array = arkit.faps[ARKIT_NAMES.index(name)]
        return row

    for name, expression in MOODS.items():
        rows[VRM1_NAMES.index(name)] = shape_rows([expression])[0]
    rows[VRM1_NAMES.index("relaxed")] = 0.4 * rows[VRM1_NAMES.index("happy")]
    for name, viseme in VOWELS.items():
        rows[VRM1_NAMES.index(name)] = shape_rows([viseme])[0]
    left, right = shape("eyeBlinkLeft"), shape("eyeBlinkRight")
    rows[VRM1_NAMES.index("blinkLeft")], rows[VRM1_NAMES.index("blinkRight")] = left, right
    rows[VRM1_NAMES.index("blink")] = left + right
    turn = LOOK_RAD / AU_RAD
    for name, numbers, sign in (
        ("lookLeft", (23, 24), 1), ("lookRight", (23, 24), -1), ("lookDown", (25, 26), 1), ("lookUp", (25, 26), -1),
    ):  # fmt: skip
        rows[VRM1_NAMES.index(name), [fap.column(number) for number in numbers]] = sign * turn
    return rows


def _looks(faps: Array) -> tuple[Array, Array]:
    """Mean of both eyes, in shares of :data:`LOOK_RAD`: to the left, and down."""
    yaw, pitch = (
        faps[:, [fap.column(number) for number in numbers]].mean(axis=1) * AU_RAD / LOOK_RAD
        for numbers in ((23, 24), (25, 26))
    )
    return yaw, pitch
