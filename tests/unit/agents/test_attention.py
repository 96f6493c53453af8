"""What a face does between its own words: looks and nods by the state of the conversation, on a clock of the test."""

import numpy as np
import pytest

from fapengine.agents.attention import FIRST_NOD_S, NODS_S, THINKS_S, Attention
from fapengine.agents.face import AgentFace
from fapengine.engine.commands import Look, SetParameter, TurnHead
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from tests.unit.agents.test_face import run
from tests.unit.host.test_stream import noise, stage


def given(attention: Attention, until_s: float, now_s: float = 0.0) -> list[tuple[float, object]]:
    """Every command until a time, at 25 frames a second."""
    frames = np.arange(now_s, until_s, 0.04)
    return [(float(at_s), command) for at_s in frames for command in attention.due(float(at_s))]


def test_it_looks_at_the_user_who_speaks_and_nods() -> None:
    attention = Attention(np.random.default_rng(1))
    attention.attend("listening")
    commands = given(attention, 20.0)
    assert [type(command) for _, command in commands[:3]] == [SetParameter, Look, TurnHead]
    assert (commands[0][1].value, commands[1][1].yaw_rad, commands[1][1].pitch_rad) == (0.0, 0.0, 0.0)
    nods_s = [at_s for at_s, command in commands if isinstance(command, TurnHead) and command.pitch_rad > 0]
    assert nods_s[0] == pytest.approx(FIRST_NOD_S, abs=0.05)
    assert 4 <= len(nods_s) <= 8
    assert all(NODS_S[0] <= gap_s <= NODS_S[1] + 0.05 for gap_s in np.diff(nods_s))
    attention.attend("listening")  # again: nothing new
    assert attention.due(20.01) == []


def test_it_looks_aside_while_it_thinks_and_not_for_ever() -> None:
    attention = Attention(np.random.default_rng(1))
    attention.attend("thinking")
    commands = given(attention, THINKS_S + 1.0)
    looks = [(at_s, command.yaw_rad) for at_s, command in commands if isinstance(command, Look)]
    assert [at_s > THINKS_S for at_s, _ in looks] == [False, True]
    assert abs(looks[0][1]) > 0.2
    assert looks[1][1] == 0.0
    assert attention.state == "idle"


def test_glances_that_are_switched_off_stay_off() -> None:
    attention = Attention(np.random.default_rng(1), gaze=False)
    attention.attend("thinking")
    attention.attend("idle")
    assert attention.due(0.0)[0] == SetParameter("gaze", 0.0)


def test_there_is_no_such_state() -> None:
    with pytest.raises(UsageError, match="state: got 'asleep', expected one of idle, listening, thinking, speaking"):
        Attention(np.random.default_rng(1)).attend("asleep")


def test_the_eyes_of_the_face_follow_the_conversation() -> None:
    face = AgentFace(stage(), 25.0)

    def eyes() -> float:
        return abs(int(face.frame(now_s)[0].faps[fap.column(23)]))

    face.attend("thinking")
    now_s, *_ = run(face, 1.5)
    assert eyes() > 15_000  # 1e-5 rad
    face.sound(noise(2.0).tobytes(), 24_000)
    face.end()
    now_s, *_ = run(face, now_s + 1.0, now_s)
    assert face.attention.state == "speaking"
    face.attend("thinking")  # its own words come first
    face.attend("listening", False)  # it did not listen
    assert face.attention.state == "speaking"
    face.attend("listening")  # a user whom it goes on speaking to, such as one who says "yes"
    assert face.attention.state == "listening"
    face.attend("thinking")
    assert face.attention.state == "speaking"
    face.interrupt(now_s)
    face.attend("listening")
    now_s, *_ = run(face, now_s + 1.0, now_s)
    assert face.attention.state == "listening"
    assert eyes() < 3_000
    face.attend("listening", False)
    assert face.attention.state == "idle"
