"""Calls through a TURN server alone, Debian's coturn: the caller has no other way (``iceTransportPolicy`` relay).

python -m tests.oracles.turn
"""

import asyncio
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import aiohttp
import numpy as np
from aiortc import RTCConfiguration, RTCIceServer, RTCIceTransportPolicy, RTCPeerConnection

from fapengine.mesh.default_head.head import build_head
from fapengine.server.config import CallChoice, Listen, ServerConfig
from fapengine.server.server import Server
from tests.english import english
from tests.live.caller import Caller, read_track
from tests.processes import free_port, start

USER, PASSWORD = "anna", "secret"
LIMIT_S = 60.0


@contextmanager
def coturn() -> Iterator[int]:
    """Run a TURN server on a port of this machine."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        process = start(
            [
                "turnserver", "-n", "--listening-ip=127.0.0.1", "--relay-ip=127.0.0.1", f"--listening-port={port}",
                "--lt-cred-mech", f"--user={USER}:{PASSWORD}", "--realm=here", "--allow-loopback-peers", "--no-tls",
                "--no-dtls", "--no-cli", f"--pidfile={folder}/pid", f"--userdb={folder}/users",
                f"--log-file={folder}/log",
            ],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            yield port
        finally:
            process.terminate()
            process.wait()


async def call(turn_port: int) -> str:
    """Call a server of one's own through it; tell what came, and by which way."""
    config = ServerConfig(listen=Listen(port=0, web_port=0), calls=CallChoice(on=True, size=64))
    server = Server(config, english(), build_head())
    await server.start()
    running = asyncio.create_task(server.run())
    (host, port), *_ = server.sites
    relay = RTCIceServer(urls=f"turn:127.0.0.1:{turn_port}?transport=udp", username=USER, credential=PASSWORD)
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[relay], iceTransportPolicy=RTCIceTransportPolicy.RELAY))
    try:
        async with aiohttp.ClientSession() as http:
            own = Caller(http, peer)
            peer.on("track", lambda track: own.readers.append(asyncio.ensure_future(read_track(own, track, np.mean))))
            for kind in ("audio", "video"):
                peer.addTransceiver(kind, direction="recvonly")
            await own.post(f"http://{host}:{port}/whep?session=anna")
            await server.hub.speak("anna", "My mama.")
            async with asyncio.timeout(LIMIT_S):
                while len(own.pictures) < 20 or np.abs(own.sound).max(initial=0) < 1000:
                    await asyncio.sleep(0.1)
            ways = {
                pair.local_candidate.type
                for pair in peer.getReceivers()[0].transport.transport.iceGatherer._connection._nominated.values()
            }
            await own.end()
            await own.close()
    finally:
        server.stop()
        await running
    assert ways == {"relay"}, ways
    return f"{len(own.pictures)} pictures and {len(own.sounds)} pieces of sound, by {', '.join(ways)}"


def check_with_turn() -> None:
    """Fail if no picture or no sound comes through a relay."""
    if shutil.which("turnserver") is None:
        print("coturn: not on this machine; Debian has it")
        return
    with coturn() as port:
        print(f"coturn: {asyncio.run(call(port))}")


if __name__ == "__main__":
    sys.exit(check_with_turn())
