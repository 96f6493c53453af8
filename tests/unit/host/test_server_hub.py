"""The hub: one tick, many listeners; sessions that close when nobody cares; voices."""

import asyncio
import logging

import numpy as np
import pytest

from fapengine.engine.commands import VOICE_UTTERANCES, Append, Audio, Begin, Blink, Cancel, End, Express, Pause
from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits, Session
from fapengine.errors import NothingToSpeakError, UsageError
from fapengine.expressions import Expression
from fapengine.host import hub as hubs
from fapengine.host import speaker
from fapengine.host.hub import Hub
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech
from tests.english import english

JAW = fap.column(3)
PHONES = tuple(Phone(label, 0.1 + 0.15 * n, 0.25 + 0.15 * n) for n, label in enumerate(["m", "ɑː", "b", "ɑː", "p"]))


class Clock:
    """Stateful: time that the test turns."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def hub_of(voice: object = None, **limits: object) -> tuple[Hub, Clock]:
    clock = Clock()
    engine = Engine(english(), rng=np.random.default_rng(1), limits=Limits(**limits), style=Style.speech_only())
    return Hub(engine, clock=clock, idle_close_s=10.0, voice=voice), clock


class ReadVoice:
    """A voice that remembers what it was asked, and takes a step of the loop for a letter.

    Stateful.
    """

    def __init__(self) -> None:
        self.asked: list[tuple[str, VoiceChoice, float]] = []

    async def speak(self, text: str, choice: VoiceChoice, most_s: float) -> Speech:
        self.asked.append((text, choice, most_s))
        for _ in text:
            await asyncio.sleep(0)
        if not any(letter.isalnum() for letter in text):
            raise NothingToSpeakError("text: nothing")
        return spoken()

    def close(self) -> None:
        pass


def run(hub: Hub, clock: Clock, seconds: float) -> list[hubs.HubFrames]:
    frames = []
    for _ in range(round(seconds * 50)):
        clock.now_s += 0.02
        frames.append(hub.tick(clock.now_s))
    return frames


def spoken() -> Speech:
    phones = PhoneTrack.from_phones([Phone("_", 0.0, 0.1), *PHONES])
    samples = np.zeros(round(phones.duration_s * 8000), np.int16)
    return Speech(samples=samples, sample_rate_hz=8000, phones=phones)


def test_one_tick_reaches_every_listener() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.open("b")
    everything, mine, other = [], [], []
    hub.listeners.on_frames(everything.append)
    stop = hub.listeners.on_frame("b", mine.append)
    hub.listeners.on_frame("absent", other.append)
    hub.apply("b", Express(Expression.JOY))
    (first, second) = run(hub, clock, 0.04)
    assert everything == [first, second]
    assert first.sessions == ("a", "b")
    assert [frame.number for frame in mine] == [0, 1]
    assert [frame.time_s for frame in mine] == [pytest.approx(1000.02), pytest.approx(1000.04)]
    assert all(np.array_equal(frame.faps, shown.faps[1]) for frame, shown in zip(mine, (first, second), strict=True))
    assert other == []
    stop()
    stop()
    run(hub, clock, 0.02)
    assert len(mine) == 2
    assert len(everything) == 3


def test_a_listener_that_fails_is_dropped_and_the_others_go_on(caplog: pytest.LogCaptureFixture) -> None:
    hub, clock = hub_of()
    hub.open("a")
    seen = []

    def fail(_: object) -> None:
        raise RuntimeError("broken page")

    hub.listeners.on_frames(fail)
    hub.listeners.on_frame("a", fail)
    hub.listeners.on_command("a", lambda *_: fail(None))
    hub.listeners.on_frame("a", seen.append)
    with caplog.at_level(logging.ERROR):
        run(hub, clock, 0.04)
        hub.apply("a", Blink())
        hub.apply("a", Blink())
    assert len(seen) == 2
    assert hub.counts.listeners_dropped == 3
    assert caplog.text.count("RuntimeError: broken page") == 3


def test_events_and_commands_are_heard_by_those_who_asked() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.open("b")
    events, all_events, commands = [], [], []
    hub.listeners.on_event("a", events.append)
    hub.listeners.on_event(None, all_events.append)
    stop = hub.listeners.on_command("a", lambda *told: commands.append(told))
    for session in ("a", "b"):
        hub.engine.apply(session, Begin(1), clock())
        hub.engine.apply(session, Append(1, 0, PHONES), clock())
        hub.engine.apply(session, End(1, len(PHONES), 0.9), clock())
    run(hub, clock, 2.0)
    assert [event.kind for event in events] == ["started", "finished"]
    assert {event.session for event in all_events} == {"a", "b"}
    assert [type(command) for _, command, _ in commands] == [Begin, Append, End]
    assert commands[0][0] == "a"
    assert commands[0][2] == 1000.0
    stop()
    hub.apply("a", Blink())
    assert len(commands) == 3
    drained = hub.engine.events()  # once more for the receiver, who asks
    assert len(drained) == len(all_events)
    assert hub.engine.events() == []


def test_a_session_that_nobody_cares_for_is_closed() -> None:
    hub, clock = hub_of()
    hub.open("told")
    hub.open("left")
    release, again = hub.hold("held"), hub.hold("held")
    run(hub, clock, 8.0)
    hub.apply("told", Blink())
    run(hub, clock, 8.0)
    assert hub.engine.sessions == ("told", "held") or set(hub.engine.sessions) == {"told", "held"}
    release()
    release()  # no more than once
    run(hub, clock, 16.0)
    assert hub.engine.sessions == ("held",)
    again()
    run(hub, clock, 6.0)
    assert hub.engine.sessions == ()
    assert hub.counts.idle_closed == 3
    assert hub.engine.touched_s == {}


def test_a_session_that_speaks_is_not_idle() -> None:
    hub, clock = hub_of()
    hub.open("a")
    long = tuple(Phone("ɑː", 0.5 * n, 0.5 * n + 0.5) for n in range(50))
    hub.apply("a", Begin(1))
    hub.apply("a", Append(1, 0, long))
    hub.apply("a", End(1, 50, 25.0))
    run(hub, clock, 20.0)
    assert "a" in hub.engine
    run(hub, clock, 25.0)
    assert "a" not in hub.engine


def test_opening_twice_and_closing_twice_are_harmless() -> None:
    hub, _ = hub_of(sessions=1)
    hub.open("a")
    hub.open("a")
    with pytest.raises(UsageError, match="limit of 1"):
        hub.open("b")
    hub.close("a")
    hub.close("a")
    assert hub.engine.sessions == ()
    with pytest.raises(UsageError, match="not open"):
        hub.apply("a", Blink())


@pytest.mark.parametrize("name", ["", "é" * 17, "a\0", "a\nb", "\ud800"])
def test_names_that_no_wire_can_carry(name: str) -> None:
    hub, _ = hub_of()
    with pytest.raises(UsageError, match=r"session: got .*, expected 1 to 32 bytes"):
        hub.open(name)


def test_what_a_voice_said_moves_the_face_and_reaches_the_ears() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.open("b")
    heard, elsewhere = [], []
    hub.listeners.on_speech("a", heard.append, plays=False)
    hub.listeners.on_speech("b", elsewhere.append, plays=True)
    said = hub.say("a", spoken(), text="mama")
    assert heard == [said]
    assert elsewhere == []
    assert (said.anchor, said.text, said.utterance) == ("now", "mama", VOICE_UTTERANCES)
    frames = run(hub, clock, 2.0)
    assert max(frame.faps[0, JAW] for frame in frames) > 50
    assert not frames[-1].faps.any()


def test_a_face_whose_sound_is_played_waits_for_it_and_then_not_for_ever() -> None:
    hub, clock = hub_of()
    hub.open("a")
    heard = []
    hub.listeners.on_speech(None, heard.append, plays=True)
    said = hub.say("a", spoken())
    assert said.anchor == "audio"
    assert not any(frame.faps.any() for frame in run(hub, clock, 1.0))
    hub.apply("a", Audio(said.utterance, clock(), 0.0))
    assert any(frame.faps.any() for frame in run(hub, clock, 1.5))
    assert hub.counts.unheard == 0
    hub.say("a", spoken())
    assert not any(frame.faps.any() for frame in run(hub, clock, 1.4))
    assert any(frame.faps.any() for frame in run(hub, clock, 1.0))  # its player is gone: the clock leads
    assert hub.counts.unheard == 1


def test_a_queued_sound_may_wait_while_the_one_before_plays() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.listeners.on_speech(None, lambda _: None, plays=True)
    first, _ = hub.say("a", spoken()), hub.say("a", spoken())
    for step in range(10):  # plays slowly
        hub.apply("a", Audio(first.utterance, clock(), 0.08 * step))
        run(hub, clock, 0.4)
    assert hub.counts.unheard == 0
    hub.apply("a", Cancel())
    run(hub, clock, 3.0)
    assert hub.counts.unheard == 0


def test_what_is_not_heard_of_goes_on_one_behind_the_other() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.listeners.on_speech(None, lambda _: None, plays=True)
    events: list[tuple[str, int]] = []
    hub.listeners.on_event("a", lambda event: events.append((event.kind, event.utterance - VOICE_UTTERANCES)))
    for _ in range(2):
        hub.say("a", spoken())
    run(hub, clock, 8.0)
    assert events == [("started", 0), ("finished", 0), ("started", 1), ("finished", 1)]
    assert hub.counts.unheard == 2


def test_a_session_that_stands_still_is_closed_too() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.say("a", spoken())
    run(hub, clock, 0.2)
    hub.apply("a", Pause())
    run(hub, clock, 12.0)
    assert "a" not in hub.engine
    assert hub.counts.idle_closed == 1


def test_a_face_that_has_too_much_to_say_is_not_given_the_sound_of_more() -> None:
    hub, _ = hub_of(utterances=1)
    hub.open("a")
    heard: list[object] = []
    hub.listeners.on_speech("a", heard.append, plays=False)
    hub.say("a", spoken())
    with pytest.raises(UsageError, match="as many utterances"):
        hub.say("a", spoken())
    assert len(heard) == 1


def test_a_player_that_fails_is_dropped() -> None:
    hub, clock = hub_of()
    hub.open("a")

    def fail(said: object) -> None:
        raise RuntimeError("no")

    hub.listeners.on_speech("a", fail, plays=False)
    hub.say("a", spoken())
    assert hub.counts.listeners_dropped == 1
    hub.say("a", spoken())
    assert hub.counts.listeners_dropped == 1
    assert any(frame.faps.any() for frame in run(hub, clock, 1.0))


def test_texts_of_a_session_are_said_in_the_order_in_which_they_came() -> None:
    hub, _ = hub_of(ReadVoice())
    hub.open("a")
    said: list[str] = []
    hub.listeners.on_speech("a", lambda one: said.append(one.text), plays=False)

    async def ask() -> None:
        await asyncio.gather(*(hub.speak("a", text) for text in ("a long one. " * 60, "short", "s")))

    asyncio.run(ask())
    assert said == ["a long one. " * 60, "short", "s"]


@pytest.mark.parametrize("steps", [0, 1, 3, 8, 20, 60])
def test_a_coroutine_that_is_cancelled_says_nothing_and_keeps_nothing(steps: int) -> None:
    async def main() -> None:
        hub, _ = hub_of(ReadVoice())
        hub.open("anna")
        said: list[str] = []
        hub.listeners.on_speech(None, lambda spoken: said.append(spoken.text), plays=False)
        asked = [asyncio.create_task(hub.speak("anna", f"Some text, number {n}. And more.")) for n in range(3)]
        for _ in range(steps):
            await asyncio.sleep(0)
        ended = sum(task.done() for task in asked)
        for task in asked:
            task.cancel()
        await asyncio.gather(*asked, return_exceptions=True)
        assert len(said) == ended
        assert (hub.speaker._asked, hub.speaker._lines) == ([], {})
        spoken = await hub.speak("anna", "The next.")
        assert spoken is not None
        assert said[ended:] == ["The next."]

    asyncio.run(main())


def test_a_long_text_costs_the_others_a_piece_each_and_not_all_of_it() -> None:
    voice = ReadVoice()
    hub, _ = hub_of(voice)
    for session in "abc":
        hub.open(session)

    async def ask() -> None:
        long = asyncio.create_task(hub.speak("a", "字" * 3000))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        await asyncio.gather(long, hub.speak("b", "b one."), hub.speak("c", "c one."), hub.speak("b", "b two."))

    asyncio.run(ask())
    order = [text[0] for text, _, _ in voice.asked]
    assert order[:6] == ["字", "b", "c", "字", "b", "字"]
    assert order[6:] == ["字"] * 7


def test_pieces_become_one_sound_and_the_sound_has_a_limit() -> None:
    voice = ReadVoice()
    hub, _ = hub_of(voice)
    hub.open("a")
    sentence = "This is a sentence of the text. "
    said = asyncio.run(hub.speak("a", sentence * 20 + "." * 300))
    assert said.text == sentence * 20 + "." * 300
    assert "".join(text for text, _, _ in voice.asked) == said.text
    assert {text for text, _, _ in voice.asked} == {sentence * 9, sentence * 2 + "." * 236, "." * 64}
    one = spoken()
    parts = 3
    pause_s = speaker.SENTENCE_PAUSE_S
    assert said.speech.duration_s == pytest.approx(
        hubs.LEAD_S + parts * one.duration_s + 2 * pause_s + hubs.TAIL_S, abs=1e-3
    )
    assert [most_s for _, _, most_s in voice.asked] == pytest.approx(
        [hubs.MAX_SOUND_S - n * one.duration_s for n in (0, 1, 2, 3)]
    )
    with pytest.raises(UsageError, match="nothing"):
        asyncio.run(hub.speak("a", "..."))


@pytest.mark.parametrize("text", ["", "\N{GRINNING FACE}"])
def test_a_text_of_faces_alone_has_nothing_to_speak(text: str) -> None:
    voice = ReadVoice()
    hub, _ = hub_of(voice)
    hub.open("a")
    with pytest.raises(NothingToSpeakError, match=f"text: '{text}' contains nothing to speak"):
        asyncio.run(hub.speak("a", text))
    assert voice.asked == []


def test_a_session_may_have_few_texts_waiting() -> None:
    hub, _ = hub_of(ReadVoice())
    hub.open("a")
    hub.open("b")

    async def ask() -> list[object]:
        asks = [hub.speak("a", f"text {n}") for n in range(speaker.MAX_TEXTS + 1)]
        return await asyncio.gather(*asks, hub.speak("b", "mine"), return_exceptions=True)

    *answers, refused, other = asyncio.run(ask())
    assert str(refused) == "text: got one more than 4 that wait for the voice"
    assert [said.text for said in (*answers, other)] == ["text 0", "text 1", "text 2", "text 3", "mine"]


def test_a_sound_whose_session_is_gone_is_forgotten() -> None:
    hub, clock = hub_of()
    hub.open("a")
    hub.listeners.on_speech(None, lambda _: None, plays=True)
    hub.say("a", spoken())
    hub.close("a")
    run(hub, clock, 2.0)
    assert hub.counts.unheard == 0


def test_text_is_spoken_by_the_voice_that_is_asked_for() -> None:
    voice = ReadVoice()
    hub, clock = hub_of(voice)
    hub.open("a")
    said = asyncio.run(hub.speak("a", "Mama.", voice="de", rate_wpm=150))
    assert voice.asked == [("Mama.", VoiceChoice("de", 150), hubs.MAX_SOUND_S)]
    assert said.text == "Mama."
    assert any(frame.faps.any() for frame in run(hub, clock, 1.0))
    with pytest.raises(UsageError, match="text: must have at most 4000 characters, got 4001"):
        asyncio.run(hub.speak("a", "x" * 4001))


def test_a_text_that_is_stopped_while_the_voice_works_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    voice = ReadVoice()
    hub, _ = hub_of(voice)
    hub.open("a")
    hub.open("b")

    async def speak(*_: object) -> Speech:
        hub.apply("a", Cancel(first=VOICE_UTTERANCES))
        return spoken()

    monkeypatch.setattr(voice, "speak", speak)
    assert asyncio.run(hub.speak("a", "Mama.")) is None
    assert hub.engine.state("a") == "idle"
    assert asyncio.run(hub.speak("b", "Mama.")) is not None
    own = hub.say("a", spoken())
    hub.apply("a", Begin(3))
    hub.apply("a", Append(3, 0, own.speech.phones.phones))
    hub.apply("a", Cancel(first=VOICE_UTTERANCES))
    assert hub.engine.utterance("a", own.utterance) is None
    assert hub.engine.utterance("a", 3) is not None  # a sender's goes on


def test_a_real_voice_speaks() -> None:
    hub, _ = hub_of()
    hub.open("a")
    said = asyncio.run(hub.speak("a", "Mama."))
    assert [phone.label for phone in said.speech.phones.phones][:2] == ["_", "m"]
    assert said.speech.duration_s > 0.6


def test_it_runs_at_its_rate_until_stopped() -> None:
    engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
    hub = Hub(engine, rate_hz=200.0)
    hub.open("a")
    before, after, numbers = [], [], []

    def count(frames: hubs.HubFrames) -> None:
        numbers.append(frames.number)
        if len(numbers) == 20:
            hub.stop()

    hub.listeners.on_frames(count)
    asyncio.run(
        asyncio.wait_for(hub.run(lambda now_s, due_s: before.append((now_s, due_s)), after.append), timeout=300)
    )
    assert len(numbers) == len(before) == len(after) == 20
    assert all(now_s >= due_s - 1e-5 for now_s, due_s in before)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] + 1 - len(numbers) == hub.counts.skipped == hub.pacer.skipped


def test_a_session_that_fails_is_counted_and_told_of_and_one_that_is_watched_begins_anew(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub, clock = hub_of()
    hub.hold("watched")
    for session in ("free", "watched", "whole"):
        hub.open(session)
        for command in (Begin(1), Append(1, 0, PHONES), End(1, len(PHONES), 1.0)):
            hub.apply(session, command)
    advance = Session.advance

    def fail(session: Session, now_s: float) -> None:
        if session.name != "whole":
            raise OverflowError("too much")
        advance(session, now_s)

    monkeypatch.setattr(Session, "advance", fail)
    with caplog.at_level(logging.ERROR):
        run(hub, clock, 0.02)
    monkeypatch.undo()
    frames = run(hub, clock, 0.3)
    assert frames[-1].sessions == ("whole", "watched")
    assert np.abs(frames[-1].faps[0]).max() > 0
    assert hub.counts.faulted == 2
    assert caplog.text.count("OverflowError: too much") == 2
    assert hub.engine.totals().utterances == 3


def test_without_a_session_it_dozes_and_the_first_wakes_it() -> None:
    async def main() -> tuple[float, int]:
        hub = Hub(Engine(english(), rng=np.random.default_rng(1)), rate_hz=100.0)
        begun_s = hub.clock()
        running = asyncio.create_task(hub.run())
        await asyncio.sleep(0.25)
        asleep, seen = hub.counts.frames / (hub.clock() - begun_s), []
        hub.listeners.on_frame("anna", seen.append)
        hub.engine.open("anna", hub.clock())  # as OSC does
        async with asyncio.timeout(100.0):
            while len(seen) < 10:
                await asyncio.sleep(0.01)
        hub.stop()
        await running
        return asleep, seen[-1].number

    asleep, number = asyncio.run(main())
    assert asleep <= 20  # frames a second, of 100
    assert number >= 25  # but they count on


def test_somebody_who_moves_a_face_is_let_go_when_no_more_comes() -> None:
    hub, clock = hub_of()
    hub.open("anna")
    hub.open("ben")
    with pytest.raises(UsageError, match="got 'carl'"):
        hub.host("carl").perform({3: 1}, hub.clock())
    hub.host("anna").perform({3: 400, 49: -200}, hub.clock())
    hub.host("anna").pin(49, 7)
    for after_s, opened in ((0.0, 400), (0.3, 400), (0.45, 200), (0.6, 0), (0.61, 0)):
        clock.now_s = 1000.0 + after_s
        frames = hub.tick(clock.now_s)
        anna, ben = (frames.faps[frames.sessions.index(name)] for name in ("anna", "ben"))
        assert anna[JAW] == pytest.approx(opened, abs=1)
        assert anna[fap.column(49)] == 7  # a slider that is held is above all
        assert not ben.any()
    hub.host("anna").perform({3: 300}, hub.clock())
    hub.close("anna")
    hub.open("anna")
    assert not hub.tick(clock.now_s + 0.1).faps[0, JAW]  # who is moved begins anew with the session
