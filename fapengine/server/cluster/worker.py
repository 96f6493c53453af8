"""A worker: a server in a child process of :mod:`.workers`, for the sessions that the parent assigns to it.

It listens for OSC at its own port, to which the parent redirects senders. From the known ports it receives, through the
parent, single datagrams, which it answers from the known port itself, and whole connections. When the parent ends for
any reason, the worker returns its faces to neutral and ends too.
"""

import asyncio
import logging
import pickle
import signal
import socket
import time
from typing import cast

from fapengine._child import Parent
from fapengine.errors import FapEngineError
from fapengine.host.listeners import HubFrames
from fapengine.server.cluster import channel
from fapengine.server.cluster.channel import Channel
from fapengine.server.config import ServerConfig
from fapengine.server.intake.listeners import Caller
from fapengine.server.intake.rates import collecting_in_pieces
from fapengine.server.intake.tasks import Tasks
from fapengine.server.logs import begin_log
from fapengine.server.ownership import OwnSessions
from fapengine.server.server import Server, serve

ALIVE_S = 0.5
"""Interval between two signs of life."""
LATE_S = 0.15
"""Time after the end of the lease from which faces are closed without a fade."""
METRICS_AT_ONCE = 64 << 10
"""Bytes of metrics in one message."""

log = logging.getLogger("fapengine.server")


class Worker:
    """The server and its end of the channel. Stateful.

    Parameters
    ----------
    link : Channel
    front : socket
        The parent's UDP socket, from which answers are sent.
    config : ServerConfig
        Configuration with the worker's own port.
    front_port : int
        Known OSC port of the parent.
    """

    def __init__(self, link: Channel, front: socket.socket, config: ServerConfig, front_port: int) -> None:
        self._link, self._front = link, front
        self._own = OwnSessions(front_port, self._read)
        self.server = Server(config, own=self._own)
        self._reported: tuple[str, ...] = ()
        self._adopting = Tasks()

    async def run(self) -> None:
        """Serve until stopped."""
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGTERM, self._stop)
        living = asyncio.create_task(self._live())
        try:
            with collecting_in_pieces():
                await serve(self.server, self._begin)
        finally:
            living.cancel()
            loop.remove_reader(self._link.fileno())

    def close(self) -> None:
        """End the channel."""
        self._link.close()

    def _begin(self) -> None:
        self.server.hub.listeners.on_frames(self._report)
        self.server.ingress.readers.append(self._read)
        asyncio.get_running_loop().add_reader(self._link.fileno(), self._read)
        sinks = [str(sink.address) for sink in self.server.sinks]
        self._link.put(channel.Ready(self.server.osc_address[1], sinks))

    async def _live(self) -> None:
        while True:
            await asyncio.sleep(ALIVE_S)
            self._link.put(channel.Alive())
            self._link.flush()

    def _report(self, frames: HubFrames) -> None:
        """Report which sessions were opened and closed."""
        if frames.sessions == self._reported:
            return
        before, now = set(self._reported), set(frames.sessions)
        self._reported = frames.sessions
        opened, closed = sorted(now - before), sorted(before - now)
        for at in range(0, max(len(opened), len(closed)), channel.SESSIONS_AT_ONCE):
            part = slice(at, at + channel.SESSIONS_AT_ONCE)
            self._link.put(channel.Sessions(opened[part], closed[part]))

    def _read(self) -> int:
        """Handle the parent's messages; return the number of datagrams."""
        packets = 0
        for message, handed in self._link.take():
            match message:
                case channel.Packet():
                    packets += 1
                    self.server.ingress.put(Caller(self._front, cast("tuple[str, int]", message.address)), message.data)
                case channel.Own():
                    self._own.epochs[message.session] = message.epoch
                case channel.Until():
                    self._own.until_s = message.time_s
                case channel.Leave():
                    if message.session not in self.server.hub.engine:
                        self._own.epochs.pop(message.session, None)
                        self._link.put(channel.Left(message.session))
                case channel.Connection():
                    if handed is not None:
                        handed.setblocking(False)
                        self._adopting.start(self.server.adopt(handed, message.session, is_page=message.is_page))
                case channel.AskMetrics():
                    text = self.server.metrics.text()
                    for at in range(0, len(text), METRICS_AT_ONCE):
                        self._link.put(channel.Metrics(text[at : at + METRICS_AT_ONCE]))
                    self._link.put(channel.Metrics(b""))
        self.server.ingress.counts.datagrams += packets
        if self._own.until_s is not None and time.monotonic() >= self._own.until_s:
            self._give_up(time.monotonic() - self._own.until_s)
        if self._link.is_broken:
            self._stop()
            asyncio.get_running_loop().remove_reader(self._link.fileno())
        return packets

    def _stop(self) -> None:
        """Stop; quietly if the sessions may continue on another machine."""
        self.server.stop(is_quiet=self._own.until_s is not None)

    def _give_up(self, late_s: float) -> None:
        """Stop because another machine may get the sessions soon, or has them already if this process was suspended."""
        self._stop()
        if late_s > LATE_S:
            engine = self.server.hub.engine
            for session in engine.sessions:
                engine.close(session, self.server.hub.clock())


def main(_: Parent, link_file: str, front_file: str) -> int:
    """Run a worker; return the exit code.

    Parameters
    ----------
    link_file, front_file : str
        File descriptors of the channel to the parent, and of the parent's UDP socket.
    """

    def add_number(record: logging.LogRecord) -> bool:
        record.worker = begin.number
        return True

    end, front = socket.socket(fileno=int(link_file)), socket.socket(fileno=int(front_file))
    end.setblocking(True)
    begin = channel.decode_begin(end.recv(channel.MAX_MESSAGE))
    config = pickle.loads(begin.config)  # from the parent
    begin_log(config.log.level, config.log.format).addFilter(add_number)
    link = Channel(end, is_worker=True)
    try:
        asyncio.run(Worker(link, front, config, begin.front_port).run())
    except FapEngineError as error:
        link.put(channel.Failed(str(error), type(error).__name__))
        return 3
    return 0
