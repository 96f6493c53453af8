"""One stream by itself, frame by frame and without the arrays of a batch: what each row of a batch is compared with."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine.errors import UsageError
from fapengine.mpeg4.track import to_codable
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import BITTEN_SHARE, close_lips
from fapengine.trajectory.faps import speech_faps
from fapengine.trajectory.phonetics import layer_faps, layer_gain
from fapengine.trajectory.stream import StreamingPlanner, StreamPlan, plan_together

Array = NDArray[np.float64]


def jet_of_plan(plan: StreamPlan, times_s: Array) -> tuple[Array, ...]:
    """Value, velocity and acceleration of a plan at any times from its start on: (T,) s -> (T, K) each."""
    jet = plan.path.jet(times_s)
    since = times_s - plan.start_s
    still = np.zeros_like(plan.left_over[0])
    value, *momentum = plan.left_over
    fades = ((plan.fade_s, (value, still, still)), (plan.momentum_s, (still, momentum[0], momentum[1])))
    for length_s, first in fades:
        fading = since < length_s
        if fading.any() and plan.left_over.any():
            quintic = hermite.quintic(length_s, first, (still, still, still))
            added = hermite.jet_of(quintic, since[fading, None] / length_s, length_s)
            for total, part in zip(jet, added, strict=True):
                total[fading] += part
    return jet


class SingleStream(StreamingPlanner):
    """A planner that plans at once, or what waits when it must, and shows its own frames."""

    __slots__ = ()

    def feed(self, phones: Sequence[Phone]) -> None:
        """Take phones in, and plan."""
        self.take(phones)
        plan_together([self])

    def cancel(self, at_s: float, *, fade_s: float = 0.2) -> None:
        """End speech, and plan."""
        super().cancel(at_s, fade_s=fade_s)
        plan_together([self])

    def path(self, times_s: ArrayLike) -> Array:
        """(T, K + axes): the path as planned so far; it settles nothing."""
        times = np.asarray(times_s, dtype=np.float64)
        starts = np.array([plan.start_s for plan in self._plans])
        index = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
        weights = np.zeros((len(times), self._width))
        for number in np.unique(index):
            mine = index == number
            weights[mine] = jet_of_plan(self._plans[number], times[mine])[0]
        return weights

    def frames(self, times_s: ArrayLike) -> NDArray[np.int32]:
        """(T, 68) FAPs of frames that are due, which settles them; ``UsageError`` if times go back."""
        times = np.asarray(times_s, dtype=np.float64)
        if not len(times):
            return np.zeros((0, 68), np.int32)
        if times[0] < self._shown_s or (np.diff(times) < 0).any():
            raise UsageError(f"times_s: got {times[0]:g} s, expected rising times from {self._shown_s:g} s")
        space = self.profile.space
        path = self.path(times)
        weights = path[:, : space.mode_count] @ self.style.gains(self.profile)
        faps = speech_faps(self.profile, weights, context=self.style.context)
        faps += layer_gain(self.style.lips_gain) * path[:, space.mode_count :] @ layer_faps(self.profile)
        bitten = BITTEN_SHARE if self.style.context else 0.0
        faps = close_lips(faps, times, self.holds, openness=self.style.openness, bitten_share=bitten)
        self.settle(float(times[-1]))
        return to_codable(faps)
