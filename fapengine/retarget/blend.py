"""Conversion between FAPs and the blendshapes of another rig.

Theory of operation
-------------------
A rig's blendshapes each move feature points, that is FAPs: a matrix ``S`` (blendshapes x 68). Converting to FAPs is a
product, ``faps = weights @ S``. Converting to weights is the box-constrained least squares problem

    minimise  |(weights @ S - faps) L|^2 + ridge |weights|^2 + |stiffness weights|^2 + 2 reluctance |S| weights,

with ``0 <= weights <= limit`` and lengths ``L`` in millimetres: by default each FAP on an adult's face, so that no unit
counts more than another; further columns are sums of FAPs that count too, such as an opening. It is solved for all
frames at once by accelerated projected gradients, whose momentum begins again in a frame that goes past its minimum
(O'Donoghue and Candes 2015, doi:10.1007/s10208-013-9150-3); the matrix is small, so a frame costs microseconds.

A single frame is solved exactly instead: once it is known which weights are 0 and which are at the limit, the others
solve a linear system. These sets are guessed, from the previous frame if there is one, and corrected by *block
principal pivoting* (Judice and Pires 1992, doi:10.1007/BF02098179; Kim and Park 2011, doi:10.1137/110821172): every
weight outside its bounds and every bound with a gradient of the wrong sign changes sides, all at once, and one by one
if that does not reduce their number, which terminates for any positive definite matrix. Speech changes few sides from
frame to frame, so one to three systems are solved.

Mouths of few shapes
--------------------
A dozen visemes, or five vowels, cannot show every mouth, and the best mix of each single frame jumps. So a map with
``change_mm`` of :class:`BlendMap` has two more terms for each frame ``t``:

    change^2 |weights_t - weights_(t-1)|^2 + meeting_t (opening(weights_t) - opening(faps_t))^2.

The opening between the lips counts the more the less they are open, so lips that meet in the FAPs meet in the shapes.
No weight changes by more than :data:`MAX_STEP` in 1/60 s. A live face solves each frame beside the previous one; a
whole track is then solved again, backwards and forwards, each frame beside both its neighbours.

Named shapes
------------
``arkit.npz`` (``design/fit_arkit.py``) was measured on ICT-FaceKit (MIT licence, University of Southern California,
Institute for Creative Technologies) through the feature points of ISO/IEC 14496-2; gaze and tongue are by definition
(30 degrees; one MW0). ``visemes.npz`` (``design/fit_visemes.py``) comes from the shipped profile's speaker: visemes as
the planner shapes them in clear speech, and full expressions, both sides made symmetric.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import Array, frozen, read_table
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu

ADULT = Fapu(irisd0_mm=11.0, es0_mm=62.0, ens0_mm=47.0, mns0_mm=22.0, mw0_mm=50.0)
"""Face with which millimetres weight the FAPs against each other; the proportions of any face would do."""
EYE_RADIUS_MM = 12.0
"""Radius that converts an eye's angle to millimetres."""
UNSHAPED = (1, 2, 43, 44, 46, 47, 48, 49, 50)
"""FAPs that no blendshape shows: visemes, expressions, tongue motion other than forward, and head rotation."""
STEPS = 140
RIDGE = 1e-3
"""Ridge relative to the mean squared length of a blendshape; prefers small weights where blendshapes are alike."""
BELOW, FREE, ABOVE = -1, 0, 1
"""Sides of a weight: at 0, between, at the limit."""
BOUND_TOLERANCE = 1e-9
"""Distance outside of a bound that counts as on it; weights are scaled to the order of millimetres."""
MAX_FAILED_PIVOTS = 3
"""Block pivots without progress before going one by one."""
LIPS = [fap.column(4), fap.column(5)]
"""Columns of the middle of the inner lips; minus their sum is the opening."""
MEETING, SPEAKING = 200.0, 5.0
"""How much the square of the opening counts where lips meet, and where they are open by :data:`PARTED_MM`."""
PARTED_MM = 6.0
BITTEN_MM, LIFTED_MM = 0.9, 0.3
"""Least opening of lips whose upper one is lifted by so much: it is f or v, where the lower lip meets the teeth. Half
of what FF opens, so that FF is seen; less than what counts as closed."""
MAX_STEP = 0.27
"""Greatest change of a weight in 1/60 s, in maps with ``change_mm``."""
SWEEPS = 2
"""How often all frames are solved again beside their neighbours."""
FULL = 1e7
"""How much the square of what fractions add up to beyond their bounds counts."""


class BlendMap:
    """Blendshapes of a rig, by their FAPs. Arrays are read-only.

    Parameters
    ----------
    names : (B,) tuple of str
        Names of the blendshapes.
    faps : (B, 68) array_like, FAPU
        At full weight.
    limit : float
        Largest weight.
    reluctance_mm : (B,) array_like, optional
        A blendshape is used only if it brings the face this much closer to the target.
    ignored : tuple of int
        FAPs that do not count when solving for weights.
    stiffness_mm : (B,) array_like, optional
        A blendshape at full weight counts as this error, so that others share its work.
    lengths_mm : (68, L) array_like, mm per FAPU, optional
        The quantities that count when solving for weights; by default :func:`weights_mm`.
    change_mm : float
        A weight that changes by 1 in 1/60 s counts as this error; above 0, lips that meet count too.
    is_fractions : bool
        Whether weights are fractions: they add up to 1 at most, and the change of their sum counts too.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        faps: ArrayLike,
        *,
        limit: float = 1.0,
        reluctance_mm: ArrayLike | None = None,
        ignored: tuple[int, ...] = (),
        stiffness_mm: ArrayLike | None = None,
        lengths_mm: ArrayLike | None = None,
        change_mm: float = 0.0,
        is_fractions: bool = False,
    ) -> None:
        if not limit > 0:
            raise UsageError(f"limit: got {limit}, expected a positive weight")
        count = len(names)
        self.names, self.limit, self.change_mm, self.is_fractions = names, limit, change_mm, is_fractions
        self.faps: Array = frozen(faps, "faps", (count, fap.FAP_COUNT), np.float64)
        none = np.zeros(count)
        reluctance = none if reluctance_mm is None else reluctance_mm
        self._reluctance = frozen(reluctance, "reluctance_mm", (count,), np.float64)
        stiff = frozen(none if stiffness_mm is None else stiffness_mm, "stiffness_mm", (count,), np.float64)
        given = np.diag(weights_mm()) if lengths_mm is None else lengths_mm
        counted = frozen(given, "lengths_mm", (fap.FAP_COUNT, "L"), np.float64).copy()
        counted[fap.columns(*ignored)] = 0.0
        scaled = self.faps @ counted
        square = scaled @ scaled.T
        if not np.trace(square) > 0:
            raise UsageError("faps: no shape moves anything")
        square[np.diag_indices_from(square)] += RIDGE * np.trace(square) / count + stiff**2
        lengths = np.sqrt(np.diag(square))  # shapes of one length make the problem round, and gradients quick
        self._lengths = lengths
        self._goals = counted @ (scaled / lengths[:, None]).T
        self._gram = square / lengths / lengths[:, None]
        self._rate = 1.0 / float(np.linalg.eigvalsh(self._gram)[-1])
        self._opening = opening_mm(self.faps) / lengths
        apart = np.eye(count) + (1.0 if is_fractions else 0.0)
        self._change = change_mm**2 * apart / lengths / lengths[:, None]

    def to_faps(self, weights: ArrayLike) -> Array:
        """(..., B) weights -> (..., 68) FAPU."""
        checked = frozen(weights, "weights", ("...", len(self.names)), np.float64)
        return checked @ self.faps

    def approximate_weights(self, faps: ArrayLike, *, cost: ArrayLike = 1.0, rate_hz: float = 60.0) -> Array:
        """Find the weights that best reproduce a motion.

        Parameters
        ----------
        faps : (T, 68) FAPU
            With ``change_mm``, of one face over time.
        cost : (T, B), optional
            Fraction of ``reluctance_mm`` of each blendshape in each frame.
        rate_hz : float
            Frame rate; only with ``change_mm``.

        Returns
        -------
        (T, B) float64
            Each 0 to ``limit``.
        """
        wanted = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
        goal = wanted @ self._goals - self._reluctance * np.asarray(cost)
        if self.change_mm:
            return self._over_time(wanted, goal, rate_hz)
        most = self.limit * self._lengths
        here = ahead = np.clip(goal * self._rate, 0.0, most)
        momentum = np.ones((len(wanted), 1))
        for _ in range(STEPS):
            after = np.clip(ahead - self._rate * (ahead @ self._gram - goal), 0.0, most)
            is_past = ((ahead - after) * (after - here)).sum(axis=1, keepdims=True) > 0.0
            momentum = np.where(is_past, 1.0, momentum)
            faster = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
            ahead = after + (momentum - 1) / faster * (after - here)
            here, momentum = after, faster
        weights: Array = here / self._lengths
        return weights

    def _over_time(self, faps: Array, goal: Array, rate_hz: float) -> Array:
        """Weights of all frames, (T, B): each beside the one before, then again beside both neighbours."""
        openings, meetings = _meeting(faps)
        weights = np.zeros((len(faps), len(self.names)))
        for row in range(len(faps)):
            before = weights[max(row - 1, 0) : row]
            weights[row] = self._beside(goal[row], openings[row], meetings[row], before, rate_hz)
        for sweep in range(SWEEPS):
            for row in range(len(faps)) if sweep % 2 else reversed(range(len(faps))):
                near = np.concatenate([weights[max(row - 1, 0) : row], weights[row + 1 : row + 2]])
                weights[row] = self._beside(goal[row], openings[row], meetings[row], near, rate_hz)
        return weights

    def _beside(self, goal: Array, opening: float, meeting: float, near: Array, rate_hz: float) -> Array:
        """Weights of one frame, (B,), beside those of its neighbours, (N, B) with N from 0 to 2."""
        change, step = self._change * (rate_hz / 60.0) ** 2, MAX_STEP * 60.0 / rate_hz
        gram = self._gram + meeting * self._opening[:, None] * self._opening + len(near) * change
        goal = goal + meeting * opening * self._opening + change @ (near.sum(axis=0) * self._lengths)
        totals, least, most = near.sum(axis=1), np.zeros(len(goal)), self.limit * self._lengths
        fewest, fullest = max(totals, default=0.0) - step, min(1.0, min(totals, default=1.0) + step)
        if len(near):
            least = np.maximum(near.max(axis=0) - step, 0.0) * self._lengths
            most = np.minimum(near.min(axis=0) + step, self.limit) * self._lengths
            most = np.maximum(most, least)
        begin = near.mean(axis=0) * self._lengths if len(near) else goal
        side = np.where(begin <= least, BELOW, np.where(begin >= most, ABOVE, FREE)).astype(np.int8)
        found = least + _pivot(gram, goal - gram @ least, most - least, side)
        if self.is_fractions and not fewest <= (total := float((found / self._lengths).sum())) <= fullest:
            goal = goal + FULL * min(max(total, fewest), fullest) / self._lengths
            gram = gram + FULL / self._lengths[:, None] / self._lengths
            found = least + _pivot(gram, goal - gram @ least, most - least, side)
        weights: Array = found / self._lengths
        return fractions(weights) if self.is_fractions else weights

    def solve_weights(
        self, faps: ArrayLike, near: ArrayLike | None = None, *, cost: ArrayLike = 1.0, rate_hz: float = 60.0
    ) -> Array:
        """Find the weights of one frame, exactly.

        Parameters
        ----------
        faps : (68,) FAPU
        near : (B,), optional
            Weights of the previous frame. With ``change_mm`` the result stays near them, unless all FAPs are 0; else it
            is the same without, only slower.
        cost : (B,), optional
            Fraction of ``reluctance_mm`` of each blendshape.
        rate_hz : float
            Frame rate; only with ``change_mm``.

        Returns
        -------
        (B,) float64
            Each 0 to ``limit``.
        """
        wanted = frozen(faps, "faps", (fap.FAP_COUNT,), np.float64)
        goal = wanted @ self._goals - self._reluctance * np.asarray(cost)
        checked = None if near is None else frozen(near, "near", (len(goal),), np.float64)
        if self.change_mm and not wanted.any():
            return np.zeros(len(goal))  # a neutral face, perhaps one that was closed: nothing follows
        if self.change_mm:
            before = np.zeros((0, len(goal))) if checked is None else checked[None]
            opening, meeting = map(float, _meeting(wanted))
            return self._beside(goal, opening, meeting, before, rate_hz)
        side = np.where(goal > 0, FREE, BELOW).astype(np.int8)
        if checked is not None:
            side = np.where(checked <= 0, BELOW, np.where(checked >= self.limit, ABOVE, FREE)).astype(np.int8)
        return _pivot(self._gram, goal, self.limit * self._lengths, side) / self._lengths

    def is_full(self, cost: Array) -> bool:
        """Whether a fraction of reluctance, (..., B), is 1 wherever there is any; then it changes nothing."""
        return not bool(((cost < 1.0) & (self._reluctance > 0.0)).any())


def opening_mm(faps: Array) -> Array:
    """(..., 68) FAPU -> (...) mm by which the inner lips of an adult's face are farther apart than at rest."""
    opening: Array = -(faps[..., LIPS] * weights_mm()[LIPS]).sum(axis=-1)
    return opening


def fractions(weights: Array) -> Array:
    """(..., B): weights that add up to 1 at most."""
    shares: Array = weights / np.maximum(weights.sum(axis=-1, keepdims=True), 1.0)
    return shares


def _meeting(faps: Array) -> tuple[Array, Array]:
    """(..., 68) FAPU -> opening that shapes should have, mm, and how much its square counts, (...) each."""
    lifted_mm = -faps[..., LIPS[0]] * weights_mm()[LIPS[0]]
    bitten_mm = BITTEN_MM * np.clip(lifted_mm / LIFTED_MM, 0.0, 1.0)
    wanted = np.maximum(opening_mm(faps), bitten_mm)
    return wanted, np.interp(wanted, (0.0, PARTED_MM), (MEETING, SPEAKING))


def _pivot(gram: Array, goal: Array, most: Array, side: NDArray[np.int8]) -> Array:
    """Minimise ``x gram x / 2 - goal x`` for 0 <= x <= most, from the given sides, which change in place."""
    fewest, failures_left = len(goal) + 1, MAX_FAILED_PIVOTS
    while True:
        free = side == FREE
        weights_now = np.where(side == ABOVE, most, 0.0)
        weights_now[free] = np.linalg.solve(gram[np.ix_(free, free)], goal[free] - gram[free] @ weights_now)
        slope = gram @ weights_now - goal
        low, high = free & (weights_now < -BOUND_TOLERANCE), free & (weights_now > most + BOUND_TOLERANCE)
        loose = ((side == BELOW) & (slope < -BOUND_TOLERANCE)) | ((side == ABOVE) & (slope > BOUND_TOLERANCE))
        wrong = np.flatnonzero(low | high | loose)
        if not len(wrong):
            return np.clip(weights_now, 0.0, most)
        if len(wrong) < fewest:
            fewest, failures_left = len(wrong), MAX_FAILED_PIVOTS
        elif failures_left:
            failures_left -= 1
        else:
            wrong = wrong[-1:]
        side[wrong] = np.where(low[wrong], BELOW, np.where(high[wrong], ABOVE, FREE))


@cache
def weights_mm() -> Array:
    """(68,), read-only: millimetres of one step of each FAP on an adult's face; 0 for what no shape shows."""
    steps = ADULT.steps()
    for row in fap.FAPS:
        if row.unit is fap.FapUnit.AU:
            steps[fap.column(row.number)] *= EYE_RADIUS_MM
    steps[fap.columns(*UNSHAPED)] = 0.0
    steps.flags.writeable = False
    return steps


_TABLES = read_table(__package__, "arkit.npz") | read_table(__package__, "visemes.npz")
ARKIT_NAMES: tuple[str, ...] = tuple(_TABLES["arkit_names"].tolist())
"""The 52 shapes in the order of Live Link Face and Azure, 0 to 51."""
VISEME_NAMES: tuple[str, ...] = tuple(_TABLES["viseme_names"].tolist())
"""The 14 visemes that move, 1 to 14."""
ALL_MOODS: tuple[str, ...] = tuple(_TABLES["expression_names"].tolist())
"""MPEG-4's six expressions."""
_ROWS = {
    name: row
    for key, names in (("arkit", ARKIT_NAMES), ("viseme", VISEME_NAMES), ("expression", ALL_MOODS))
    for name, row in zip(names, _TABLES[key], strict=True)
}


def shape_rows(names: Sequence[str]) -> Array:
    """(N, 68) FAPU: what shapes, visemes and expressions do at full weight, by name."""
    return np.array([_ROWS[name] for name in names])
