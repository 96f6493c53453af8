"""Conversations with a live server, replayed frame by frame on a virtual clock.

A file of ``sessions/`` is a conversation, a line an event: the time in s, who, and what::

    0.50 a /phoneme sf m 0.2          an OSC message of peer a: address, types, values
    0.70 b 2f6661702f...              a datagram of peer b, as fapengine.Client sent it
    1.00 page enter anna              a page is opened on a session, and left
    1.20 page {"type": "blink"}       what it sends over its WebSocket
    4.00 end

The server makes 60 frames a second. Digests are of the FAPs of each session, in whole and second by second, of what
peers are answered, and of what pages are sent.
"""

import asyncio
import hashlib
import json
import shlex
import struct
from collections import defaultdict
from collections.abc import AsyncIterator, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from aiohttp import WSMessage, WSMsgType

from tests.snapshots._live import LiveServer
from tests.snapshots.digests import DIGITS, NUMBER, rounded

FOLDER = Path(__file__).with_name("sessions")
DIGESTS = FOLDER / "digests.txt"
VOICED = ("client-tells-words", "page-that-plays", "words-and-marks")
"""Conversations with a voice, which may speak a little differently the second time in one process; the others are
tests of the engine.
"""
RATE_HZ = 60
START_S = 1000.0
"""Engine time of the beginning."""
SETTLE_S = 60.0
"""Time on the wall that a voice may take before the replay is given up."""
Event = tuple[float, str, str]
"""Time in s, who, what."""


def conversations() -> list[str]:
    """Names of the recorded conversations."""
    return sorted(path.stem for path in FOLDER.glob("*.osc"))


def events_of(name: str) -> tuple[list[Event], float]:
    """Read a conversation: its events, and when it ends."""
    events: list[Event] = []
    for line in (FOLDER / f"{name}.osc").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        time, who, *what = line.split(maxsplit=2)
        if who == "end":
            return sorted(events, key=lambda event: event[0]), float(time)
        events.append((float(time), who, what[0]))
    raise ValueError(f"{name}: got no end, expected a last line such as 4.0 end")


def replay(name: str) -> dict[str, str]:
    """Replay a conversation; digests by what they are of."""
    return asyncio.run(_replay(name))


async def _replay(name: str) -> dict[str, str]:
    events, end_s = events_of(name)
    clock = Clock()
    world = World(LiveServer(clock))
    for tick in range(round(end_s * RATE_HZ)):
        clock.now_s = START_S + tick / RATE_HZ
        while events and events[0][0] <= tick / RATE_HZ + 1e-9:
            _, who, what = events.pop(0)
            world.take(who, what)
            await world.settle()
        world.tick(tick)
        await world.settle()
    await world.close()
    return world.digests()


@dataclass
class Clock:
    """Time that the replay turns. Stateful."""

    now_s: float = START_S

    def __call__(self) -> float:
        return self.now_s


@dataclass(eq=False)
class Socket:
    """A page's WebSocket: what it says comes from the conversation, what it is sent is kept. Stateful."""

    sent: list[bytes]
    said: asyncio.Queue[str | None] = field(default_factory=asyncio.Queue)
    closed: bool = False

    async def __aiter__(self) -> AsyncIterator[WSMessage]:
        while (text := await self.said.get()) is not None:
            yield WSMessage(WSMsgType.TEXT, text, None)

    async def send_str(self, text: str) -> None:
        self.sent.append(_without_prose(text))

    async def send_bytes(self, frame: bytes) -> None:
        self.sent.append(frame)

    async def close(self, **_: object) -> None:
        self.closed = True


def _without_prose(text: str) -> bytes:
    """Leave the kind and the numbers of a message for a page; its words may be reworded."""
    try:
        message = json.loads(text)
    except ValueError:
        return b""
    kept = {key: value for key, value in message.items() if key not in ("message", "text", "reason")}
    return NUMBER.sub(lambda match: rounded(float(match[0]), 3), json.dumps(kept, sort_keys=True)).encode()


@dataclass(eq=False)
class World:
    """A server and those who talk to it. Stateful."""

    server: LiveServer
    frames: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    """FAPs of each session, little-endian int32, a frame an item."""
    ticks: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    answers: dict[Hashable, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    pages: dict[str, tuple[Socket, asyncio.Task[None]]] = field(default_factory=dict)
    sent: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))

    def take(self, who: str, what: str) -> None:
        """Let an event happen."""
        if what.startswith("enter "):
            socket = Socket(self.sent[who])
            page = self.server.page(socket, what.partition(" ")[2])
            self.pages[who] = socket, asyncio.ensure_future(page)
        elif what == "leave":
            self.pages.pop(who)[0].said.put_nowait(None)
        elif what.startswith("{"):
            self.pages[who][0].said.put_nowait(what)
        else:
            data = osc_message(what) if what.startswith("/") else bytes.fromhex(what)
            self._note(self.server.datagram(data, who))

    def tick(self, number: int) -> None:
        """Make a frame."""
        frames, replies = self.server.tick()
        for session, faps in frames.items():
            self.frames[session].append(np.asarray(faps, "<i4").tobytes())
            self.ticks[session].append(number)
        self._note(replies)

    def _note(self, replies: Sequence[tuple[Hashable, bytes]]) -> None:
        for peer, data in replies:
            self.answers[peer].append(data)

    async def settle(self) -> None:
        """Wait until voices have spoken and pages are written to: no more tasks than a reader and a writer a page."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + SETTLE_S
        for _ in range(12):
            await asyncio.sleep(0)
        while len(asyncio.all_tasks()) > 1 + 2 * len(self.pages):
            if loop.time() > until_s:
                raise TimeoutError(f"still running: {asyncio.all_tasks()}")
            await asyncio.sleep(0.001)

    async def close(self) -> None:
        """Let all pages leave."""
        for socket, task in self.pages.values():
            socket.said.put_nowait(None)
            await task
        self.pages.clear()

    def digests(self) -> dict[str, str]:
        """Say what happened: number of items and their SHA-256."""
        found = {}
        for session, frames in sorted(self.frames.items()):
            numbers = np.array(self.ticks[session])
            found[f"{session}, whole"] = _digest([*frames, numbers.astype("<i4").tobytes()])
            for second in range(numbers[0] // RATE_HZ, numbers[-1] // RATE_HZ + 1):
                part = [frame for frame, number in zip(frames, numbers, strict=True) if number // RATE_HZ == second]
                found[f"{session}, second {second}"] = _digest(part)
        found |= {f"answers to {peer}": _digest(data) for peer, data in sorted(self.answers.items(), key=str)}
        found |= {f"sent to {page}": _digest(data) for page, data in sorted(self.sent.items())}
        return found


def _digest(parts: Sequence[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(struct.pack("<I", len(part)) + part)
    return f"{len(parts)} {whole.hexdigest()[:DIGITS]}"


def osc_message(text: str) -> bytes:
    """Spell an OSC message: address, types and values as a line of a conversation has them."""
    address, *rest = shlex.split(text)
    types, values = (rest[0], rest[1:]) if rest else ("", [])
    packed = [_packed(kind, value) for kind, value in zip(types, values, strict=True)]
    return _padded(address.encode()) + _padded(b"," + types.encode()) + b"".join(packed)


def _packed(kind: str, value: str) -> bytes:
    if kind == "s":
        return _padded(("" if value == "-" else value).encode())
    if kind == "b":
        data = bytes.fromhex(value)
        return struct.pack(">I", len(data)) + data + bytes(-len(data) % 4)
    return struct.pack({"i": ">i", "h": ">q", "f": ">f", "d": ">d"}[kind], int(value) if kind in "ih" else float(value))


def _padded(data: bytes) -> bytes:
    return data + bytes(4 - len(data) % 4)


def write_digests(found: Mapping[str, Mapping[str, str]]) -> str:
    """Spell ``digests.txt``."""
    rows = [f"{name} | {what} | {digest}" for name, digests in found.items() for what, digest in digests.items()]
    return "\n".join(["# conversation | of what | number of items and their SHA-256, first digits", *rows]) + "\n"


def read_digests() -> dict[str, dict[str, str]]:
    """Read them: by conversation and what they are of."""
    found: dict[str, dict[str, str]] = {}
    if DIGESTS.exists():
        for line in DIGESTS.read_text(encoding="utf-8").splitlines():
            if not line.startswith("#"):
                name, what, digest = line.split(" | ")
                found.setdefault(name, {})[what] = digest
    return found
