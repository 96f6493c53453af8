"""Ends in the middle of a word: senders, servers, by signal, by force. The mouth does not stay open."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from fapengine.speech.phone_track import Phone
from fapengine.wire.speech_osc.sender import OscSender
from tests.live.stage import Ear, Sender, Serve, config_of, on_a_loop, running, until, wait
from tests.patient import PatientClock

LONG = [Phone(label, 0.12 * n, 0.12 * n + 0.12) for n, label in enumerate(["m", "a", "b", "a"] * 250)]
"""Two minutes, so that there is something left to be said whenever the server is back."""


def test_a_signal_lets_the_faces_come_to_rest(tmp_path: Path) -> None:
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear)
    sender = Sender(server.address)
    sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
    sender.utter("anna", 0, "maaaaaaaaaaaaaaaaaaaaaaaaa")
    wait(lambda: ear.jaw("anna")[-1:] > [50])
    assert server.end(signal.SIGINT) == 0
    assert ear.jaw("anna")[-1] == 0
    assert any("cancelled" in message.arguments for message in sender.answers())
    lines = [json.loads(line) for line in server.log.read_text().splitlines()]
    assert lines[-1]["sessions"] == 1
    assert all("trouble" not in line for line in lines)
    sender.close()
    ear.close()


def test_a_server_killed_and_started_again_is_told_everything_again(tmp_path: Path) -> None:
    ear = Ear.open()
    server = Serve(tmp_path / "log", ear)
    own = Sender(server.address).socket
    sender = OscSender("anna", instance=7)
    utterance = sender.begin(time.monotonic(), anchor="at", at_s=time.monotonic() + 0.3)
    sender.append(utterance, LONG)
    sender.end(utterance)

    def exchange() -> None:
        for packet in sender.due(time.monotonic()):
            try:
                own.send(packet)
            except ConnectionRefusedError:  # nobody there just now
                continue
        while True:
            try:
                sender.receive(own.recv(4096), time.monotonic())
            except (BlockingIOError, ConnectionRefusedError):
                return

    wait(lambda: ear.jaw("anna")[-1:] > [50], work=exchange)
    server.end(signal.SIGKILL)
    open_at = ear.frames["anna"][-1].number
    wait(lambda: ear.jaw("anna")[-1] == 0)  # its guard shuts the mouth
    assert ear.frames["anna"][-1].number > open_at
    ear.frames.clear()
    again = Serve(tmp_path / "log2", ear, server.port)
    wait(lambda: max(ear.jaw("anna"), default=0) > 50, work=exchange)  # it speaks on
    sender.cancel(time.monotonic())
    wait(lambda: not sender.live, work=exchange)
    wait(lambda: ear.jaw("anna")[-20:] == [0] * 20, work=exchange)
    assert again.end(signal.SIGTERM) == 0
    own.close()
    ear.close()


def test_a_sender_that_is_killed_leaves_a_closed_mouth() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=PatientClock()) as server:
            sender = Sender(server.osc_address)
            sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            sender.utter("anna", 0, "mamama", ends=False)
            sender.close()
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            await until(lambda: ear.jaw("anna")[-10:] == [0] * 10)
            assert server.hub.engine.state("anna") in ("waiting", "speaking")  # more may come
            await until(lambda: server.hub.engine.state("anna") == "idle")
            assert server.hub.engine.totals().unended == 1
        ear.close()

    on_a_loop(main)


def test_a_sender_that_comes_back_begins_anew() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            old = Sender(server.osc_address)
            old.tell("/fap/1/hello", "sissisi", "anna", 1, "ipa", "", 1, "", 5)
            old.utter("anna", 0, "a" * 40)
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            old.close()
            new = Sender(server.osc_address)
            new.tell("/fap/1/hello", "sissisi", "anna", 1, "ipa", "", 1, "", 6)
            await until(lambda: ear.jaw("anna")[-5:] == [0] * 5)
            new.utter("anna", 0, "ma", phone_s=0.2)  # a number that was there before
            ear.frames.clear()
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            await until(lambda: ear.jaw("anna")[-5:] == [0] * 5)
            new.close()
        ear.close()

    on_a_loop(main)


def test_a_port_that_is_taken_is_one_line_and_exit_code_3(tmp_path: Path) -> None:
    ear = Ear.open()
    command = [sys.executable, "-m", "fapengine", "serve", "--no-page", "--port", str(ear.port)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=dict(os.environ))
    assert done.returncode == 3
    assert done.stderr.startswith(
        f"fapengine: UDP port {ear.port} on 127.0.0.1: Address already in use; choose another"
    )
    assert len(done.stderr.splitlines()) == 1
    ear.close()
