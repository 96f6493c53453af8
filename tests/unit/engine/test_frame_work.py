"""The work of one frame has a limit, whatever waits in a session: calls and keys are counted, not timed."""

from cProfile import Profile
from typing import Any

import numpy as np
import pytest

from bench.growth import CROWDS, FRAME_HZ, crowded, utterance
from fapengine.engine.commands import Append, Begin, Seek
from fapengine.engine.engine import Engine
from fapengine.engine.utterance import Utterance
from fapengine.errors import UsageError
from fapengine.host.host import Host
from fapengine.speech.phone_track import Phone
from fapengine.trajectory import stream
from fapengine.trajectory.targets import speech_keys
from tests.english import english

MOST_CALLS = 12_000
"""Calls of Python functions and built-in ones that a frame may make. Normal speech makes up to 3,400."""
MOST_KEYS = 1000
"""Keyframes that one plan may place: two a phone or part of one, and those of pauses."""


def frames_of(name: str, seconds: float, monkeypatch: pytest.MonkeyPatch) -> tuple[list[int], list[int]]:
    """Count the calls of each frame, and the keyframes of each plan."""
    calls: list[int] = []
    keys: list[int] = []

    def counted_keys(*arguments: Any, **options: Any) -> Any:
        made = speech_keys(*arguments, **options)
        keys.append(len(made.times_s))
        return made

    def frame(engine: Engine, now_s: float) -> None:
        with Profile() as profile:
            engine.frame(now_s)
        calls.append(sum(entry.callcount for entry in profile.getstats()))

    crowded(name, Engine.frame, english(), 1 / FRAME_HZ)  # what is known of labels is computed once
    monkeypatch.setattr(stream, "speech_keys", counted_keys)
    crowded(name, frame, english(), seconds)
    return calls, keys


@pytest.mark.parametrize("name", CROWDS)
def test_no_frame_works_more_than_it_may(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, keys = frames_of(name, 8.5 if name == "32 x 400 phones of 20 ms" else 0.15, monkeypatch)
    assert max(calls) <= MOST_CALLS
    assert max(keys, default=0) <= MOST_KEYS


def test_a_queue_is_planned_in_linear_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within 8 s of speech 400 phones are planned, and few of them twice, though 12,800 wait."""
    _, keys = frames_of("32 x 400 phones of 20 ms", 8.0, monkeypatch)
    assert 400 <= sum(keys) <= 2 * 400  # phones so short have one each


def test_phones_that_change_are_planned_in_work_that_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A result of a recognizer every 80 ms, for 24 s: each plans its phones and the few around them."""
    keys = []

    def counted_keys(*arguments: Any, **options: Any) -> Any:
        made = speech_keys(*arguments, **options)
        keys.append(len(made.times_s))
        return made

    monkeypatch.setattr(stream, "speech_keys", counted_keys)
    engine = Engine(english(), rng=np.random.default_rng(1))
    engine.open("anna", 0.0)
    engine.apply("anna", Begin(1), 0.0)
    for block in range(300):
        starts_s = [0.08 * number + 0.2 for number in range(block, block + 4)]
        partial = tuple(Phone("mabi"[(block + n) % 3], at_s, at_s + 0.08) for n, at_s in enumerate(starts_s))
        engine.apply("anna", Append(1, block, partial, block, keeps_earlier=True), 0.08 * block)
        for third in range(3):
            engine.frame(0.08 * block + 0.027 * third)
    assert len(keys) == 300
    assert max(keys) <= 40


def test_phones_before_the_position_of_a_seek_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = Engine(english(), rng=np.random.default_rng(1))
    engine.open("anna", 0.0)
    long = Phone("a", 0.0, 500.0)
    for command in (Begin(1), Append(1, 0, (long,))):
        engine.apply("anna", command, 0.0)
    engine.frame(0.1)
    engine.apply("anna", Seek(1, 501.0), 0.1)
    engine.apply("anna", Append(1, 1, tuple(Phone("a", 0.1 * n, 0.1 * n + 0.1) for n in range(1000))), 0.1)
    shifted = []
    in_stream = Utterance.in_stream
    monkeypatch.setattr(Utterance, "in_stream", lambda *given: shifted.append(given) or in_stream(*given))
    for _ in range(5):
        engine.apply("anna", Append(1, 0, (long,)), 0.1)  # a repeat
    assert len(shifted) <= 10


def test_phones_of_all_utterances_have_one_limit() -> None:
    engine = crowded("normal speech", Engine.frame, english(), 0.1)
    for number in range(10, 60):
        refusals = [engine.apply("anna", command, 0.1) for command in utterance(number, 1000, 0.1)]
        if any(refusals):
            break
    assert number == 10 + 19
    assert next(filter(None, refusals)) == "phones: got more than the 20000 that may wait in a session"
    assert engine.counters("anna").refused >= 1
    host = Host(engine, "anna")
    host.begin(99, 0.1)
    with pytest.raises(UsageError, match=r"utterance 99: phones: got more than the 20000 that may wait in a session"):
        host.phones(99, [Phone("a", 0.1, 0.2)] * 1000, 0.1)
