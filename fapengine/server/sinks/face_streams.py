"""The MPEG-4 face stream over TCP, for all who connect."""

import asyncio
import socket
from typing import cast

from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrames
from fapengine.server.intake.doors import Door, Guarded, limit_unread
from fapengine.server.intake.listeners import bound
from fapengine.server.sinks.encoders import FbaFrameEncoder, joined
from fapengine.server.sinks.kinds import SinkAddress, SinkCounts

UNREAD_BYTES = 64 << 10
"""Unread bytes of a face stream, some seconds, beyond which the receiver is resumed at a later I plane."""
STREAMS = 256
END = b"\x00\x00\x01\xb1"
"""End code of a face stream."""


class FaceStreams:
    """A sink that streams one face to every connection; each begins, and resumes, at an I plane. Stateful."""

    def __init__(self, hub: Hub, address: SinkAddress, face: FbaFrameEncoder) -> None:
        self.address, self.counts = address, SinkCounts()
        self.face = face
        self._server: asyncio.Server | None = None
        self.door = Door.shared(STREAMS)
        self.listeners: set[_FaceStream] = set()
        self._stop = hub.listeners.on_frames(self._show)

    @classmethod
    async def open(cls, hub: Hub, address: SinkAddress) -> "FaceStreams":
        """Listen for connections.

        Raises UsageError if an option's value is wrong; ResourceError if the port is in use.
        """
        face = FbaFrameEncoder(address, hub.pacer.rate_hz)
        listening = bound(address.host, address.port, socket.SOCK_STREAM)
        sink = cls(hub, address, face)
        loop = asyncio.get_running_loop()
        sink._server = await loop.create_server(lambda: _FaceStream(sink), sock=listening)
        return sink

    @property
    def port(self) -> int:
        """Port on which it listens."""
        port: int = 0 if self._server is None else self._server.sockets[0].getsockname()[1]
        return port

    async def close(self) -> None:
        """Close all connections."""
        self._stop()
        if self._server is not None:
            self._server.close()
        for listener in tuple(self.listeners):
            listener.end()

    def _show(self, frames: HubFrames) -> None:
        for plane in self.face.encode(frames):
            for listener in tuple(self.listeners):
                taken = listener.show(plane)
                self.counts.sent += taken
                self.counts.dropped += not taken


class _FaceStream(Guarded, asyncio.Protocol):
    """The connection of one receiver of a face stream. Stateful."""

    def __init__(self, sink: FaceStreams) -> None:
        self._sink = sink
        self._begun = self._follows = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if not self.enter(self._sink.door, transport):
            cast("asyncio.Transport", transport).abort()
            return
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        limit_unread(transport, UNREAD_BYTES, UNREAD_BYTES // 2)
        self._sink.listeners.add(self)
        self._sink.face.request_intra()

    def connection_lost(self, exc: BaseException | None) -> None:
        super().connection_lost(exc)
        self._sink.listeners.discard(self)

    def show(self, plane: bytes) -> bool:
        """Send a plane if the receiver can decode it; False if it was not sent."""
        if self._link is None or self._link.is_closing():
            return False
        if self._follows and self._link.get_write_buffer_size() > UNREAD_BYTES:
            self._follows = False
        if not self._follows:
            start = joined(plane)
            if start is None or self._link.get_write_buffer_size() > UNREAD_BYTES // 2:
                return False
            plane = plane if self._begun else start
            self._begun = self._follows = True
        self._link.write(plane)
        return True

    def end(self) -> None:
        if self._link is not None:
            if self._begun:
                self._link.write(END)
            self._link.close()
