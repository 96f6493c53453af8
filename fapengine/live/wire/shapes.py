"""FAPs to what other programs show: ARKit's 52 shapes, VRM's presets, and the turns of head and eyes."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.arkit import ARKIT_NAMES, arkit_map
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.moods import MOODS, mood_map, moods_to_faps
from fapengine.retarget.vrm import SHOWN, join_presets, vowel_map

Array = NDArray[np.float64]

HEAD_TURNS = (49, 48, 50)
"""FAP numbers of yaw, pitch, roll."""
EYE_TURNS = ((23, 25), (24, 26))
"""FAP numbers of yaw and pitch, left eye and right eye."""


def arkit_weights(faps: ArrayLike) -> Array:
    """Find the shapes that show FAPs.

    Parameters
    ----------
    faps : (T, 68) FAPU
        As :attr:`fapengine.mpeg4.track.FapTrack.values`. Many frames at once, of one session or of many, cost less.

    Returns
    -------
    (T, 52) float64
        0..1, in the order of :data:`fapengine.retarget.arkit.ARKIT_NAMES`. ``mouthClose`` never goes past
        ``jawOpen``: it closes lips over an open jaw, and without one it pushes them through each other.
    """
    return _lips_over_jaw(_map().approximate_weights(faps))


class ArkitFollower:
    """The shapes of one face, frame by frame; each frame begins where the one before ended.

    Stateful.
    """

    def __init__(self) -> None:
        self._last: Array | None = None

    def follow(self, faps: ArrayLike) -> Array:
        """Take the next frame, (68,) FAPU; return (52,) as a row of :func:`arkit_weights`, only solved exactly."""
        self._last = _map().solve_weights(faps, self._last)
        return _lips_over_jaw(self._last.copy())


class PresetFollower:
    """VRM's presets of one face, frame by frame, without the looks: its eyes turn as bones.

    Stateful.
    """

    def __init__(self) -> None:
        self._upper: Array | None = None
        self._vowels: Array | None = None

    def follow(self, faps: ArrayLike) -> Array:
        """Take the next frame, (68,) FAPU; return (13,): as :data:`fapengine.retarget.vrm.VRM1_NAMES` begins."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        self._upper = mood_map().solve_weights(values, self._upper)
        spoken = values - moods_to_faps(self._upper[: len(MOODS)])
        self._vowels = vowel_map().solve_weights(spoken, self._vowels)
        return join_presets(values[None], self._upper[None], self._vowels[None])[0, :SHOWN]


def _lips_over_jaw(weights: Array) -> Array:
    close, jaw = ARKIT_NAMES.index("mouthClose"), ARKIT_NAMES.index("jawOpen")
    weights[..., close] = np.minimum(weights[..., close], weights[..., jaw])
    return weights


def turns_rad(faps: ArrayLike) -> Array:
    """Read the turns of head and eyes out of FAPs.

    Returns
    -------
    (T, 3, 3) float64, rad
        Head, left eye, right eye, each yaw, pitch, roll; positive is the subject's left, down and right ear down, as
        FAP 48 to 50 count. The eyes' roll is 0: no FAP has it.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    turns = np.zeros((len(values), 3, 3))
    for row, numbers in enumerate((HEAD_TURNS, *EYE_TURNS)):
        turns[:, row, : len(numbers)] = values[:, [fap.column(number) for number in numbers]] * AU_RAD
    return turns


@cache
def _map() -> BlendMap:
    return arkit_map()
