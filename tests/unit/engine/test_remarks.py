"""Phones of live sessions are held against what is plausible, as those of files are: remarks become events."""

import numpy as np
import pytest

from fapengine.engine.commands import Append, Begin, Cancel, End
from fapengine.engine.engine import Engine
from fapengine.engine.session import Event
from fapengine.server.web.session_view import SessionView
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.speech.plausible import remarks_on
from fapengine.trajectory.style import Style
from fapengine.wire import osc
from fapengine.wire.speech_osc import schema
from tests.english import english
from tests.unit.wire.protocol_double import Wire


def events_of(labels: list[str], each_s: float, cancel: bool = False) -> list[Event]:
    face = Engine(english(), rng=np.random.default_rng(1), style=Style.speech_only())
    face.open("anna", 0.0)
    phones = tuple(Phone(label, n * each_s, (n + 1) * each_s) for n, label in enumerate(labels))
    face.apply("anna", Begin(1), 0.0)
    face.apply("anna", Append(1, 0, phones), 0.0)
    face.apply("anna", Cancel(1) if cancel else End(1, len(phones), len(phones) * each_s), 0.0)
    for n in range(round(25 * (len(labels) * each_s + 0.2)) + 2):
        face.frame(n / 25)
    return face.events()


@pytest.mark.parametrize("cancel", [False, True])
def test_unknown_labels_and_wrong_units_are_remarked_before_the_end(cancel: bool) -> None:
    events = events_of(["AA1", "m", "a", "m", "a"], 0.5, cancel=cancel)
    said = [event.reason for event in events if event.kind == "remark"]
    track = PhoneTrack.from_phones([Phone(label, n * 0.5, n * 0.5 + 0.5) for n, label in enumerate(["AA1", *"mama"])])
    assert said == list(remarks_on(track))
    assert said[0].startswith("unknown phone 'AA1' once")
    assert said[1].startswith("timings: the median of 5 phones is 500 ms")
    assert events[-1].kind == ("cancelled" if cancel else "finished")


def test_usual_speech_has_none() -> None:
    assert "remark" not in [event.kind for event in events_of(list("mamapapa"), 0.08)]


def test_osc_senders_and_pages_get_the_reason() -> None:
    wire = Wire()
    wire.send(schema.Hello("anna"), schema.BeginUtterance("anna", 7))
    event = Event("anna", wire.faces.commands()[0].utterance, "remark", 1.0, reason="timings: odd")
    replies: list[tuple[object, bytes]] = []
    wire.receiver._tell_event(event, replies)
    (message,) = osc.parse_packet(replies[0][1])
    assert message.arguments[:3] == ("anna", 7, "remark")
    assert message.arguments[-1] == "timings: odd"
    told: list[str] = []
    view = SessionView.__new__(SessionView)
    view._tell_all, view._speaking = told.append, None  # type: ignore[method-assign]
    view._event(event)
    assert '"reason": "timings: odd"' in told[0] or '"reason":"timings: odd"' in told[0]
