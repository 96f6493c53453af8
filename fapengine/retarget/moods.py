"""Moods of a face, recognized where speech moves nothing.

Theory of operation
-------------------
Brows, lids, cheeks and nose show the mood; its effect on the mouth follows from it. An idle face moves these without a
mood, too: it blinks, raises its brows on accents, lets brows and lids drift, and its lids follow the gaze. So all of
these are solved for together with the moods and cost nothing, while a mood costs :data:`MOOD_MM`: motion that idle
shapes explain is not a mood. Raised brows alone are an accent, raised brows and wide eyes surprise; lids raised by the
gaze are not wide eyes, because the eyeballs show it. While a blink hides the eyes, a face keeps its mood
(:class:`MoodHold`).
"""

from functools import cache

import numpy as np

from fapengine._arrays import Array
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.retarget.blend import BlendMap, shape_rows

MOODS = {"happy": "joy", "angry": "anger", "sad": "sadness", "surprised": "surprise"}
"""VRM's moods that MPEG-4 also has, and its names for them."""
VRM_MOODS = tuple(MOODS.values())
UPPER_FACE = (19, 20, 21, 22, *range(31, 43), 61, 62, 63, 64)
"""FAPs that show moods and blinks."""
MOOD_MM = {"joy": 0.25, "sadness": 0.2, "anger": 0.25, "fear": 0.15, "disgust": 0.42, "surprise": 0.15}
"""Fainter moods are ignored: drifting brows, lids that do not follow exactly as here. Moods that share more with the
accents of speech cost less, so that each is found within 0.06 of its true value.
"""
ACCENT: dict[tuple[int, ...], float] = {(31, 32, 33, 34, 35, 36): 200.0}
"""Brows raised as a whole, FAPU at full weight: more than any accent of the planner."""
LIDS_PER_RAD: dict[tuple[int, ...], float] = {(19, 20): 600.0, (21, 22): -200.0}
"""FAPU by which lids follow a gaze one radian down, as in the planner."""
GAZE_RAD = 0.5
DRIFTS: tuple[dict[tuple[int, ...], float], ...] = (
    {(31, 32, 33, 34): 28.0}, {(31, 32, 33, 34): -28.0, (35, 36): -16.0}, {(19, 20): -30.0}, {(21, 22): 80.0},
)  # fmt: skip
"""Twice the drift of brows and lids in the planner, FAPU, and the lower lids of a blink."""
IDLE = ("blinkLeft", "blinkRight", "accent", "lookDown", "lookUp", "browsUp", "browsDown", "lidsUp", "lowerLids")
"""Idle motion, in the order of :func:`mood_map`."""
PLAIN = (0.1, 0.3)
"""Weight found first up to which a shape has its whole cost, and from which it has none, so that it keeps its size."""
LIDS = [fap.column(19), fap.column(20)]
BLINK_STEP, OPEN_AGAIN = 25.0, 150.0
"""Step of the upper lids per frame from which it belongs to a blink, and distance from their position before at which
they are open again; FAPU. A blink at 60 frames per second begins with 45, a growing sadness has 5.
"""
MAX_BLINK_FRAMES = 30
"""Longest blink. Lids that stay down longer belong to eyes that are closed or look down."""
FAINT = (0.1, 0.2)
"""Weight up to which a mood is ignored, and from which it is shown unchanged."""


@cache
def mood_map(moods: tuple[str, ...] = VRM_MOODS) -> BlendMap:
    """Return the map of moods, then :data:`IDLE`, on the upper face and the gaze's height."""
    upper = np.zeros(fap.FAP_COUNT)
    upper[fap.columns(*UPPER_FACE)] = 1.0
    lids = shape_rows(("eyeBlinkLeft", "eyeBlinkRight"))
    life = np.zeros((3 + len(DRIFTS), fap.FAP_COUNT))
    _set(life[0], ACCENT)
    for row, gaze_rad in ((life[1], GAZE_RAD), (life[2], -GAZE_RAD)):
        _set(row, {(25, 26): gaze_rad / AU_RAD})
        _set(row, {numbers: per_rad * gaze_rad for numbers, per_rad in LIDS_PER_RAD.items()})
    for row, drift in zip(life[3:], DRIFTS, strict=True):
        _set(row, drift)
    rows = np.concatenate([shape_rows(moods) * upper, lids * upper, life])
    names = (*moods, *IDLE)
    return BlendMap(names, rows, reluctance_mm=np.array([MOOD_MM.get(name, 0.0) for name in names]))


def find_moods(faps: Array, names: tuple[str, ...] = VRM_MOODS) -> tuple[Array, Array]:
    """Find moods, (T, M), each 0..1, and lids closed by a blink, left and right, (T, 2), from FAPs (T, 68)."""
    upper = approximate_upper(faps, names)
    moods, hold = read_moods(upper, names), MoodHold()
    for row, values in zip(moods, faps, strict=True):
        row[:] = hold.follow(row.copy(), values)
    return moods, upper[:, len(names) : len(names) + 2]


class MoodHold:
    """The moods of one face, frame by frame, held while a blink closes and opens its eyes.

    Stateful.
    """

    def __init__(self) -> None:
        self._lid, self._open = 0.0, 0.0
        self._moods: Array | None = None
        self._held, self._frames = False, 0

    def follow(self, moods: Array, faps: Array) -> Array:
        """Process the next frame's moods, (M,), and FAPs, (68,); return the moods to show."""
        lid = float(faps[LIDS].max())
        step, self._lid = lid - self._lid, lid
        if self._moods is None:
            self._moods = moods
        elif not self._held and step > BLINK_STEP:
            self._held, self._frames, self._open = True, 0, max(lid - step, 0.0)  # wide eyes may close to normal ones
        elif self._held:
            self._frames += 1
            is_open = step > -BLINK_STEP and lid < self._open + OPEN_AGAIN
            self._held = not is_open and self._frames < MAX_BLINK_FRAMES
        if not self._held:
            self._moods = moods
        return self._moods


def approximate_upper(faps: Array, names: tuple[str, ...] = VRM_MOODS) -> Array:
    """Find weights of :func:`mood_map`, (T, M + 9), for FAPs (T, 68); clear moods cost nothing."""
    first = mood_map(names).approximate_weights(faps)
    return mood_map(names).approximate_weights(faps, cost=cost_share(first))


def cost_share(weights: Array) -> Array:
    """Weights, (..., B) -> fraction of its reluctance that each bears: see :data:`PLAIN`."""
    return np.clip((PLAIN[1] - weights) / (PLAIN[1] - PLAIN[0]), 0.0, 1.0)


def read_moods(upper: Array, names: tuple[str, ...] = VRM_MOODS) -> Array:
    """Extract the moods, (..., M), from weights of :func:`mood_map`, (..., M + 9), without :data:`FAINT` ones."""
    moods = upper[..., : len(names)]
    return moods * np.clip((moods - FAINT[0]) / (FAINT[1] - FAINT[0]), 0.0, 1.0)


def without_moods(faps: Array, moods: Array, names: tuple[str, ...] = VRM_MOODS) -> Array:
    """Subtract the effect of moods, (..., M), from FAPs, (..., 68) FAPU: speech and idle motion remain.

    A FAP with one direction, such as ``open_jaw``, never recorded a mood that would move it the other way.
    """
    rows, one_way = _rows(names)
    done = moods @ rows
    done[..., one_way] = np.maximum(done[..., one_way], 0.0)
    return faps - done


@cache
def _rows(names: tuple[str, ...]) -> tuple[Array, list[int]]:
    one_way = [fap.column(row.number) for row in fap.FAPS if not row.bidirectional]
    return shape_rows(names), one_way


def _set(row: Array, values: dict[tuple[int, ...], float]) -> None:
    for numbers, value in values.items():
        row[fap.columns(*numbers)] = value
