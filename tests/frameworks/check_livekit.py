"""The face against LiveKit's published classes: generator, runner, avatar session. No server: the room is a double."""

import asyncio
import math
import time
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from livekit import rtc
from livekit.agents.types import TimedString
from livekit.agents.voice.avatar import AudioSegmentEnd, QueueAudioOutput

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.livekit import AvatarSession
from fapengine.agents.livekit_tracks import (
    IDENTITY,
    MAX_ACTS,
    SAMPLE_RATE_HZ,
    FaceGenerator,
    FaceOutput,
    RemoteOutput,
    runner_of,
)
from tests.frameworks.clock import in_time
from tests.leaping import LeapingLoop

OPTIONS = AgentOptions(size=(64, 64))


def sound(length_s: float) -> np.ndarray:
    times = np.arange(int(length_s * SAMPLE_RATE_HZ)) / SAMPLE_RATE_HZ
    return (8_000 * np.sin(2 * np.pi * 140 * times) * (np.sin(2 * np.pi * 3 * times) > 0)).astype(np.int16)


def pieces(samples: np.ndarray, step: int = 2_400) -> list[rtc.AudioFrame]:
    return [
        rtc.AudioFrame(piece.tobytes(), SAMPLE_RATE_HZ, 1, len(piece))
        for piece in np.split(samples, range(step, len(samples), step))
    ]


class Publication:
    async def wait_for_subscription(self) -> None: ...


class Participant:
    identity = "agent"

    async def publish_track(self, *_: Any) -> Publication:
        return Publication()


class Room(rtc.EventEmitter):  # type: ignore[type-arg]
    local_participant = Participant()
    name = "room"

    def isconnected(self) -> bool:
        return True


class StandInPainter:
    """Takes a time for each image."""

    def __init__(self, takes_s: float) -> None:
        self.takes_s = takes_s

    async def ready(self) -> None: ...

    async def picture(self, faps: np.ndarray) -> bytes:
        await asyncio.sleep(self.takes_s)
        return bytes(64 * 64 * 3)

    def close(self) -> None: ...


async def _generated(length_s: float, takes_s: float) -> tuple[list[Any], np.ndarray]:
    """Frames of a generator whose images take a time, each with the time at which it came."""
    actor = AgentFace.open(replace(OPTIONS, hears=False))
    actor.painter.close()
    actor.painter = StandInPainter(takes_s)
    generator, given, made = FaceGenerator(actor, OPTIONS.size), sound(length_s), []
    for frame in pieces(given):
        await generator.push_audio(frame)
    await generator.push_audio(AudioSegmentEnd())
    async for frame in generator:
        made.append((time.monotonic(), frame))
        if isinstance(frame, AudioSegmentEnd):
            break
    actor.close()
    return made, given


def _in_virtual_time(monkeypatch: pytest.MonkeyPatch, *of: float) -> tuple[list[Any], np.ndarray]:
    loop = LeapingLoop()
    loop.lend(monkeypatch)
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        return runner.run(_generated(*of))


def test_the_generator_gives_all_sound_each_with_its_picture_then_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    made, given = _in_virtual_time(monkeypatch, 1.0, 0.017)
    heard = [(at_s, frame) for at_s, frame in made if isinstance(frame, rtc.AudioFrame)]
    assert np.array_equal(np.concatenate([np.frombuffer(frame.data, np.int16) for _, frame in heard]), given)
    assert len(heard) == 25
    for (_, before), (_, frame) in pairwise(made):
        if isinstance(before, rtc.AudioFrame):
            assert isinstance(frame, rtc.VideoFrame)
    ended_s = made[-1][0]
    assert ended_s - heard[0][0] >= 1.0 - 0.02  # not before it was heard


@pytest.mark.parametrize("takes_s", [0.005, 0.06, 0.1, 0.2, 1e6])
def test_sound_never_waits_for_pictures(monkeypatch: pytest.MonkeyPatch, takes_s: float) -> None:
    made, given = _in_virtual_time(monkeypatch, 4.0, takes_s)
    heard = [(at_s, frame) for at_s, frame in made if isinstance(frame, rtc.AudioFrame)]
    assert np.array_equal(np.concatenate([np.frombuffer(frame.data, np.int16) for _, frame in heard]), given)
    for number, (at_s, _) in enumerate(heard):
        assert at_s - heard[0][0] <= 0.04 * number + 1e-6
    shown = sum(isinstance(frame, rtc.VideoFrame) for _, frame in made)
    assert shown >= min(100, int(0.9 * 4.0 / takes_s))
    print(f"a picture takes {takes_s:g} s: {shown} shown in {made[-1][0] - heard[0][0]:.2f} s")


@pytest.mark.parametrize("rate_hz", [8_000, 22_050, 48_000])
def test_sound_of_another_rate_comes_out_at_the_rate_of_the_track(rate_hz: int) -> None:
    """The runner fails on any other rate: its track has one."""

    async def resampled() -> np.ndarray:
        actor = AgentFace.open(replace(OPTIONS, hears=False))
        generator, taken = FaceGenerator(actor, OPTIONS.size), []
        actor.sound = lambda data, rate, channels: taken.append((np.frombuffer(data, np.int16), rate, channels))
        for length_s in (1.0, 0.5):
            times = np.arange(round(length_s * rate_hz)) / rate_hz
            samples = (8_000 * np.sin(2 * np.pi * 200 * times)).astype(np.int16)
            for piece in np.split(samples, range(rate_hz // 10, len(samples), rate_hz // 10)):
                await generator.push_audio(rtc.AudioFrame(piece.tobytes(), rate_hz, 1, len(piece)))
            await generator.push_audio(AudioSegmentEnd())
        actor.close()
        assert {(rate, channels) for _, rate, channels in taken} == {(SAMPLE_RATE_HZ, 1)}
        return np.concatenate([samples for samples, *_ in taken])

    samples = asyncio.run(resampled()).astype(float)
    assert len(samples) == pytest.approx(1.5 * SAMPLE_RATE_HZ, rel=0.02)
    spectrum = np.abs(np.fft.rfft(samples[: SAMPLE_RATE_HZ // 2]))
    assert np.argmax(spectrum) == 100  # 200 Hz


async def _played(*, interrupts: bool = False, pauses_s: float = 0.0) -> list[Any]:
    actor, events = AgentFace.open(OPTIONS), []
    output = FaceOutput(actor)
    await actor.ready()
    output.on("playback_started", lambda event: events.append(("started", time.monotonic(), event)))
    output.on("playback_finished", lambda event: events.append(("finished", time.monotonic(), event)))
    runner = runner_of(Room(), output, actor, OPTIONS)
    await runner.start()
    for frame in pieces(sound(1.5)):
        await output.capture_frame(frame)
    output.flush()
    if interrupts:
        while not events:
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.6)
        output.clear_buffer()
    if pauses_s:
        while not events:
            await asyncio.sleep(0.02)
        output.pause()
        await asyncio.sleep(pauses_s)
        assert len(events) == 1
        output.resume()
    async with asyncio.timeout(60):
        while not any(kind == "finished" for kind, *_ in events):
            await asyncio.sleep(0.02)
    await runner.aclose()
    actor.close()
    return events


def test_the_runner_tells_when_playback_begins_and_ends() -> None:
    (started, began_s, _), (finished, ended_s, event) = asyncio.run(_played())
    assert (started, finished, event.interrupted) == ("started", "finished", False)
    assert event.playback_position == pytest.approx(1.5, abs=0.02)
    assert ended_s - began_s >= 1.5 - 0.1


def test_a_pause_holds_the_sound_and_nothing_of_it_is_lost() -> None:
    (_, began_s, _), (_, ended_s, event) = asyncio.run(_played(pauses_s=3.0))
    assert not event.interrupted
    assert event.playback_position == pytest.approx(1.5, abs=0.02)
    assert ended_s - began_s >= 1.5 + 3.0 - 0.2  # the runner plays the 0.1 s that it has


def test_the_runner_tells_of_an_interruption() -> None:
    in_time(_off_of_an_interruption, lambda off_s: off_s < 0.3)  # the runner counts what it queued (0.1 s) as played


def _off_of_an_interruption() -> float:
    events = asyncio.run(_played(interrupts=True))
    began_s = next(at_s for kind, at_s, _ in events if kind == "started")
    _, ended_s, event = next(one for one in events if one[0] == "finished")
    if not event.interrupted or event.playback_position >= 1.4:
        return math.inf  # or the machine has too much to do: it was played before
    return abs(float(event.playback_position) - (ended_s - began_s))


async def _painter_dies() -> list[Any]:
    actor, events = AgentFace.open(OPTIONS), []
    output = QueueAudioOutput(sample_rate=SAMPLE_RATE_HZ, wait_playback_start=True)
    await actor.ready()
    output.on("playback_finished", events.append)
    runner = runner_of(Room(), output, actor, OPTIONS)
    await runner.start()
    for spoken in (1, 2):
        for frame in pieces(sound(1.5)):
            await output.capture_frame(frame)
        output.flush()
        await asyncio.sleep(0.5)
        actor.painter._child.kill()
        async with asyncio.timeout(60):
            while len(events) < spoken:
                await asyncio.sleep(0.02)
    drawn = actor.pictures.counts.drawn
    async with asyncio.timeout(60):
        while actor.pictures.counts.drawn == drawn:
            await asyncio.sleep(0.02)
    await runner.aclose()
    actor.close()
    return events


def test_the_runner_tells_the_end_of_utterances_whose_painter_died() -> None:
    for event in asyncio.run(_painter_dies()):
        assert not event.interrupted
        assert event.playback_position == pytest.approx(1.5, abs=0.02)


class Output:
    tail: Any = None

    def replace_audio_tail(self, tail: Any) -> None:
        self.tail = tail


class Session(rtc.EventEmitter):  # type: ignore[type-arg]
    def __init__(self) -> None:
        super().__init__()
        self.output = Output()


async def _text(*given: Any) -> Any:
    for piece in given:
        yield piece


async def _session() -> None:
    avatar, session, room = AvatarSession(size=(64, 64)), Session(), Room()
    avatar._wait_avatar_join = lambda: asyncio.sleep(0)  # type: ignore[method-assign]
    await avatar.start(session, room)  # type: ignore[arg-type]
    assert isinstance(session.output.tail, QueueAudioOutput)
    assert session.output.tail.can_pause  # LiveKit then resumes after a false interruption
    assert avatar.avatar_identity == "agent"
    for name, state, then in (
        ("user", "speaking", "listening"), ("agent", "listening", "listening"), ("user", "listening", "idle"),
        ("agent", "thinking", "thinking"), ("user", "away", "thinking"), ("agent", "speaking", "idle"),
    ):  # fmt: skip
        session.emit(f"{name}_state_changed", SimpleNamespace(new_state=state))
        assert avatar._face.attention.state == then
    said = [text async for text in avatar.without_marks(_text("[lau", "ghs] Well. And <mark ", "name='nod'/>now"))]
    assert said == ["Well. ", "And now"]
    passed = [
        piece async for piece in avatar.read(_text(TimedString("Well", 0.1, 0.4), " ", TimedString("now", 0.6, 0.8)))
    ]
    assert "".join(passed) == "Well now"
    assert len(avatar._face.host._cues[1]) == 3
    await avatar.aclose()


def test_the_session_takes_the_sound_and_the_words() -> None:
    asyncio.run(_session())


def test_what_is_said_when_the_room_has_gone_is_dropped_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    async def left(room: Room) -> list[Any]:
        output = RemoteOutput(room)  # type: ignore[arg-type]
        for number in range(MAX_ACTS + 1):
            output.act("word", number)
        assert output._acting is not None
        await asyncio.wait_for(output._acting, 60.0)
        return output._acts

    class Gone(Room):
        asked = 0

        def isconnected(self) -> bool:
            self.asked += 1
            assert self.asked < 5, "it tries for ever"
            return False

    assert asyncio.run(left(Gone())) == []
    assert [record.getMessage() for record in caplog.records] == [
        "the remote face did not receive words, cues or a pause: room is not connected"
    ]


def test_what_is_sent_before_a_remote_face_has_joined_reaches_it_and_is_dropped_if_it_leaves() -> None:
    async def sent() -> list[str]:
        room, payloads = Room(), []
        room.remote_participants = {}

        async def perform_rpc(*, payload: str, **_: str) -> str:
            payloads.append(payload)
            return ""

        room.local_participant = SimpleNamespace(perform_rpc=perform_rpc)
        output = RemoteOutput(room)  # type: ignore[arg-type]
        output.act("expect", "[nod] Hello.")
        output.pause()
        await asyncio.sleep(0.01)
        assert payloads == []
        video = SimpleNamespace(kind=rtc.TrackKind.KIND_VIDEO)
        face = SimpleNamespace(identity=IDENTITY, track_publications={"v": video})
        room.remote_participants[IDENTITY] = face
        room.emit("track_published", video, face)
        await output._acting
        room.remote_participants.clear()
        output.resume()
        await asyncio.sleep(0.01)
        room.emit("participant_disconnected", face)
        await output._acting
        return payloads

    assert asyncio.run(sent()) == ['[["expect", "[nod] Hello."], ["pause"]]']
