"""Sound as it comes moves a face: a client gives it piece by piece, and the server's recognizer finds the phones."""

import asyncio
import socket
from dataclasses import replace

import numpy as np

import fapengine

receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind(("127.0.0.1", 0))
receiver.setblocking(False)
speech = fapengine.speak("My mother made marmalade.").speech


async def main() -> None:
    """Play the microphone: 20 ms of a voice every 20 ms, and save what the server shows."""
    config = fapengine.ServerConfig(sinks=(f"fba://127.0.0.1:{receiver.getsockname()[1]}",))
    server = fapengine.Server(replace(config, listen=replace(config.listen, port=0, web_port=None)))
    await server.start()
    running = asyncio.create_task(server.run())
    decoder, frames, number = fapengine.Decoder(errors="resync"), [], None  # a datagram may be lost
    running.get_loop().add_reader(receiver, lambda: frames.extend(decoder.feed(receiver.recv(65536))))
    with fapengine.Client(*server.osc_address, session="anna") as face:
        for piece in np.array_split(speech.samples, round(speech.duration_s / 0.02)):
            number = face.send_audio(piece, speech.sample_rate_hz, utterance=number)
            await asyncio.sleep(0.02)
        face.end(number)
        while not any(event.kind == "finished" for event in face.events()):
            await asyncio.sleep(0.02)
    server.stop()
    await running
    track = fapengine.FapTrack.from_values(np.array([frame.values for frame in frames]), rate_hz=config.face.rate_hz)
    print(f"{len(track)} frames: {fapengine.save(track, 'out/heard.fap')}")


asyncio.run(main())
receiver.close()
