"""Our OSC against python-osc, in one run: how many times longer the library takes for the same message.

Run ``python -m bench.osc``. Ratios travel, seconds belong to a machine: the rounds time both, one after the other, and
the shortest of each is compared. The last column is what the library would take beyond ours for :data:`SESSIONS`
sessions, at the rates of :data:`PER_SESSION_HZ`, as a share of one core.
"""

import time
from collections.abc import Callable

import numpy as np
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder

from fapengine.engine.commands import Look
from fapengine.mpeg4 import fap
from fapengine.wire import fap_osc, osc
from fapengine.wire.speech_osc import codec, schema

SESSIONS = 500
CROWD = 20
"""Sessions whose frames are written in one call."""
ROUNDS, CALLS = 200, 5
PER_SESSION_HZ = {"frame": 60.0, "phones": 5.0, "ack": 5.0, "pong": 0.5, "look": 1.0}
"""Messages a second, of each kind, that a speaking session sends or receives."""


def packets() -> dict[str, bytes]:
    """One packet of each kind: a frame of all low-level FAPs, 24 phones as a sender repeats them, and control."""
    frames = fap_osc.SessionFrames()
    values = np.arange(fap.FAP_COUNT, dtype=np.int32)[None] * 7
    phones = tuple(schema.WirePhone("aɪ" if n % 3 else "m", n * 80_000, 80_000) for n in range(24))
    return {
        "frame": frames.encode(("anna",), values, 40_000)[0],
        "phones": codec.encode(schema.Phones("anna", 7, 3, 16, phones, 0)),
        "ack": codec.encode(schema.Ack("anna", 7, 24, 0, 500_000, 0, 0)),
        "pong": codec.encode(schema.Pong(3, 1_000_000, 2_000_000, 2_000_100, 77)),
        "look": codec.encode(schema.SessionCommand("anna", Look(0.2, -0.1))),
    }


def build_with_library(message: osc.Message) -> bytes:
    """Build a message with python-osc."""
    builder = OscMessageBuilder(message.address)
    for tag, value in zip(message.tags, message.arguments, strict=True):
        builder.add_arg(value, tag)
    built: bytes = builder.build().dgram
    return built


def compare(ours: Callable[[], object], theirs: Callable[[], object]) -> tuple[float, float]:
    """Give the shortest times of a call, s."""
    shortest_s = [float("inf"), float("inf")]
    for _ in range(ROUNDS):
        for index, function in enumerate((ours, theirs)):
            start_s = time.perf_counter()
            for _ in range(CALLS):
                function()
            shortest_s[index] = min(shortest_s[index], (time.perf_counter() - start_s) / CALLS)
    return shortest_s[0], shortest_s[1]


def main() -> None:
    frames, values = fap_osc.SessionFrames(), np.arange(fap.FAP_COUNT, dtype=np.int32)[None].repeat(CROWD, 0)
    names = tuple(f"s{number}" for number in range(CROWD))
    print(f"{'':14}{'library : ours':>16}{'µs more':>10}{'of a core':>15}")
    for name, packet in packets().items():
        (message,) = osc.parse_packet(packet)
        assert build_with_library(message) == packet
        rows = {"read": (lambda packet=packet: osc.parse_packet(packet), lambda packet=packet: OscMessage(packet))}
        ours = (
            (lambda: frames.encode(names, values, 40_000))
            if name == "frame"
            else (lambda message=message: osc.message(message.address, message.tags, *message.arguments))
        )
        times = CROWD if name == "frame" else 1
        rows["write"] = (ours, lambda message=message, times=times: [build_with_library(message) for _ in range(times)])
        for way, (mine, theirs) in rows.items():
            mine_s, theirs_s = compare(mine, theirs)
            more_s = (theirs_s - mine_s) / (CROWD if name == "frame" and way == "write" else 1)
            core = more_s * SESSIONS * PER_SESSION_HZ[name]
            print(f"{name + ', ' + way:14}{theirs_s / mine_s:16.1f}{1e6 * more_s:10.1f}{100 * core:14.0f}%")


if __name__ == "__main__":
    main()
