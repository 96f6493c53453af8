"""Several workers: a face in one place, another one when that is gone, one known port for everybody."""

import json
import os
import re
import signal
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from fapengine.clients.sender import Client
from fapengine.clients.websocket_viewer import WebSocketViewer
from fapengine.errors import UsageError
from fapengine.server.cluster.workers import check_workers
from fapengine.server.config import ServerConfig, SoundChoice
from fapengine.server.ownership import worker_of
from fapengine.speech.phone_track import Phone
from fapengine.wire.fap_osc import FapFrame
from tests.live.stage import JAW, Ear, Sender, Serve, wait

LONG = [Phone(label, 0.12 * n, 0.12 * n + 0.12) for n, label in enumerate(["m", "a", "b", "a"] * 250)]
SESSIONS = ("anna", "cleo", "dora")
OPEN = 50
"""FAP 3 of an open mouth."""


class Stage:
    """Two workers, and what they show."""

    def __init__(self, folder: Path, *more: str) -> None:
        self.ear = Ear.open()
        self.log = folder / "log"
        self.serve = Serve(self.log, self.ear, 0, "--workers", "2", "--metrics-port", "0", *more)
        told = dict(part.split(":") for part in self.serve.where["workers"].split())
        self.processes = {int(worker): int(process) for worker, process in told.items()}

    def is_speaking(self, session: str) -> bool:
        return self.ear.jaw(session)[-1:] > [OPEN]

    def kill(self, worker: int) -> float:
        self.ear.listen()
        self.ear.frames.clear()
        os.kill(self.processes[worker], signal.SIGKILL)
        return time.monotonic()

    def metrics(self) -> dict[str, float]:
        text = urllib.request.urlopen(self.serve.where["metrics"], timeout=300).read().decode()
        return {key: float(value) for key, value in re.findall(r"^([^#\s]\S*) (\S+)$", text, re.M)}

    def end(self) -> None:
        assert self.serve.end(signal.SIGTERM) == 0
        self.ear.listen()
        troubles = [line for line in map(json.loads, self.log.read_text().splitlines()) if "trouble" in line]
        assert troubles == []


@contextmanager
def staged(folder: Path, *more: str) -> Iterator[Stage]:
    stage = Stage(folder, *more)
    try:
        yield stage
    finally:
        stage.ear.close()


def assert_in_one_place(frames: list[FapFrame]) -> None:
    """Epochs only rise, and within one the numbers rise one by one, but for the guard's last frames."""
    for before, after in pairwise(frames):
        assert after.epoch >= before.epoch
        assert after.epoch > before.epoch or after.number >= before.number


def test_a_worker_killed_in_a_word_shuts_its_mouths_and_others_speak_on(tmp_path: Path) -> None:
    with staged(tmp_path) as stage:
        clients = {name: Client(*stage.serve.address, session=name) for name in SESSIONS}
        for client in clients.values():
            client.wait(60.0).send_phones(LONG)
        simple = Sender(stage.serve.address)
        simple.tell("/phoneme", "sf", "a", 60.0)  # to the known port, and never told of another
        everybody = (*SESSIONS, "face")
        wait(lambda: all(map(stage.is_speaking, everybody)))
        workers = {name: worker_of(name, [0, 1]) for name in everybody}
        assert set(workers.values()) == {0, 1}
        counts = {
            f'fapengine_sessions{{state="speaking",worker="{worker}"}}': list(workers.values()).count(worker)
            for worker in (0, 1)
        }
        wait(lambda: counts.items() <= stage.metrics().items())  # a worker counts a frame after it shows
        figures = stage.metrics()
        assert figures['fapengine_front_total{kind="moved"}'] == len(SESSIONS)
        assert figures["fapengine_placed"] == len(everybody)
        before = {name: list(stage.ear.frames[name]) for name in everybody}

        gone = workers["anna"]
        killed = [name for name in SESSIONS if workers[name] == gone]
        killed_s = stage.kill(gone)
        wait(lambda: all(stage.ear.jaw(name)[-1:] == [0] for name in killed))
        rest_s = time.monotonic() - killed_s
        wait(lambda: all(map(stage.is_speaking, killed)))
        speech_s = time.monotonic() - killed_s
        print(f"at rest after {rest_s:.3f} s, speech after {speech_s:.3f} s")
        wait(lambda: stage.metrics()["fapengine_workers"] == 2)
        figures = stage.metrics()
        assert figures["fapengine_worker_restarts_total"] == 1
        assert figures[f'fapengine_sessions{{state="speaking",worker="{gone}"}}'] == 0  # none was moved back
        stage.ear.listen()
        for name in killed:
            after = stage.ear.frames[name]
            assert_in_one_place(before[name] + after)
            assert after[-1].epoch > before[name][-1].epoch
            old = [frame for frame in after if frame.epoch == before[name][-1].epoch]
            assert old[-1].values[JAW] == 0  # the parent's, before the new worker's first
        for name in set(SESSIONS) - set(killed):
            assert {frame.epoch for frame in stage.ear.frames[name]} == {before[name][-1].epoch}
        for client in clients.values():
            client.cancel()
            client.close()
        simple.tell("/tts/stop")
        stage.end()
        assert all(stage.ear.jaw(name)[-1] == 0 for name in everybody)
        simple.close()


def test_pages_and_streams_are_handed_over_and_rest_when_the_parent_is_killed(tmp_path: Path) -> None:
    with staged(tmp_path, "--web-port", "0") as stage:
        url = stage.serve.where["page"]
        assert b"<canvas" in urllib.request.urlopen(url, timeout=300).read()
        viewers = {name: WebSocketViewer(url, session=name) for name in SESSIONS}
        wait(lambda: all(viewer.state == "open" for viewer in viewers.values()))
        client = Client(*stage.serve.address, session="anna", tcp=True).wait(60.0)
        client.send_phones(LONG)
        wait(lambda: int(viewers["anna"].faps()[JAW]) > OPEN)
        assert viewers["cleo"].faps()[JAW] == 0
        figures = stage.metrics()
        for worker in (0, 1):
            here = [worker_of(name, [0, 1]) for name in SESSIONS].count(worker)
            assert figures[f'fapengine_pages{{worker="{worker}"}}'] == here
        stage.serve.end(signal.SIGKILL)
        wait(lambda: stage.ear.jaw("anna")[-1] == 0)
        wait(lambda: not any(map(_lives, stage.processes.values())))
        client.close()
        for viewer in viewers.values():
            viewer.close()


def _lives(process: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False


@pytest.mark.parametrize(
    ("config", "why"),
    [
        (ServerConfig(sinks=("vmc://127.0.0.1",)), "session=NAME"),
        (ServerConfig(sinks=("fba+tcp://127.0.0.1:9?session=anna",)), "one that sends datagrams"),
        (ServerConfig(sound=SoundChoice(session="face")), "audio devices"),
        (ServerConfig(sound=SoundChoice(microphone="default")), "audio devices"),
    ],
)
def test_what_one_process_alone_can_do_is_refused(config: ServerConfig, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        check_workers(config)
