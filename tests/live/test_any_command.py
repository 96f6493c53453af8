"""Five seconds of :mod:`.any_command`."""

from fapengine.engine import commands
from tests.live.any_command import run


def test_whatever_a_server_is_told_its_faces_stay_faces() -> None:
    trial, memory = run(5.0, 40.0, seed=3, longest_s=1.0, least=150)
    assert not trial.broken, trial.first
    assert len(set(trial.told)) >= len(commands.COMMANDS) - 3
    assert trial.frames > 0
    assert memory
