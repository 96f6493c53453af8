"""Senders and a receiver for a live server: many sessions that speak without end, in a process of their own.

    python -m bench.live_load --to HOST:PORT --hear PORT --sessions N --seconds S [--phones]

Each session is an ``OscSender`` with a socket of its own: clauses of two seconds, each sent whole when half a second of
the one before is left (TTS knows a clause before its sound begins), or, with ``--phones``, in chunks of a tenth of a
second, half a second ahead, each with two repeats. Acknowledgements are asked for and read. Frames of all sessions come
back to port PORT as ``/fap/1/frame``; what is missing in their numbers was lost or never shown. Prints JSON.
"""

import argparse
import heapq
import json
import select
import socket
import struct
import time
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fapengine.speech.phone_track import Phone
from fapengine.wire.speech_osc.schema import Moved
from fapengine.wire.speech_osc.sender import OscSender

PHONES_HZ, CLAUSE_PHONES = 12.0, 24
LEFT_S = 0.5
CHUNK_S, AHEAD_S = 0.1, 0.5
LABELS = ("m", "ɑː", "b", "iː", "p", "uː", "f", "ɛ", "v", "s", "t", "n", "k", "aɪ", "ʃ", "l")
JOIN_HZ, SETTLE_S = 100.0, 2.0
"""So many senders begin in a second; then it settles."""
NUMBER_AT, PLAIN_BYTES = 96, 388
"""Place of the number in a ``/fap/1/frame`` with 66 FAPs and a name of 5 letters (address 16 bytes, tags 72, name 8),
and the size of one; an epoch adds 4 bytes to each."""
HEAD = struct.Struct(">8siq")


def warming_s(sessions: int) -> float:
    """How long it takes until all speak and it has settled."""
    return sessions / JOIN_HZ + SETTLE_S


def name_of(session: int) -> str:
    """Five letters."""
    return f"s{session:04d}"


@dataclass(slots=True)
class Speaker:
    """Stateful: one session that speaks without end."""

    sender: OscSender
    socket: socket.socket
    rng: np.random.Generator
    chunked: bool
    utterance: int = -1
    ends_s: float = 0.0
    begun: int = 0
    waiting: list[Phone] = field(default_factory=list)
    zero_s: float = 0.0

    def work(self, now_s: float) -> float:
        """Say what is due and send it; gives when to come again."""
        if now_s >= self.ends_s - LEFT_S:
            self._begin(max(self.ends_s, now_s))
        if self.utterance not in self.sender.live:  # somebody cancelled it
            self.waiting = []
        while self.waiting and self.zero_s + self.waiting[0].start_s < now_s + AHEAD_S:
            self.sender.append(self.utterance, self._next_chunk())
            if not self.waiting:
                self.sender.end(self.utterance)
        for packet in self.sender.due(now_s):
            self.socket.send(packet)
        due_s = min(self.ends_s - LEFT_S, self.sender.next_s(now_s))
        if self.waiting:
            due_s = min(due_s, self.zero_s + self.waiting[0].start_s - AHEAD_S)
        return max(due_s, now_s + 0.002)

    def hear(self, now_s: float) -> None:
        """Take answers in."""
        while True:
            try:
                data = self.socket.recv(4096)
            except BlockingIOError:
                return
            for answer in self.sender.receive(data, now_s):
                if isinstance(answer, Moved):
                    self.socket.connect((self.socket.getpeername()[0], answer.port))
                    self.sender.move(now_s)
                    return

    def _begin(self, start_s: float) -> None:
        lengths = self.rng.lognormal(0.0, 0.35, CLAUSE_PHONES)
        edges = np.cumsum([0.0, *lengths / lengths.mean() / PHONES_HZ])
        labels = self.rng.choice(LABELS, CLAUSE_PHONES)
        phones = [Phone(str(label), float(a), float(b)) for label, (a, b) in zip(labels, pairwise(edges), strict=True)]
        self.utterance = self.sender.begin(time.monotonic())
        self.begun += 1
        self.zero_s, self.ends_s = start_s, start_s + phones[-1].end_s
        if self.chunked:
            self.waiting = phones
        else:
            self.sender.append(self.utterance, phones)
            self.sender.end(self.utterance)

    def _next_chunk(self) -> list[Phone]:
        stop_s = self.waiting[0].start_s + CHUNK_S
        chunk = [phone for phone in self.waiting if phone.start_s < stop_s]
        del self.waiting[: len(chunk)]
        return chunk


class Load:
    """Stateful: all speakers, and the socket that receives their frames."""

    def __init__(
        self, to: tuple[str, int], receiver: socket.socket, sessions: int, *, chunked: bool, seed: int = 0
    ) -> None:
        self.receiver = receiver
        self.frames: dict[bytes, list[int]] = {}
        """Of each session: frames heard, first number, last number."""
        self._poll = select.epoll()
        self._poll.register(receiver.fileno(), select.EPOLLIN)
        self.speakers: list[Speaker] = []
        self._by_file: dict[int, Speaker] = {}
        for session in range(sessions):
            own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            own.connect(to)
            own.setblocking(False)
            speaker = Speaker(
                OscSender(name_of(session), instance=session + 1, follows=True),
                own,
                np.random.default_rng((seed, session)),
                chunked,
            )
            self.speakers.append(speaker)
            self._by_file[own.fileno()] = speaker
            self._poll.register(own.fileno(), select.EPOLLIN)

    def run(self, seconds: float, warm_s: float) -> None:
        """Speak and hear; frames count after ``warm_s``."""
        start_s = time.monotonic()
        stop_s = start_s + warm_s + seconds
        spread_s = warm_s - SETTLE_S if warm_s else 0.0
        plan = [(start_s + spread_s * n / len(self.speakers), n) for n in range(len(self.speakers))]
        heapq.heapify(plan)
        counting = False
        while (now_s := time.monotonic()) < stop_s:
            if not counting and now_s > start_s + warm_s:
                counting, self.frames = True, {}
            while plan and plan[0][0] <= now_s:
                _, number = heapq.heappop(plan)
                heapq.heappush(plan, (self.speakers[number].work(now_s), number))
            wait_s = max(0.0, (plan[0][0] if plan else stop_s) - time.monotonic())
            for file, _ in self._poll.poll(min(wait_s, 0.1), 512):
                if file == self.receiver.fileno():
                    self._hear_frames()
                else:
                    self._by_file[file].hear(now_s)

    def _hear_frames(self) -> None:
        receive, frames, unpack = self.receiver.recv, self.frames, HEAD.unpack_from
        for _ in range(2000):
            try:
                data = receive(2048)
            except BlockingIOError:
                return
            session, number, _ = unpack(data, NUMBER_AT - 8 + 4 * (len(data) > PLAIN_BYTES))
            known = frames.get(session)
            if known is None:
                frames[session] = [1, number, number]
            else:
                known[0] += 1
                known[2] = number

    def close(self) -> None:
        """End."""
        for speaker in self.speakers:
            speaker.socket.close()
        self._poll.close()

    def report(self) -> dict[str, object]:
        """Sum up: frames heard, and those missing between the first and the last of each session."""
        heard = sum(count for count, _, _ in self.frames.values())
        due = sum(last - first + 1 for _, first, last in self.frames.values())
        return {
            "sessions": len(self.frames), "heard": heard, "missing": due - heard,
            "utterances": sum(speaker.begun for speaker in self.speakers),
            "unfinished": sum(len(speaker.sender.live) for speaker in self.speakers),
        }  # fmt: skip


def listening(port: int = 0) -> socket.socket:
    """Open a socket with room for many frames."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    receiver.bind(("127.0.0.1", port))
    receiver.setblocking(False)
    return receiver


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--to", required=True)
    parser.add_argument("--hear", type=int, required=True)
    parser.add_argument("--sessions", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--phones", action="store_true")
    wanted = parser.parse_args()
    host, port = wanted.to.rsplit(":", 1)
    load = Load((host, int(port)), listening(wanted.hear), wanted.sessions, chunked=wanted.phones)
    cpu_s = time.process_time()
    warm_s = warming_s(wanted.sessions)
    load.run(wanted.seconds, warm_s)
    cpu_s = time.process_time() - cpu_s
    load.close()
    print(json.dumps(load.report() | {"load_cpu": cpu_s / (wanted.seconds + warm_s)}))


if __name__ == "__main__":
    main()
