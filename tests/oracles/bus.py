"""Several servers over a real NATS server: faces in one place each, elsewhere when a server is gone, never in two.

python -m tests.oracles.bus, with Debian's nats-server and nats-py.
"""

import os
import re
import signal
import socket
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fapengine.clients.sender import Client
from fapengine.clients.websocket_viewer import WebSocketViewer
from fapengine.speech.phone_track import Phone
from fapengine.wire.fap_osc import FapFrame
from tests.live.stage import JAW, Ear, Sender, Serve, wait
from tests.live.test_workers import assert_in_one_place
from tests.processes import free_port, start

SESSIONS = tuple(f"s{number}" for number in range(12))
LONG = [Phone(label, 0.12 * n, 0.12 * n + 0.12) for n, label in enumerate(["m", "a", "b", "a"] * 1000)]
OPEN = 50
REST_S, SPEECH_S = 0.3, 4.0
"""Bounds: lips at rest, speech again, after a server was killed."""


class Nats:
    """A NATS server of its own. Stateful."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.folder = folder
        self.process = self.start()

    @property
    def url(self) -> str:
        return f"nats://127.0.0.1:{self.port}"

    def start(self) -> "subprocess.Popen[bytes]":
        command = ["nats-server", "-js", "-sd", str(self.folder / "nats"), "-a", "127.0.0.1", "-p", str(self.port)]
        with (self.folder / "nats.log").open("a") as log:
            self.process = start(command, stdout=log, stderr=log)
        wait(lambda: _listens(self.port))
        return self.process

    def end(self, number: int = signal.SIGKILL) -> None:
        self.process.send_signal(number)
        self.process.wait(10)


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 0.5).close()
    except OSError:
        return False
    return True


class Server(Serve):
    """One server of several. Stateful."""

    @property
    def workers(self) -> list[int]:
        return [int(part.split(":")[1]) for part in self.where["workers"].split()]

    def metrics(self) -> dict[str, float]:
        text = urllib.request.urlopen(self.where["metrics"], timeout=10).read().decode()
        return {key: float(value) for key, value in re.findall(r"^([^#\s]\S*) (\S+)$", text, re.M)}

    def kill(self) -> float:
        """Kill the parent; the workers notice."""
        self.process.send_signal(signal.SIGKILL)
        return time.monotonic()


class Stage:
    """Servers, what they show, and senders. Stateful."""

    def __init__(self, folder: Path, servers: int = 3) -> None:
        self.folder, self.ear, self.nats = folder, Ear.open(), Nats(folder)
        self.servers: list[Server] = []
        for _ in range(servers):
            self.add()
        wait(lambda: all(server.metrics()["fapengine_machines"] == servers for server in self.servers))
        self.history: dict[str, list[FapFrame]] = {}

    def add(self, *more: str) -> Server:
        log = self.folder / f"log{len(self.servers)}"
        more = ("--nats", self.nats.url, "--metrics-port", "0", "--web-port", "0", *more)
        self.servers.append(Server(log, self.ear, 0, *more))
        return self.servers[-1]

    def talk(self, sessions: tuple[str, ...] = SESSIONS) -> dict[str, Client]:
        clients = {}
        for number, name in enumerate(sessions):
            addresses = [server.address for server in self.servers]
            first = number % len(addresses)
            host, port = addresses[first]
            others = addresses[first + 1 :] + addresses[:first]
            clients[name] = Client(host, port, session=name, fallback_addresses=others)
        for client in clients.values():
            client.wait(30.0).send_phones(LONG)
        wait(lambda: all(map(self.is_speaking, sessions)))
        return clients

    def is_speaking(self, session: str) -> bool:
        self.ear.listen()
        return any(frame.values[JAW] > OPEN for frame in self.ear.frames.get(session, [])[-60:])

    def forget(self) -> None:
        """Put away what was heard."""
        self.ear.listen()
        for name, frames in self.ear.frames.items():
            self.history.setdefault(name, []).extend(frames)
        self.ear.frames.clear()

    def end(self) -> None:
        for server in self.servers:
            if server.process.poll() is None:
                server.process.send_signal(signal.SIGTERM)
        for server in self.servers:
            server.process.wait(30)
        self.nats.end()
        self.ear.close()


@contextmanager
def staged(servers: int = 3) -> Iterator[Stage]:
    with tempfile.TemporaryDirectory() as folder, ExitStack() as at_end:
        stage = Stage(Path(folder), servers)
        at_end.callback(stage.end)
        yield stage


def _faces(server: Server) -> int:
    return round(sum(value for key, value in server.metrics().items() if key.startswith("fapengine_sessions{")))


def _check_one_place(stage: Stage) -> None:
    stage.forget()
    for frames in stage.history.values():
        assert_in_one_place(frames)


def check_server_is_killed() -> None:
    """The parent of one server of three is killed in a word: its workers shut the mouths, others speak on."""
    with staged() as stage:
        clients = stage.talk()
        wait(lambda: sum(_faces(server) for server in stage.servers) == len(SESSIONS))
        shares = [_faces(server) for server in stage.servers]
        assert min(shares) >= 1, shares
        stage.forget()
        before = {name: stage.history[name][-1].epoch for name in SESSIONS}
        busiest = stage.servers[shares.index(max(shares))]
        killed_s = busiest.kill()
        rest_s, speech_s = _times(stage, killed_s, before, max(shares))
        for _ in range(20):
            time.sleep(0.1)
            stage.ear.listen()
        moved = {name for name in SESSIONS if stage.ear.frames[name][-1].epoch > before[name]}
        assert len(moved) == max(shares), (moved, shares)
        _check_one_place(stage)
        print(f"bus: faces {shares}; a server killed: rest {max(rest_s):.2f}, speech {max(speech_s):.2f} s")
        assert max(rest_s) <= REST_S
        assert max(speech_s) <= SPEECH_S
        _close(clients)


def _times(stage: Stage, killed_s: float, before: dict[str, int], count: int) -> tuple[list[float], list[float]]:
    """Wait until as many sessions rest, and speak again under a higher epoch; gives the times of each."""
    rest_s: dict[str, float] = {}
    speech_s: dict[str, float] = {}
    seen: dict[str, int] = {}
    stop_s = time.monotonic() + 20.0
    while len(speech_s) < count and time.monotonic() < stop_s:
        stage.ear.listen()
        now_s = time.monotonic()
        for name, frames in stage.ear.frames.items():
            for frame in frames[seen.get(name, 0) :]:
                jaw = frame.values[JAW]
                if frame.epoch > before[name]:
                    if jaw > OPEN:
                        speech_s.setdefault(name, now_s - killed_s)
                elif jaw:
                    rest_s.pop(name, None)
                else:
                    rest_s.setdefault(name, now_s - killed_s)
            seen[name] = len(frames)
        time.sleep(0.002)
    assert len(speech_s) == count, f"{len(speech_s)} of {count} speak again"
    return [rest_s[name] for name in speech_s], list(speech_s.values())


def _close(clients: dict[str, Client]) -> None:
    for client in clients.values():
        client.cancel()
    for client in clients.values():
        client.close()


def check_worker_is_killed() -> None:
    """The only worker of a server is killed: the parent shuts the mouths and gives its sessions up at once."""
    with staged(2) as stage:
        clients = stage.talk()
        stage.forget()
        before = {name: stage.history[name][-1].epoch for name in SESSIONS}
        faces = _faces(stage.servers[0])
        os.kill(stage.servers[0].workers[0], signal.SIGKILL)
        rest_s, speech_s = _times(stage, time.monotonic(), before, faces)
        _check_one_place(stage)
        print(f"bus: a worker killed: {faces} moved; rest {max(rest_s):.2f}, speech {max(speech_s):.2f} s")
        assert max(rest_s) <= REST_S
        assert max(speech_s) <= SPEECH_S
        _close(clients)


def check_simple_senders_and_pages() -> None:
    """Senders of one line, pages and TCP at any server reach the face at its own."""
    with staged(2) as stage:
        simple = [Sender(server.address) for server in stage.servers]
        for sender in simple:
            sender.tell("/phoneme", "sf", "a", 60.0)
            wait(lambda: stage.is_speaking("face"))
            sender.tell("/tts/stop")
            wait(lambda: stage.ear.jaw("face")[-1:] == [0])
        assert sum(map(_faces, stage.servers)) == 1
        viewers = [WebSocketViewer(server.where["page"], session="face") for server in stage.servers]
        simple[0].tell("/phoneme", "sf", "a", 60.0)
        wait(lambda: all(int(viewer.faps()[JAW]) >= OPEN for viewer in viewers))
        streams = [Client(*server.address, session="tess", tcp=True) for server in stage.servers]
        streams[0].wait(20.0).send_phones(LONG)
        wait(lambda: stage.is_speaking("tess"))
        streams[1].wait(20.0)
        assert sum(map(_faces, stage.servers)) == 2
        relayed = sum(server.metrics()['fapengine_front_total{kind="relayed"}'] for server in stage.servers)
        assert relayed >= 4, relayed
        _check_one_place(stage)
        print(f"bus: senders of one line, pages and TCP at every server; {relayed:.0f} relayed")
        for one in (*viewers, *streams, *simple):
            one.close()


def check_nats_is_gone_and_back() -> None:
    """NATS is away for a moment: nothing changes. For longer: all come to rest, and speak again when it is back."""
    with staged(2) as stage:
        clients = stage.talk()
        stage.forget()
        before = {name: stage.history[name][-1].epoch for name in SESSIONS}
        stage.nats.end()
        stage.nats.start()
        time.sleep(3.0)
        stage.forget()
        after = {name: stage.history[name][-1].epoch for name in SESSIONS}
        assert after == before, "a short stop of NATS moved sessions"
        gone_s = time.monotonic()
        stage.nats.end()
        wait(lambda: all(stage.ear.jaw(name)[-1:] == [0] for name in SESSIONS), 10.0)
        rest_s = time.monotonic() - gone_s
        time.sleep(2.0)
        stage.forget()
        back_s = time.monotonic()
        stage.nats.start()
        wait(lambda: all(map(stage.is_speaking, SESSIONS)), 30.0)
        print(
            f"bus: NATS gone: at rest after {rest_s:.2f} s; speech {time.monotonic() - back_s:.2f} s after it is back"
        )
        stage.ear.listen()
        assert all(stage.ear.frames[name][-1].epoch > before[name] for name in SESSIONS)
        _check_one_place(stage)
        _close(clients)


def check_server_stands_still() -> None:
    """A server that is stopped and goes on later moves nothing that another has meanwhile.

    What was made before it stood still may be on its way: one frame, whose epoch tells a receiver to leave it.
    """
    with staged(2) as stage:
        clients = stage.talk()
        stage.forget()
        before = {name: stage.history[name][-1].epoch for name in SESSIONS}
        still = stage.servers[0]
        faces = _faces(still)
        stopped_s = time.monotonic()
        everybody = [still.process.pid, *still.workers]
        for process in everybody:
            os.kill(process, signal.SIGSTOP)
        stop_s = time.monotonic() + 10.0
        while time.monotonic() < stop_s:
            stage.ear.listen()
            if sum(frames[-1].epoch > before[name] for name, frames in stage.ear.frames.items()) == faces:
                break
            time.sleep(0.01)
        speech_s = time.monotonic() - stopped_s
        for process in everybody:
            os.kill(process, signal.SIGCONT)
        time.sleep(3.0)
        stage.forget()
        for name in SESSIONS:
            frames = stage.history[name]
            newest = [frame for frame in frames if frame.epoch > before[name]]
            if newest:
                at = frames.index(newest[0])
                late = [frame for frame in frames[at:] if frame.epoch == before[name]]
                made_later = [frame for frame in late if frame.time_us > 1e6 * stopped_s]
                assert all(frame.values[JAW] == 0 for frame in made_later), "an old server moved a face"
                assert len(late) - len(made_later) <= 1, "more than the frame that was on its way was sent"
        assert faces == sum(stage.history[name][-1].epoch > before[name] for name in SESSIONS)
        print(f"bus: a server that stood still: {faces} moved, shown again after {speech_s:.2f} s; it moved none later")
        _close(clients)


def main() -> None:
    """Run all of it."""
    check_server_is_killed()
    check_worker_is_killed()
    check_simple_senders_and_pages()
    check_nats_is_gone_and_back()
    check_server_stands_still()


if __name__ == "__main__":
    main()
