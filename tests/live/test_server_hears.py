"""Sound in over the network moves a face: the whole server, its ear's process, and a client on loopback."""

import asyncio
import subprocess
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.clients.sender import Client
from fapengine.engine.commands import Begin, Command
from fapengine.host.hearing import MAX_WAITING_S
from fapengine.recognition.process import RecognizerProcess
from fapengine.recognition.protocol import RATE_HZ
from fapengine.server.server import Server
from fapengine.wire.speech_osc import codec, schema
from tests.live.stage import Ear, Sender, config_of, on_a_loop, running, until
from tests.patient import PatientClock
from tests.unit.recognition.speech import BABY, FAPU_MM, closures, no_speech, opening_mm, spoken

PIECE = RATE_HZ // 50
MIN_LIKENESS = 0.75
"""Correlation with the lips of the true phones: 0.905; less if the process is as late as :data:`LAG_S` allows."""
LAG_S = 0.04
"""Sound that an ear may not have heard yet: two frames. The face follows after 0.25 s: more shows in its lips."""


async def tell_sound(face: Client, server: Server, clock: PatientClock, samples: NDArray[np.int16]) -> None:
    """Send sound in pieces of 20 ms, each when it is due, to its end.

    Time stands still while the ear's process is behind, as it is on a busy machine.
    """
    begun_s, number = clock(), None
    heard_s = server.hearing.counts.heard_s

    def is_heard(up_to_s: float) -> bool:
        server.hearing.tick(clock())
        return server.hearing.counts.heard_s >= up_to_s

    for start in range(0, len(samples), PIECE):
        due_s = (start + PIECE) / RATE_HZ
        await at(clock, begun_s + due_s)
        number = face.send_audio(samples[start : start + PIECE], RATE_HZ, utterance=number)
        clock.allow(face, PIECE / RATE_HZ)
        await until(lambda: is_heard(heard_s + due_s - LAG_S))  # noqa: B023  called at once
    clock.free(face)
    assert number is not None
    face.end(number)


async def at(clock: PatientClock, time_s: float) -> None:
    """Wait for a time of the clock."""
    await until(lambda: clock() >= time_s)


async def ready(server: Server) -> None:
    """Let the ear's process be there, so that a slow machine's start does not count."""
    server.hub.open("warm")
    server.hearing.hear("warm", 1 << 29, np.zeros(PIECE, np.int16), RATE_HZ, is_placed=False, is_last=True)
    await until(lambda: server.hearing.counts.heard_s > 0)
    server.hearing.drop("warm")


def opening(ear: Ear, session: str, zero_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times from an engine time on, and mm by which the lips are open in the middle."""
    ear.listen()
    frames = ear.frames[session]
    at_s = np.array([frame.time_us * 1e-6 - zero_s for frame in frames])
    values = np.array([frame.values for frame in frames])
    return at_s, -(values[:, 3] + values[:, 4]) * FAPU_MM


@pytest.mark.parametrize("tcp", [False, True])
def test_the_lips_follow_the_sound_and_are_shut_on_its_m_b_p(tcp: bool) -> None:
    speech = spoken("rms", BABY)
    reference = opening_mm(speech.phones, len(speech.samples) / RATE_HZ)

    async def main() -> None:
        clock = PatientClock()
        with closing(Ear.open()) as ear:
            async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=clock) as server:
                await ready(server)
                server.hub.listeners.on_command("anna", lambda _, command, now_s: told.append((now_s, command)))
                with Client(*server.osc_address, session="anna", tcp=tcp, clock=clock) as face:
                    await tell_sound(face, server, clock, speech.samples)
                    await until(lambda: any(notice.kind == "finished" for notice in face.events()))
                assert server.receiver.counts.sound_lost == 0
                assert server.hearing.counts.refused_s == 0
            [(now_s, begin)] = [(now_s, command) for now_s, command in told if isinstance(command, Begin)]
            assert begin.at_s > now_s
            lips.append(opening(ear, "anna", begin.at_s))

    told: list[tuple[float, Command]] = []
    lips: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    on_a_loop(main)
    [(at_s, open_mm)] = lips
    heard = np.interp(np.arange(len(reference)) / 60, at_s, open_mm)
    likeness = float(np.corrcoef(heard, reference)[0, 1])
    print(f"likeness {likeness:.3f}")
    assert likeness > MIN_LIKENESS
    shut = [heard[max(round(60 * at_s) - 5, 0) : round(60 * at_s) + 6].min() for at_s in closures(speech.phones)]
    assert np.mean(np.array(shut) < 0.5) > 0.75
    assert heard.max() > 5
    assert open_mm[-1] == pytest.approx(0.0, abs=0.5)


def test_a_barge_in_empties_the_ear() -> None:
    speech = np.tile(spoken("rms", BABY).samples, 4)

    async def main() -> None:
        clock = PatientClock()
        with closing(Ear.open()) as ear:
            async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=clock) as server:
                await ready(server)
                with Client(*server.osc_address, session="anna", clock=clock) as face:
                    number = face.send_audio(speech, RATE_HZ)  # all at once
                    await until(lambda: max(ear.jaw("anna"), default=0) > 50)
                    face.cancel()
                    await until(lambda: any(notice.kind == "cancelled" for notice in face.events()))
                    cancelled_s = clock()
                    await at(clock, cancelled_s + 0.8)
                    at_s, open_mm = opening(ear, "anna", cancelled_s)
                    assert np.abs(open_mm[at_s > 0.4]).max() < 0.5
                    assert server.hub.engine.state("anna") == "idle"
                    phones = server.hearing.counts.phones
                    number = face.send_audio(speech[: 2 * RATE_HZ], RATE_HZ)  # and it hears what is said next
                    face.end(number)
                    await until(lambda: any(notice.kind == "finished" for notice in face.events()))
                    assert server.hearing.counts.phones > phones

    on_a_loop(main)


def test_a_flood_of_sound_is_bounded_and_counted() -> None:
    async def main() -> None:
        async with running(config_of(recognizers=1)) as server:
            await ready(server)
            sender = Sender(server.osc_address)
            blob = no_speech(1.0)["white noise"][: schema.MAX_SAMPLES].astype("<i2").tobytes()
            for index in range(round(1.5 * MAX_WAITING_S * RATE_HZ / schema.MAX_SAMPLES)):
                first = index * schema.MAX_SAMPLES
                sender.socket.send(codec.encode(schema.Sound("anna", 0, first, RATE_HZ, blob)))
                if index % 20 == 0:
                    await asyncio.sleep(0.001)
            await until(lambda: server.hearing.counts.refused_s > 1)
            one = server.hearing._sessions["anna"]
            assert one.recognizer.waiting_s <= MAX_WAITING_S
            sender.tell("/fap/1/hello", "s", "bert")
            sender.socket.send(codec.encode(schema.Sound("bert", 0, 0, RATE_HZ, blob)))
            await until(lambda: any("recognizers" in message.arguments for message in sender.answers()))  # one too many
            assert server.hub.counts.frames > 10
            sender.tell("/fap/1/utt/cancel", "s", "anna")
            await until(lambda: one.recognizer.waiting_s == 0)
            sender.close()

    on_a_loop(main)


def test_an_ear_that_is_killed_is_told_of_and_replaced() -> None:
    async def main() -> None:
        async with running(config_of()) as server:
            await ready(server)
            server.hub.open("anna")
            server.hearing.hear("anna", 1, np.zeros(PIECE, np.int16), RATE_HZ, is_placed=False)
            killed = server.hearing._sessions["anna"].recognizer
            assert isinstance(killed, RecognizerProcess)
            killed.child.kill()
            await until(lambda: server.hearing.counts.ended == 1)
            heard_s = server.hearing.counts.heard_s
            server.hearing.hear("anna", 2, np.zeros(RATE_HZ, np.int16), RATE_HZ, is_placed=False)
            await until(lambda: server.hearing.counts.heard_s > heard_s)
            process = server.hearing._sessions["anna"].recognizer
            assert isinstance(process, RecognizerProcess)
        assert not process.child.is_alive  # it ends with the server

    on_a_loop(main)


@pytest.mark.nightly
def test_memory_stays_where_it_is() -> None:
    """Half a minute of sound and more, as fast as the ear hears it."""
    speech = np.concatenate([spoken("rms", BABY).samples, np.zeros(RATE_HZ, np.int16)])

    def resident_mb(process: "subprocess.Popen[bytes]") -> float:
        return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * 4096 / 1e6

    ear = RecognizerProcess.open()
    sizes = []
    heard_s = 0.0
    try:
        ear.begin()
        for _ in range(10):
            ear.push(speech, RATE_HZ)
            while ear.waiting_s > 0.05:
                heard_s = max([heard_s, *(heard.position_s for heard in ear.poll())])
                time.sleep(0.002)
            sizes.append(resident_mb(ear.child.process))
    finally:
        ear.close()
    assert heard_s > 30
    assert sizes[-1] < sizes[3] + 5
