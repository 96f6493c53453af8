"""One list of commands: a new one is found on every wire, in the client, in the engine and in the documentation."""

import inspect
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isinf, nan
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pytest

from design import command_tables
from fapengine.clients.sender import Client
from fapengine.engine import commands
from fapengine.engine.command_table import (
    Angle,
    Choice,
    Command,
    CommandSpec,
    Duration,
    EndlessDuration,
    Time,
    checked,
    fields_of,
)
from fapengine.engine.engine import Engine
from fapengine.engine.gestures import BatchGestures
from fapengine.errors import DataError, UsageError
from fapengine.files.profiles import load_profile
from fapengine.server.web import messages
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, one_shot, schema
from tests.unit.wire.protocol_double import Wire

ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True, slots=True)
class RaiseBrow(Command):
    """A command that there is not."""

    SPEC: ClassVar[CommandSpec] = CommandSpec(
        doc="raise a brow", osc="/fap/1/brow", one_shot="/brow", json="brow", is_direct=True, is_repeatable=True
    )
    height_rad: Annotated[float, Angle(osc="height_deg", json="height", low=0.0, high=0.5, doc="up")]
    over_s: Annotated[float, Duration(osc="over_us", json="over", low=0.01, high=2.0)] = 0.25


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[object]]:
    """The made-up command on the list, and the motion that answers it."""
    answered: list[object] = []
    monkeypatch.setattr(commands, "COMMANDS", (*commands.COMMANDS, RaiseBrow))
    answer = lambda gestures, row, command, now_s: answered.append((row, command, now_s))  # noqa: E731
    monkeypatch.setattr(BatchGestures, "make", answer)
    made_of_the_list = (schema.from_sender, one_shot.nameless, messages.structs)
    for made in made_of_the_list:
        made.cache_clear()
    yield answered
    for made in made_of_the_list:
        made.cache_clear()


def test_a_new_command_comes_by_osc_with_and_without_a_session(listed: list[object]) -> None:
    one = Wire()
    packet = codec.encode(schema.SessionCommand("anna", RaiseBrow(np.pi / 18, 0.5)))
    (message,) = osc.parse_packet(packet)
    assert (message.address, message.tags, message.arguments[0]) == ("/fap/1/brow", "sfi", "anna")
    assert message.arguments[1:] == (pytest.approx(10.0), 500_000)
    one.send(packet)
    one.say("/brow", "f", 10.0)
    first, second = one.faces.commands(RaiseBrow)
    assert first == RaiseBrow(pytest.approx(np.pi / 18), 0.5)
    assert second == RaiseBrow(pytest.approx(np.pi / 18), 0.25)
    one.say("/brow")
    assert (one.counts.malformed, one.counts.unknown) == (1, 0)


def test_a_new_command_comes_from_a_page(listed: list[object]) -> None:
    text = json.dumps({"type": "brow", "height": 0.25})
    assert messages.parse_request(text) == messages.Tell(RaiseBrow(0.25))
    with pytest.raises(DataError, match=r"height: got 0\.6, expected a number, 0 to 0\.5 \(at message 'brow'\)"):
        messages.parse_request(json.dumps({"type": "brow", "height": 0.6}))


def test_a_new_command_is_sent_by_the_client(listed: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    with Client(port=9, session="anna") as face:
        sent: list[tuple[object, bool]] = []
        monkeypatch.setattr(face, "_send", lambda message, *, repeats: sent.append((message, repeats)))
        face.send_command(RaiseBrow(0.25))
        with pytest.raises(UsageError, match="command: got Begin, expected one that concerns no utterance"):
            face.send_command(commands.Begin(1))
    assert sent == [(schema.SessionCommand("anna", RaiseBrow(0.25)), True)]


def test_a_new_command_reaches_its_motion_within_its_range(listed: list[object]) -> None:
    engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1))
    engine.open("anna", 0.0)
    engine.apply("anna", RaiseBrow(0.25, over_s=9.0), 1.0)
    engine.apply("anna", RaiseBrow(0.6), 1.0)
    assert listed == [(0, RaiseBrow(0.25, over_s=2.0), 1.0)]
    assert engine.counters("anna").refused == 1


def test_a_new_command_is_in_the_tables_of_the_documentation(listed: list[object]) -> None:
    assert (
        "| `/fap/1/brow` | `sf[i]` | session, height_deg, over_us | raise a brow: height_deg up |"
        in command_tables.osc_table()
    )
    assert (
        "| `brow` | `height` (rad 0 to 0.5, up); [`over`] (s 0.01 to 2) | raise a brow |" in command_tables.json_table()
    )


@pytest.mark.parametrize("name", sorted(command_tables.PAGES))
def test_the_tables_of_the_documentation_are_current(name: str) -> None:
    assert command_tables.page(name) == (command_tables.DOCS / name).read_text(), "run: python -m design.command_tables"


def python_name(kind: type[Command]) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()


@pytest.mark.parametrize("kind", commands.COMMANDS, ids=python_name)
def test_names_outside_are_there_and_unique(kind: type[Command]) -> None:
    spec = kind.SPEC
    assert spec.doc
    assert spec.osc in schema.from_sender()
    assert bool(spec.one_shot) <= spec.is_direct
    for name in ("osc", "one_shot", "json"):
        others = [getattr(other.SPEC, name) for other in commands.COMMANDS if other is not kind]
        assert not getattr(spec, name) or getattr(spec, name) not in others


@pytest.mark.parametrize("kind", [kind for kind in commands.COMMANDS if kind.SPEC.is_direct], ids=python_name)
def test_the_client_has_a_method_of_the_commands_name_and_defaults(kind: type[Command]) -> None:
    method = inspect.signature(getattr(Client, python_name(kind))).parameters
    described = inspect.signature(kind).parameters
    renamed = {"expression": "name", "at_s": None}
    endless = {"hold_s": None}
    for name in fields_of(kind):
        if (ours := renamed.get(name, name)) is None:
            continue
        default = described[name].default
        if default is not inspect.Parameter.empty:
            assert method[ours].default == endless.get(name, default)
        assert ours in method


def test_a_head_turns_by_what_is_asked_for_and_is_straight_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Command] = []
    monkeypatch.setattr(Client, "send_command", lambda client, command: sent.append(command))
    with Client(port=9) as face:
        for asked in ({}, {"pitch_rad": 0.1}, {"yaw_rad": 0.1}, {"roll_rad": 0.1}):
            face.turn_head(**asked)
            straight = {"pitch_rad": 0.0, "yaw_rad": 0.0, "roll_rad": 0.0}
            assert sent.pop() == commands.TurnHead(**straight | asked)


def test_the_page_sends_only_messages_that_there_are() -> None:
    sent = set()
    for file in (*(ROOT / "web-page").glob("*.js"), *(ROOT / "fapengine-face").glob("*.js")):
        sent |= set(re.findall(r"""\bsend\(\s*(?:wanted \? )?"(\w+)"(?: : "(\w+)")?""", file.read_text()))
    names = {name for pair in sent for name in pair if name}
    assert names <= set(messages.structs())
    assert {"say", "pin", "express", "look", "pause", "resume", "plays", "ping"} <= names


def test_commands_that_may_be_repeated_are_these():
    repeatable = {kind.__name__ for kind in commands.COMMANDS if kind.SPEC.is_repeatable}
    assert repeatable == {"Express", "Look", "TurnHead", "SetParameter"}


def test_pages_that_join_later_are_told_what_lasts():
    lasting = {kind.__name__ for kind in commands.COMMANDS if kind.SPEC.is_shown}
    assert lasting == {"Express", "TurnHead", "SetParameter"}


def test_times_from_the_arrival_are_whole_microseconds_and_zero_is_now():
    time = Time(osc="at_us")
    assert (time.to_osc(1.5), time.to_osc(None), time.to_osc(-3.0)) == (1_500_000, -1, -1)
    assert [time.from_osc(value) for value in (1_500_000, 1, 0, -1)] == [1.5, 1e-6, None, None]
    for named, message in ((time, "at_us: got inf"), (Time(), "time: got inf")):
        with pytest.raises(UsageError, match=f"^{message}, expected a finite time"):
            named.checked(inf)


def test_a_duration_without_an_end_is_minus_one_in_osc():
    duration = EndlessDuration()
    assert [duration.to_osc(value) for value in (1.5, inf)] == [1_500_000, -1]
    assert [duration.from_osc(value) for value in (1_500_000, 0, -1)] == [1.5, 0.0, inf]


def test_numbers_of_the_server_s_own_utterances_and_of_phones_fit_into_the_int32_of_osc():
    assert commands.VOICE_UTTERANCES + 1_000_000 < 2**31
    assert checked(most := commands.End(1, 2**31 - 1, 1.0)) == most
    with pytest.raises(UsageError, match="got 2147483648"):
        checked(commands.End(1, 2**31, 1.0))


@pytest.mark.parametrize("kind", commands.COMMANDS, ids=python_name)
def test_a_value_out_of_range_is_named_as_its_sender_names_it(kind: type[Command]) -> None:
    for spec in fields_of(kind).values():
        if isinstance(spec, Choice | Time):
            continue
        name = spec.json or spec.osc or "value"
        for value in (nan,) if isinstance(spec, Duration) else (spec.low - 1, spec.high + 1):
            if not isinf(value):
                with pytest.raises(UsageError) as told:
                    spec.checked(value)
                assert str(told.value) == f"{name}: got {value}, expected {spec.low:g} to {spec.high:g}"
