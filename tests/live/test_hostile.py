"""Hostile peers over real sockets: no crash, no stall for the other faces, everything counted."""

import asyncio
import contextlib
import random
import socket
import sys
from collections import Counter
from itertools import islice

from fapengine.server.server import Server
from fapengine.wire.speech_osc.peers import WireCounts
from tests.live.hostile import datagrams, streams
from tests.live.stage import Ear, Sender, config_of, on_a_loop, running, until
from tests.processes import start

FLOOD = """
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
out.connect(("127.0.0.1", int(sys.argv[1])))
kinds = [bytes.fromhex(data) for data in sys.argv[2:]]
while True:
    for number in range(64):
        try:
            out.send(kinds[number % len(kinds)])
        except OSError:
            pass
    time.sleep(0.001)
"""


def others_are_well(server: Server, ear: Ear) -> None:
    assert ear.missing("anna") == 0
    assert server.ingress.counts.faults == 0
    assert server.hub.counts.listeners_dropped == 0


def talk_on(sender: Sender, number: int) -> None:
    sender.utter("anna", number, "mabababama")


def test_hostile_datagrams_are_counted_and_anna_speaks_on() -> None:
    async def main() -> None:
        rng, ear = random.Random(1), Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}?session=anna", sessions=4)) as server:
            anna, foe = Sender(server.osc_address), Sender(server.osc_address)
            anna.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            talk_on(anna, 0)
            sent = 0
            for data in islice(datagrams(rng), 3000):
                with contextlib.suppress(BlockingIOError, OSError):
                    sent += foe.socket.send(data) == len(data)
                if sent % 50 == 0:
                    await asyncio.sleep(0.002)
            await asyncio.sleep(0.1)
            await until(lambda: len(server.ingress.queue) == 0)
            assert len(server.hub.engine.sessions) <= 4
            counts = server.receiver.counts
            queue = server.ingress.queue
            assert counts.packets + queue.flooded == server.ingress.counts.datagrams
            assert counts.malformed > sent / 3
            for name in ("unknown", "refused", "surplus", "clamped"):
                assert getattr(counts, name) > 0, name
            anna.tell("/fap/1/utt/cancel", "si", "anna", -1)
            ear.frames.clear()
            talk_on(anna, 1000)
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            others_are_well(server, ear)
            anna.close()
            foe.close()
        assert ear.jaw("anna")[-1] == 0
        ear.close()

    on_a_loop(main)


def test_hostile_streams_are_counted_and_anna_speaks_on() -> None:
    async def main() -> None:
        rng, ear = random.Random(2), Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}?session=anna", sessions=4, streams=8)) as server:
            anna, opened = Sender(server.osc_address), []
            anna.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            talk_on(anna, 0)
            loop = asyncio.get_running_loop()
            for number, data in enumerate(streams(rng) * 2):
                if number % 8 == 0:  # there is room for new ones
                    for own in opened:
                        own.close()
                    await until(lambda: server.ingress.counts.streams == 0)
                own = socket.socket()
                own.setblocking(False)
                await loop.sock_connect(own, server.osc_address)
                with contextlib.suppress(OSError, asyncio.TimeoutError):
                    await asyncio.wait_for(loop.sock_sendall(own, data), 0.5)
                opened.append(own)
            await until(lambda: len(server.ingress.queue) == 0)
            assert server.ingress.counts.streams <= 8
            counts = server.ingress.counts
            assert counts.streams_refused >= 6
            assert counts.streams_broken >= 8
            for own in opened:
                own.close()
            await until(lambda: server.ingress.counts.streams == 0)
            ear.frames.clear()
            talk_on(anna, 1000)
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            others_are_well(server, ear)
            anna.close()
        ear.close()

    on_a_loop(main)


def test_a_flood_costs_only_its_sender() -> None:
    """A flood from another process, 60,000 a second where there is time for it, of three kinds in turn."""

    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}?session=anna")) as server:
            anna = Sender(server.osc_address)
            anna.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            await until(lambda: any("welcome" in message.address for message in anna.answers()))
            kinds = [b"/nobody/knows\0\0\0,\0\0\0", b"not osc at all", b"/blink\0\0,\0\0\0"]
            words = [sys.executable, "-c", FLOOD, str(server.osc_address[1]), *(kind.hex() for kind in kinds)]
            with start(words) as flood:
                try:
                    await until(lambda: server.receiver.counts.packets > 100)
                    told, asked = Counter[str](), 0
                    while told["/fap/1/pong"] < 10:  # they find their way through; some are lost in the network
                        asked += 1
                        anna.tell("/fap/1/ping", "ih", asked, 0)
                        await asyncio.sleep(0.05)
                        told.update(message.address for message in anna.answers())
                finally:
                    flood.kill()
            await until(lambda: len(server.ingress.queue) == 0)
            others_are_well(server, ear)
            anna.close()
        ear.close()

    on_a_loop(main)


def test_every_kind_of_trouble_has_a_count() -> None:
    """A reminder: what is counted is told to Prometheus by name."""
    assert {"malformed", "unknown", "surplus", "refused", "repeated", "clamped"} <= set(WireCounts.__slots__)
