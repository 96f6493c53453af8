"""Every command over real sockets: what :mod:`tests.simulation.any_command` does, to a server in a process of its own.

    python -m tests.live.any_command [--minutes 5] [--rate 15] [--seed 1]

Commands go as OSC over UDP, each of them with any arguments that its table allows; what every second face is told is
damaged now and then, so that nobody knows how far it may open. Frames come back as ``/fap/1/frame``. In each must hold
what holds there; besides, the server answers to the end, counts no fault, does not grow, and all lips rest at the end.
"""

import argparse
import os
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.live import Server, serving
from bench.live_load import listening
from fapengine.engine import commands
from fapengine.engine.command_table import shifted
from fapengine.engine.commands import Append, Audio, Begin, Cancel, Command, End, Express, Seek
from fapengine.expressions import EXPRESSIONS
from fapengine.mpeg4 import fap
from fapengine.wire.fap_osc import decode_frame
from fapengine.wire.speech_osc import codec, schema
from tests.simulation.any_command import INNER, Face, Trial

CONFIG = """[style]
blinks = false
head_motion = false
gaze = false
idle = false
emphasis = false
[limits]
silence_s = 1
wait_s = 3
"""
PACKET_PHONES = 12
DAMAGED = 0.05
"""Share of the messages to every second face that have a byte changed."""
SETTLE_S = 11.5
"""The slowest fade and its closures, in the server's time, which its frames tell."""
LIMIT_S = 300.0
"""Time on the wall in which a server shows so many seconds: only one that hangs takes longer."""
GROWTH_MB = 8.0


@dataclass
class WireTrial(Trial):
    """Faces of a server at ``address``, whose frames come to ``ear``."""

    address: tuple[str, int] = ("", 0)
    ear: socket.socket = field(default_factory=listening)
    seen: dict[str, int] = field(default_factory=dict)
    rows: dict[str, np.ndarray] = field(default_factory=dict)
    """The last frame of each."""
    shown_s: float = 0.0
    """Time of the latest frame, on the server's clock."""

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.watched = {f"face {n}": Face(f"face {n}", is_natural=n % 2 == 0) for n in range(self.faces)}
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.out.connect(self.address)
        for name in self.watched:
            self.out.send(codec.encode(schema.Hello(name)))

    def tell(self, face: Face, command: Command) -> None:
        """Send a command; a face that is natural gets neither moods nor gains."""
        if face.is_natural and isinstance(command, Express | commands.SetParameter):
            return
        for message in messages(face.name, command, self.now_s):
            packet = bytearray(codec.encode(message))
            if not face.is_natural and self.rng.random() < DAMAGED and len(packet) > 60:
                packet[int(self.rng.integers(len(packet) - 8, len(packet)))] ^= 1 << int(self.rng.integers(8))
            self.out.send(packet)
        self.told[type(command).__name__] += 1
        self.recent.append(f"{self.now_s:.3f} {face.name} {command}"[:300])
        face.note(command, self.now_s)

    def bounds(self, face: Face) -> tuple[float, float]:
        """Greatest opening and jaw; of a face that damaged messages reach nobody knows."""
        return super().bounds(face) if face.is_natural else (np.inf, np.inf)

    def listen(self) -> None:
        """Look at all frames that have come."""
        while True:
            try:
                frame = decode_frame(self.ear.recv(4096))
            except BlockingIOError:
                return
            face = self.watched.get(frame.session)
            if face is None:
                continue
            row, before = np.asarray(frame.values), self.seen.get(frame.session, frame.number - 9)
            self.seen[frame.session], self.rows[frame.session] = frame.number, row
            self.shown_s = max(self.shown_s, frame.time_us * 1e-6)
            self.frames += 1
            self.look_at(face, row, 1 / 60 if frame.number == before + 1 else 0.0)


def messages(session: str, command: Command, now_s: float) -> Iterator[schema.FromSender]:
    """Give the messages that tell a session a command; its times are of the sender's clock."""

    def us(seconds: float) -> int:
        return round(1e6 * seconds)

    def short(seconds: float) -> int:
        return max(min(us(seconds), 2**31 - 1), -(2**31))

    if isinstance(command, Begin):
        anchor_us = us(command.at_s)
        yield schema.BeginUtterance(session, command.utterance, command.revision, command.anchor, anchor_us)
    elif isinstance(command, Append):
        for first in range(0, len(command.phones), PACKET_PHONES):
            phones = tuple(
                schema.WirePhone(phone.label, us(phone.start_s), us(phone.duration_s), phone.stress)
                for phone in command.phones[first : first + PACKET_PHONES]
            )
            yield schema.Phones(session, command.utterance, 0, command.first_index + first, phones, command.revision)
    elif isinstance(command, End):
        duration_us = us(command.duration_s)
        yield schema.EndUtterance(session, command.utterance, command.phone_count, duration_us, 0, command.revision)
    elif isinstance(command, Cancel):
        number = -1 if command.utterance is None else command.utterance
        yield schema.CancelUtterance(session, number, -1, round(1000 * command.fade_s))
    elif isinstance(command, Seek):
        yield schema.SeekUtterance(session, command.utterance, short(command.position_s))
    elif isinstance(command, Audio):
        position_us = short(command.position_s)
        yield schema.AudioPosition(session, command.utterance, us(command.at_s), position_us, command.rate)
    else:
        yield schema.SessionCommand(session, shifted(command, -now_s))


def run(
    seconds: float, rate: float, seed: int, *, longest_s: float = np.inf, least: int = 0
) -> tuple[WireTrial, list[float]]:
    """Tell a server so many commands a second, at least some; gives the trial, and its memory every second, MB."""
    memory: list[float] = []
    with listening() as ear, listening() as other:
        ports = ear.getsockname()[1], other.getsockname()[1]
        with serving(*ports, config=CONFIG) as server:
            trial = WireTrial(seed, longest_s=longest_s, address=server.address, ear=ear)
            start_s = time.monotonic()
            while (now_s := time.monotonic() - start_s) < seconds or trial.told.total() < least:
                trial.now_s = now_s
                trial.listen()
                for _ in range(int(trial.rng.poisson(rate * 0.02))):
                    face = trial.watched[str(trial.of(*trial.watched))]
                    for command in trial.some(face):
                        trial.tell(face, command)
                if now_s > len(memory):
                    memory.append(_memory_mb(server))
                time.sleep(0.02)
            _come_to_rest(trial, start_s)
            told = server.metrics()
            if count := told.get('fapengine_intake_total{kind="faults"}', 0.0):
                trial.fail("faults", f"{count:.0f} faults")
    trial.out.close()
    return trial, memory


def _come_to_rest(trial: WireTrial, start_s: float) -> None:
    """Stop everything, and look whether all faces come to rest."""
    for face in trial.watched.values():
        trial.tell(face, Cancel(fade_s=0.2))
        for expression in () if face.is_natural else EXPRESSIONS:
            trial.tell(face, Express(expression, 0.0, attack_s=0.3))
    limit_s, until_s = time.monotonic() + LIMIT_S, trial.shown_s + SETTLE_S
    restless = dict(trial.rows)
    while restless and trial.shown_s < until_s and time.monotonic() < limit_s:
        time.sleep(0.05)
        trial.now_s = time.monotonic() - start_s
        trial.listen()
        restless = {name: row for name, row in trial.rows.items() if row[INNER].any() or row[fap.column(3)]}
    for name, row in restless.items():
        trial.fail("rest", f"{name}: {row[2:18].tolist()}")
    if len(trial.rows) < trial.faces:
        trial.fail("faults", f"frames of {sorted(trial.rows)} alone")


def _memory_mb(server: Server) -> float:
    pages = int(Path(f"/proc/{server.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def grew(memory: list[float]) -> bool:
    """Whether memory at the end is more than in the middle."""
    return len(memory) > 60 and max(memory[-9:]) > max(memory[len(memory) // 2 :][:9]) + GROWTH_MB


def main() -> int:
    """Run one trial, and print what it found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=15.0, help="commands a second")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    trial, memory = run(60 * chosen.minutes, chosen.rate, chosen.seed)
    print(f"{trial.now_s:.0f} s, {trial.frames} frames of {trial.faces} faces, {sum(trial.told.values())} commands: "
          f"{dict(trial.told)}; widest {dict(trial.worst)}; server {memory[0]:.0f} to {memory[-1]:.0f} MB")  # fmt: skip
    for kind, what in trial.first.items():
        print(f"{kind}: {trial.broken[kind]} times; first {what}")
    print("memory grew" if grew(memory) else "", "" if trial.broken else "all held")
    return bool(trial.broken or grew(memory))


if __name__ == "__main__":
    sys.exit(main())
