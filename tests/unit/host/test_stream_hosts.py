"""Many hosts on one engine: each as if it were alone."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.host.stream import StreamHosts
from fapengine.host.words import TimedWord
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.host.test_stream import DT_S, RATE_HZ, noise, shown, sound_of, spelled, stage


def test_each_is_as_alone() -> None:
    hosts = StreamHosts(english(), rng=np.random.default_rng(1), style=Style.still())
    alone, frames = stage(), {"anna": [], "ben": []}
    anna = hosts.open("anna", pronounce=spelled)
    for one in (anna, alone):
        one.words([TimedWord("mama", 0.1, 0.6)])
        one.push(noise(1.0), RATE_HZ)
        one.end()
    for number in range(40):
        if number == 10:
            hosts.open("ben").push(noise(0.5, seed=2), RATE_HZ)
            hosts.hosts["ben"].end()
        for name, frame in hosts.next(DT_S).items():
            frames[name].append(frame)
    expected = shown(alone, 40 * DT_S)
    assert np.array_equal(sound_of(frames["anna"]), noise(1.0))
    assert np.array_equal(sound_of(frames["ben"]), noise(0.5, seed=2))
    apart = np.abs(np.array([f.faps for f in frames["anna"]]) - np.array([f.faps for f in expected]))
    assert apart.max() <= 1
    assert [event.kind for event in hosts.hosts["ben"].events()] == ["started", "finished"]
    hosts.close("ben")
    assert list(hosts.next(DT_S)) == ["anna"]


def test_names_are_taken_once() -> None:
    hosts = StreamHosts(english(), rng=np.random.default_rng(1))
    hosts.open("anna")
    with pytest.raises(UsageError, match="open already"):
        hosts.open("anna")
    with pytest.raises(UsageError, match="not open"):
        hosts.close("ben")
