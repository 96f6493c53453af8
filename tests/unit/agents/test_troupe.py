"""Many stages on one engine: each as if it were alone."""

import numpy as np
import pytest

from fapengine.agents.spoken_words import TimedWord
from fapengine.agents.troupe import Troupe
from fapengine.errors import UsageError
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.agents.test_stage import DT_S, RATE_HZ, noise, shown, sound_of, spelled, stage


def test_each_is_as_alone() -> None:
    troupe = Troupe(english(), rng=np.random.default_rng(1), style=Style.still())
    alone, frames = stage(), {"anna": [], "ben": []}
    anna = troupe.open("anna", pronounce=spelled)
    for one in (anna, alone):
        one.words([TimedWord("mama", 0.1, 0.6)])
        one.push(noise(1.0), RATE_HZ)
        one.end()
    for number in range(40):
        if number == 10:
            troupe.open("ben").push(noise(0.5, seed=2), RATE_HZ)
            troupe.stages["ben"].end()
        for name, frame in troupe.next(DT_S).items():
            frames[name].append(frame)
    expected = shown(alone, 40 * DT_S)
    assert np.array_equal(sound_of(frames["anna"]), noise(1.0))
    assert np.array_equal(sound_of(frames["ben"]), noise(0.5, seed=2))
    apart = np.abs(np.array([f.faps for f in frames["anna"]]) - np.array([f.faps for f in expected]))
    assert apart.max() <= 1
    assert [event.kind for event in troupe.stages["ben"].events()] == ["started", "finished"]
    troupe.close("ben")
    assert list(troupe.next(DT_S)) == ["anna"]


def test_names_are_taken_once() -> None:
    troupe = Troupe(english(), rng=np.random.default_rng(1))
    troupe.open("anna")
    with pytest.raises(UsageError, match="open already"):
        troupe.open("anna")
    with pytest.raises(UsageError, match="not open"):
        troupe.close("ben")
