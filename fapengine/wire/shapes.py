"""FAPs to what other programs show: ARKit's 52 shapes, VRM's presets, and the turns of head and eyes."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import frozen
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.arkit import ask, join_shapes, speech_map, spoken_cost
from fapengine.retarget.blend import BlendMap
from fapengine.retarget.moods import MOODS, MoodHold, cost_share, mood_map, read_moods, without_moods
from fapengine.retarget.oculus import oculus_map, shares
from fapengine.retarget.shape_rows import ALL_MOODS
from fapengine.retarget.vrm import SHOWN, join_presets, vowel_map

Array = NDArray[np.float64]

HEAD_TURNS = (49, 48, 50)
"""FAP numbers of yaw, pitch, roll."""
EYE_TURNS = ((23, 25), (24, 26))
"""FAP numbers of yaw and pitch, left eye and right eye."""


class _Follower:
    """Weights of one map, frame by frame, found twice as :func:`fapengine.retarget.moods.approximate_upper` does.

    Stateful.
    """

    def __init__(self, shapes: BlendMap, cost: Callable[[Array], Array]) -> None:
        self._shapes, self._cost = shapes, cost
        self._first: Array | None = None
        self._second: Array | None = None

    def follow(self, faps: Array) -> Array:
        self._first = self._shapes.solve_weights(faps, self._first)
        cost = self._cost(self._first)
        if self._shapes.is_full(cost):
            self._second = self._first
        else:
            self._second = self._shapes.solve_weights(faps, self._second, cost=cost)
        return self._second


class ArkitFollower:
    """The shapes of one face, frame by frame; each frame begins where the one before ended.

    Stateful.
    """

    def __init__(self) -> None:
        self._upper, self._hold = _Follower(mood_map(ALL_MOODS), cost_share), MoodHold()
        self._spoken = _Follower(speech_map(), spoken_cost)

    def follow(self, faps: ArrayLike) -> Array:
        """Take the next frame, (68,) FAPU; return (52,) as a row of ``approximate_arkit``, only solved exactly."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        moods = self._hold.follow(read_moods(self._upper.follow(values), ALL_MOODS), values)
        spoken = self._spoken.follow(ask(values, moods))
        shown: Array = join_shapes(values[None], moods[None], spoken[None])[0]
        return shown


class PresetFollower:
    """VRM's presets of one face, frame by frame, without the looks: its eyes turn as bones.

    Stateful.
    """

    def __init__(self) -> None:
        self._upper, self._hold = _Follower(mood_map(), cost_share), MoodHold()
        self._vowels: Array | None = None

    def follow(self, faps: ArrayLike) -> Array:
        """Take the next frame, (68,) FAPU; return (13,): as :data:`fapengine.retarget.vrm.VRM1_NAMES` begins."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        upper = self._upper.follow(values)
        moods, lids = self._hold.follow(read_moods(upper), values), upper[len(MOODS) : len(MOODS) + 2]
        self._vowels = vowel_map().solve_weights(without_moods(values, moods), self._vowels)
        return join_presets(values[None], moods[None], lids[None], self._vowels[None])[0, :SHOWN]


class VisemeFollower:
    """Oculus' visemes of one face, frame by frame.

    Stateful.
    """

    def __init__(self) -> None:
        self._upper, self._hold = _Follower(mood_map(), cost_share), MoodHold()
        self._weights: Array | None = None

    def follow(self, faps: ArrayLike) -> Array:
        """Take the next frame, (68,) FAPU; return (15,) as a row of ``approximate_visemes``, only solved exactly."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        moods = self._hold.follow(read_moods(self._upper.follow(values)), values)
        self._weights = oculus_map().solve_weights(without_moods(values, moods), self._weights)
        return shares(self._weights)


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
