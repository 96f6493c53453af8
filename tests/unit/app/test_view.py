"""What a window can show, without the window."""

import threading
import time

import numpy as np
import pytest

from fapengine.app.face import Face, Ticks
from fapengine.app.view import BLINK, PAUSE, STOP, FaceSource, OscSource, ServerSource, TrackSource
from fapengine.audio.output import Output, SilentOutput
from fapengine.engine.commands import SetParameter
from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.style import Style
from fapengine.voices.protocol import Speech


class Clock:
    now_s = 10.0

    def __call__(self) -> float:
        return self.now_s


def ramp(frames: int = 100, rate_hz: float = 50.0) -> FapTrack:
    values = np.zeros((frames, 68), int)
    values[:, fap.column(3)] = np.arange(frames)
    return FapTrack.from_values(values, rate_hz=rate_hz)


def jaw(faps: np.ndarray) -> int:
    return int(faps[fap.column(3)])


# A file


def test_a_track_is_played_at_its_rate_and_over_again() -> None:
    clock = Clock()
    source = TrackSource(ramp(), clock)
    assert source.duration_s == pytest.approx(2.0)
    assert jaw(source.frame(0.0)) == 0
    clock.now_s += 1.0
    assert jaw(source.frame(0.0)) == 50
    assert jaw(source.frame(0.1)) == 55
    assert source.status() == "1.00 of 2.00 s, 50 Hz"
    clock.now_s += 1.5
    source.frame(0.0)
    clock.now_s += 0.1
    assert jaw(source.frame(0.0)) == 5
    source.close()


def test_a_track_pauses_and_plays_from_another_place() -> None:
    clock = Clock()
    source = TrackSource(ramp(), clock)
    clock.now_s += 0.5
    source.frame(0.0)
    source.press(PAUSE)
    assert source.is_paused
    assert source.status() == "0.50 of 2.00 s, 50 Hz, paused"
    clock.now_s += 5.0
    assert jaw(source.frame(0.3)) == 25
    source.seek(1.5)
    assert jaw(source.frame(0.0)) == 75
    source.press(PAUSE)
    assert not source.is_paused
    clock.now_s += 0.2
    assert jaw(source.frame(0.0)) == 85


def test_skipped_frames_of_a_track_show_what_was_there_before() -> None:
    track = ramp(4, rate_hz=10.0)
    gaps = FapTrack(
        values=track.values, mask=track.mask, visemes=track.visemes, expressions=track.expressions,
        frame_numbers=np.array([5, 6, 9, 10]), rate_hz=10.0,
    )  # fmt: skip
    clock = Clock()
    source = TrackSource(gaps, clock)
    shown = []
    for _ in range(6):
        shown.append(jaw(source.frame(0.0)))
        clock.now_s += 0.1
    assert shown == [0, 1, 1, 1, 2, 3]


def test_a_track_follows_its_sound() -> None:
    clock = Clock()
    output = SilentOutput(8000, "", now=clock)
    samples = np.ones(20_000, np.int16)  # 2.5 s: longer than the motion
    source = TrackSource(ramp(), clock, samples=samples, sample_rate_hz=8000, output=output)
    assert source.duration_s == pytest.approx(2.5)
    clock.now_s += 1.0
    assert jaw(source.frame(0.0)) == pytest.approx(50, abs=1)
    source.seek(0.5)
    clock.now_s += 0.25
    assert jaw(source.frame(0.0)) == pytest.approx(37, abs=1)
    assert source.position_s == pytest.approx(0.74, abs=2e-3)  # what was stopped fades for 10 ms
    source.press(PAUSE)
    clock.now_s += 9.0
    assert source._sound is None
    source.press(PAUSE)
    clock.now_s += 0.5
    assert jaw(source.frame(0.0)) == pytest.approx(62, abs=1)
    source.seek(2.5)
    clock.now_s += 0.01
    source.frame(0.0)  # over: it begins again
    clock.now_s += 0.1
    assert jaw(source.frame(0.0)) == pytest.approx(5, abs=1)
    source.close()


def test_a_sound_that_is_late_holds_the_track() -> None:
    class Late(SilentOutput):
        def position_s(self, sound: int, now_s: float) -> float | None:
            place_s = super().position_s(sound, now_s)
            return None if place_s is None else place_s - 0.3

    clock = Clock()
    source = TrackSource(
        ramp(), clock, samples=np.ones(16_000, np.int16), sample_rate_hz=8000, output=Late(8000, "", now=clock)
    )
    clock.now_s += 0.2
    assert jaw(source.frame(0.0)) == pytest.approx(0, abs=1)
    clock.now_s += 0.4
    assert jaw(source.frame(0.0)) == pytest.approx(15, abs=1)


def test_a_track_goes_on_when_its_device_is_pulled_out() -> None:
    class Pulled(Output):
        def is_alive(self, now_s: float) -> bool:
            return now_s < 11.0

        def _device_s(self, now_s: float) -> float:
            return self._skip_to(min(now_s, 10.5) - 10.0)

    clock = Clock()
    output = Pulled(8000, "a card", clock)
    source = TrackSource(ramp(), clock, samples=np.ones(16_000, np.int16), sample_rate_hz=8000, output=output)
    shown = {}
    for _ in range(75):
        clock.now_s += 0.02
        shown[round(clock.now_s, 2)] = jaw(source.frame(0.0))
    assert [shown[at_s] for at_s in (10.6, 10.9, 11.0, 11.02)] == pytest.approx([25] * 4, abs=1)
    assert shown[11.5] == pytest.approx(50, abs=2)


# Our own face


def speech_of(text: str) -> Speech:
    phones = PhoneTrack.from_phones([Phone("m", 0.0, 0.1), Phone("a", 0.1, 0.4), Phone("m", 0.4, 0.5)])
    return Speech(samples=np.zeros(4000, np.int16), sample_rate_hz=8000, phones=phones)


class Hall:
    """A speaking source whose time the test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = Clock()
        monkeypatch.setattr("fapengine.app.face.open_output", self._output)
        self.face = Face("grid_s1_en", style=Style.speech_only(), silent=True)
        self.face.hub.clock = self.clock
        self.face.hub.close("face")
        self.face.hub.open("face")
        self.source = FaceSource(self.face)

    def _output(self, sample_rate_hz: int, **_: object) -> SilentOutput:
        return SilentOutput(sample_rate_hz, "no card", now=self.clock)

    def run(self, seconds: float) -> list[np.ndarray]:
        frames = []
        for _ in range(round(seconds * 50)):
            self.clock.now_s += 0.02
            frames.append(self.source.frame(0.01))
        return frames

    def say(self, text: str) -> None:
        self.face.say(speech_of(text).padded(lead_s=0.15, tail_s=0.25), text=text)


@pytest.fixture
def hall(monkeypatch: pytest.MonkeyPatch) -> Hall:
    made = Hall(monkeypatch)
    yield made
    made.source.close()


def opening(faps: np.ndarray) -> float:
    return -float(faps[fap.column(51)] + faps[fap.column(52)])


def test_it_says_what_it_is_given(hall: Hall) -> None:
    hall.say("mam")
    assert hall.face.is_speaking
    frames = hall.run(0.5)
    assert max(map(opening, frames)) > 80
    assert hall.source.status().endswith("ms from its sound")
    frames = hall.run(1.0)
    assert not hall.face.is_speaking
    assert opening(frames[-1]) == pytest.approx(0, abs=2)
    assert hall.source.status() == "no card"
    assert hall.face.errors.as_dict()["max"] < 15


def test_frames_are_of_the_time_at_which_they_are_seen(hall: Hall) -> None:
    hall.say("mam")
    hall.run(0.4)
    at_s = hall.clock.now_s
    hall.face.frame(0.25)
    assert hall.face.hub.engine._shown_s == pytest.approx(at_s + 0.25)
    hall.face.frame(0.0)  # a frame that was quicker than expected: time does not go back
    assert hall.face.hub.engine._shown_s == pytest.approx(at_s + 0.25)


def test_moods_come_and_go_with_the_sound(hall: Hall) -> None:
    """Joy from 0.4 s on, to the end: the face waits 0.6 s for its sound, and the mood with it."""
    speech = speech_of("mam").padded(lead_s=1.0, tail_s=1.5)  # 3 s
    moods = [Mood(Expression.JOY, 1.0, 0.4, attack_s=0.1, release_s=0.2)]
    hall.clock.now_s += 0.6
    hall.face.say(speech, text="mam", expressions=moods)
    cheeks = [float(frame[fap.column(41)]) for frame in hall.run(4.0)]
    shown = np.flatnonzero(np.array(cheeks) > 0.5 * max(cheeks)) * 0.02
    assert max(cheeks) > 20
    assert shown[0] == pytest.approx(0.45, abs=0.06)
    assert shown[-1] == pytest.approx(2.9, abs=0.08)


def test_the_last_utterance_brings_the_face_to_rest(hall: Hall) -> None:
    """Head motion that was switched on ends with what is said, 1.3 s long, and not before."""
    hall.face.send_command(SetParameter("head_motion", 1.0))
    hall.face.say(speech_of("mam").padded(lead_s=0.5, tail_s=0.5), is_last=True)
    turns = np.array(hall.run(6.0))[:, fap.column(49)]
    assert np.abs(turns[30:50]).max() > 50
    assert not turns[-150:].any()


def test_pause_and_stop_hold_the_face_and_its_sound(hall: Hall) -> None:
    hall.say("mam")
    hall.run(0.36)
    hall.source.press(PAUSE)
    assert hall.face.speaker.is_paused
    hall.run(1.0)
    assert hall.face.hub.engine.state("face") == "paused"
    hall.source.press(PAUSE)
    hall.run(0.1)
    assert hall.face.hub.engine.state("face") == "speaking"
    hall.source.press(STOP)
    frames = hall.run(0.5)
    assert not hall.face.is_speaking
    assert opening(frames[-1]) == pytest.approx(0, abs=2)


def test_a_pause_is_of_what_is_being_said(hall: Hall) -> None:
    hall.run(0.1)
    hall.source.press(PAUSE)  # nothing is said: nothing stands still
    assert not hall.face.speaker.is_paused
    hall.say("mam")
    assert max(map(opening, hall.run(0.5))) > 80
    assert len(hall.face.errors.sync_error_s) > 10  # the face goes with its sound
    hall.source.press(PAUSE)
    hall.run(0.5)
    assert hall.face.speaker.is_paused
    hall.source.press(PAUSE)
    hall.say("mam")
    assert not hall.face.speaker.is_paused
    hall.run(2.5)
    assert not hall.face.is_speaking
    assert hall.face.hub.engine.counters("face").finished == 2


def test_gestures_and_keys_move_the_face(hall: Hall) -> None:
    def settled() -> np.ndarray:
        return hall.run(1.0)[-1]

    rest = settled()
    hall.face.express("joy")
    assert settled()[fap.column(12)] > rest[fap.column(12)] + 50
    hall.face.express("neutral")
    assert hall.face.hub.engine.counters("face").refused == 0
    assert abs(settled()[fap.column(12)] - rest[fap.column(12)]) < 5
    hall.face.look(0.3, 0.0)
    assert settled()[fap.column(23)] == pytest.approx(30_000, rel=0.05)
    hall.face.set_parameter("articulation", 0.0)
    assert hall.face.hub.engine.style("face").articulation == 0.0
    hall.source.press(BLINK)
    assert max(frame[fap.column(19)] for frame in hall.run(0.5)) > 500


# Elsewhere


class Link:
    state, trouble, is_speaking = "lost", "Cannot connect to host 127.0.0.1:1", True
    age_s = round_trip_s = None

    class counts:  # noqa: N801
        missed = 3

    def __init__(self) -> None:
        self.sent: list[tuple[str, dict[str, object]]] = []

    def send(self, kind: str, **fields: object) -> None:
        self.sent.append((kind, fields))

    def faps(self) -> np.ndarray:
        return np.arange(68)


def test_a_servers_face_is_told_what_is_pressed() -> None:
    from fapengine.server.web.messages import parse_request, text_of

    link = Link()
    source = ServerSource(link, texts=["Guten Tag", "Ja"], voice="de")
    source.frame(0.0)
    assert not link.sent  # nobody would hear it yet
    assert source.status() == "no server: Cannot connect to host 127.0.0.1:1"
    link.state = "open"
    assert source.status() == "open"
    link.age_s, link.round_trip_s = 0.012, 0.0014
    assert source.status() == "frames 12 ms old, 3 missed, 1.4 ms there and back"
    assert source.frame(0.0)[5] == 5
    for key in (BLINK, PAUSE, PAUSE, PAUSE, STOP, PAUSE):
        source.press(key)
    assert [kind for kind, _ in link.sent] == [
        "say", "say", "blink", "pause", "resume", "pause", "cancel", "resume", "pause",
    ]  # fmt: skip
    assert [fields["text"] for kind, fields in link.sent if kind == "say"] == ["Guten Tag", "Ja"]
    source.frame(0.0)
    assert source.is_paused
    link.is_speaking = False
    source.frame(0.0)
    assert not source.is_paused  # it was over, or the server is another
    source.press(PAUSE)
    assert not source.is_paused
    assert [kind for kind, _ in link.sent[-2:]] == ["pause", "resume"]
    for kind, fields in link.sent:
        parse_request(text_of(kind, **fields))  # the server understands it


def test_osc_tells_what_comes() -> None:
    class Frames:
        port, session, is_silent = 9100, "anna", True

        class counts:  # noqa: N801
            frames, missed = 5, 1

        closed = False

        def faps(self) -> np.ndarray:
            return np.arange(68)

        def close(self) -> None:
            self.closed = True

    frames = Frames()
    source = OscSource(frames)
    assert source.status() == "nothing comes to port 9100"
    frames.is_silent = False
    assert source.status() == "session anna, 5 frames, 1 missed"
    assert source.frame(0.1)[7] == 7
    source.press(PAUSE)
    source.close()
    assert frames.closed


# Small things


def test_ticks_are_steady_and_count_what_they_skip() -> None:
    now = [0.0]
    ticks = Ticks(10.0, clock=lambda: now[0])
    ticks.wait()
    now[0] = 0.35
    ticks.wait()
    assert (ticks.frames, ticks.skipped) == (2, 2)
    threading.Timer(0.05, lambda: now.__setitem__(0, 0.4)).start()
    started = time.monotonic()
    ticks.wait()
    assert time.monotonic() - started >= 0.03
    assert ticks.frames == 3
