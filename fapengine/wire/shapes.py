"""Weights of one face for other programs: ARKit's 52 shapes, VRM's presets, Oculus' visemes; turns of head and eyes.

As JSON text, for programs with a JSON parser and blend shapes (Unity, Godot, a page, a script), a frame is one object::

    {"t": 12.35,                           engine time, s
     "session": "face",
     "arkit": {"jawOpen": 0.31, ...},      all 52, 0..1
     "visemes": {"sil": 0.2, "aa": ...},   Oculus' 15, 0..1, together 1
     "head": [pitch, yaw, roll]}           degrees; positive is down, the subject's left, right ear down

A receiver uses either the shapes or the visemes, whichever its model has.
"""

import json
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.arkit import ask, join_shapes, speech_map, spoken_cost
from fapengine.retarget.blend import ALL_MOODS, ARKIT_NAMES, BlendMap
from fapengine.retarget.moods import MOODS, MoodHold, cost_share, mood_map, read_moods, without_moods
from fapengine.retarget.visemes import OCULUS_NAMES, SHOWN, join_presets, oculus_map, shares, vowel_map

HEAD_TURNS = (49, 48, 50)
"""FAP numbers of yaw, pitch, roll."""
EYE_TURNS = ((23, 25), (24, 26))
"""FAP numbers of yaw and pitch, left eye and right eye."""


class _Follower:
    """Weights of one map, frame by frame, solved twice as in :func:`fapengine.retarget.moods.approximate_upper`.

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
    """ARKit's shapes of one face, frame by frame; each solution starts from that of the frame before.

    Stateful.
    """

    def __init__(self) -> None:
        self._upper, self._hold = _Follower(mood_map(ALL_MOODS), cost_share), MoodHold()
        self._spoken = _Follower(speech_map(), spoken_cost)

    def follow(self, faps: ArrayLike) -> Array:
        """Add the next frame, (68,) FAPU; return (52,) like a row of ``approximate_arkit``, solved exactly."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        moods = self._hold.follow(read_moods(self._upper.follow(values), ALL_MOODS), values)
        spoken = self._spoken.follow(ask(values, moods))
        shown: Array = join_shapes(values[None], moods[None], spoken[None])[0]
        return shown


class _MoodFollower:
    """Moods of one face, frame by frame, and the weights of a map for the rest of the face. Stateful."""

    def __init__(self, shapes: BlendMap, rate_hz: float) -> None:
        self._upper, self._hold = _Follower(mood_map(), cost_share), MoodHold()
        self._shapes, self._rate_hz = shapes, rate_hz
        self._weights: Array | None = None

    def _follow(self, values: Array) -> tuple[Array, Array, Array]:
        """Return the weights of the upper face, the moods, and the weights of the map."""
        upper = self._upper.follow(values)
        moods = self._hold.follow(read_moods(upper), values)
        spoken = without_moods(values, moods)
        self._weights = self._shapes.solve_weights(spoken, self._weights, rate_hz=self._rate_hz)
        return upper, moods, self._weights


class PresetFollower(_MoodFollower):
    """VRM's presets of one face, frame by frame, without gaze: its eyes turn as bones.

    Stateful.
    """

    def __init__(self, rate_hz: float = 60.0) -> None:
        super().__init__(vowel_map(), rate_hz)

    def follow(self, faps: ArrayLike) -> Array:
        """Add the next frame, (68,) FAPU; return (13,), the first of :data:`fapengine.retarget.visemes.VRM1_NAMES`."""
        values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        upper, moods, vowels = self._follow(values)
        lids = upper[len(MOODS) : len(MOODS) + 2]
        return join_presets(values[None], moods[None], lids[None], vowels[None])[0, :SHOWN]


class VisemeFollower(_MoodFollower):
    """Oculus' visemes of one face, frame by frame.

    Stateful.
    """

    def __init__(self, rate_hz: float = 60.0) -> None:
        super().__init__(oculus_map(), rate_hz)

    def follow(self, faps: ArrayLike) -> Array:
        """Add the next frame, (68,) FAPU; return (15,) as ``approximate_visemes``, from the past alone."""
        return shares(self._follow(frozen(faps, "faps", (fap.FAP_COUNT,), np.float64))[2])


def turns_rad(faps: ArrayLike) -> Array:
    """Return the turns of head and eyes in one frame, (68,) FAPU.

    Returns
    -------
    (3, 3) float64, rad
        Head, left eye, right eye, each yaw, pitch, roll; positive is the subject's left, down and right ear down, as
        in FAP 48 to 50. The eyes' roll is 0: no FAP has it.
    """
    values = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
    turns = np.zeros((3, 3))
    for row, numbers in enumerate((HEAD_TURNS, *EYE_TURNS)):
        turns[row, : len(numbers)] = values[fap.columns(*numbers)] * AU_RAD
    return turns


DIGITS = 4
"""Decimal places."""


def encode_weights(session: str, time_s: float, arkit: ArrayLike, visemes: ArrayLike, faps: ArrayLike) -> bytes:
    """Encode one frame.

    Parameters
    ----------
    session : str
    time_s : float
        Engine time.
    arkit : (52,)
        Weights in the order of ``ARKIT_NAMES``.
    visemes : (15,)
        Shares in the order of ``OCULUS_NAMES``.
    faps : (68,) FAPU
        FAP 48 to 50 are the head.

    Examples
    --------
    >>> encode_weights("face", 1.5, [0.0] * 52, [1.0] + [0.0] * 14, [0] * 68)[-24:].decode()
    '"head": [0.0, 0.0, 0.0]}'
    """
    shapes = frozen(arkit, "arkit", (len(ARKIT_NAMES),), np.float64)
    mouth = frozen(visemes, "visemes", (len(OCULUS_NAMES),), np.float64)
    yaw, pitch, roll = np.degrees(turns_rad(faps)[0]).tolist()
    frame = {
        "t": round(time_s, DIGITS),
        "session": session,
        "arkit": dict(zip(ARKIT_NAMES, shapes.round(DIGITS).tolist(), strict=True)),
        "visemes": dict(zip(OCULUS_NAMES, mouth.round(DIGITS).tolist(), strict=True)),
        "head": [round(angle, 2) for angle in (pitch, yaw, roll)],
    }
    return json.dumps(frame).encode()
