"""Audio that never waits for images, and parts that are started again; painters and recognizers are stand-ins."""

import asyncio
import logging
import sys
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine import _child
from fapengine.agents.face import AHEAD_S, AgentFace
from fapengine.agents.pictures import WARN_AFTER
from fapengine.errors import ResourceError
from fapengine.host.stream import StreamFrame
from fapengine.mpeg4 import fap
from fapengine.recognition.process import RecognizerProcess
from fapengine.recognition.protocol import RecognizedPhones
from fapengine.server.film.painter import Painter
from tests.leaping import run_leaping
from tests.unit.host.test_stream import RATE_HZ, noise, stage
from tests.unit.host.ticking_recognizer import TickingRecognizer

LONG_S = 4.0
ECHO = """
import sys
from fapengine._child import messages, packed
for _, data in messages(sys.stdin.buffer):
    sys.stdout.buffer.write(packed({}, data))
    sys.stdout.buffer.flush()
"""
"""A painter's program whose image is what it was sent."""


class StandInPainter:
    """Takes a time for each image, which is its number; ends before image ``ends``."""

    def __init__(self, takes_s: float = 0.0, ends: int = 1_000_000) -> None:
        self.takes_s, self.ends = takes_s, ends
        self.drawn: list[NDArray[np.int32]] = []
        self.at_once = self.most_at_once = 0

    async def picture(self, faps: NDArray[np.int32]) -> bytes:
        if len(self.drawn) >= self.ends:
            raise ResourceError("painter: its process has ended")
        self.drawn.append(faps)
        self.at_once += 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        await asyncio.sleep(self.takes_s)
        self.at_once -= 1
        return bytes([len(self.drawn) % 256])


def face_with(painter: StandInPainter, ear: TickingRecognizer | None = None) -> AgentFace:
    face = AgentFace(stage(ear), 25.0)
    face.painter, face.recognizer = painter, ear  # type: ignore[assignment]
    return face


async def shown(face: AgentFace, length_s: float) -> tuple[list[tuple[float, StreamFrame]], int]:
    """Forward frames as the plug-ins do; returns them with their times, and the number of images that came."""
    time_s = asyncio.get_running_loop().time
    frames, images, until_s = [], 0, time_s() + length_s
    while time_s() < until_s:
        await asyncio.sleep(face.wait_s(time_s()))
        frame, _ = face.frame(time_s())
        face.show(frame)
        images += await face.drawn(face.image_wait_s(time_s())) is not None
        frames.append((time_s(), frame))
    face.pictures.close()
    await asyncio.sleep(0)
    return frames, images


@pytest.mark.parametrize("takes_s", [0.005, 0.03, 0.06, 0.1, 0.2, 1e6])
def test_audio_goes_by_the_clock_however_long_an_image_takes(takes_s: float) -> None:
    painter, given = StandInPainter(takes_s), noise(LONG_S)
    face = face_with(painter)
    face.sound(given, RATE_HZ)
    face.end()
    frames, images = run_leaping(shown(face, LONG_S + 0.5))
    sounding = [(at_s, sound.samples) for at_s, frame in frames for sound in frame.sounds]
    assert np.array_equal(np.concatenate([samples for _, samples in sounding]), given)
    handed_s = 0.0
    for at_s, samples in sounding:  # never later than it is heard, never earlier than AHEAD_S
        assert handed_s - AHEAD_S - 0.041 <= at_s - sounding[0][0] <= handed_s + 1e-6
        handed_s += len(samples) / RATE_HZ
    assert painter.most_at_once == 1
    wanted = min(len(frames), int(LONG_S / takes_s))
    assert images >= 0.9 * wanted
    assert face.pictures.counts.left_out <= len(frames) - images


def test_the_next_image_is_of_the_newest_faps() -> None:
    async def work() -> None:
        painter = StandInPainter(0.1)
        face = face_with(painter)
        poses = np.arange(68 * 4, dtype=np.int32).reshape(4, 68) * 1000
        face.pictures.counts.drawn = 1
        for pose in poses:
            face.show(StreamFrame(pose, ()))
            await asyncio.sleep(0)
        picture = await face.drawn(1.0)
        assert [faps[0] for faps in painter.drawn] == [poses[0][0], poses[3][0]]
        assert picture is not None
        assert picture.faps[0] == poses[3][0]
        assert face.pictures.counts.left_out == 2
        assert await face.drawn(1.0) is None

    run_leaping(work())


def test_one_warning_says_that_more_than_half_were_skipped(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "fapengine.agents")
    for takes_s, warnings in ((0.07, 0), (0.1, 1)):
        caplog.clear()
        face = face_with(StandInPainter(takes_s))
        face.sound(noise(6.0), RATE_HZ)
        run_leaping(shown(face, 6.0))
        assert face.pictures.counts.drawn + face.pictures.counts.left_out > WARN_AFTER + 10
        assert len(caplog.records) == warnings


def test_without_a_painter_that_draws_the_audio_continues(caplog: pytest.LogCaptureFixture) -> None:
    given, face = noise(2.0), face_with(StandInPainter(0.01, ends=10))
    face.sound(given, RATE_HZ)
    face.end()
    frames, images = run_leaping(shown(face, 2.5))
    assert images == 10
    assert np.array_equal(np.concatenate([sound.samples for _, frame in frames for sound in frame.sounds]), given)
    assert str(face.pictures.failure) == "painter: its process has ended"
    assert face.pictures.counts.faults == len(caplog.records) == 1


def test_a_listening_face_that_hardly_moves_is_drawn_every_second_time() -> None:
    async def work() -> None:
        face = face_with(StandInPainter())
        rest = np.zeros(68, np.int32)
        breath, blink, glance = rest.copy(), rest.copy(), rest.copy()
        breath[fap.column(48)], blink[fap.column(19)], glance[fap.column(23)] = 500, 200, 9000

        async def pictures(*poses: NDArray[np.int32]) -> list[int]:
            found = []
            for pose in poses:
                face.show(StreamFrame(pose, ()))
                picture = await face.drawn(1.0)
                assert picture is not None
                found.append(picture.pixels[0])
            return found

        assert await pictures(rest, breath, rest, breath) == [1, 1, 2, 2]
        assert await pictures(rest, blink, rest, glance) == [3, 4, 5, 6]
        face.sound(noise(0.2).tobytes(), RATE_HZ)
        assert await pictures(rest, rest) == [7, 8]

    run_leaping(work())


def test_a_painter_whose_process_ends_draws_the_same_image_in_a_new_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_child, "BACK_OFF_S", (0.0, 0.0))
    monkeypatch.setattr("fapengine.server.film.painter.command", lambda *_, **__: [sys.executable, "-c", ECHO])
    painter = Painter()
    try:
        for ends in (1, 2):
            painter._child.kill()
            assert painter.draw(np.full(68, ends, np.int32)) == np.full(68, ends, np.int32).tobytes()
            assert painter.counts.restarts == ends
    finally:
        painter.close()
    with pytest.raises(ResourceError, match="its process has ended"):
        painter.draw(np.zeros(68, np.int32))
    assert painter.counts.restarts == 2


def test_a_painter_that_never_draws_is_started_three_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_child, "BACK_OFF_S", (0.0, 0.0))
    monkeypatch.setattr("fapengine.server.film.painter.command", lambda *_, **__: [sys.executable, "-c", "pass"])
    painter = Painter()
    with pytest.raises(ResourceError, match="its process has ended"):
        painter.draw(np.zeros(68, np.int32))
    assert painter.counts.restarts == 2
    painter.close()


def test_a_painter_that_draws_once_and_ends_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_child, "BACK_OFF_S", (0.0, 0.0))
    once = (
        "import sys; from fapengine._child import packed, read_message; read_message(sys.stdin.buffer);"
        "sys.stdout.buffer.write(packed({}, b'image'))"
    )
    monkeypatch.setattr("fapengine.server.film.painter.command", lambda *_, **__: [sys.executable, "-c", once])
    painter = Painter()
    for _ in range(3):
        assert painter.draw(np.zeros(68, np.int32)) == b"image"
    with pytest.raises(ResourceError, match="its process has ended"):
        painter.draw(np.zeros(68, np.int32))
    assert painter.counts.restarts == 2
    painter.close()


def test_a_recognizer_that_ends_is_started_again_and_hears_the_next_utterance(monkeypatch: pytest.MonkeyPatch) -> None:
    ears = [TickingRecognizer() for _ in range(3)]
    ears[1].is_dead = True
    opened = iter(ears[1:])
    monkeypatch.setattr(RecognizerProcess, "open", lambda: next(opened))
    face, given = face_with(StandInPainter(), ears[0]), noise(2.0)

    async def work() -> None:
        face.sound(given, RATE_HZ)
        before, _ = await shown(face, 1.0)
        ears[0].is_dead = True
        face.end()
        after, _ = await shown(face, 2.0)
        assert np.array_equal(
            np.concatenate([sound.samples for _, frame in before + after for sound in frame.sounds]), given
        )
        assert face.recognizer is ears[2]
        face.sound(given, RATE_HZ)
        face.end()
        spoken, _ = await shown(face, 3.0)
        assert sum(sound.duration_s for _, frame in spoken for sound in frame.sounds) == pytest.approx(2.0)
        assert max(abs(frame.faps).max() for _, frame in spoken) > 50  # the mouth moves
        assert ears[2].heard_s == pytest.approx(2.0)

    run_leaping(work())


def test_a_recognizer_that_ends_three_times_is_given_up(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ears = [TickingRecognizer(is_dead=True) for _ in range(3)]
    opened = iter(ears[1:])
    monkeypatch.setattr(RecognizerProcess, "open", lambda: next(opened))
    face, given = face_with(StandInPainter(), ears[0]), noise(2.0)
    face.sound(given, RATE_HZ)
    face.end()
    frames, _ = run_leaping(shown(face, 3.0))
    assert np.array_equal(np.concatenate([sound.samples for _, frame in frames for sound in frame.sounds]), given)
    assert face.recognizer is None
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING", "ERROR"]


def test_a_recognizer_that_ends_in_each_utterance_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it was ready before; one that has recognized an utterance to its end may end three times more."""
    ends = iter([True, True, False, True, True, True])
    opened: list[TickingRecognizer] = []

    class Ending(TickingRecognizer):
        def end(self) -> None:
            super().end()
            self.is_dead = next(ends)

    def opens() -> TickingRecognizer:
        opened.append(Ending())
        return opened[-1]

    monkeypatch.setattr(RecognizerProcess, "open", opens)
    face = face_with(StandInPainter(), Ending())

    async def work() -> None:
        for _ in range(7):
            face.sound(noise(0.5), RATE_HZ)
            face.end()
            await shown(face, 5.0)

    run_leaping(work())
    assert (len(opened), next(ends, None)) == (4, None)
    assert face.recognizer is None


def test_a_recognizer_that_ends_each_time_it_is_ready_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[TickingRecognizer] = []

    class Dying(TickingRecognizer):
        polls = 0

        def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
            self.polls += 1
            self.is_dead = self.polls > 5
            return super().poll(shown_s)

    def opens() -> TickingRecognizer:
        opened.append(Dying())
        return opened[-1]

    monkeypatch.setattr(RecognizerProcess, "open", opens)
    face = face_with(StandInPainter(), Dying())
    run_leaping(shown(face, 10.0))
    assert len(opened) == 2
    assert face.recognizer is None
