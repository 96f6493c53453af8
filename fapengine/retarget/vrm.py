"""The presets of VRM avatars, version 0 and 1: from FAPs and to FAPs.

Theory of operation
-------------------
An avatar has five vowels for the mouth, a few moods, and blinks. Moods come first (:mod:`.moods`); their effect on the
mouth is removed, and the vowels are fitted to the remainder, no wider than it is open: a closed mouth shows no vowel.
Both eyes closed together are ``blink``; ``blinkLeft`` and ``blinkRight`` show the difference. ``relaxed`` (``Fun``)
corresponds to none of MPEG-4's expressions and stays 0, as does ``neutral``; fear and disgust are shown by the nearest
moods. Looks are for avatars without eye bones; full weight is 30 degrees.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.moods import MOODS, find_moods, without_moods
from fapengine.retarget.oculus import DEPTH
from fapengine.retarget.shape_rows import shape_rows

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
MIN_OPENING = 1.0
"""Least opening between the lips that vowels are scaled to, MNS: 0.02 mm."""
LOOK_RAD = np.deg2rad(30.0)
LOOKS = {"lookLeft": ((23, 24), 1), "lookRight": ((23, 24), -1), "lookDown": ((25, 26), 1), "lookUp": ((25, 26), -1)}
"""FAPs of both eyes by look, and their sign."""


@cache
def vowel_map() -> BlendMap:
    """Return the map of the five vowels."""
    return BlendMap(tuple(VOWELS), shape_rows([*VOWELS.values()]), ignored=DEPTH)


def approximate_presets(faps: ArrayLike) -> Array:
    """Find the presets that show FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU

    Returns
    -------
    (T, 18) float64
        0 to 1, in the order of :data:`VRM1_NAMES` and of :data:`VRM0_NAMES`.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    moods, lids = find_moods(values)
    spoken = without_moods(values, moods)
    return join_presets(values, moods, lids, vowel_map().approximate_weights(spoken))


def join_presets(faps: Array, moods: Array, lids: Array, vowels: Array) -> Array:
    """Combine moods (T, 4), lids (T, 2) and vowels (T, 5) of FAPs (T, 68) into presets (T, 18)."""
    # Vowels are scaled down where they would open the lips wider than the FAPs do: closed lips stay closed.
    shown, wanted = _opening(vowel_map().to_faps(vowels)), _opening(without_moods(faps, moods))
    scale = np.clip(wanted / np.maximum(shown, MIN_OPENING), 0.0, 1.0)
    scale = np.where(shown > MIN_OPENING, scale, 1.0)
    both = lids.min(axis=1)
    named = dict(zip(MOODS, moods.T, strict=True)) | dict(zip(VOWELS, scale * vowels.T, strict=True))
    named |= {"blink": both, "blinkLeft": lids[:, 0] - both, "blinkRight": lids[:, 1] - both}
    yaw, pitch = gaze_of(faps)
    for name, angle in {"lookLeft": yaw, "lookRight": -yaw, "lookDown": pitch, "lookUp": -pitch}.items():
        named[name] = np.clip(angle / LOOK_RAD, 0.0, 1.0)
    return np.stack([named.get(name, np.zeros(len(faps))) for name in VRM1_NAMES], axis=1)


def gaze_of(faps: Array) -> tuple[Array, Array]:
    """(T, 68) FAPU -> yaw to the left and pitch down, (T,) rad each: mean of both eyes."""
    yaw, pitch = (
        faps[:, [fap.column(number) for number in numbers]].mean(axis=1) * AU_RAD for numbers in ((23, 24), (25, 26))
    )
    return yaw, pitch


def _opening(faps: Array) -> Array:
    """(T, 68) FAPU -> (T,) MNS: opening between the lips in the middle, mean of inner and outer edges."""
    lips = [fap.column(number) for number in (4, 5, 51, 52)]
    between: Array = -0.5 * faps[..., lips].sum(axis=-1)
    return between


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
        named[name][[fap.column(number) for number in numbers]] = sign * LOOK_RAD / AU_RAD
    return np.stack([named.get(name, np.zeros(fap.FAP_COUNT)) for name in VRM1_NAMES])
