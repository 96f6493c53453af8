"""What pages of one session are told, and who of them leads."""

import json

import numpy as np
import pytest

from fapengine.engine.commands import (
    VOICE_UTTERANCES,
    Append,
    Audio,
    Begin,
    Blink,
    Cancel,
    Command,
    End,
    Express,
    TurnHead,
)
from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits
from fapengine.errors import UsageError
from fapengine.expressions import Expression
from fapengine.host.hub import Hub
from fapengine.mpeg4 import fap
from fapengine.server.web import session_view as views
from fapengine.server.web.session_view import SessionView, open_session_view
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.style import Style
from fapengine.voices.protocol import Speech
from tests.english import english

PHONES = (Phone("m", 0.1, 0.2), Phone("ɑː", 0.2, 0.5, word="ma"))


class Page:
    """A member that keeps what it is sent."""

    def __init__(self) -> None:
        self.texts: list[dict] = []
        self.frames: list[bytes] = []

    def put_text(self, text: str) -> None:
        self.texts.append(json.loads(text))

    def put_frame(self, frame: bytes) -> None:
        self.frames.append(frame)

    def kinds(self) -> list[str]:
        return [text["type"] for text in self.texts]

    def of(self, kind: str) -> list[dict]:
        return [text for text in self.texts if text["type"] == kind]


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def hub(clock: Clock) -> Hub:
    engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only(), limits=Limits(sessions=2))
    return Hub(engine, clock=clock)


def run(hub: Hub, clock: Clock, seconds: float) -> None:
    for _ in range(round(60 * seconds)):
        clock.now_s += 1 / 60
        hub.tick(clock.now_s)


def say(hub: Hub, number: int = 1) -> None:
    hub.apply("anna", Begin(number))
    hub.apply("anna", Append(number, 0, PHONES))
    hub.apply("anna", End(number, 2, 0.6))


def faps_of(frame: bytes) -> np.ndarray:
    return np.frombuffer(frame, "<i4", offset=16)


def test_all_pages_see_the_frames(hub: Hub, clock: Clock) -> None:
    view, one, other = SessionView(hub, "anna"), Page(), Page()
    view.enter(one)
    run(hub, clock, 0.1)
    view.enter(other)
    run(hub, clock, 0.1)
    assert (len(one.frames), len(other.frames)) == (12, 6)
    assert one.frames[6:] == other.frames


def test_an_utterance_is_told_from_beginning_to_end(hub: Hub, clock: Clock) -> None:
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    run(hub, clock, 0.1)
    say(hub)
    run(hub, clock, 1.0)
    assert page.of("begin")[0]["utterance"] == 1
    assert page.of("phones")[0]["phones"] == [["m", 0.1, 0.2, None], ["ɑː", 0.2, 0.5, "ma"]]
    assert page.of("end")[0]["duration_s"] == 0.6
    assert [event["kind"] for event in page.of("event")] == ["started", "finished"]
    places = page.of("position")
    assert len(places) >= 2
    zeros = [place["time_s"] - place["position_s"] for place in places]
    assert max(zeros) - min(zeros) < 1e-6  # it passes as time does
    run(hub, clock, 0.5)
    assert page.of("position") == places  # nothing more behind its end


def test_a_page_that_comes_late_is_told_what_is_being_said(hub: Hub, clock: Clock) -> None:
    view, early, late = SessionView(hub, "anna"), Page(), Page()
    view.enter(early)
    say(hub)
    hub.apply("anna", Express(Expression.JOY, 0.5))
    hub.apply("anna", TurnHead(roll_rad=0.0, pitch_rad=0.1, yaw_rad=0.3))
    hub.apply("anna", TurnHead(roll_rad=0.0, pitch_rad=0.1, yaw_rad=0.2))
    run(hub, clock, 0.3)
    hub.host("anna").pin(3, 50)
    view.enter(late)
    assert late.kinds() == ["pins", "express", "head", "begin", "phones", "end"]
    assert late.texts[2] == {"type": "head", "roll": 0.0, "pitch": 0.1, "yaw": 0.2, "over": 0.4}
    assert late.texts[0]["values"] == {"3": 50}
    assert late.texts[1] == {"type": "express", "name": "joy", "level": 0.5}
    run(hub, clock, 1.0)
    last = Page()
    view.enter(last)
    assert last.kinds() == ["pins", "express", "head"]  # it is over


def test_a_repeated_message_is_told_once(hub: Hub) -> None:
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    say(hub)
    say(hub)
    assert page.kinds() == ["pins", "begin", "phones", "end"]


def test_a_page_is_told_of_a_bounded_number_of_utterances(hub: Hub, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "MAX_UTTERANCES", 5)
    view, page, late = SessionView(hub, "anna"), Page(), Page()
    view.enter(page)
    for number in range(8):
        hub.apply("anna", Append(number, 0, PHONES))
    view.enter(late)
    assert [text["utterance"] for text in late.of("phones")] == [3, 4, 5, 6, 7]


def test_what_came_phone_by_phone_is_told_a_late_page_in_few_messages(hub: Hub) -> None:
    view, page, late = SessionView(hub, "anna"), Page(), Page()
    view.enter(page)
    hub.apply("anna", Begin(1))
    phones = [Phone("m", index / 10, (index + 1) / 10) for index in range(900)]
    for index, phone in enumerate(phones):
        if index != 600:  # lost on the way
            hub.apply("anna", Append(1, index, (phone,)))
    view.enter(late)
    assert late.kinds() == ["pins", "begin", "phones", "phones"]
    assert [(text["first"], len(text["phones"])) for text in late.of("phones")] == [(0, 600), (601, 299)]
    hub.apply("anna", Append(1, 4, (phones[4],), revision=1))  # all of it anew, of which nothing else came yet
    last = Page()
    view.enter(last)
    assert [(text["first"], text["revision"], text["phones"]) for text in last.of("phones")] == [
        (4, 1, [["m", 0.4, 0.5, None]])
    ]


def test_a_sender_that_leaves_gaps_does_not_flood_a_late_page(hub: Hub) -> None:
    view, page, late = SessionView(hub, "anna"), Page(), Page()
    view.enter(page)
    for index in range(0, 3000, 2):
        hub.apply("anna", Append(1, index, (Phone("m", index / 10, (index + 1) / 10),)))
    view.enter(late)
    assert [text["first"] for text in late.of("phones")] == list(range(3000 - 2 * views.MAX_RUNS, 3000, 2))


def test_a_cancel_is_told(hub: Hub) -> None:
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    say(hub)
    hub.apply("anna", Cancel())
    assert page.of("cancel") == [{"type": "cancel", "utterance": None}]


def test_where_the_server_s_voice_is_stopped_a_sender_s_utterance_goes_on(hub: Hub) -> None:
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    say(hub)
    say(hub, VOICE_UTTERANCES)
    say(hub, VOICE_UTTERANCES + 1)
    hub.apply("anna", Cancel(first=VOICE_UTTERANCES))
    hub.apply("anna", Cancel(1))
    assert [text["utterance"] for text in page.of("cancel")] == [VOICE_UTTERANCES, VOICE_UTTERANCES + 1, 1]


def test_a_held_fap_stays_whatever_is_said_and_all_pages_know(hub: Hub, clock: Clock) -> None:
    view, one, other = SessionView(hub, "anna"), Page(), Page()
    view.enter(one)
    view.enter(other)
    view.pin({3: 777, 19: -5})
    assert other.of("pins")[-1]["values"] == {"3": 777, "19": -5}
    say(hub)
    run(hub, clock, 0.4)
    jaw = fap.column(3)
    assert {int(faps_of(frame)[jaw]) for frame in one.frames} == {777}
    assert len({faps_of(frame)[fap.column(5)].item() for frame in one.frames}) > 3  # the lips go on
    view.pin({19: None})
    assert hub.host("anna").pins == {3: 777}
    view.release()
    assert other.of("pins")[-1]["values"] == {}
    run(hub, clock, 1.0)
    assert faps_of(one.frames[-1])[jaw] == 0


def test_sound_is_offered_with_its_address(hub: Hub, clock: Clock) -> None:
    speech = Speech(samples=np.zeros(8000, np.int16), sample_rate_hz=16_000, phones=PhoneTrack.from_phones(PHONES))
    view, page = SessionView(hub, "a b"), Page()
    view.enter(page)
    spoken = hub.say("a b", speech, text="Ma!")
    assert spoken.anchor == "now"
    assert page.of("sound") == [
        {"type": "sound", "utterance": spoken.utterance, "text": "Ma!",
         "url": f"/sound.wav?session=a+b&utterance={spoken.utterance}"}
    ]  # fmt: skip
    view.plays(page, on=True)
    assert hub.say("a b", speech).anchor == "audio"
    view.plays(page, on=False)
    assert hub.say("a b", speech).anchor == "now"
    assert len(page.of("sound")) == 3


def test_one_page_leads_a_sound_and_another_takes_over_when_it_goes(hub: Hub) -> None:
    heard: list[Audio] = []
    hub.listeners.on_command(
        "anna", lambda session, command, now_s: heard.append(command) if isinstance(command, Audio) else None
    )
    view, one, other = SessionView(hub, "anna"), Page(), Page()
    view.enter(one)
    view.enter(other)
    say(hub)
    hub_time = 100.0
    view.tell(one, Audio(1, hub_time, 0.1))
    view.tell(other, Audio(1, hub_time, 0.4))
    view.tell(one, Audio(1, hub_time, 0.2))
    view.tell(one, Audio(99, hub_time, 0.2))  # nobody says that
    assert [audio.position_s for audio in heard] == [0.1, 0.2]
    view.leave(one)
    view.tell(other, Audio(1, hub_time, 0.5))
    assert [audio.position_s for audio in heard] == [0.1, 0.2, 0.5]


def test_where_the_server_plays_the_sound_no_page_does(hub: Hub) -> None:
    heard: list[Command] = []
    hub.listeners.on_command("anna", lambda session, command, now_s: heard.append(command))
    view, page = SessionView(hub, "anna", server_plays_audio=True), Page()
    view.enter(page)
    view.plays(page, on=True)
    speech = Speech(samples=np.zeros(8000, np.int16), sample_rate_hz=16_000, phones=PhoneTrack.from_phones(PHONES))
    spoken = hub.say("anna", speech)
    assert spoken.anchor == "now"  # the page is not waited for
    assert [text["url"] for text in page.of("sound")] == [None]
    view.tell(page, Audio(spoken.utterance, 100.0, 0.1))
    assert not any(isinstance(command, Audio) for command in heard)


def test_the_last_page_closes_the_door(hub: Hub, clock: Clock) -> None:
    opened: dict[str, SessionView] = {}
    page, other = Page(), Page()
    view = open_session_view(hub, "anna", opened)
    view.enter(page)
    assert open_session_view(hub, "anna", opened) is view
    view.enter(other)
    view.leave(page)
    run(hub, clock, 0.05)
    assert len(other.frames) == 3
    view.leave(other)
    run(hub, clock, 0.05)
    say(hub)
    assert (len(other.frames), other.of("begin")) == (3, [])
    assert open_session_view(hub, "anna", opened) is not view


def test_a_session_is_held_while_anybody_watches_and_given_up_then(clock: Clock) -> None:
    engine = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
    hub = Hub(engine, clock=clock, idle_close_s=2.0)
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    view.plays(page, on=True)
    run(hub, clock, 12.0)
    assert "anna" in hub.engine
    view.leave(page)
    speech = Speech(samples=np.zeros(8000, np.int16), sample_rate_hz=16_000, phones=PhoneTrack.from_phones(PHONES))
    assert hub.say("anna", speech).anchor == "now"  # nobody plays it any more
    assert page.of("sound") == []
    run(hub, clock, 12.0)
    assert "anna" not in hub.engine


def test_a_full_server_opens_no_room(hub: Hub) -> None:
    SessionView(hub, "anna").enter(Page())
    SessionView(hub, "bert").enter(Page())
    with pytest.raises(UsageError, match="limit of 2"):
        SessionView(hub, "carl")
    assert hub.engine.sessions == ("anna", "bert")


def test_what_is_asked_of_a_lost_session_is_refused(hub: Hub) -> None:
    view, page = SessionView(hub, "anna"), Page()
    view.enter(page)
    hub.close("anna")
    with pytest.raises(UsageError, match="session: got 'anna'"):
        view.pin({3: 1})
    with pytest.raises(UsageError, match="anna"):
        view.tell(page, Blink())
