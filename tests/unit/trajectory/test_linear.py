"""What a plan costs grows as its length does: ratios in one run, of processor time."""

import time
from itertools import cycle, islice

import numpy as np

from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english


def cost_s(length_s: float, style: Style) -> float:
    """Least processor time of three plans."""
    labels = islice(cycle("mapistol"), round(length_s * 10))
    phones = [Phone(label, n / 10, (n + 1) / 10, stress=int(n % 4 == 1)) for n, label in enumerate(labels)]
    track, costs = PhoneTrack.from_phones(phones), []
    for _ in range(3):
        begun_s = time.process_time()
        plan(track, english(), rng=np.random.default_rng(1), style=style)
        costs.append(time.process_time() - begun_s)
    return min(costs)


def test_gestures_and_speech_cost_as_much_as_they_are_long() -> None:
    short_s, long_s, still_s = cost_s(100, Style()), cost_s(400, Style()), cost_s(400, Style.speech_only())
    assert long_s < 8 * short_s  # 4 if it is linear, 16 if it grows by the square
    assert long_s < 4 * still_s
