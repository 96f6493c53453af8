"""A live server in this process: one OSC message makes a face speak, and its MPEG-4 stream comes back over UDP."""

import asyncio
import socket
from dataclasses import replace

import numpy as np
from pythonosc.udp_client import SimpleUDPClient

import fapengine

receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind(("127.0.0.1", 0))
receiver.setblocking(False)


async def main() -> None:
    """Let the server speak, and save what it shows."""
    config = fapengine.ServerConfig(sinks=(f"fba://127.0.0.1:{receiver.getsockname()[1]}",))
    config = replace(config, listen=replace(config.listen, port=0, web_port=None))
    server = fapengine.Server(config)
    await server.start()
    running = asyncio.create_task(server.run())
    SimpleUDPClient(*server.osc_address).send_message("/tts/text", "Hello there.")
    decoder, frames = fapengine.Decoder(errors="resync"), []  # a datagram may be lost
    while len(frames) < 120:
        frames += decoder.feed(await asyncio.get_running_loop().sock_recv(receiver, 65536))
    server.stop()
    await running
    track = fapengine.FapTrack.from_values(np.array([frame.values for frame in frames]), rate_hz=config.face.rate_hz)
    print(f"{len(track)} frames: {fapengine.save(track, 'out/live.fap')}")


asyncio.run(main())
receiver.close()
