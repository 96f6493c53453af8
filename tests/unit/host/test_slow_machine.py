"""A recognizer that needs more time than it has: the face goes on, a bounded time after the sound."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine._child import Head, Message
from fapengine.host.hearing import DELAY_S
from fapengine.host.stream import StreamFrame, StreamHost
from fapengine.recognition.process import LEAD_S, REDUCED_S, RecognizerProcess, answers
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.small_recognizer import JointRecognizer, SmallRecognizer
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.host.test_hearing import Clock, Stage, piecewise
from tests.unit.recognition.speech import BABY, FAPU_MM, POPPIES, opening_mm, spoken

FRAME_HZ = 200 / 3


class Reducible(SmallRecognizer):
    """The small network, as if it had a costly part."""

    def reduce_work(self, is_wanted: bool) -> bool:
        return is_wanted


@dataclass(eq=False)
class SlowChild:
    """A child process on the test's clock: it needs ``costs(now_s)`` seconds per second of audio, or reduced."""

    clock: Clock
    costs: Callable[[float], tuple[float, float]]
    _inbox: deque[Message] = field(default_factory=deque)
    _told: list[tuple[float, Head]] = field(default_factory=list)
    _free_s: float = 0.0

    def __post_init__(self) -> None:
        self._answers = answers(self._messages(), Reducible())
        self._told.append((self.clock.now_s, next(self._answers)))

    def _messages(self) -> Iterator[Message]:
        while True:
            yield self._inbox.popleft()

    def put(self, head: Head, data: bytes) -> None:
        begins_s = max(self._free_s, self.clock.now_s)
        self._free_s = begins_s + self.costs(begins_s)[head["is_reduced"]] * len(data) / 2 / RATE_HZ
        self._inbox.append((head, data))
        self._told.append((self._free_s, next(self._answers)))

    def flush(self) -> bool:
        return True

    def poll(self) -> list[Message]:
        due = [(head, b"") for at_s, head in self._told if at_s <= self.clock.now_s]
        del self._told[: len(due)]
        return due

    def close(self) -> None:
        pass


@dataclass(eq=False)
class SlowStage(Stage):
    costs: Callable[[float], tuple[float, float]] = lambda now_s: (0.2, 0.1)
    leads_s: list[float] = field(default_factory=list)
    """Time from what the face shows to what was processed, before each frame."""

    def open(self, model: Path | None) -> Any:
        self.slow = RecognizerProcess(SlowChild(self.clock, self.costs))  # type: ignore[arg-type]
        return self.slow

    def hears(self, samples: NDArray[np.int16]) -> NDArray[np.float64]:
        """Hear a microphone; returns the opening of the lips, mm, from its first sample on, moved by the delay."""
        give = piecewise(samples, lambda piece: self.hearing.listen("anna", piece, RATE_HZ))

        def gives(step: int) -> None:
            give(step)
            self.leads_s.append(self.slow._processed_s - (self.clock.now_s - 100.0 - DELAY_S))

        return self.run(len(samples) / RATE_HZ + DELAY_S, gives)[round(DELAY_S * FRAME_HZ) :]


def talk(duration_s: float) -> NDArray[np.int16]:
    return np.resize(
        np.concatenate([spoken("slt", BABY).samples, spoken("slt", POPPIES).samples]), int(duration_s * RATE_HZ)
    )


def moved_mm(lips_mm: NDArray[np.float64]) -> float:
    """Least range of the opening within a second, after the first three."""
    seconds = np.split(lips_mm, np.arange(0, len(lips_mm), round(FRAME_HZ)))[3:-1]
    return min(float(np.ptp(one)) for one in seconds)


@pytest.mark.parametrize(("costs", "skips"), [((3.0, 0.4), False), ((9.0, 1.2), True)])
def test_lips_keep_moving_with_the_sound(
    costs: tuple[float, float], skips: bool, caplog: pytest.LogCaptureFixture
) -> None:
    stage = SlowStage(costs=lambda now_s: costs)
    lips_mm = stage.hears(talk(8.0))
    counts = stage.hearing.counts
    assert moved_mm(lips_mm) > 2  # phones that last longer across what is skipped are held
    assert min(stage.leads_s[150:-20]) > 0
    assert counts.reduced_s > 0
    assert (counts.skipped_s > 1.0) == skips
    assert counts.heard_s + counts.skipped_s == pytest.approx(8.0, abs=0.3)
    assert sum("too slow" in record.message for record in caplog.records) == 1


def test_a_recognizer_with_reduced_work_follows_as_well_as_before() -> None:
    speech = spoken("slt", BABY)
    fast, slow = SlowStage(), SlowStage(costs=lambda now_s: (3.0, 0.4))
    quiet = np.zeros(RATE_HZ, np.int16)  # in which it finds out
    likeness = []
    for stage in (fast, slow):
        lips_mm = stage.hears(np.concatenate([quiet, speech.samples]))[round(FRAME_HZ) :]
        reference = opening_mm(speech.phones, len(speech.samples) / RATE_HZ, FRAME_HZ)[: len(lips_mm)]
        likeness.append(float(np.corrcoef(lips_mm[: len(reference)], reference)[0, 1]))
    assert likeness[1] > likeness[0] - 0.03
    assert fast.hearing.counts.reduced_s == fast.hearing.counts.skipped_s == 0


def test_the_whole_recognizer_comes_back() -> None:
    stage = SlowStage(costs=lambda now_s: (3.0, 0.4) if now_s < 102 else (0.5, 0.4))
    stage.hears(talk(REDUCED_S + 5))
    assert stage.hearing.counts.reduced_s == pytest.approx(REDUCED_S, abs=1.0)
    assert min(stage.leads_s[-200:-20]) > LEAD_S


def test_a_network_that_stalls_is_no_slow_recognizer() -> None:
    stage = SlowStage()
    sound = talk(4.0)
    held: list[NDArray[np.int16]] = []

    def take(piece: NDArray[np.int16]) -> None:
        held.append(piece)
        if len(held) == 12 or not 100 < stage.clock.now_s * 50 % 200 < 112:
            stage.hearing.listen("anna", np.concatenate(held), RATE_HZ)
            held.clear()

    stage.run(4.3, piecewise(sound, take))
    counts = stage.hearing.counts
    assert counts.reduced_s == counts.skipped_s == 0
    assert counts.heard_s == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize(("costs", "is_live"), [((3.0, 0.4), True), ((1.5, 0.4), False)])
def test_an_agents_audio_does_not_wait_for_a_slow_recognizer(costs: tuple[float, float], is_live: bool) -> None:
    clock, sound = Clock(), talk(4.0)
    recognizer = RecognizerProcess(SlowChild(clock, lambda now_s: costs))  # type: ignore[arg-type]
    style = Style.speech_only()
    face = StreamHost(english(), rng=np.random.default_rng(1), style=style, recognizer=recognizer)
    arriving = np.array_split(sound, 100 if is_live else 1)
    frames: list[StreamFrame] = []
    while face.is_speaking or not frames:
        clock.now_s += 0.04
        if arriving:
            face.push(arriving.pop(0), RATE_HZ)
        else:
            face.end()
        frames.append(face.next(0.04))
    started = [bool(frame.sounds) for frame in frames]
    spoken_frames = frames[started.index(True) : len(started) - started[::-1].index(True)]
    lips_mm = np.array([-(frame.faps[3] + frame.faps[4]) * FAPU_MM for frame in spoken_frames])
    assert started.index(True) < 20
    assert len(spoken_frames) <= 100 + 12  # half a second of waiting
    assert min(float(np.ptp(second)) for second in np.split(lips_mm, range(25, len(lips_mm), 25))[:-1]) > 3


def phones_of(recognizer: SmallRecognizer, sound: NDArray[np.int16], is_reduced: Callable[[int], bool]) -> list[Phone]:
    found = []
    for number, piece in enumerate(np.split(sound, range(800, len(sound), 800))):
        recognizer.reduce_work(is_reduced(number))
        found += recognizer.push(piece)
    return found + recognizer.end()


def test_a_reduced_joint_recognizer_is_the_small_one_and_joins_again() -> None:
    sound = spoken("rms", BABY).samples
    small, joint = SmallRecognizer(), JointRecognizer()
    assert phones_of(joint, sound, lambda number: True) == phones_of(small, sound, lambda number: False)
    joint.reset()
    twice = np.tile(sound, 2)
    whole = phones_of(joint, twice, lambda number: False)
    joint.reset()
    parts = phones_of(joint, twice, lambda number: 5 <= number < 20)
    second_s = len(sound) / RATE_HZ
    late = [phone for phone in whole if phone.start_s > second_s and not phone.is_silence]
    met = [any(p.label == q.label and abs(p.start_s - q.start_s) < 0.03 for q in parts) for p in late]
    assert np.mean(met) > 0.85
    alone = phones_of(small, twice, lambda number: False)
    assert [p for p in parts if p.start_s > second_s] != [p for p in alone if p.start_s > second_s]
