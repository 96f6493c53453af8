"""What a plan costs grows as its length does, in lines of code that are run and in memory."""

from itertools import cycle, islice

import numpy as np

from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english
from tests.work_done import bytes_taken, lines_run


def cost(length_s: float, style: Style) -> np.ndarray:
    """Lines that a plan runs, and bytes that it holds at most."""
    labels = islice(cycle("mapistol"), round(length_s * 10))
    phones = [Phone(label, n / 10, (n + 1) / 10, stress=int(n % 4 == 1)) for n, label in enumerate(labels)]
    track, profile = PhoneTrack.from_phones(phones), english()

    def work() -> None:
        plan(track, profile, rng=np.random.default_rng(1), style=style)

    work()  # what is kept for the next plan is not counted
    return np.array([lines_run(work), bytes_taken(work)])


def test_gestures_and_speech_cost_as_much_as_they_are_long() -> None:
    short, long, still = cost(50, Style()), cost(200, Style()), cost(200, Style.speech_only())
    assert np.all(long < 4.2 * short)  # 4 if it is linear, 16 if it grows by the square
    assert np.all(long < 1.5 * still)
