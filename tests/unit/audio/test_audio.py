"""Sound out: queued, played on a sound card of software, and kept time of without one."""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.audio import device
from fapengine.audio.device import DEAD_S, Player, open_output
from fapengine.audio.mixer import FADE_S, KEPT, Mixer
from fapengine.audio.output import Output, SilentOutput
from fapengine.errors import ResourceError, UsageError
from tests.patient import TRIES

RATE_HZ = 8000


def tone(frames: int, level: int = 1000) -> np.ndarray:
    return np.full(frames, level, np.int16)


# The queue


@given(st.lists(st.integers(0, 40), max_size=6), st.lists(st.integers(0, 25), max_size=20))
def test_sounds_come_out_whole_and_in_order_however_they_are_fetched(lengths: list[int], buffers: list[int]) -> None:
    queue = Mixer(RATE_HZ)
    sounds = [tone(length, number + 1) for number, length in enumerate(lengths)]
    numbers = [queue.add(one) for one in sounds]
    assert numbers == list(range(1, len(lengths) + 1))
    out = np.concatenate([queue.take(frames) for frames in (*buffers, 300)])
    assert queue.taken == sum(buffers) + 300
    np.testing.assert_array_equal(out[: sum(lengths)], np.concatenate([*sounds, tone(0)]))
    assert not out[sum(lengths) :].any()


def test_a_sound_knows_its_place() -> None:
    queue = Mixer(RATE_HZ)
    queue.take(800)
    first, second = queue.add(tone(800)), queue.add(tone(400))
    assert queue.position_s(first, 0.1) is None
    assert not queue.is_over(first, 99.0)
    queue.take(900)
    assert queue.position_s(first, 0.05) == pytest.approx(-0.05)  # fetched, not yet heard
    assert queue.position_s(first, 0.17) == pytest.approx(0.07)
    assert queue.position_s(second, 0.2) == pytest.approx(0.0)
    assert not queue.is_over(first, 0.199)
    assert queue.is_over(first, 0.2)
    assert queue.position_s(first, 5.0) == pytest.approx(0.1)
    assert not queue.is_over(second, 0.24)
    assert queue.is_over(second, 0.25)


def test_a_stop_fades_and_drops_what_waits() -> None:
    queue = Mixer(RATE_HZ)
    playing, waiting = queue.add(tone(8000)), queue.add(tone(100))
    queue.take(100)
    queue.stop()
    rest = queue.take(400)
    fade = round(FADE_S * RATE_HZ)
    assert (np.diff(rest[: fade + 1].astype(int)) < 0).all()
    assert not rest[fade:].any()
    assert queue.is_over(waiting, 0.0)
    assert queue.position_s(waiting, 1.0) is None
    assert queue.is_over(playing, (100 + fade) / RATE_HZ)
    queue.stop()  # nothing plays: nothing happens
    assert not queue.take(10).any()
    after = queue.add(tone(5))
    assert queue.take(5).any()
    assert queue.position_s(after, 1.0) == pytest.approx(5 / RATE_HZ)


@given(st.lists(st.integers(1, 300), min_size=1, max_size=12))
def test_a_pause_loses_nothing_and_places_stay_true(buffers: list[int]) -> None:
    """Every sample comes once, in order; what is at a place of the stream is what was told."""
    queue = Mixer(RATE_HZ)
    number = queue.add(np.arange(1, 1001, dtype=np.int16) * 30)
    out = []
    for turn, frames in enumerate(buffers):
        queue.pause(turn % 2 == 1)
        out.append(queue.take(frames))
    queue.pause(False)
    out.append(queue.take(1200 + round(FADE_S * RATE_HZ)))
    heard = np.concatenate(out)
    places = [queue.position_s(number, frame / RATE_HZ) or 0.0 for frame in range(len(heard))]
    told = np.rint(np.array(places) * RATE_HZ).astype(int)
    assert (np.diff(told) >= 0).all()
    assert (np.diff(told) <= 1).all()
    loud = np.flatnonzero(heard)
    whole = heard[loud] == 30 * (told[loud] + 1)
    assert whole.sum() >= 1000 - 2 * round(FADE_S * RATE_HZ) * len(buffers)  # outside the fades
    assert (heard[loud] <= 30 * (told[loud] + 1)).all()
    assert told[-1] == 1000
    assert queue.is_over(number, len(heard) / RATE_HZ)


def test_a_sound_that_is_dropped_leaves_the_others_alone() -> None:
    queue = Mixer(RATE_HZ)
    first, second, third, fourth = (queue.add(tone(1000, 1000 * level)) for level in (1, 2, 3, 4))
    queue.take(100)
    queue.drop(second)
    assert queue.is_over(second, 0.0)
    queue.drop(first)
    queue.drop(second)
    fade = round(FADE_S * RATE_HZ)
    out = queue.take(fade + 1000)
    assert (np.diff(out[:fade].astype(int)) < 0).all()
    np.testing.assert_array_equal(out[fade:], tone(1000, 3000))
    assert queue.is_over(first, (100 + fade) / RATE_HZ)
    assert queue.position_s(third, (100 + fade + 500) / RATE_HZ) == pytest.approx(500 / RATE_HZ)
    queue.drop(third)  # it was handed out already
    assert not queue.is_over(third, (100 + fade + 500) / RATE_HZ)
    queue.take(10)
    queue.pause(True)
    queue.take(200)
    queue.drop(fourth)  # nothing of it is heard any more, and nothing clicks
    queue.pause(False)
    assert not queue.take(500).any()


def test_a_pause_fades_and_a_stop_ends_it() -> None:
    queue = Mixer(RATE_HZ)
    first = queue.add(tone(4000))
    queue.take(100)
    queue.pause(True)
    queue.pause(True)
    fade = round(FADE_S * RATE_HZ)
    down = queue.take(200)
    assert (np.diff(down[: fade + 1].astype(int)) < 0).all()
    assert not down[fade:].any()
    assert not queue.take(1000).any()
    assert queue.position_s(first, 1300 / RATE_HZ) == pytest.approx((100 + fade) / RATE_HZ)
    queue.pause(False)
    up = queue.take(200)
    assert (np.diff(up[: fade + 1].astype(int)) > 0).all()
    assert up[-1] == 1000
    queue.pause(True)
    queue.take(200)
    queue.stop()
    assert not queue.take(200).any()
    assert queue.is_over(first, 1.0)
    queue.add(tone(10))
    assert queue.take(10).all()  # the pause is over, too


def test_old_sounds_are_forgotten_when_they_are_over() -> None:
    queue = Mixer(RATE_HZ)
    first = queue.add(tone(10))
    for _ in range(KEPT):
        queue.add(tone(10))
    assert not queue.is_over(first, 0.0)  # it waits still
    queue.take(20_000)
    queue.add(tone(10))
    assert queue.position_s(first, 1.0) is None
    assert queue.is_over(first, 1.0)
    assert len(queue._known) == KEPT


@pytest.mark.parametrize("number", [0, 2, -1])
def test_an_unknown_sound_is_refused(number: int) -> None:
    queue = Mixer(RATE_HZ)
    queue.add(tone(1))
    with pytest.raises(UsageError, match=rf"sound: got {number}, expected 1 to 1"):
        queue.position_s(number, 0.0)


@given(st.lists(st.tuples(st.sampled_from(["add", "pause", "go on", "drop", "stop"]), st.integers(0, 40_000))))
def test_what_is_skipped_leaves_the_queue_as_what_is_taken_does(deeds: list[tuple[str, int]]) -> None:
    taken, skipped = Mixer(RATE_HZ), Mixer(RATE_HZ)
    for deed, frames in deeds:
        for queue in (taken, skipped):
            if deed == "add":
                queue.add(tone(frames))
            elif deed == "drop" and queue._count:
                queue.drop(queue._count)
            elif deed == "stop":
                queue.stop()
            else:
                queue.pause(deed == "pause")
        taken.take(frames)
        skipped.skip(frames)
        assert (taken.taken, taken._ramp) == (skipped.taken, skipped._ramp)
        for number in range(1, taken._count + 1):
            for stream_s in (0.5 * taken.taken / RATE_HZ, taken.taken / RATE_HZ):
                assert taken.position_s(number, stream_s) == skipped.position_s(number, stream_s)


# Without a device


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_a_silent_output_takes_as_long_as_sound_would() -> None:
    clock = Clock()
    out = SilentOutput(RATE_HZ, "no device", now=clock)
    clock.now_s = 103.0
    first, second = out.play(tone(4000)), out.play(tone(800))
    assert out.position_s(first, 103.25) == pytest.approx(0.25, abs=2 / RATE_HZ)
    assert out.position_s(second, 103.25) is None
    assert not out.is_over(first, 103.49)
    assert out.is_over(first, 103.51)
    assert out.position_s(second, 103.55) == pytest.approx(0.05, abs=3 / RATE_HZ)
    clock.now_s = 103.56
    out.stop()
    assert out.is_over(second, 103.56 + FADE_S + 0.001)
    out.close()


@pytest.mark.parametrize("end", [SilentOutput.stop, lambda out: out.pause(True)])
def test_a_silent_output_may_be_left_alone_for_years(end: Callable[[SilentOutput], None]) -> None:
    clock = Clock()
    out = SilentOutput(22_050, "no device", now=clock)
    clock.now_s += 1e9
    out.play(tone(22_050))
    clock.now_s += 0.5
    end(out)
    clock.now_s += 1e9
    out.stop()
    number = out.play(tone(22_050))
    assert out.position_s(number, clock.now_s + 0.5) == pytest.approx(0.5, abs=0.01)


class Pulled(Output):
    """Plays to nobody, until it is pulled out: then it stands still, and a second later is known to be gone."""

    is_closed = False

    def __init__(self, clock: Clock, pulled_s: float) -> None:
        super().__init__(RATE_HZ, "a card", clock)
        self.pulled_s, self.start_s = pulled_s, clock()

    def is_alive(self, now_s: float) -> bool:
        return now_s < self.pulled_s + 1.0

    def close(self) -> None:
        self.is_closed = True

    def _device_s(self, now_s: float) -> float:
        return self._skip_to(min(now_s, self.pulled_s) - self.start_s)


def test_silence_goes_on_where_a_device_that_is_pulled_out_was(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    out = Pulled(clock, 103.0)
    over, dropped = out.play(tone(4000)), out.play(tone(4000))
    clock.now_s = 100.6
    assert out.is_over(over, 100.6)
    out.drop(dropped)
    first, second = out.play(tone(8000 * 4)), out.play(tone(8000))
    clock.now_s = 103.5
    before_s = out.position_s(first, 103.5)
    assert before_s == pytest.approx(2.4, abs=0.02)
    assert (out.description, out.is_silent) == ("a card", False)
    clock.now_s = 104.0
    assert out.position_s(first, 104.0) == pytest.approx(before_s, abs=0.002)
    assert (out.description, out.is_silent, out.is_closed) == ("a card: is gone", True, True)
    assert "the face keeps time by the clock: a card: is gone" in caplog.text
    assert out.position_s(first, 104.5) == pytest.approx(before_s + 0.5, abs=0.002)
    assert out.position_s(second, 104.5) is None
    assert out.position_s(second, 106.0) == pytest.approx(0.4, abs=0.02)
    assert out.is_over(first, 106.0)
    assert all(out.is_over(number, 106.0) for number in (over, dropped))
    clock.now_s = 106.0
    out.stop()
    assert out.is_over(second, 106.0 + FADE_S + 0.001)
    assert out.position_s(out.play(tone(800)), 106.05) == pytest.approx(0.04, abs=0.02)
    out.close()


def test_silence_that_takes_the_place_of_a_paused_device_is_paused() -> None:
    clock = Clock()
    out = Pulled(clock, 101.0)
    number = out.play(tone(8000 * 4))
    clock.now_s = 100.5
    out.pause(True)
    clock.now_s = 102.0
    assert out.position_s(number, 102.0) == pytest.approx(0.51, abs=0.02)
    clock.now_s = 106.0
    assert out.position_s(number, 106.0) == pytest.approx(0.52, abs=0.02)
    assert out.is_silent
    out.pause(False)
    assert out.position_s(number, 106.5) == pytest.approx(1.02, abs=0.02)


# On devices that are no devices


def fake(**changes: object) -> SimpleNamespace:
    class PortAudioError(Exception):
        pass

    def query_devices(device: object = None, kind: object = None) -> object:
        about = {"name": "Card", "default_samplerate": 44_100.0, "max_output_channels": 2}
        return about if kind else [about, {**about, "name": "Microphone", "max_output_channels": 0}]

    class OutputStream:
        def __init__(self, **options: object) -> None:
            self.options = options

        active = True

        def start(self) -> None:
            pass

        def close(self) -> None:
            self.closed = True

    made = SimpleNamespace(
        PortAudioError=PortAudioError, query_devices=query_devices, OutputStream=OutputStream,
        check_output_settings=lambda **options: None, default=SimpleNamespace(device=[-1, 0]),
    )  # fmt: skip
    vars(made).update(changes)
    return made


def test_a_device_that_does_not_know_the_rate_gets_it_resampled(monkeypatch: pytest.MonkeyPatch) -> None:
    card = fake()

    def refuse(**options: object) -> None:
        raise card.PortAudioError("Invalid sample rate")

    card.check_output_settings = refuse
    monkeypatch.setattr(device, "portaudio", lambda: card)
    now = Clock()
    with Player(22_050, now=now) as player:
        assert player.description == "Card, 44100 Hz"
        times = np.arange(22_050) / 22_050
        number = player.play(np.rint(8000 * np.sin(2 * np.pi * 440 * times)).astype(np.int16))
        empty = player.play(tone(0))
        out = np.zeros((44_100, 1), np.int16)
        status = SimpleNamespace(output_underflow=True)
        player._fetch(out, 44_100, SimpleNamespace(currentTime=1.0, outputBufferDacTime=1.25), status)
        spectrum = np.abs(np.fft.rfft(out[:, 0]))
        assert spectrum.argmax() == 440
        assert player.position_s(number, 100.0) == pytest.approx(-0.25)
        assert player.position_s(number, 100.75) == pytest.approx(0.5)
        assert player.clock.underruns == 1
        assert player.is_alive(100.0 + DEAD_S - 0.1)
        assert not player.is_alive(100.0 + DEAD_S)
        player._stream.active = False
        assert not player.is_alive(100.0)
        player._stream.active = True
        player._fetch(out[:441], 441, SimpleNamespace(currentTime=2.0, outputBufferDacTime=2.25), status)
        assert player.is_over(empty, 101.26)
        player.stop()
    assert player._stream.closed


def test_refuses_and_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    card = fake()
    monkeypatch.setattr(device, "portaudio", lambda: card)
    assert [(one.name, one.is_default) for one in device.devices()] == [("Card", True)]
    with pytest.raises(UsageError, match="sample_rate_hz: got 0"):
        Player(0)
    opened = open_output(8000)
    assert not opened.is_silent
    opened._stream.active = False
    opened.play(tone(1))
    assert opened.description == "Card, 8000 Hz: is gone"

    def refuse(device: object = None, kind: object = None) -> object:
        raise card.PortAudioError("Error querying device -1")

    card.query_devices = refuse
    with pytest.raises(ResourceError, match="Error querying device -1; `fapengine doctor` lists"):
        Player(8000)
    with pytest.raises(ResourceError, match="querying device"):
        open_output(8000, device="Card")
    fallback = open_output(8000)
    assert fallback.is_silent
    assert "querying device" in fallback.description
    card.default.device = [-1, -1]
    with pytest.raises(ResourceError, match="there is no output device"):
        Player(8000)
    assert open_output(8000).description == "there is no output device; see `fapengine doctor`"
    assert open_output(8000, silent=True).description == "no sound was wished for"


def test_portaudio_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(ResourceError, match="Install it with: sudo apt-get install -y libportaudio2"):
        device.devices()
    assert open_output(8000).is_silent


# On a sound card of software


def clicks(environment: Mapping[str, str]) -> dict[str, Any]:
    """Play eight clicks, hear them at the sink's monitor, and stop a longer sound."""
    driver = Path(__file__).with_name("sound_loop.py")
    done = subprocess.run([sys.executable, driver], env=environment, capture_output=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr.decode()
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_what_is_played_is_heard_and_stops(null_sink: Mapping[str, str]) -> None:
    answer = clicks(null_sink)
    assert 1 <= len(answer["off_s"]) <= 8
    assert answer["took_s"] > 2.4
    assert answer["stopped"]
    assert answer["description"].endswith("22050 Hz")
    assert answer["devices"]


@pytest.mark.nightly
def test_what_is_told_is_what_is_heard(null_sink: Mapping[str, str]) -> None:
    """An ear at the sink's monitor hears each click when the player says that it sounds."""
    for _ in range(TRIES):
        answer = clicks(null_sink)
        off = np.abs(answer["off_s"])  # of eight clicks; measured 0.001 on a quiet machine
        if len(off) == 8 and np.median(off) < 0.02 and not answer["backwards"]:
            return
    pytest.fail(f"what was told was not what was heard: {answer}")
