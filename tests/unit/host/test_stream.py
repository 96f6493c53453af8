"""The stage on frames of 40 ms: a TTS that stalls, sends nothing, all at once or another rate; an ear that fails."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import pytest

from fapengine.engine.commands import Command, Express, Pause
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.host.stream import (
    HEARD_LEAD_S,
    LEAD_S,
    PATIENCE_S,
    REST_S,
    STALL_S,
    StreamEvent,
    StreamFrame,
    StreamHost,
)
from fapengine.host.words import TimedWord
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.host.ticking_recognizer import BEHIND_S, TickingRecognizer

DT_S, RATE_HZ = 0.04, 24_000
MOUTH = [fap.column(number) for number in (3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 51, 52, 53, 54)]


def spelled(words: Sequence[tuple[str, float, float]]) -> list[Phone]:
    """A letter is a phone."""
    phones = []
    for word, start_s, end_s in words:
        edges = np.linspace(start_s, end_s, len(word) + 1)
        phones += [Phone(letter, float(a), float(b)) for letter, a, b in zip(word, edges[:-1], edges[1:], strict=True)]
    return phones


def stage(ear: TickingRecognizer | None = None) -> StreamHost:
    return StreamHost(
        english(), rng=np.random.default_rng(1), style=Style.speech_only(), recognizer=ear, pronounce=spelled
    )


def noise(length_s: float, rate_hz: int = RATE_HZ, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(-9_000, 9_000, round(length_s * rate_hz)).astype(np.int16)


def shown(one: StreamHost, length_s: float) -> list[StreamFrame]:
    return [one.next(DT_S) for _ in range(round(length_s / DT_S))]


def sound_of(frames: Sequence[StreamFrame]) -> np.ndarray:
    pieces = [sound.samples for frame in frames for sound in frame.sounds]
    return np.concatenate(pieces) if pieces else np.zeros(0, np.int16)


def mouths(frames: Sequence[StreamFrame]) -> np.ndarray:
    """(T,) greatest movement of jaw and lips, FAPU."""
    return np.array([np.abs(frame.faps[MOUTH]).max() for frame in frames])


def pauses_of(one: StreamHost) -> list[Command]:
    """The face's pauses from now on: each is a stall of its sound."""
    pauses: list[Command] = []

    def note(session: str, command: Command, now_s: float) -> None:
        if isinstance(command, Pause):
            pauses.append(command)

    one.engine.command_listeners.append(note)
    return pauses


def test_all_at_once_is_said_in_its_time() -> None:
    one = stage(TickingRecognizer())
    pauses = pauses_of(one)
    sound = noise(40.0)
    one.push(sound, RATE_HZ)
    one.end()
    frames = shown(one, 41.0)
    assert np.array_equal(sound_of(frames), sound)
    assert sum(bool(frame.sounds) for frame in frames) == 1000
    assert one.events() == [StreamEvent(1, "started", 0.0), StreamEvent(1, "finished", 40.0)]
    counters = one.engine.counters(one.session)
    assert (counters.late, counters.dropped, counters.finished, len(pauses)) == (0, 0, 1, 0)
    assert mouths(frames[:990]).max() > 300


def test_the_lips_are_shut_on_the_sound_of_the_m() -> None:
    one = stage(TickingRecognizer())
    one.push(noise(3.0), RATE_HZ)
    one.end()
    frames = [frame for frame in shown(one, 4.0) if frame.sounds]
    opening = np.array([-int(frame.faps[MOUTH[1]] + frame.faps[MOUTH[2]]) for frame in frames])
    phases = (np.arange(len(frames)) * DT_S) % 0.2
    middle_of_m, middle_of_a = (phases > 0.02) & (phases < 0.07), (phases > 0.12) & (phases < 0.17)
    assert opening[middle_of_m][1:-1].max() < 30
    assert opening[middle_of_a][1:-1].min() > 150


def shown_as_it_comes(one: StreamHost, length_s: float) -> tuple[float, list[StreamFrame]]:
    """Audio comes as it is spoken; returns when it begins, and the frames from there on."""
    frames = []
    for _ in range(round(length_s / DT_S)):
        one.push(noise(DT_S), RATE_HZ)
        frames.append(one.next(DT_S))
    began = [bool(frame.sounds) for frame in frames].index(True)
    return (began + 1) * DT_S, frames[began:]


def test_sound_begins_when_the_lips_are_ready() -> None:
    began_s, _ = shown_as_it_comes(stage(TickingRecognizer()), 1.6)
    assert began_s == pytest.approx(HEARD_LEAD_S + BEHIND_S + 0.1, abs=0.05)  # and a phone, and a frame


@pytest.mark.parametrize(("guess", "behind_s"), [("mm", BEHIND_S), ("aa", BEHIND_S), ("ma", 0.6)])
def test_phones_that_may_change_begin_the_sound_earlier_and_are_replaced(guess: str, behind_s: float) -> None:
    """All are guessed to be the one or the other; or the guess is right, and final only after its sound."""
    one = stage(TickingRecognizer(guess=guess, behind_s=behind_s))
    pauses = pauses_of(one)
    began_s, frames = shown_as_it_comes(one, 3.0)
    assert began_s == pytest.approx(LEAD_S + DT_S, abs=DT_S)
    assert all(frame.sounds for frame in frames)
    assert (pauses, one.engine.counters(one.session).dropped) == ([], 0)
    opening = np.array([-int(frame.faps[MOUTH[1]] + frame.faps[MOUTH[2]]) for frame in frames])[10:]
    phases = (np.arange(10, len(frames)) * DT_S) % 0.2
    assert opening[(phases > 0.02) & (phases < 0.07)].max() < 30
    assert opening[(phases > 0.12) & (phases < 0.17)].min() > 100


def test_nothing_is_sent_and_nothing_happens() -> None:
    one = stage(TickingRecognizer())
    one.end()
    one.interrupt()
    assert not sound_of(shown(one, 1.0)).size
    assert one.events() == []
    one.words([TimedWord("mama", 0.0, 0.4)])
    one.end()
    shown(one, 0.2)
    assert one.events() == [StreamEvent(1, "finished", 0.0)]


def test_a_stall_rests_the_face_then_plays_what_was_held_back() -> None:
    one = stage(TickingRecognizer())
    pauses = pauses_of(one)
    sound = noise(2.0)
    one.push(sound[:RATE_HZ], RATE_HZ)
    frames = shown(one, 3.0)
    assert np.array_equal(sound_of(frames), sound[:RATE_HZ])
    silent = [bool(frame.sounds) for frame in frames]
    assert [key for key, _ in groupby(silent)][-3:] == [False, True, False]  # held back, then its end
    assert (silent.index(False, silent.index(True)) + 1) * DT_S < STALL_S
    assert mouths(frames[-20:]).max() <= 1
    assert one.is_speaking
    one.push(sound[RATE_HZ:], RATE_HZ)
    one.end()
    more = shown(one, 2.0)
    assert np.array_equal(sound_of(more), sound[RATE_HZ:])
    assert [event.kind for event in one.events()] == ["started", "finished"]
    assert (one.engine.counters(one.session).late, one.engine.counters(one.session).dropped) == (0, 0)
    assert len(pauses) == 2


@pytest.mark.parametrize("ends", [True, False])
def test_a_pause_holds_all_sound_and_rests_the_face_until_it_goes_on(ends: bool) -> None:
    one = stage(TickingRecognizer())
    sound = noise(2.0)
    one.pause()  # before anything is said
    one.push(sound, RATE_HZ)
    if ends:
        one.end()
    assert not len(sound_of(shown(one, 3.0)))
    one.resume()
    before = shown(one, 1.0)
    one.pause()
    assert not one.is_ready(DT_S)
    held = shown(one, 4.0)  # longer than a stall, longer than a recognizer has
    assert not len(sound_of(held))
    assert mouths(held[-20:]).max() <= 1
    one.resume()
    more = shown(one, 3.0)
    assert np.array_equal(sound_of(before + more), sound)
    assert mouths(more[:15]).max() > 50
    assert [event.kind for event in one.events()] == ["started"] + ["finished"] * ends


def test_an_interruption_in_a_pause_drops_what_was_held_and_the_next_utterance_waits_for_the_end_of_the_pause() -> None:
    one = stage()
    one.push(noise(2.0), RATE_HZ)
    one.words([TimedWord("mama", 0.1, 1.8)])
    shown(one, 1.0)
    one.pause()
    shown(one, 1.0)
    one.interrupt()
    one.push(noise(0.5, seed=3), RATE_HZ)
    one.end()
    assert not len(sound_of(shown(one, 1.0)))
    one.resume()
    assert np.array_equal(sound_of(shown(one, 1.0)), noise(0.5, seed=3))
    assert [event.kind for event in one.events()] == ["started", "interrupted", "started", "finished"]


def test_another_rate_in_the_middle_keeps_its_own() -> None:
    one = stage(TickingRecognizer())
    first, second = noise(0.33), noise(0.5, 16_000, seed=2)
    one.push(first, RATE_HZ)
    one.push(second, 16_000)
    one.end()
    sounds = [sound for frame in shown(one, 2.0) for sound in frame.sounds]
    assert np.array_equal(np.concatenate([s.samples for s in sounds if s.rate_hz == RATE_HZ]), first)
    assert np.array_equal(np.concatenate([s.samples for s in sounds if s.rate_hz == 16_000]), second)
    assert one.events()[-1] == StreamEvent(1, "finished", pytest.approx(0.83))


def test_an_interruption_rests_the_lips_and_tells_what_was_heard() -> None:
    one = stage(TickingRecognizer())
    one.push(noise(5.0), RATE_HZ)
    frames = shown(one, 1.0)
    assert mouths(frames[-10:]).max() > 200
    one.interrupt(unplayed_s=0.03)
    handed_s = len(sound_of(frames)) / RATE_HZ
    assert one.events()[-1] == StreamEvent(1, "interrupted", pytest.approx(handed_s - 0.03, abs=1e-4))
    after = shown(one, 2.0)
    assert not sound_of(after).size
    assert mouths(after)[round(REST_S / DT_S) :].max() == 0


def test_a_storm_of_interruptions() -> None:
    """Twenty in ten seconds, each in the middle of what is said."""
    ear = TickingRecognizer()
    one = stage(ear)
    kinds = []
    for number in range(20):
        sound = noise(3.0, seed=number)
        one.push(sound, RATE_HZ)
        frames = shown(one, 0.24)
        one.interrupt()
        frames += shown(one, 0.28)
        assert mouths(frames)[-1] == 0
        played = sound_of(frames)
        assert np.array_equal(played, sound[: len(played)])
        kinds += [event.kind for event in one.events()]
    assert kinds == ["started", "interrupted"] * 20
    one.push(sound := noise(1.0), RATE_HZ)
    one.end()
    assert np.array_equal(sound_of(shown(one, 2.0)), sound)
    assert (one.engine.counters(one.session).late, one.engine.counters(one.session).dropped) == (0, 0)


def test_a_dead_ear_does_not_stop_the_sound() -> None:
    ear = TickingRecognizer()
    one = stage(ear)
    one.push(sound := noise(2.0), RATE_HZ)
    frames = shown(one, 0.8)
    ear.is_dead = True
    one.end()
    assert np.array_equal(sound_of(frames + shown(one, 2.0)), sound)


def test_a_silent_ear_delays_the_sound_once() -> None:
    ear = TickingRecognizer(is_mute=True)
    one = stage(ear)
    one.push(sound := noise(2.0), RATE_HZ)
    one.end()
    frames = shown(one, PATIENCE_S + 2.2)
    assert np.array_equal(sound_of(frames), sound)
    assert not any(frame.sounds for frame in frames[: round(PATIENCE_S / DT_S) - 1])
    ear.is_mute = False
    one.push(sound, RATE_HZ)
    one.end()
    assert mouths(shown(one, 2.5)).max() > 200


def test_words_move_the_mouth_and_the_ear_moves_the_words() -> None:
    """The word says b, which the ear hears as m, 40 ms later."""
    late = [TimedWord("bababababa", 0.04, 1.04)]
    openings = {}
    for name, ear, words in (("words", None, late), ("both", TickingRecognizer(), late)):
        one = stage(ear)
        one.words(words)
        one.push(noise(1.2), RATE_HZ)
        one.end()
        frames = [frame for frame in shown(one, 2.0) if frame.sounds]
        openings[name] = np.array([-int(frame.faps[MOUTH[1]] + frame.faps[MOUTH[2]]) for frame in frames])
    at = round(0.44 / DT_S)  # where the words alone begin their b: the ear's is half over
    assert openings["both"][at] == 0
    assert openings["words"][at + 1] == 0
    assert openings["both"][at - 1] < openings["words"][at - 1]


def test_words_without_ends_and_words_too_late() -> None:
    one = stage()
    one.push(noise(3.0), RATE_HZ)
    one.words([TimedWord("ma", 0.2), TimedWord("mama", 0.4)])
    frames = shown(one, 2.5)
    one.words([TimedWord("mo", 0.1, 0.3), TimedWord("mo", 2.6, 2.8)])
    one.end()
    frames += shown(one, 1.0)
    assert mouths(frames)[round(2.7 / DT_S)] > 100
    assert one.engine.counters(one.session).dropped == 0


def test_a_cue_comes_with_its_word() -> None:
    one = stage()
    one.push(noise(3.0), RATE_HZ)
    one.cue(Express(Expression.JOY, 1.0, attack_s=0.1), 1.0)
    one.end()
    frames = shown(one, 2.0)
    smile = np.array([frame.faps[fap.column(12)] for frame in frames])
    assert not smile[:25].any()
    assert smile[29] > 50


@pytest.mark.parametrize("rate_hz", [0, -1, 3_999, 1_000_000])
def test_no_such_rate(rate_hz: int) -> None:
    with pytest.raises(UsageError, match="rate_hz: got"):
        stage().push(noise(0.1), rate_hz)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 2.0, float("nan")])
def test_no_such_frame(dt_s: float) -> None:
    with pytest.raises(UsageError, match="dt_s: got"):
        stage().next(dt_s)
