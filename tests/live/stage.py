"""A whole server in a test: real sockets on loopback, the loop of the test, a receiver of frames."""

import asyncio
import json
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4 import fap
from fapengine.server.config import Caps, Face, Listen, ServerConfig
from fapengine.server.server import Server
from fapengine.trajectory.style import Style
from fapengine.wire import osc
from fapengine.wire.fap_osc import FapFrame, decode_frame
from tests.english import english
from tests.patient import PatientClock
from tests.processes import start

JAW = fap.column(3)


@dataclass(eq=False)
class Ear:
    """Hears frames, and remembers them by session."""

    socket: socket.socket
    frames: dict[str, list[FapFrame]] = field(default_factory=dict)

    @classmethod
    def open(cls) -> "Ear":
        own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        own.bind(("127.0.0.1", 0))
        own.setblocking(False)
        OPENED.append(own)
        return cls(own)

    @property
    def port(self) -> int:
        port: int = self.socket.getsockname()[1]
        return port

    def listen(self) -> None:
        while True:
            try:
                frame = decode_frame(self.socket.recv(4096))
            except BlockingIOError:
                return
            self.frames.setdefault(frame.session, []).append(frame)

    def jaw(self, session: str) -> list[int]:
        """FAP 3 of every frame so far."""
        self.listen()
        return [int(frame.values[JAW]) for frame in self.frames.get(session, [])]

    def missing(self, session: str) -> int:
        """Frames lost on the way: gaps in the numbers."""
        self.listen()
        numbers = [frame.number for frame in self.frames.get(session, [])]
        return numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0

    def close(self) -> None:
        self.socket.close()


class Sender:
    """Sends OSC messages from a socket of its own."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        OPENED.append(self.socket)
        self.socket.connect(address)
        self.socket.setblocking(False)

    def tell(self, address: str, tags: str = "", *values: osc.Argument) -> None:
        self.socket.send(osc.message(address, tags, *values))

    def answers(self) -> list[osc.Message]:
        found: list[osc.Message] = []
        while True:
            try:
                found += osc.parse_packet(self.socket.recv(65536))
            except (BlockingIOError, ConnectionRefusedError):
                return found

    def utter(self, session: str, utterance: int, labels: str, *, phone_s: float = 0.12, ends: bool = True) -> None:
        """Say phones, all at once, in the robust mode: one letter a phone."""
        step = round(1e6 * phone_s)
        self.tell("/fap/1/utt/begin", "siishss", session, utterance, 0, "now", 0, "ipa", "")
        phones = [part for n, label in enumerate(labels) for part in (label, n * step, step, 0, 1.0)]
        self.tell("/fap/1/phones", "siiii" + "siiif" * len(labels), session, utterance, 0, 0, len(labels), *phones)
        if ends:
            self.tell("/fap/1/utt/end", "siii", session, utterance, len(labels), step * len(labels))

    def close(self) -> None:
        self.socket.close()


def config_of(*sinks: str, port: int = 0, token: str | None = None, **limits: float) -> ServerConfig:
    """A quiet server: nothing moves by itself, no page."""
    return ServerConfig(
        listen=Listen(port=port, web_port=None, token=token),
        face=Face(rate_hz=60.0),
        style=Style.speech_only(),
        limits=Caps(**limits),  # type: ignore[arg-type]
        sinks=sinks,
    )


@asynccontextmanager
async def running(
    config: ServerConfig, head: FaceMesh | None = None, clock: PatientClock | None = None
) -> AsyncIterator[Server]:
    """Run a server inside, and drain it at the end; a patient clock waits for each of its frames."""
    server = Server(config, english(), head, clock=clock or time.monotonic)
    if clock is not None:
        server.hub.listeners.on_frames(lambda frames: clock.allow(server, 1 / config.face.rate_hz))
    await server.start()
    task = asyncio.create_task(server.run())
    try:
        yield server
    finally:
        if clock is not None:
            clock.free(server)
        server.stop()
        await task


def on_a_loop(main: Callable[[], Coroutine[None, None, None]], limit_s: float = 600.0) -> None:
    """Run a test, with a limit so that none hangs."""

    async def whole() -> None:
        await main()
        for _ in range(5):
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(whole(), limit_s))


async def until(true: Callable[[], bool], limit_s: float = 300.0) -> None:
    """Let the loop work until something is so."""
    stop_s = asyncio.get_running_loop().time() + limit_s
    while not true():
        if asyncio.get_running_loop().time() > stop_s:
            raise AssertionError("it never became so")
        await asyncio.sleep(0.01)


STARTED: list[subprocess.Popen[bytes]] = []
"""Servers in processes of their own; when a test is over they are ended."""
OPENED: list[socket.socket] = []
"""Sockets of ears and senders; when a test is over, and failed, they are closed all the same."""


class Serve:
    """``fapengine serve`` in a process of its own."""

    def __init__(
        self, log: Path, ear: Ear, port: int = 0, *more: str, environment: Mapping[str, str] | None = None
    ) -> None:
        page = [] if "--web-port" in more else ["--no-page"]
        command = [sys.executable, "-m", "fapengine", "serve", *page, "--log", "json", "--port", str(port)]
        command += ["--without", "all", "--sink", f"osc://127.0.0.1:{ear.port}", *more]
        with log.open("w") as file:
            self.process = start(command, stdout=file, stderr=file, env=environment)
        STARTED.append(self.process)
        self.log = log
        wait(lambda: "\n" in log.read_text() or self.process.poll() is not None)
        ready = json.loads(log.read_text().splitlines()[0])
        assert ready["message"] == "ready"
        self.where = {one["what"]: one["where"] for one in ready["listens"]}
        self.port = int(self.where["OSC in"].split()[0].rsplit(":", 1)[1])
        self.address = ("127.0.0.1", self.port)

    def end(self, number: int) -> int:
        self.process.send_signal(number)
        return self.process.wait(300)


def wait(true: Callable[[], bool], limit_s: float = 300.0, work: Callable[[], object] = lambda: None) -> None:
    stop_s = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < stop_s, "it never became so"
        work()
        time.sleep(0.01)
