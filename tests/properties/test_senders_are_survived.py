"""Whatever senders send: no exception from receiver, engine or sender, and everything is counted."""

import random
from dataclasses import asdict
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.engine.commands import Cancel
from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits
from fapengine.trajectory.style import Style
from fapengine.wire import osc
from fapengine.wire.speech_osc import codec, schema
from fapengine.wire.speech_osc.one_shot import ADDRESSES, nameless
from fapengine.wire.speech_osc.peers import WireLimits
from fapengine.wire.speech_osc.receiver import OscReceiver
from fapengine.wire.speech_osc.sender import OscSender
from tests.english import english

LIMITS = WireLimits(peers=8, utterances=8, texts=4)
STRANGE_NUMBERS = (0, 1, -1, 2, 63, 64, 255, 256, 2**31 - 1, -(2**31), 2**63 - 1, -(2**63), 10**12)
STRANGE_FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, 3.4e38, float("inf"), float("-inf"), float("nan"), 600.0)
STRINGS = (
    "",
    "anna",
    "b",
    "face",
    "now",
    "at",
    "audio",
    "ipa",
    "arpabet",
    "m",
    "ɑ",
    "PP",
    "joy",
    "jaw",
    "az:21",
    "x" * 40,
)


def engine() -> Engine:
    limits = Limits(sessions=3, utterances=4, phones=300, queued_s=60.0)
    return Engine(english(), rng=np.random.default_rng(1), limits=limits, style=Style.speech_only())


def strange_message(rng: random.Random) -> bytes:
    """A message of the schema, mostly of the right types, with values from the edges."""
    kinds = [*schema.from_sender().values(), *get_args(schema.FromEngine)]
    if rng.random() < 0.3:
        address = rng.choice([*ADDRESSES, *nameless(), "/zz", "/fap/1/frame"])
        tags = "".join(rng.choice("sif") for _ in range(rng.randrange(5)))
    else:
        kind = rng.choice(kinds)
        address, tags = codec.layout(kind).address, codec.layout(kind).tags
        if kind is schema.Phones:
            tags += schema.Phones.ROW_TAGS * rng.randrange(4)
        if rng.random() < 0.2:
            tags = tags[: rng.randrange(len(tags) + 1)] + "".join(
                rng.choice("sifhdTFNb") for _ in range(rng.randrange(3))
            )
    values: list[osc.Argument] = []
    for place, tag in enumerate(tags):
        if tag in "ih":
            value: osc.Argument = rng.choice(STRANGE_NUMBERS) if rng.random() < 0.4 else rng.randrange(0, 400_000)
            if address == schema.Phones.ADDRESS and place == 4:
                value = (len(tags) - 5) // 5
            if address == schema.Phones.ADDRESS and place == 3:
                value = rng.randrange(12)
            if place == 1 and rng.random() < 0.8:
                value = rng.randrange(4)
            bits = 31 if tag == "i" else 63
            value = max(min(int(value), 2**bits - 1), -(2**bits))
        elif tag in "fd":
            value = rng.choice(STRANGE_FLOATS) if rng.random() < 0.3 else rng.uniform(0, 2)
        elif tag == "s":
            value = rng.choice(STRINGS) if place else rng.choice(STRINGS[1:4])
        elif tag == "b":
            value = rng.randbytes(rng.randrange(1, 9))
        else:
            value = {"T": True, "F": False, "N": None}[tag]
        values.append(value)
    return osc.message(address, tags, *values)


def strange_packet(rng: random.Random) -> bytes:
    packet = strange_message(rng)
    choice = rng.random()
    if choice < 0.2:
        parts = [packet, *(strange_message(rng) for _ in range(rng.randrange(4)))]
        tag = rng.choice([1, 0, 2**64 - 1, (2_208_988_800 + 1_790_000_000) << 32, rng.getrandbits(64)])
        packet = b"#bundle\0" + tag.to_bytes(8, "big") + b"".join(len(part).to_bytes(4, "big") + part for part in parts)
        for _ in range(rng.randrange(12) if rng.random() < 0.2 else 0):
            packet = b"#bundle\0" + bytes(7) + b"\1" + len(packet).to_bytes(4, "big") + packet
    if choice > 0.85:
        damaged = bytearray(packet)
        for _ in range(rng.randrange(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        packet = bytes(damaged)
    if choice > 0.95:
        packet = packet[: rng.randrange(len(packet))]
    return packet


@pytest.mark.parametrize("token", [None, "key"])
@pytest.mark.parametrize("seed", range(3))
def test_a_storm_of_strange_packets_is_survived_and_counted(seed, token):
    rng = random.Random(seed)
    faces = engine()
    receiver = OscReceiver(faces, token=token, limits=LIMITS)
    sender = OscSender("anna", instance=3)
    if token:
        receiver.receive(codec.encode(schema.Hello("anna", token=token, flags=1)), 0, 10.0, 1.79e9)
    now_s, answered = 10.0, 0
    for step in range(2500):
        packet = strange_packet(rng)
        before = receiver.counts.messages + receiver.counts.malformed
        answers = receiver.receive(packet, rng.randrange(12), now_s, 1.79e9 + rng.choice([0, 0, 0, 1e6, -1e6]) + now_s)
        assert receiver.counts.messages + receiver.counts.malformed > before or packet[16:] == b""
        if step % 10 == 0:
            now_s += rng.choice([0.001, 0.02, 0.02, 1.5])
            frame = faces.frame(now_s)
            assert frame.faps.shape == (len(faces.sessions), 68)
            answers += receiver.tick(now_s)
        for _, answer in answers:
            answered += 1
            sender.receive(answer, now_s)
        if step % 50 == 0:
            sender.due(now_s)
            receiver.texts()
    counts = receiver.counts
    assert counts.packets == 2500 + bool(token)
    assert min(counts.malformed, counts.unknown, counts.surplus, counts.refused) > 20
    assert (min(counts.repeated, counts.clamped) > 5) or token
    assert answered > 100
    assert len({*receiver._joined, *receiver._strangers}) <= 2 * LIMITS.peers
    assert len(faces.sessions) <= 3
    assert min(asdict(counts).values()) >= 0
    for name in faces.sessions:
        faces.apply(name, Cancel(), now_s)
    faces.frame(now_s)
    assert {faces.state(name) for name in faces.sessions} == {"idle"}


@given(st.binary(max_size=200))
def test_any_bytes_are_survived_by_both_sides(data):
    faces = engine()
    receiver, sender = OscReceiver(faces, limits=LIMITS), OscSender("anna", instance=3)
    answers = receiver.receive(data, "a", 1.0, 1.79e9)
    assert receiver.counts.packets == 1
    assert [sender.receive(packet, 1.0) is not None for packet in (data, *(packet for _, packet in answers))]


def test_a_flood_of_sessions_and_utterances_stays_within_its_limits():
    faces = engine()
    receiver = OscReceiver(faces, limits=LIMITS)
    phones = tuple(schema.WirePhone("m", 1000 * n, 1000) for n in range(40))
    for number in range(300):
        receiver.receive(codec.encode(schema.Hello(f"s{number}", flags=1)), number, 1.0, 1.79e9)
        receiver.receive(codec.encode(schema.BeginUtterance("s0", number, anchor="audio")), 0, 1.0, 1.79e9)
        for first in range(0, 120, 40):
            receiver.receive(codec.encode(schema.Phones("s0", number, 0, first, phones)), 0, 1.0, 1.79e9)
    assert len(faces.sessions) == 3
    assert receiver.counts.refused == 297 + 296 + 5  # sessions, utterances beyond 4, messages beyond 300 phones
    assert faces.counters("s0").refused > 0
    faces.frame(1.1)
    assert len(receiver.tick(1.1)) < 1000


def test_the_largest_packets_hold_a_bounded_number_of_messages():
    receiver = OscReceiver(engine())
    element = b"\0\0\0\4/\0\0\0"
    packet = b"#bundle\0" + bytes(7) + b"\1" + element * ((WireLimits().packet - 16) // len(element))
    receiver.receive(packet, "a", 1.0, 1.79e9)
    assert receiver.counts.unknown == receiver.counts.messages == WireLimits().messages
    assert receiver.counts.refused == 2046 - WireLimits().messages
    receiver.receive(packet + element, "a", 1.0, 1.79e9)
    assert receiver.counts.malformed == 1
