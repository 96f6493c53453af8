"""Calls by WebRTC: how well lips and sound are together where they arrive, and what a call costs.

``python -m bench.calls`` runs a whole server and calls it by WHEP on the loopback. Each picture carries its engine time
in its pixels, so that a picture that was received says when it was meant; where the sound is, the received samples say.
Printed are, in ms, how much earlier a picture comes than its sound: by arrival at the caller (what a player without a
buffer of its own shows), and by the sender's reports (what a browser plays by); the mouth's dark pixels in phones that
shut the lips and in open ones; pictures a second, and the processor's share. ``--json`` for programs.

``python -m bench.calls --viewers 1,2,4`` counts instead what viewers of one face cost: images that were encoded and
sent, and the server's processor time. The viewers are another process. The last of several viewers joins late.
"""

import argparse
import asyncio
import json
import resource
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import aiohttp
import numpy as np
from aiortc.codecs.vpx import Vp8Encoder
from aiortc.rtp import RtcpSrPacket

from fapengine.files.profiles import load_profile
from fapengine.host.listeners import Spoken
from fapengine.mesh.default_head.head import build_head
from fapengine.server.calls.tracks import VIDEO_HZ, FilmTracks
from fapengine.server.config import CallChoice, Listen, ServerConfig
from fapengine.server.film.soundtrack import RATE_HZ
from fapengine.server.server import Server
from fapengine.trajectory.style import Style
from tests.live.caller import Caller, watch

TEXT = "My mama bought a big pumpkin, and Bob made plum jam for me. People may bring apples, beans and a pipe."
SIZE_PX, CODE_BITS, CODE_PX = 256, 16, 16
SHUT, OPEN = ("m", "p", "b"), ("ɑː", "ʌ", "æ", "ɔː", "eɪ", "aɪ")
LIMIT_S = 0.04
WATCHED_S, JOIN_S = 10.0, 2.0
"""Time for which viewers are counted, and time between the first ones and the late one."""
WATCHED_HZ = 10.0
"""Images per second for viewers, few enough that a busy machine draws all, so that counts compare."""


@dataclass(eq=False)
class Wire:
    """Packets of one receiver, before any buffer. Stateful."""

    came_s: dict[int, float] = field(default_factory=dict)
    """Timestamp of RTP to the time at which its last packet came."""
    reports: list[tuple[int, float]] = field(default_factory=list)
    """Timestamp of RTP, and the sender's time of day at it, s."""

    def tap(self, receiver: Any) -> None:
        """Listen in on a receiver of aiortc."""
        packet, report = receiver._handle_rtp_packet, receiver._handle_rtcp_packet

        async def rtp(came: Any, arrival_time_ms: int) -> None:
            self.came_s[came.timestamp] = time.monotonic()
            await packet(came, arrival_time_ms=arrival_time_ms)

        async def rtcp(came: Any) -> None:
            if isinstance(came, RtcpSrPacket):
                told = came.sender_info
                self.reports.append((told.rtp_timestamp, told.ntp_timestamp / 2**32))
            await report(came)

        receiver._handle_rtp_packet, receiver._handle_rtcp_packet = rtp, rtcp

    def arrived_s(self, stamp: int) -> float:
        """Time at which a frame was complete; its stamp counts from the first that came."""
        return self.came_s[(next(iter(self.came_s)) + stamp) % 2**32]

    def sent_s(self, stamp: float, rate_hz: int) -> float:
        """Time of day at which the sender says that it was, by its last report before."""
        number = next(iter(self.came_s)) + stamp
        told = [((number - base + 2**31) % 2**32 - 2**31, ntp_s) for base, ntp_s in self.reports]
        past = [one for one in told if one[0] >= 0] or told
        ahead, ntp_s = min(past, key=lambda one: abs(one[0]))
        return ntp_s + ahead / rate_hz


def number_pictures() -> None:
    """Write the engine time of each picture, ms, into its upper edge."""
    show = FilmTracks.picture

    def picture(self: FilmTracks, time_s: float, pixels: bytes) -> None:
        picture = np.frombuffer(pixels, np.uint8).reshape(SIZE_PX * 3 // 2, SIZE_PX).copy()  # I420
        code = round(1000 * time_s) % 2**CODE_BITS
        for bit in range(CODE_BITS):
            picture[:CODE_PX, bit * CODE_PX : (bit + 1) * CODE_PX] = 16 + 219 * (code >> bit & 1)
        show(self, time_s, picture.tobytes())

    FilmTracks.picture = picture  # type: ignore[method-assign]


def read_picture(picture: np.ndarray) -> tuple[int, int]:
    """Engine time, ms, of a picture that was received, and the dark pixels of its mouth."""
    bits = picture[4 : CODE_PX - 4].astype(float).mean(axis=(0, 2)).reshape(CODE_BITS, CODE_PX)[:, 4:-4].mean(axis=1)
    code = sum(int(bit > 128) << number for number, bit in enumerate(bits))
    return code, int((picture[158:200, 116:140, 1] < 110).sum())


def found(sent: np.ndarray, rate_hz: int, received: np.ndarray) -> int:
    """Sample of the received sound, 48 kHz, at which the sent one begins."""
    wanted = np.interp(np.arange(0, len(sent) / rate_hz, 1 / RATE_HZ), np.arange(len(sent)) / rate_hz, sent)
    size = 1 << int(np.ceil(np.log2(len(received) + len(wanted))))
    match = np.fft.irfft(np.fft.rfft(received, size) * np.conj(np.fft.rfft(wanted, size)), size)
    return int(np.argmax(match[: len(received)]))


@dataclass
class Seen:
    """Pictures and sound that one call received."""

    caller: Caller
    wires: dict[str, Wire]
    spoken: Spoken
    zero_s: float
    """Engine time at which the sound of the text began."""
    wall_s: float
    cpu_s: float


async def call(text: str, size: int = SIZE_PX, rate_hz: float = 30.0) -> Seen:
    """Call a server of one's own, let it speak, and hang up."""
    number_pictures()
    wires = {"audio": Wire(), "video": Wire()}
    calls = CallChoice(on=True, size=size, rate_hz=rate_hz)
    async with serving(calls, Style.speech_only()) as (server, url), aiohttp.ClientSession() as http:
        caller = await watch(http, f"{url}/whep?session=anna", read_picture)
        for transceiver in caller.peer.getTransceivers():
            wires[transceiver.kind].tap(transceiver.receiver)
        while len(caller.pictures) < 5:
            await asyncio.sleep(0.05)
        begun_s, used_s = time.monotonic(), _cpu_s()
        spoken = await server.hub.speak("anna", text)
        assert spoken is not None
        zero_s = -np.inf
        while server.hub.engine.utterance("anna", spoken.utterance) is not None:
            utterance = server.hub.engine.utterance("anna", spoken.utterance)
            now_s = server.hub.clock()
            if utterance is not None and utterance.state.is_placed:
                zero_s = now_s - utterance.position_s(now_s)
            await asyncio.sleep(0.05)
        wall_s, cpu_s = time.monotonic() - begun_s, _cpu_s() - used_s
        await asyncio.sleep(0.5)
        await caller.end()
        await caller.close()
    return Seen(caller, wires, spoken, zero_s, wall_s, cpu_s)


def measured(seen: Seen) -> dict[str, Any]:
    """Compare what came as pictures with what came as sound."""
    caller, speech = seen.caller, seen.spoken.speech
    stamps = np.array([round(entry.stamp_s * RATE_HZ) for entry in caller.sounds])
    received = np.zeros(stamps[-1] - stamps[0] + RATE_HZ)  # as it was made: what is missing is silent
    for entry, stamp in zip(caller.sounds, stamps - stamps[0], strict=True):
        received[stamp : stamp + len(entry.value)] = entry.value  # type: ignore[arg-type,call-overload]
    first = found(speech.samples.astype(float), speech.sample_rate_hz, received) + stamps[0]
    audio, video = seen.wires["audio"], seen.wires["video"]
    came_s = np.array([audio.arrived_s(stamp) for stamp in stamps])
    steady_s = np.median(came_s - stamps / RATE_HZ)  # a player plays as steadily as the sound was made
    by_arrival, by_reports = [], []
    at: dict[str, list[int]] = {"shut": [], "open": []}
    labels = [(phone.label, phone.start_s, phone.end_s) for phone in speech.phones.phones]
    for entry in caller.pictures:
        code, dark = entry.value  # type: ignore[misc]
        behind_ms = (code - round(1000 * seen.zero_s) + 2 ** (CODE_BITS - 1)) % 2**CODE_BITS - 2 ** (CODE_BITS - 1)
        position_s = behind_ms / 1000
        if not 0.0 <= position_s <= speech.duration_s:
            continue
        sample = first + position_s * RATE_HZ
        stamp = round(entry.stamp_s * VIDEO_HZ)
        by_arrival.append(steady_s + sample / RATE_HZ - video.arrived_s(stamp))
        sound_s = audio.sent_s(sample, RATE_HZ)
        by_reports.append(sound_s - video.sent_s(stamp, VIDEO_HZ))
        for label, start_s, end_s in labels:
            third_s = (end_s - start_s) / 3
            if start_s + third_s <= position_s <= end_s - third_s:
                at["shut"] += [dark] * (label in SHUT)
                at["open"] += [dark] * (label in OPEN)
    spread = (5, 25, 50, 75, 95)
    return {
        "pictures": len(by_arrival),
        "pictures_hz": len(by_arrival) / speech.duration_s,
        "arrival_ms": [round(1000 * float(value), 1) for value in np.percentile(by_arrival, spread)],
        "arrival_p95_ms": round(1000 * float(np.percentile(np.abs(by_arrival), 95)), 1),
        "reports_ms": [round(1000 * float(value), 1) for value in np.percentile(by_reports, spread)],
        "reports_p95_ms": round(1000 * float(np.percentile(np.abs(by_reports), 95)), 1),
        "dark_shut": at["shut"],
        "dark_open": at["open"],
        "shut_told_from_open": max(at["shut"], default=0) < min(at["open"], default=0),
        "cpu_share": round(seen.cpu_s / seen.wall_s, 2),
    }


@asynccontextmanager
async def serving(calls: CallChoice, style: Style, *sinks: str) -> AsyncIterator[tuple[Server, str]]:
    """Run a server with calls; yield it and its URL."""
    config = ServerConfig(listen=Listen(port=0, web_port=0), style=style, calls=calls, sinks=sinks)
    server = Server(config, load_profile("grid_s1_en"), build_head())
    await server.start()
    running = asyncio.create_task(server.run())
    host, port = server.sites[0]
    try:
        yield server, f"http://{host}:{port}"
    finally:
        server.stop()
        await running


async def count_viewers(viewers: int, size: int = 512) -> dict[str, float]:
    """Count what viewers of one face cost a server, in :data:`WATCHED_S`."""
    encode, encoded = Vp8Encoder.encode, [0]

    def counted(self: Vp8Encoder, frame: Any, force_keyframe: bool = False) -> Any:
        encoded[0] += 1
        return encode(self, frame, force_keyframe)

    Vp8Encoder.encode = counted  # type: ignore[method-assign]
    try:
        async with serving(CallChoice(on=True, size=size, rate_hz=WATCHED_HZ), Style()) as (server, url):
            watching = await asyncio.create_subprocess_exec(
                sys.executable, "-m", __spec__.name, "--watch", f"{url}/whep?session=anna", str(viewers),
                stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            )  # fmt: skip
            assert watching.stdout is not None
            await watching.stdout.readline()  # all see the face
            first, used_s, drawn = encoded[0], _cpu_s(), server.studio.counts.drawn
            await asyncio.sleep(WATCHED_S)
            costs = {
                "viewers": viewers,
                "drawn": server.studio.counts.drawn - drawn,
                "encoded": encoded[0] - first,
                "server_cpu_s": round(_cpu_s() - used_s, 2),
            }
            shown, _ = await watching.communicate(b"\n")
    finally:
        Vp8Encoder.encode = encode  # type: ignore[method-assign]
    return costs | json.loads(shown)


async def _watch(url: str, viewers: int) -> None:
    """Watch as several viewers, of whom the last comes late, until a line comes; the other process."""
    async with aiohttp.ClientSession() as http:
        callers, late_s = [], 0.0
        for number in range(viewers):
            if number and number == viewers - 1:
                await asyncio.sleep(JOIN_S)
            joined_s = time.monotonic()
            callers.append(await watch(http, url, np.mean))
            while not callers[-1].pictures:
                await asyncio.sleep(0.01)
            late_s = time.monotonic() - joined_s
        print("seen", flush=True)
        before = [len(one.pictures) for one in callers]
        await asyncio.to_thread(sys.stdin.readline)
        shown = [len(one.pictures) - first for one, first in zip(callers, before, strict=True)]
        print(json.dumps({"shown": shown, "last_joined_s": round(late_s, 2)}))
        for one in callers:
            await one.end()
            await one.close()


def _cpu_s() -> float:
    """Seconds of processor of this process: server, encoder, caller; the drawing is another."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure once, and say whether the goal is met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--viewers", metavar="N,N,...", help="count what viewers of one face cost")
    parser.add_argument("--watch", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.watch:
        asyncio.run(_watch(given.watch[0], int(given.watch[1])))
        return
    if given.viewers:
        for viewers in given.viewers.split(","):
            print(json.dumps(asyncio.run(count_viewers(int(viewers)))), flush=True)
        return
    told = measured(asyncio.run(call(TEXT)))
    if given.json:
        print(json.dumps(told))
        return
    for name, value in told.items():
        print(f"{name:<16} {value}")
    limit_ms = 1000 * LIMIT_S
    is_met = max(told["arrival_p95_ms"], told["reports_p95_ms"]) <= limit_ms and told["shut_told_from_open"]
    print(f"lips shut on every m p b, and p95 of |picture before sound| at most {limit_ms:.0f} ms:", is_met)
    raise SystemExit(not is_met)


if __name__ == "__main__":
    main()
