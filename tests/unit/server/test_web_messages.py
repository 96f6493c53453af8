"""What pages may say, and what they are sent."""

import contextlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.engine import commands
from fapengine.errors import DataError
from fapengine.expressions import Expression
from fapengine.server.ownership import check_name
from fapengine.server.web import messages
from fapengine.server.web.messages import (
    Perform,
    Phones,
    Pin,
    Ping,
    Plays,
    Release,
    Say,
    Tell,
    Watch,
    Words,
    pack_frame,
    parse_request,
    text_of,
)

CASES = [
    ({"type": "say", "text": "Hello"}, Say("Hello", "", 0)),
    ({"type": "words", "words": [["Hi", 0.1, 0.4]], "audio": True}, Words(words=[("Hi", 0.1, 0.4)], audio=True)),
    (
        {"type": "words", "words": [["Hi", 0.1, 0.4]], "utterance": 7, "last": False},
        Words(words=[("Hi", 0.1, 0.4)], utterance=7, last=False),
    ),
    (
        {"type": "phones", "phones": [["HH", 0.1, 0.4]], "set": "arpabet", "at_s": 2.5},
        Phones(phones=[("HH", 0.1, 0.4)], set="arpabet", at_s=2.5),
    ),
    ({"type": "say", "text": "Hallo", "voice": "de", "rate": 200}, Say("Hallo", "de", 200)),
    ({"type": "pin", "values": {"3": 400, "68": None}}, Pin({3: 400, 68: None})),
    ({"type": "perform", "values": {"3": 400, "68": -1}}, Perform({3: 400, 68: -1})),
    ({"type": "release"}, Release()),
    ({"type": "express", "name": "joy", "level": 0.5}, Tell(commands.Express(Expression.JOY, 0.5))),
    ({"type": "look", "yaw": 0.1, "pitch": -0.2}, Tell(commands.Look(0.1, -0.2, 0.1))),
    ({"type": "look", "yaw": 0, "pitch": 0, "over": 2}, Tell(commands.Look(0.0, 0.0, 2.0))),
    (
        {"type": "head", "yaw": 0.1, "pitch": -0.2, "roll": 0},
        Tell(commands.TurnHead(roll_rad=0.0, pitch_rad=-0.2, yaw_rad=0.1, over_s=0.4)),
    ),
    ({"type": "blink"}, Tell(commands.Blink())),
    ({"type": "manner", "setting": "jaw", "value": 1.5}, Tell(commands.SetParameter("jaw", 1.5))),
    (
        {"type": "audio", "utterance": 7, "at_s": 12.5, "position_s": 0.25},
        Tell(commands.Audio(utterance=7, at_s=12.5, position_s=0.25, rate=1.0)),
    ),
    ({"type": "cancel"}, Tell(commands.Cancel())),
    ({"type": "pause"}, Tell(commands.Pause())),
    ({"type": "resume"}, Tell(commands.Resume())),
    ({"type": "ping", "number": 3}, Ping(3)),
    ({"type": "plays", "on": True}, Plays(True)),
    ({"type": "watch", "on": False}, Watch(False)),
]
assert {message["type"] for message, _ in CASES} == set(messages.structs())

REFUSED = [
    ("", "expected JSON"),
    ("[" * 5000, "expected JSON"),
    ('{"type": "look", "yaw": NaN, "pitch": 0}', "expected JSON"),
    ("x" * 20_000, "at most 16384"),
    ("[]", "expected an object of type"),
    ('{"type": 3}', "expected an object of type"),
    ('{"type": "shout"}', "expected an object of type"),
    ('{"type": "blink", "twice": true}', r"unknown 'twice' \(at message 'blink'\)"),
    ('{"type": "say"}', "text: got None, expected up to 2000 characters"),
    (json.dumps({"type": "say", "text": "a" * 2001}), "expected up to 2000 characters"),
    ('{"type": "say", "text": "a\\ud800"}', "expected JSON"),
    ('{"type": "say", "text": "a", "rate": 160.5}', "rate: got 160.5, expected a whole number"),
    ('{"type": "say", "text": "a", "rate": 20}', r"rate: got 20, expected a whole number, 80 to 449"),
    ('{"type": "express", "name": "neutral", "level": 1}', "name: got 'neutral', expected one of anger"),
    ('{"type": "express", "name": "joy", "level": true}', r"level: got True, expected a number, 0 to 2"),
    ('{"type": "express", "name": "joy", "level": 1e400}', "expected JSON"),
    ('{"type": "perform", "values": {"3": null}}', "FAP 3: got None, expected whole FAPU .at"),
    ('{"type": "perform", "values": {"2": 1}}', r"got FAP '2', expected 3 to 68"),
    ('{"type": "perform"}', "values"),
    ('{"type": "pin", "values": [3]}', "values: got .*, expected an object"),
    ('{"type": "pin", "values": {"2": 1}}', r"got FAP '2', expected 3 to 68"),
    ('{"type": "pin", "values": {"69": 1}}', r"got FAP '69', expected 3 to 68"),
    ('{"type": "pin", "values": {"٣": 1}}', r"expected 3 to 68"),
    ('{"type": "pin", "values": {"' + "0" * 6000 + '3": 1}}', r"expected 3 to 68"),
    ('{"type": "pin", "values": {"0003' + "0" * 5000 + '": 1}}', r"expected 3 to 68"),
    ('{"type": "pin", "values": {"00040000": 1}}', r"got FAP '00040000', expected 3 to 68"),
    ('{"type": "pin", "values": {"3": 1.5}}', "FAP 3: got 1.5, expected whole FAPU or null"),
    ('{"type": "pin", "values": {"3": true}}', "FAP 3: got True"),
    ('{"type": "pin", "values": {"3": 16777217}}', "FAP 3: got 16777217"),
    ('{"type": "plays", "on": 1}', "on: got 1, expected true or false"),
]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
FIELDS = [
    "text",
    "voice",
    "rate",
    "values",
    "name",
    "level",
    "yaw",
    "pitch",
    "setting",
    "value",
    "utterance",
    "at_s",
    "on",
]


@pytest.mark.parametrize(("message", "request_"), CASES, ids=lambda value: str(value)[:40])
def test_a_message_is_read(message: dict, request_: messages.Request) -> None:
    assert parse_request(json.dumps(message)) == request_


@pytest.mark.parametrize(("text", "complaint"), REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_used_is_refused_with_a_reason(text: str, complaint: str) -> None:
    with pytest.raises(DataError, match=complaint) as caught:
        parse_request(text)
    assert len(str(caught.value)) < 400


@given(st.text() | JSON.map(json.dumps))
def test_any_text_is_a_request_or_a_data_error(text: str) -> None:
    with contextlib.suppress(DataError):
        parse_request(text)


@given(st.sampled_from(sorted(messages.structs())), st.dictionaries(st.sampled_from(FIELDS), JSON, max_size=4))
def test_any_fields_are_a_request_or_a_data_error(kind: str, fields: dict) -> None:
    with contextlib.suppress(DataError):
        parse_request(json.dumps({"type": kind, **fields}))


def test_a_frame_is_as_documented() -> None:
    faps = np.arange(-30, 38, dtype=np.int32) * 10_000
    packed = pack_frame(2**32 + 5, 12.25, faps)
    assert len(packed) == 16 + 4 * 68
    assert packed[:8] == bytes.fromhex("01000000 05000000")  # kind 1, number modulo 2**32, little-endian
    assert np.frombuffer(packed, "<f8", 1, 8)[0] == 12.25
    assert (np.frombuffer(packed, "<i4", offset=16) == faps).all()


def test_the_documentation_names_every_message() -> None:
    text = (Path(__file__).resolve().parents[3] / "docs" / "page.md").read_text()
    table = text.split("| from the page |")[1]
    assert [kind for kind in messages.structs() if f"`{kind}`" not in table] == []
    assert f'"{messages.PROTOCOL}"' in text
    assert f"{messages.FRAME.size} bytes" in text


def test_numbers_that_json_lacks_become_null() -> None:
    assert json.loads(text_of("position", position_s=-math.inf, label="ə")) == {
        "type": "position",
        "position_s": None,
        "label": "ə",
    }


@pytest.mark.parametrize("name", ["", "a\nb", "x" * 33, "é" * 17, "\ud800"])
def test_a_session_has_a_short_printable_name(name: str) -> None:
    with pytest.raises(DataError, match="session: got"):
        check_name(name)


def test_any_printable_name_will_do() -> None:
    assert check_name("Anna's façade 1") == "Anna's façade 1"
