"""Gestures of live faces when the clock leaps, as after a sleep of the machine."""

from collections.abc import Iterable

import numpy as np
import pytest

from fapengine.engine.engine import Engine
from fapengine.trajectory import gestures
from fapengine.trajectory.gestures import blink
from fapengine.trajectory.ramps import Ramp, Ramps
from tests.english import english


def test_a_face_that_was_not_shown_for_hours_does_not_catch_up_on_its_gestures(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[int] = []
    send = Ramps.send

    def count(self: Ramps, row: int, ramps: Iterable[Ramp]) -> None:
        ramps = list(ramps)
        sent.append(len(ramps))
        send(self, row, ramps)

    drawn: list[float] = []
    monkeypatch.setattr(Ramps, "send", count)
    monkeypatch.setattr(gestures, "blink", lambda at_s: drawn.append(at_s) or blink(at_s))
    engine = Engine(english(), rng=np.random.default_rng(1))
    engine.open("anna", 0.0)
    engine.frame(1.0)
    before = engine.frame(2.0).faps
    after = engine.frame(3 * 3600.0).faps
    assert max(sent) < 300
    assert 5 < len(drawn) < 300  # 2 s of work after a day otherwise
    assert np.isfinite(after).all()
    assert before.shape == after.shape
    assert len({engine.frame(3 * 3600.0 + 0.5 * number).faps.tobytes() for number in range(40)}) > 10  # it goes on
