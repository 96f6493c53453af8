"""A caller by WHEP and WHIP: aiortc and aiohttp, with what it sees and hears written down."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction

import aiohttp
import av
import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

SDP = {"Content-Type": "application/sdp"}
Reads = Callable[[np.ndarray], object]


@dataclass(frozen=True)
class Arrived:
    """A picture, or a piece of sound, as it came."""

    at_s: float
    """On the clock of the machine."""
    stamp_s: float
    """Of the sender."""
    value: object


@dataclass(eq=False)
class Caller:
    """Stateful: one call."""

    http: aiohttp.ClientSession
    peer: RTCPeerConnection
    place: str = ""
    """Address at which the call can be ended."""
    pictures: list[Arrived] = field(default_factory=list)
    sounds: list[Arrived] = field(default_factory=list)
    readers: list[asyncio.Task[None]] = field(default_factory=list)

    @property
    def sound(self) -> np.ndarray:
        """(N,) int16, 48 kHz."""
        return np.concatenate([np.zeros(0, np.int16), *(entry.value for entry in self.sounds)])

    async def post(self, url: str, token: str | None = None) -> None:
        """Offer what the peer has, and take the answer."""
        await self.peer.setLocalDescription(await self.peer.createOffer())
        headers = SDP | ({"Authorization": f"Bearer {token}"} if token else {})
        async with self.http.post(url, data=self.peer.localDescription.sdp, headers=headers) as answer:
            assert answer.status == 201, await answer.text()
            self.place = str(answer.url.join(aiohttp.client.URL(answer.headers["Location"], encoded=True)))
            await self.peer.setRemoteDescription(RTCSessionDescription(await answer.text(), "answer"))

    async def end(self) -> int:
        """Hang up; gives the status."""
        async with self.http.delete(self.place) as answer:
            return answer.status

    async def close(self) -> None:
        for reader in self.readers:
            reader.cancel()
        await self.peer.close()
        await asyncio.gather(*self.readers, return_exceptions=True)


def caller(http: aiohttp.ClientSession) -> Caller:
    return Caller(http, RTCPeerConnection(RTCConfiguration(iceServers=[])))


async def watch(http: aiohttp.ClientSession, url: str, reads: Reads, token: str | None = None) -> Caller:
    """Call by WHEP; of each picture, (H, W, 3) uint8, what ``reads`` finds is kept."""
    own = caller(http)

    @own.peer.on("track")
    def on_track(track: MediaStreamTrack) -> None:
        own.readers.append(asyncio.ensure_future(read_track(own, track, reads)))

    own.peer.addTransceiver("audio", direction="recvonly")
    own.peer.addTransceiver("video", direction="recvonly")
    await own.post(url, token)
    return own


async def speak(http: aiohttp.ClientSession, url: str, samples: np.ndarray, rate_hz: int) -> Caller:
    """Call by WHIP, and speak."""
    own = caller(http)
    own.peer.addTrack(Mouth(samples, rate_hz))
    await own.post(url)
    return own


class Mouth(MediaStreamTrack):
    """Sound as somebody says it, then silence. Stateful."""

    kind = "audio"

    def __init__(self, samples: np.ndarray, rate_hz: int) -> None:
        super().__init__()
        self._samples, self._rate_hz, self._sent = samples, rate_hz, 0
        self._begun_s: float | None = None

    async def recv(self) -> av.AudioFrame:
        step = self._rate_hz // 50
        self._begun_s = self._begun_s or time.monotonic()
        await asyncio.sleep(max(0.0, self._begun_s + self._sent / self._rate_hz - time.monotonic()))
        piece = self._samples[self._sent : self._sent + step]
        frame = av.AudioFrame.from_ndarray(
            np.pad(piece, (0, step - len(piece))).reshape(1, -1), format="s16", layout="mono"
        )
        frame.sample_rate, frame.pts, frame.time_base = self._rate_hz, self._sent, Fraction(1, self._rate_hz)
        self._sent += step
        return frame


async def read_track(own: Caller, track: MediaStreamTrack, reads: Reads) -> None:
    """Write down what comes of a track, until it ends."""
    with suppress(MediaStreamError):
        while True:
            frame = await track.recv()
            now_s, stamp_s = time.monotonic(), float(frame.pts * frame.time_base)
            if isinstance(frame, av.AudioFrame):
                samples = frame.to_ndarray().reshape(-1, len(frame.layout.channels))[:, 0].copy()
                own.sounds.append(Arrived(now_s, stamp_s, samples))
            else:
                own.pictures.append(Arrived(now_s, stamp_s, reads(frame.to_ndarray(format="rgb24"))))
