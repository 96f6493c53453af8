"""Records what fapengine.Client sends: ``python -m tests.snapshots.record NAME`` writes ``sessions/client-NAME.osc``.

The client is the real one, on a real socket, and is answered by the server of the replay, in real time. What is kept
are the client's datagrams and the times at which they came. A recording is made once: another one has other times.
"""

import asyncio
import sys
import time
from collections.abc import Callable

import fapengine
from fapengine import Phone
from tests.snapshots._live import LiveServer
from tests.snapshots.sessions import FOLDER, RATE_HZ, START_S

PHONES = [
    Phone("b", 0.0, 0.1), Phone("ɑː", 0.1, 0.35, 1), Phone("m", 0.35, 0.45), Phone("iː", 0.45, 0.7),
    Phone("p", 0.7, 0.8), Phone("uː", 0.8, 1.1),
]  # fmt: skip


def speaks(face: fapengine.Client) -> None:
    """Say phones that are all known, then a mood and gestures."""
    number = face.send_phones(PHONES)
    face.express("joy", 0.7, hold_s=0.5)
    face.look(0.1, -0.05)
    face.turn_head(yaw_rad=0.1, over_s=0.3)
    face.blink()
    face.wait_until_finished(number, 5.0)


def goes_on(face: fapengine.Client) -> None:
    """Say phones as they become known, with the sound's position; revise what is to come."""
    number = face.begin(audio=True)
    face.append(number, PHONES[:2])
    time.sleep(0.1)
    for step in range(6):
        face.audio_position(number, 0.15 * step)
        if step < 4:
            face.append(number, PHONES[2 + step : 3 + step])
        time.sleep(0.15)
    face.end(number, duration_s=1.4)
    face.wait_until_finished(number, 5.0)


def changes_its_mind(face: fapengine.Client) -> None:
    """Revise, pause, go on, seek, cancel."""
    number = face.send_phones(PHONES, at_s=time.monotonic() + 0.2)
    time.sleep(0.3)
    face.revise(number, [*PHONES[:3], Phone("s", 0.45, 0.9), Phone("ɑː", 0.9, 1.2)])
    time.sleep(0.2)
    face.pause()
    time.sleep(0.3)
    face.resume()
    time.sleep(0.1)
    face.seek(number, 0.1)
    time.sleep(0.2)
    face.set_parameter("jaw", 1.5)
    face.cancel(number)
    time.sleep(0.1)
    face.send_phones(PHONES[:3])
    time.sleep(0.6)


def tells_words(face: fapengine.Client) -> None:
    """Words with their times, pronounced by the client; a text for the server's voice."""
    number = face.send_words([("bright", 0.0, 0.3), ("moon", 0.3, 0.8)])
    face.end(number)
    face.wait_until_finished(number, 5.0)
    face.send_text("Feel pool.")
    time.sleep(1.0)


SCRIPTS: dict[str, Callable[[fapengine.Client], None]] = {
    "speaks": speaks, "goes-on": goes_on, "changes-its-mind": changes_its_mind, "tells-words": tells_words,
}  # fmt: skip


class _Door(asyncio.DatagramProtocol):
    """The server's socket. Stateful."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.server, self.clock = LiveServer(clock), clock
        self.lines: list[str] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.peer = addr
        self.lines.append(f"{self.clock() - START_S:.4f} client {data.hex()}")
        self.answer(self.server.datagram(data, "client"))

    def answer(self, replies: list[tuple[object, bytes]]) -> None:
        for _, data in replies:
            self.transport.sendto(data, self.peer)  # type: ignore[attr-defined]


async def record(name: str) -> list[str]:
    """Let a script speak; give the lines of the conversation."""
    begin_s = time.monotonic()
    loop = asyncio.get_running_loop()
    transport, door = await loop.create_datagram_endpoint(
        lambda: _Door(lambda: START_S + time.monotonic() - begin_s), local_addr=("127.0.0.1", 0)
    )
    port = transport.get_extra_info("sockname")[1]
    speaking = asyncio.create_task(asyncio.to_thread(_speak, SCRIPTS[name], port))
    while not speaking.done():
        door.answer(door.server.tick()[1])
        await asyncio.sleep(1 / RATE_HZ)
    speaking.result()
    transport.close()
    return [*door.lines, f"{door.clock() - START_S + 1.5:.1f} end"]


def _speak(script: Callable[[fapengine.Client], None], port: int) -> None:
    with fapengine.Client(port=port, session="anna") as face:
        face.wait(10.0)
        script(face)


def main() -> None:
    """Record one script."""
    name = sys.argv[1]
    lines = asyncio.run(record(name))
    (FOLDER / f"client-{name}.osc").write_text(f"# {SCRIPTS[name].__doc__}\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
