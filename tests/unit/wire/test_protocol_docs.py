"""docs/osc.md says what the code does."""

import re
import time
from pathlib import Path
from typing import get_args

import pytest

from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.one_shot import ADDRESSES, EVENT, nameless
from tests.unit.clients.test_sender_client import MAMA, SOON_S, Place

PAGE = (Path(__file__).parents[3] / "docs" / "osc.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(/fap/1/[a-z/]+)` \| `([a-z\[\]]+)` \| ([^|]+) \|", PAGE, flags=re.M)
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, flags=re.S | re.M)
KINDS = [*schema.from_sender().values(), *get_args(schema.FromEngine)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_message_is_documented_as_it_is(kind):
    layout = codec.layout(kind)
    rows = [row for row in ROWS if row[0] == layout.address]
    assert len(rows) == 1
    _, types, arguments = rows[0]
    needed, others = layout.tags[: layout.required], layout.tags[layout.required :]
    assert types == (f"{needed}[{others}]" if others else needed)
    names = list(layout.names)
    if kind is schema.Phones:
        assert names.pop() == "revision"
    if kind is schema.WordTimes:
        assert names.pop() == "voice"
    assert arguments.split(", ") == names


def test_nothing_else_is_documented():
    assert len(ROWS) == len(KINDS)
    simple = set(re.findall(r"`(/[a-z/]+)", PAGE[: PAGE.index("\n## Every phone")]))
    assert simple - {"/fap/"} == {*ADDRESSES, EVENT, *nameless()}


def test_the_bytes_are_those_of_the_encoder():
    (block,) = [text for language, text in BLOCKS if not language]
    spelled = "".join(re.match(r"((?:[0-9a-f]{8} ?)+)", line)[1] for line in block.strip().splitlines())
    phones = (schema.WirePhone("m", 0, 80_000, 1), schema.WirePhone("aɪ", 80_000, 120_000))
    assert bytes.fromhex(spelled) == codec.encode(schema.Phones("anna", 7, 3, 16, phones))


@pytest.mark.parametrize("number", [0, 1])
def test_the_python_examples_speak(number):
    code = [text for language, text in BLOCKS if language == "python" and "send_audio(" not in text][number]
    name, scope = ("face", "anna")[number], {}
    with Place() as place:
        exec(code.replace("9110", str(place.port)), scope)
        stop_s = time.monotonic() + SOON_S
        while place.receiver.counts.messages < len(MAMA):
            assert time.monotonic() < stop_s
            time.sleep(0.01)
        if number == 0:
            scope["face"]._sock.close()
        counts, counters = place.receiver.counts, place.engine.counters(name)
        assert (counts.malformed, counts.unknown, counts.surplus, counters.unknown) == (0, 0, 0, 0)
        assert counters.utterances == 1
        assert number == 0 or counters.finished == 1


def test_the_example_of_sound_sends_it():
    (code,) = [text for language, text in BLOCKS if language == "python" and "send_audio(" in text]
    with Place() as place:
        exec(code.replace("9110", str(place.port)), {})
        requests = place.receiver.sounds(0.0)
        assert sum(len(request.samples) for request in requests) == 10 * 320
        counts = place.receiver.counts
        assert (counts.malformed, counts.unknown, counts.surplus) == (0, 0, 0)


def test_the_page_names_all_kinds_of_events_and_the_limits():
    for kind in ("started", "underrun", "late", "concealed", "finished", "cancelled", "error", "unknown"):
        assert f"`{kind}`" in PAGE
    assert f"{schema.TEXT_BYTES} bytes" in PAGE
    assert f"1 to {schema.SESSION_BYTES} bytes, labels up to {schema.LABEL_BYTES}" in PAGE
