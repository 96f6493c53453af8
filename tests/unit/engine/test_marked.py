"""Marks of a text as gestures of a face: on the engine, in a file, and through the server's voice."""

import asyncio

import numpy as np

from fapengine.app.manner import Manner
from fapengine.app.performance import perform, speak
from fapengine.engine.commands import Blink, Cancel, Express, Look, TurnHead
from fapengine.engine.engine import Engine
from fapengine.engine.gestures import commands_of
from fapengine.expressions import Expression
from fapengine.host.hub import Hub
from fapengine.mpeg4 import fap
from fapengine.speech.marks import GESTURES, Feel, Gesture, TimedMark
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.style import Style
from fapengine.voices.espeak import EspeakVoice
from tests.english import english

PITCH, YAW, EYES = fap.column(48), fap.column(49), fap.column(23)


def hub_at(now_s: list[float]) -> Hub:
    engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
    hub = Hub(engine, rate_hz=50.0, clock=lambda: now_s[0])
    hub.open("anna")
    return hub


def test_commands_come_with_their_word() -> None:
    marks = [TimedMark(1.0, Gesture(name), 2.0) for name in ("left", "shake", "blink")]
    marks += [TimedMark(0.1, Feel(Expression.JOY, 0.5), 2.0), TimedMark(2.0, Feel(Expression.NEUTRAL, 0.0), 3.0)]
    told = commands_of(marks)
    assert [at_s for at_s, _ in told] == sorted(at_s for at_s, _ in told)
    assert {type(command) for _, command in told} == {Express, Look, TurnHead, Blink}
    express = next(command for _, command in told if isinstance(command, Express))
    assert told[0] == (0.0, express)
    assert express.attack_s + express.hold_s + express.release_s == 2.0


def test_cues_are_seen_and_not_exaggerated() -> None:
    """The head turns by 5 to 10 degrees, the eyes by 10 to 20, and all turns end at 0."""
    for name in GESTURES:
        commands = [command for _, command in commands_of([TimedMark(1.0, Gesture(name), 2.0)])]
        turns = [max(abs(one.yaw_rad), abs(one.pitch_rad)) for one in commands if not isinstance(one, Blink)]
        low, high = np.deg2rad((5, 10) if isinstance(commands[0], TurnHead) else (10, 20))
        assert name == "blink" or (low < max(turns) < high and turns[-1] == 0)


def test_a_file_nods_at_the_word() -> None:
    phones = PhoneTrack.from_phones([Phone("a", 0.5, 1.0), Phone("m", 1.0, 1.4)])
    manner = Manner(profile=english(), style=Style.speech_only(), rate_hz=50.0)
    marks = (TimedMark(1.0, Gesture("nod"), 1.5), TimedMark(0.2, Gesture("left"), 1.0))
    values = perform(phones, None, manner, marks=marks).track.values
    assert not values[:50, PITCH].any()
    assert np.argmax(values[:, PITCH]) == 60
    assert values[20, EYES] > 10_000


def test_pauses_are_heard_and_laughs_seen() -> None:
    plain, marked = speak("Well yes."), speak('[laughs] Well <expr type="break" label="800ms"/> yes.')
    assert 0.6 < marked.duration_s - plain.duration_s < 1.3
    smile = fap.column(12)
    assert marked.track.values[15:45, smile].mean() > plain.track.values[15:45, smile].mean() + 100
    assert marked.text == "Well yes."
    assert [phone.word for phone in marked.phones.phones if phone.word][-1] == "yes"


def test_ssml_moves_the_face() -> None:
    speech = EspeakVoice("en-us", ssml=True).speak('<speak>Are you <mark name="surprise:0.5"/>sure?</speak>')
    assert speech.marks[0].act == Feel(Expression.SURPRISE, 0.5)
    sure = next(phone for phone in speech.phones.phones if phone.word.startswith("sure"))
    assert speech.marks[0].at_s == sure.start_s


def test_the_server_gives_cues_at_their_time() -> None:
    now_s = [0.0]
    hub = Hub(
        Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only()), rate_hz=50.0, clock=lambda: now_s[0]
    )
    hub.open("anna")
    spoken = asyncio.run(hub.speak("anna", 'One two three. Four <mark name="nod"/>five six. [laughs]'))
    assert spoken is not None
    assert spoken.text == "One two three. Four five six."
    five_s = next(phone.start_s for phone in spoken.speech.phones.phones if phone.word == "five")
    pitches = []
    while now_s[0] < five_s + 0.5:
        pitches.append(hub.tick(now_s[0]).faps[0][PITCH])
        now_s[0] += 0.02
    assert abs(np.argmax(pitches) * 0.02 - five_s - 0.2) < 0.05
    assert not np.any(pitches[: int(five_s / 0.02) - 1])


def test_what_is_cancelled_makes_no_gesture() -> None:
    now_s = [0.0]
    hub = Hub(
        Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only()), rate_hz=50.0, clock=lambda: now_s[0]
    )
    hub.open("anna")
    asyncio.run(hub.speak("anna", 'One two three <mark name="nod"/>four.'))
    hub.tick(0.0)
    hub.apply("anna", Cancel())
    assert not any(hub.tick(0.02 * n).faps[0][PITCH] for n in range(1, 150))


def test_a_glance_comes_back_to_straight_ahead():
    (_, away), (_, back) = commands_of([TimedMark(1.0, Gesture("up"), 2.0)])
    assert away.pitch_rad < 0
    assert (back.yaw_rad, back.pitch_rad) == (0.0, 0.0)
