"""A face in a program: speech, expressions, frames in their time, and an end. Its sound: test_view."""

import subprocess
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest

import fapengine
from fapengine.engine.commands import Blink
from fapengine.mpeg4 import fap

STILL = fapengine.Style.speech_only()


def opening(faps: np.ndarray) -> float:
    return -float(faps[fap.column(51)] + faps[fap.column(52)])


def test_frames_come_in_their_time_until_the_face_is_at_rest() -> None:
    with fapengine.Face(style=STILL, silent=True, rate_hz=50.0) as face:
        assert not face.is_speaking
        assert face.say("Mama.") == face.say("Papa.") - 1
        assert face.is_speaking
        frames = list(face.frames())
        assert not face.is_speaking
        assert face.sound
        assert face.sync_error_s is None
    openings = [opening(frame) for frame in frames]
    assert max(openings) > 80
    assert abs(openings[-1]) < 5
    assert 40 < len(frames) < 250


def test_what_was_spoken_before_is_said_again() -> None:
    hello = fapengine.speak("Mama.", rate_hz=25.0)
    with fapengine.Face(style=STILL, silent=True) as face:
        face.say(hello, expressions={"joy": 1.0})
        assert face.is_speaking
        face.stop()
        silent = fapengine.animate(hello.phones)
        with pytest.raises(fapengine.UsageError, match="sound: this performance has no sound"):
            face.say(silent)
        with pytest.raises(fapengine.UsageError, match="expressions: got 'glee'"):
            face.say(hello, expressions=["glee"])


def test_it_obeys_without_speaking() -> None:
    with fapengine.Face(style=STILL, silent=True) as face:
        face.hub.clock = iter(np.arange(0.0, 9.0, 0.5)).__next__
        face.express("joy")
        face.look(0.2, 0.1)
        face.turn_head(yaw_rad=0.3)
        face.set_parameter("articulation", 0.5)
        face.send_command(Blink())
        face.pause()
        face.resume()
        for _ in range(4):
            faps = face.frame()
        assert faps.shape == (68,)
        assert faps[fap.column(49)] == pytest.approx(0.3e5, rel=0.01)  # head_yaw, AU
        assert faps[fap.column(23)] == pytest.approx(0.2e5, rel=0.01)  # yaw_l_eyeball
        assert faps[fap.column(41)] > 20  # a cheek of joy
        with pytest.raises(fapengine.UsageError, match="got 'glee', expected one of joy"):
            face.express("glee")


def test_what_cannot_be() -> None:
    with pytest.raises(fapengine.UsageError, match=r"sinks: got 'fba\+tcp://127.0.0.1:1'"):
        fapengine.Face(sinks=["fba+tcp://127.0.0.1:1"])
    with pytest.raises(fapengine.UsageError, match="nobody"):
        fapengine.Face("nobody")
    face = fapengine.Face(silent=True, style=STILL)
    face.close()
    face.close()


def test_another_thread_is_refused() -> None:
    errors = []

    def use(face: fapengine.Face) -> None:
        for call in (face.frame, face.stop, lambda: face.say("Mama."), lambda: face.express("joy")):
            with pytest.raises(fapengine.UsageError, match="face: another thread uses it") as caught:
                call()
            errors.append(caught.value)

    with fapengine.Face(style=STILL, silent=True) as face:
        face.frame()
        thread = threading.Thread(target=use, args=(face,))
        thread.start()
        thread.join(300)
        assert len(errors) == 4
        assert face.frame().shape == (68,)


def test_a_thread_may_use_a_face_that_another_made() -> None:
    with fapengine.Face(style=STILL, silent=True) as face:
        shapes = []
        thread = threading.Thread(target=lambda: shapes.append(face.frame().shape))
        thread.start()
        thread.join(300)
        assert shapes == [(68,)]


@pytest.mark.parametrize(
    "use",
    [
        lambda face: face.frame(), lambda face: face.say("Mama."), lambda face: face.express("joy"),
        lambda face: face.pause(), lambda face: face.stop(), lambda face: face.look(0.1, 0.1),
    ],
)  # fmt: skip
def test_a_closed_face_says_so(use: Callable[[fapengine.Face], object]) -> None:
    face = fapengine.Face(style=STILL, silent=True)
    face.close()
    face.close()
    with pytest.raises(fapengine.UsageError, match="face: it is closed"):
        use(face)


@pytest.mark.parametrize("speech", [None, 3, b"Mama."])
def test_what_is_no_speech_is_refused(speech: object) -> None:
    with (
        fapengine.Face(style=STILL, silent=True) as face,
        pytest.raises(fapengine.UsageError, match=r"speech: got .*expected a string or Performance or Speech"),
    ):
        face.say(speech)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "program",
    [
        "face = fapengine.Face(silent=True); face.say('Mama.'); face.frame()",
        "import os; child = os.fork(); face = fapengine.Face(silent=True); face.frame(); face.close();"
        " child and sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))",
    ],
    ids=["ends with an open face", "forks after the import"],
)
def test_a_program_ends_in_order(program: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", f"import sys, fapengine; {program}"], capture_output=True, text=True, timeout=300
    )
    assert (ended.returncode, ended.stderr) == (0, "")
