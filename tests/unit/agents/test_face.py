"""What the plug-ins share, on a clock of the test: sound in bytes, marks with their words, the pace."""

import asyncio

import numpy as np
import pytest

from fapengine.agents.face import AHEAD_S, AgentFace, AgentOptions
from fapengine.engine.commands import Express, TurnHead
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.host.stream import LEAD_S, StreamEvent
from fapengine.host.words import CHARACTER_S, MarkTimer
from fapengine.mpeg4 import fap
from fapengine.render.drawing import Pixels
from fapengine.server.film.painter import Painter
from tests.unit.host.test_stream import noise, pauses_of, stage
from tests.unit.host.ticking_recognizer import TickingRecognizer


def run(
    actor: AgentFace, until_s: float, now_s: float = 0.0
) -> tuple[float, np.ndarray, list[tuple[float, StreamEvent]]]:
    """Show frames when they are due; returns the time, the sound and the events with their times."""
    sounds, events = [np.zeros(0, np.int16)], []
    while now_s < until_s:
        now_s += actor.wait_s(now_s)
        frame, told = actor.frame(now_s)
        sounds += [sound.samples for sound in frame.sounds]
        events += [(now_s, event) for event in told]
        now_s += 0.005  # drawing
    return now_s, np.concatenate(sounds), events


@pytest.mark.parametrize("channels", [1, 2])
def test_bytes_cut_anywhere_are_the_same_sound(channels: int) -> None:
    actor, sound = AgentFace(stage(), 25.0), noise(1.0)
    data = np.repeat(sound, channels).astype("<i2").tobytes()
    rng = np.random.default_rng(3)
    while data:
        cut = int(rng.integers(1, 2_000))
        actor.sound(data[:cut], 24_000, channels)
        data = data[cut:]
    actor.end()
    _, heard, _ = run(actor, 2.0)
    assert np.array_equal(heard, sound)


@pytest.mark.parametrize("form", ["float32", "float64", "int32", "stereo"])
def test_samples_in_any_form_are_the_same_sound(form: str) -> None:
    actor, sound = AgentFace(stage(), 25.0), noise(0.5)
    forms = {
        "float32": (sound / 2**15).astype(np.float32), "float64": sound / 2**15,
        "int32": sound.astype(np.int32) << 16, "stereo": np.stack([sound, sound], axis=1),
    }  # fmt: skip
    actor.sound(forms[form], 24_000)
    with pytest.raises(UsageError, match="samples: got dtype int64"):
        actor.sound(sound.astype(np.int64), 24_000)
    actor.end()
    _, heard, _ = run(actor, 1.5)
    assert np.array_equal(heard, sound)


def test_a_delivery_is_shown_while_it_speaks() -> None:
    actor = AgentFace(stage(), 25.0)
    given: list[Express] = []
    actor.host.send_command = given.append  # type: ignore[method-assign,assignment]
    actor.feel("say happily")
    assert given == []  # it says nothing
    actor.sound(noise(1.0), 24_000)
    for delivery in ('say "sadly" & <slowly>', "say happily", "speak"):
        actor.feel(delivery)
    assert [express.expression.name for express in given] == ["SADNESS", "JOY"]


def test_no_such_channels() -> None:
    with pytest.raises(DataError, match="channels: got 0"):
        AgentFace(stage(), 25.0).sound(b"", 24_000, 0)
    with pytest.raises(UsageError, match="frame_rate_hz: got 0"):
        AgentOptions(frame_rate_hz=0.0)
    with pytest.raises(UsageError, match="edges: got 'rough'"):
        AgentOptions(edges="rough")
    with pytest.raises(UsageError, match="size: got 9x100000, expected a width and a height of 16 to 4096 pixels"):
        AgentOptions(size=(9, 100_000))


def test_frames_with_sound_are_made_ahead_and_no_more() -> None:
    actor = AgentFace(stage(TickingRecognizer()), 25.0)
    run(actor, 1.0)
    actor.sound(noise(4.0).tobytes(), 24_000)
    now_s, heard, _ = run(actor, 3.0, 1.0)
    played_s = len(heard) / 24_000 - actor.unplayed_s(now_s)
    assert AHEAD_S - 0.09 < actor.unplayed_s(now_s) < AHEAD_S + 0.05
    actor.interrupt(now_s)
    assert actor.host.events() == [StreamEvent(1, "interrupted", pytest.approx(played_s, abs=0.001))]


def test_frames_wait_for_sound_that_comes_as_it_is_spoken() -> None:
    """Frames made ahead would find no sound, and a stall rests the face."""
    actor = AgentFace(stage(TickingRecognizer(guess="ma")), 25.0)
    pauses = pauses_of(actor.host)
    now_s, began_s, silent = 1.0, None, 0
    pushed_s = now_s
    while now_s < 4.0:
        now_s += actor.wait_s(now_s)
        while pushed_s < now_s - 0.02:
            actor.sound(noise(0.02).tobytes(), 24_000)
            pushed_s += 0.02
        sounds = actor.frame(now_s)[0].sounds
        began_s = now_s if sounds and began_s is None else began_s
        silent += began_s is not None and not sounds
        now_s += 0.005
    assert began_s is not None
    assert began_s - 1.0 < LEAD_S + 0.1
    assert (silent, pauses) == (0, [])


def test_a_late_face_does_not_hurry_after() -> None:
    actor = AgentFace(stage(), 25.0)
    run(actor, 1.0)
    assert actor.wait_s(20.0) == 0.0
    actor.frame(20.0)
    assert actor.wait_s(20.0) == pytest.approx(0.04)


def test_marks_come_with_their_words() -> None:
    actor = AgentFace(stage(TickingRecognizer()), 25.0)
    assert actor.marks.expect("Well [nod] yes.") == "Well yes."
    actor.sound(noise(2.0).tobytes(), 24_000)
    actor.word("Well", 0.1, 0.4)
    actor.word("yes.", 0.8, 1.2)
    actor.end()
    pitch, now_s, began_s = [], 0.0, None
    while now_s < 3.0:
        now_s += actor.wait_s(now_s)
        frame, _ = actor.frame(now_s)
        began_s = now_s if began_s is None and frame.sounds else began_s
        if began_s is not None:
            pitch.append(frame.faps[fap.column(48)])
    assert np.argmax(pitch) == pytest.approx((0.8 + 0.2) * 25, abs=1.1)


def test_without_words_marks_are_estimated() -> None:
    timer = MarkTimer()
    assert timer.expect("One two [nod] three. ") == "One two three."
    assert timer.expect("😀 Four.") == "Four."
    told = timer.estimated()
    assert [type(command) for _, command in told] == [TurnHead, TurnHead, Express]
    assert told[0][0] == pytest.approx(8 * CHARACTER_S)
    assert told[2][0] == pytest.approx(14 * CHARACTER_S - 0.35)
    assert timer.estimated() == []


def test_words_of_the_next_text_end_the_one_before() -> None:
    timer = MarkTimer()
    timer.expect("One two. [laughs]")
    timer.expect("Three [nod] four.")
    assert timer.word("One", 0.1) == []
    assert [at_s for at_s, _ in timer.word("Three", 1.0)] == [pytest.approx(0.65)]
    assert [at_s for at_s, _ in timer.word("four.", 1.5)] == [1.5, pytest.approx(1.7)]
    timer.clear()
    assert timer.word("four.", 2.0) == []


def test_a_painter_draws_in_a_process_of_its_own() -> None:
    async def painted() -> tuple[bytes, bytes]:
        painter = Painter(size=(32, 48), edges="none")
        shut, wide = np.zeros(68, np.int32), np.zeros(68, np.int32)
        wide[fap.column(3)] = 800
        try:
            return await painter.picture(shut), await painter.picture(wide)
        finally:
            painter.close()

    shut, wide = asyncio.run(painted())
    assert len(shut) == len(wide) == 32 * 48 * 3
    assert shut != wide


@pytest.mark.parametrize("renderer", ["gl", "native"])
def test_a_painter_draws_i420_for_encoders(renderer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAPENGINE_RENDERER", renderer)

    def painted(pixels: Pixels) -> np.ndarray:
        painter = Painter(size=(32, 48), pixels=pixels)
        try:
            return np.frombuffer(painter.draw(np.zeros(68, np.int32)), np.uint8)
        finally:
            painter.close()

    rgb, planes = painted("rgb").reshape(48, 32, 3), painted("i420").reshape(72, 32)
    luma = 16 + rgb @ np.array([65.481, 128.553, 24.966]) / 255  # Rec. 601
    assert np.abs(planes[:48] - luma).max() <= 1.5
    small = rgb.reshape(24, 2, 16, 2, 3).mean(axis=(1, 3))
    for plane, weights in zip(
        planes[48:].reshape(2, 24, 16), ((-37.797, -74.203, 112.0), (112.0, -93.786, -18.214)), strict=True
    ):
        assert np.abs(plane - (128 + small @ np.array(weights) / 255)).max() <= 1.5


def test_a_painter_that_cannot_says_why() -> None:
    painter = Painter(head="nobody", size=(32, 32))
    with pytest.raises(ResourceError, match="head: got 'nobody'"):
        asyncio.run(painter.ready())
    painter.close()
