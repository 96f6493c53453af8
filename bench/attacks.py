"""Frames that speaking faces lose during attacks, relative to quiet stretches of one run.

    python -m bench.attacks [ATTACK ...]

For each attack: frames that arrived in SECONDS during it, and in as many that begin 2 s after it, divided by those of
the quiet stretch; and the processor time of the server, without its children, for each frame. Promised: at least 0.99
in both. The attackers are a niced process on the same machine: where that has no core to spare, what they take
themselves is in the frames, but not in the server's time. Where other programs are busy, too, root can put it before
all of them: ``setsid -w sh -c 'echo -15 > /proc/self/autogroup; exec python -m bench.attacks'``.
"""

import argparse
import asyncio
import base64
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from pathlib import Path

import aiohttp
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from bench.doors import FACES, Watch, free_port, name_of
from tests.live.caller import SDP
from tests.live.stage import Sender
from tests.processes import start

LEAST, REST_S = 0.99, 2.0
WEBSOCKET = (
    "GET {} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: " + base64.b64encode(bytes(16)).decode() + "\r\n\r\n"
)
POST = (
    b"POST /whep?session=a HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/sdp\r\n"
    b"Content-Length: 60000\r\n\r\n"
)
PHONES = json.dumps({"type": "phones", "phones": [["m", 0.02 * n, 0.02 * (n + 1)] for n in range(400)]})
Attack = Callable[[int, int], Coroutine[None, None, None]]


async def hold(data: bytes, number: int, page: int, readers: int, *, at_readers: bool = False) -> None:
    """Open connections from several addresses, send this, and read nothing."""
    held = []
    for n in range(number):
        one = socket.socket()
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with suppress(OSError):
            one.bind((f"127.0.0.{2 + n // 128}", 0))
            one.connect(("127.0.0.1", readers if at_readers else page))
            one.sendall(data)
            held.append(one)
    await asyncio.sleep(3600)


async def ask_for_heads(page: int, _: int) -> None:
    """Ask for all built-in heads at once, again and again."""
    async with aiohttp.ClientSession() as client:

        async def ask(name: str) -> None:
            async with client.get(f"http://127.0.0.1:{page}/head.bin?name={name}") as answer:
                await answer.read()

        while True:
            await asyncio.gather(*map(ask, ("woman", "man", "child", "older")))


async def call_and_hang_up(page: int, _: int) -> None:
    """Call from eight addresses, and hang up as soon as the call is connected."""
    url = f"http://127.0.0.1:{page}"

    async def one(number: int) -> None:
        own = aiohttp.TCPConnector(local_addr=(f"127.0.0.{2 + number}", 0))
        async with aiohttp.ClientSession(url, connector=own) as client:
            while True:
                peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
                for kind in ("audio", "video"):
                    peer.addTransceiver(kind, direction="recvonly")
                await peer.setLocalDescription(await peer.createOffer())
                offer = peer.localDescription.sdp
                async with client.post(f"/whep?session=call{number}", data=offer, headers=SDP) as answer:
                    if answer.status == 201:
                        await peer.setRemoteDescription(RTCSessionDescription(await answer.text(), "answer"))
                        for _ in range(50):
                            await asyncio.sleep(0.0 if peer.connectionState == "connected" else 0.05)
                        async with client.delete(answer.headers["Location"]):
                            pass
                await peer.close()
                await asyncio.sleep(0.2)

    await asyncio.gather(*map(one, range(8)))


async def flood(pages: int, page: int, _: int) -> None:
    """Send 400 phones five times a second from each of some pages."""

    async def one(client: aiohttp.ClientSession, number: int) -> None:
        with suppress(aiohttp.ClientError, ConnectionError):
            async with client.ws_connect(f"http://127.0.0.1:{page}/ws?session=flood{number}") as link:
                while True:
                    await link.send_str(PHONES)
                    await asyncio.sleep(0.2)

    async with aiohttp.ClientSession() as client:
        await asyncio.gather(*(one(client, number) for number in range(pages)))


ATTACKS: dict[str, Attack] = {
    "requests": partial(hold, b"GET /ws?session=" + b"a" * 5000, 240),
    "bodies": partial(hold, POST, 512),
    "readers": partial(hold, WEBSOCKET.format("/").encode(), 64, at_readers=True),
    "heads": ask_for_heads,
    "calls": call_and_hang_up,
    "pages-1": partial(flood, 1),
    "pages-4": partial(flood, 4),
    "pages-40": partial(flood, 40),
}


def speak(port: int, stopped: threading.Event) -> None:
    """Let all faces speak until stopped."""
    sender, number = Sender(("127.0.0.1", port)), 0
    while True:
        for n in range(FACES):
            sender.tell("/fap/1/hello", "sissisi", name_of(n), 1, "ipa", "", 1, "", 5)
            sender.utter(name_of(n), number, "mamamamamamamamama")
        sender.answers()
        number += 1
        if stopped.wait(2.0):
            return


def cpu_s(process: int) -> float:
    """Processor time of a process so far, without its children."""
    user, system = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def frames_of(watch: Watch, seconds: float, process: int) -> tuple[int, float]:
    """Count the frames of speaking faces from now on; and the server's processor time for one of all faces, ms."""
    since_s, since_cpu_s = time.monotonic(), cpu_s(process)
    time.sleep(seconds)
    each_ms = 1e3 * (cpu_s(process) - since_cpu_s) / (60 * seconds)
    came = (at_s for name in map(name_of, range(FACES)) for at_s, _ in list(watch.came.get(name, [])))
    return sum(at_s > since_s for at_s in came), each_ms


def main() -> int:
    """Measure and print; 1 if frames are lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("attacks", nargs="*", metavar="ATTACK", help=f"default: {' '.join(ATTACKS)}")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--ports", nargs=2, type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.ports:
        print("begun", flush=True)
        asyncio.run(ATTACKS[options.attacks[0]](*options.ports))
    watch, stopped = Watch(), threading.Event()
    osc, page, readers = free_port(), free_port(), free_port()
    command = [
        sys.executable, "-m", "fapengine", "serve", "--port", str(osc), "--web-port", str(page), "--webrtc",
        "--without", "all", "--sink", f"osc://127.0.0.1:{watch.socket.getsockname()[1]}",
        "--sink", f"ws-json://127.0.0.1:{readers}",
    ]  # fmt: skip
    worst = 1.0
    with start(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        watch.start()
        try:
            while server.stdout is not None and "Ctrl-C" not in server.stdout.readline():
                pass
            threading.Thread(target=speak, args=(osc, stopped), daemon=True).start()
            time.sleep(3.0)
            for name in options.attacks or ATTACKS:
                quiet, quiet_ms = frames_of(watch, options.seconds, server.pid)
                again = ["nice", sys.executable, "-m", "bench.attacks", name, "--ports", str(page), str(readers)]
                attacker = start(again, stdout=subprocess.PIPE)
                assert attacker.stdout is not None
                attacker.stdout.readline()  # "begun"
                time.sleep(1.0)
                during, during_ms = frames_of(watch, options.seconds, server.pid)
                attacker.kill()
                attacker.wait()
                time.sleep(REST_S)
                after, after_ms = frames_of(watch, options.seconds, server.pid)
                worst = min(worst, during / quiet, after / quiet)
                spent = " ".join(f"{each_ms:.1f}" for each_ms in (quiet_ms, during_ms, after_ms))
                print(
                    f"{name:9} quiet {quiet:5d} frames; during {during / quiet:.3f}, {REST_S:g} s later"
                    f" {after / quiet:.3f}; processor ms for each frame {spent}",
                    flush=True,
                )
        finally:
            stopped.set()
            server.kill()
            watch.socket.close()
    return worst < LEAST


if __name__ == "__main__":
    sys.exit(main())
