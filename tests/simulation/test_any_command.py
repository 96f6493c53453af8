"""A short run of :mod:`.any_command`, and that its eyes are open."""

import numpy as np
import pytest

from fapengine.engine import commands
from fapengine.engine.session import Session
from fapengine.mpeg4 import fap
from tests.simulation.any_command import Trial, run


def test_whatever_faces_are_told_they_stay_faces() -> None:
    trial = Trial(seed=5)
    run(trial, 30.0, 600)
    assert not trial.broken, trial.first
    assert set(trial.told) == {kind.__name__ for kind in commands.COMMANDS}
    assert sum(trial.told.values()) > 400
    assert trial.worst["opening"] > 300


def test_it_sees_what_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    trial = Trial(seed=5)
    face = trial.watched["face 0"]
    wide, crossed, beyond, still = np.zeros((4, fap.FAP_COUNT), int)
    wide[fap.column(3)], crossed[fap.column(5)], beyond[fap.column(3)] = 4000, 40, -5
    for row in (wide, crossed, beyond, still):
        trial.look_at(face, row, 0.5)
    assert trial.broken == {"near": 1, "lips": 1, "range": 1}
    trial.now_s = 99.0
    for row in (wide // 10, still):
        trial.look_at_state(face, row)
    assert trial.broken["rest"] == 1
    monkeypatch.setattr(Session, "flush", lambda session, now_s: 1 / 0)
    trial = Trial(seed=5)
    run(trial, 10.0, 200)
    assert set(trial.broken) == {"faults"}
