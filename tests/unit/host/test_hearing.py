"""Sound to phones to a face, on a clock of the test: how late, what a microphone's speech becomes, and the limits."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.engine.commands import Append, Begin, Cancel, Command, End
from fapengine.engine.engine import Engine
from fapengine.errors import ResourceError
from fapengine.host import hearing as module
from fapengine.host.hearing import DELAY_S, IDLE_S, MAX_WAITING_S, Hearing
from fapengine.host.hub import Hub
from fapengine.recognition.protocol import RATE_HZ, RecognizedPhones, Recognizer
from fapengine.recognition.small_recognizer import LOOK_AHEAD_S, SmallRecognizer
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.recognition.speech import BABY, FAPU_MM, closures, no_speech, opening_mm, spoken

WORK_S = 0.03
"""What the ear's process and the pipes take."""
PIECE = RATE_HZ // 50


@dataclass(eq=False)
class Clock:
    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


@dataclass(eq=False)
class EarHere:
    """An ear that hears at once and tells after :data:`WORK_S`."""

    clock: Clock
    is_ready: bool = True
    look_ahead_s: float = LOOK_AHEAD_S
    waiting_s: float = 0.0
    ear: Recognizer = field(default_factory=SmallRecognizer)
    told: list[tuple[float, RecognizedPhones]] = field(default_factory=list)
    stream: int = 0
    heard_s: float = 0.0
    is_closed: bool = False

    def begin(self) -> int:
        self.ear.reset()
        self.told.clear()
        self.stream, self.heard_s, self.waiting_s = self.stream + 1, 0.0, 0.0
        return self.stream

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        self.heard_s += len(samples) / rate_hz
        if not self.is_ready:
            self.waiting_s += len(samples) / rate_hz
        phones = tuple(self.ear.push(samples))
        self._tell(RecognizedPhones(self.stream, self.heard_s, phones, partial=tuple(self.ear.partial)))

    def end(self) -> None:
        self._tell(RecognizedPhones(self.stream, self.heard_s, tuple(self.ear.end()), is_over=True))

    def _tell(self, heard: RecognizedPhones) -> None:
        self.told.append((self.clock.now_s + WORK_S, heard))

    def poll(self, shown_s: float = -inf) -> list[RecognizedPhones]:
        due = [heard for at_s, heard in self.told if at_s <= self.clock.now_s and self.is_ready]
        self.told = [entry for entry in self.told if entry[1] not in due]
        return due

    def close(self) -> None:
        self.is_closed = True


@dataclass(eq=False)
class Stage:
    """A hub with ears, on the test's clock."""

    recognizer: Callable[[], Recognizer] = SmallRecognizer
    clock: Clock = field(default_factory=Clock)
    ears: list[EarHere] = field(default_factory=list)
    told: list[tuple[float, Command]] = field(default_factory=list)
    faps: list[NDArray[np.int32]] = field(default_factory=list)

    def __post_init__(self) -> None:
        engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
        self.hub = Hub(engine, clock=self.clock)
        self.hub.hold("anna")
        self.hub.listeners.on_command("anna", lambda _, command, at_s: self.told.append((at_s, command)))
        self.hearing = Hearing(self.hub, max_recognizers=1, opens=self.open)

    def open(self, model: Path | None) -> EarHere:
        self.ears.append(EarHere(self.clock, ear=self.recognizer()))
        return self.ears[-1]

    def run(self, duration_s: float, gives: Callable[[int], None] = lambda step: None) -> NDArray[np.float64]:
        """Let time pass, 200 steps a second with a frame in every third; returns the opening of the lips, mm."""
        first = len(self.faps)
        for step in range(round(duration_s * 200)):
            self.clock.now_s += 1 / 200
            if step % 4 == 3:
                gives(step // 4)
            if step % 3 == 0:
                self.hearing.tick(self.clock.now_s)
                self.faps.append(self.hub.tick(self.clock.now_s).faps[0])
        values = np.array(self.faps[first:])
        return -(values[:, 3] + values[:, 4]) * FAPU_MM

    def commands(self, kind: type[Command]) -> list[Command]:
        return [command for _, command in self.told if isinstance(command, kind)]


def piecewise(samples: NDArray[np.int16], take: Callable[[NDArray[np.int16]], object]) -> Callable[[int], None]:
    """Give sound as it is spoken, 20 ms at a time."""

    def gives(step: int) -> None:
        piece = samples[step * PIECE : (step + 1) * PIECE]
        if len(piece):
            take(piece)

    return gives


@pytest.mark.parametrize("delay_s", [DELAY_S, 0.1])
def test_the_delay_is_what_lips_need(monkeypatch: pytest.MonkeyPatch, delay_s: float) -> None:
    speech = spoken("slt", BABY)
    reference = opening_mm(speech.phones, len(speech.samples) / RATE_HZ, 200 / 3)

    def likeness(delay_s: float) -> float:
        monkeypatch.setattr(module, "DELAY_S", delay_s)
        stage = Stage()
        take = piecewise(
            speech.samples, lambda piece: stage.hearing.hear("anna", 1, piece, RATE_HZ, is_placed=False)
        )  # fmt: skip
        heard = stage.run(len(speech.samples) / RATE_HZ + delay_s + 0.1, take)[round(delay_s * 200 / 3) :]
        assert stage.told[0][1] == Begin(1, "at", pytest.approx(100.0 + 1 / 50 + delay_s, abs=0.02))
        return float(np.corrcoef(heard[: len(reference)], reference)[0, 1])

    known = likeness(1.5)
    if delay_s == DELAY_S:
        assert likeness(delay_s) > known - 0.03  # as good as if all had been known
    else:
        assert likeness(delay_s) < known - 0.1  # so the other can fail


def test_speech_in_a_microphones_sound_is_utterances() -> None:
    stage = Stage()
    speech, pause = spoken("rms", BABY), np.zeros(RATE_HZ * 3 // 2, np.int16)
    sound = np.concatenate([pause, speech.samples, pause, speech.samples, pause])
    heard = stage.run(
        len(sound) / RATE_HZ + 1.5, piecewise(sound, lambda piece: stage.hearing.listen("anna", piece, RATE_HZ))
    )
    begins = [command for command in stage.commands(Begin) if isinstance(command, Begin)]
    assert len(begins) == len(stage.commands(End)) == 2
    second_s = (2 * len(pause) + len(speech.samples)) / RATE_HZ
    assert begins[1].at_s - begins[0].at_s == pytest.approx(second_s - 1.5, abs=0.15)
    assert stage.hub.engine.state("anna") == "idle"
    rate_hz = 200 / 3
    for start_s in (1.5, second_s):
        at_s = np.array([start_s + DELAY_S + middle_s for middle_s in closures(speech.phones)])
        shut = [heard[round((time_s - 0.08) * rate_hz) : round((time_s + 0.08) * rate_hz)].min() for time_s in at_s]
        assert np.mean(np.array(shut) < 0.5) > 0.7
    assert np.abs(heard[: round(1.5 * rate_hz)]).max() < 0.5  # a microphone that is open says nothing


@pytest.mark.parametrize("name", no_speech())
def test_no_speech_opens_the_lips_of_a_microphones_face(name: str) -> None:
    stage = Stage(recognizer=SmallRecognizer)
    sound = no_speech(2.0)[name]
    gives = piecewise(sound, lambda piece: stage.hearing.listen("anna", piece, RATE_HZ))
    assert np.abs(stage.run(2.5, gives)).max() < 0.5


def test_a_cancel_makes_a_microphone_deaf_to_what_it_has_heard() -> None:
    stage = Stage()
    sound = np.concatenate([spoken("rms", BABY).samples, np.zeros(RATE_HZ, np.int16)])
    gives = piecewise(sound, lambda piece: stage.hearing.listen("anna", piece, RATE_HZ))
    stage.run(1.2, gives)
    stage.hub.apply("anna", Cancel())
    begun = len(stage.commands(Begin))
    assert begun == 1
    closed = stage.run(1.0)[round(0.4 * 200 / 3) :]  # no more sound comes
    assert np.abs(closed).max() < 0.5
    assert len(stage.commands(Begin)) == begun


def test_a_cancel_empties_the_ear_and_the_next_utterance_is_heard() -> None:
    stage = Stage()
    samples = spoken("rms", BABY).samples
    stage.hearing.hear("anna", 1, samples, RATE_HZ, is_placed=False)
    stage.run(0.02)
    stage.hub.apply("anna", Cancel(1))
    assert np.abs(stage.run(1.0)[-20:]).max() < 0.5
    assert not stage.commands(Append) or stage.hub.engine.state("anna") == "idle"
    stage.hearing.hear("anna", 2, samples, RATE_HZ, is_placed=False, is_last=True)
    assert stage.run(2.0).max() > 5
    stage.run(1.5)
    (end,) = stage.commands(End)
    assert end == End(2, pytest.approx(25, abs=15), pytest.approx(len(samples) / RATE_HZ))


def test_a_stall_of_the_sound_moves_what_follows_and_nothing_else() -> None:
    stage = Stage()
    sound = spoken("rms", BABY).samples
    listen = lambda piece: stage.hearing.listen("anna", piece, RATE_HZ)  # noqa: E731
    stage.run(len(sound) / RATE_HZ, piecewise(sound, listen))
    stage.run(2.0)
    again_s = stage.clock.now_s
    stage.run(len(sound) / RATE_HZ + 1.5, piecewise(sound, listen))
    begins = [command for command in stage.commands(Begin) if isinstance(command, Begin)]
    assert len(begins) >= 2
    assert begins[-1].at_s == pytest.approx(again_s + DELAY_S, abs=0.4)
    assert len(stage.commands(End)) == len(begins)


def test_a_sound_waits_for_an_ear_that_starts() -> None:
    stage = Stage()
    stage.hearing.hear("anna", 1, np.zeros(PIECE, np.int16), RATE_HZ, is_placed=False)
    stage.ears[0].is_ready = False
    stage.run(1.0)
    assert stage.commands(Begin) == []
    stage.ears[0].is_ready = True
    ready_s = stage.clock.now_s
    stage.run(0.1)
    assert stage.commands(Begin) == [Begin(1, "at", pytest.approx(ready_s + DELAY_S, abs=0.03))]


def test_what_is_cancelled_before_the_ear_is_there_is_never_said() -> None:
    stage = Stage()
    stage.hearing.hear("anna", 1, np.zeros(PIECE, np.int16), RATE_HZ, is_placed=False)
    stage.ears[0].is_ready = False
    stage.run(0.1)
    stage.hub.apply("anna", Cancel(1))
    stage.ears[0].is_ready = True
    stage.run(0.1)
    assert stage.commands(Begin) == []


def test_ears_are_bounded_and_given_back() -> None:
    stage = Stage()
    silence = np.zeros(RATE_HZ, np.int16)
    stage.hub.open("bert")
    assert stage.hearing.listen("anna", silence, RATE_HZ)
    with pytest.raises(ResourceError, match="recognizers: got audio of another session, expected 1 at most"):
        stage.hearing.listen("bert", silence, RATE_HZ)
    assert stage.hearing.counts.refused_s == 1.0
    stage.ears[0].waiting_s = MAX_WAITING_S
    assert not stage.hearing.listen("anna", silence, RATE_HZ)
    assert stage.hearing.counts.refused_s == 2.0
    stage.clock.now_s += IDLE_S + 1
    stage.hearing.tick(stage.clock.now_s)
    assert stage.hearing.listen("bert", silence, RATE_HZ)
    assert len(stage.ears) == stage.hearing.counts.recognizers == 1  # the same one
    stage.hearing.close()
    assert stage.ears[0].is_closed
    assert stage.hearing.counts.recognizers == 0


def test_a_session_that_is_closed_gives_its_ear_back() -> None:
    stage = Stage()
    stage.hub.open("bert")
    stage.hearing.hear("bert", 1, np.zeros(PIECE, np.int16), RATE_HZ)
    stage.hub.close("bert")
    stage.run(0.1)
    assert stage.ears[0].is_closed
    assert stage.hearing.counts.recognizers == 0


@pytest.mark.parametrize("final", [(), (Phone("m", 0.0, 0.1),)])
@pytest.mark.parametrize("is_over", [True, False])
def test_phones_that_the_recognizer_takes_back_are_not_said(final: tuple[Phone, ...], is_over: bool) -> None:
    stage = Stage()
    stage.hearing.hear("anna", 1, np.zeros(PIECE, np.int16), RATE_HZ, is_placed=False)
    stage.run(2 * WORK_S)
    ear = stage.ears[0]
    partial = (Phone("m", 0.0, 0.1), Phone("ɑ", 0.1, 1.2))
    ear.told.append((stage.clock.now_s, RecognizedPhones(ear.stream, 0.02, (), partial=partial)))
    assert stage.run(DELAY_S + 0.25).max() > 5
    ear.told.append((stage.clock.now_s, RecognizedPhones(ear.stream, 0.04, final, is_over)))
    assert np.abs(stage.run(0.5)[round(0.3 * 200 / 3) :]).max() < 0.5
    assert len(stage.commands(End)) == is_over
    stage.run(1.0)
    assert stage.hub.engine.counters("anna").finished == is_over


def test_a_shout_reaches_the_face() -> None:
    def jaw(loudness_db: float) -> float:
        stage = Stage()
        stage.hub.apply("anna", Begin(1, "now"))
        phones = tuple(
            Phone(label, n / 5, (n + 1) / 5, confidence=0.5, loudness_db=loudness_db) for n, label in enumerate("mama")
        )
        stage.hearing.hear("anna", 1, np.zeros(PIECE, np.int16), RATE_HZ)
        stage.ears[0].told.append((stage.clock.now_s, RecognizedPhones(stage.ears[0].stream, 0.02, phones)))
        stage.run(1.0)
        return float(np.array(stage.faps)[:, 2].max())

    assert jaw(8.0) > 1.4 * jaw(0.0)
