"""A live server in this process: one OSC message makes a face speak, and its frames come back over UDP."""

import asyncio
import socket
from pathlib import Path

import numpy as np
from pythonosc.udp_client import SimpleUDPClient

from fapengine.files.fap import save_fap
from fapengine.files.profiles import load_profile
from fapengine.live.config import Listen, ServeConfig
from fapengine.live.fap_osc import decode_frame
from fapengine.live.server.server import Server
from fapengine.mpeg4.track import FapTrack

ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
ear.bind(("127.0.0.1", 0))
ear.setblocking(False)


async def main() -> None:
    """Let the server speak, and save what it shows."""
    config = ServeConfig(listen=Listen(port=0, web_port=None), sinks=(f"osc://127.0.0.1:{ear.getsockname()[1]}",))
    server = Server(config, load_profile(config.face.profile))
    await server.start()
    running = asyncio.create_task(server.run())
    SimpleUDPClient(*server.osc_address).send_message("/tts/text", "Hello there.")
    frames = []
    while len(frames) < 120:
        frames.append(decode_frame(await asyncio.get_running_loop().sock_recv(ear, 2048)))
    server.stop()
    await running
    save_fap(Path("out/live.fap"), FapTrack.of(np.array([frame.values for frame in frames]), rate_hz=60.0))
    print(f"{len(frames)} frames of session {frames[0].session!r}: out/live.fap")


asyncio.run(main())
ear.close()
