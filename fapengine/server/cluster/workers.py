"""A server of several processes: the parent starts workers, assigns sessions to them, and restarts them.

Theory of operation
-------------------
The parent holds the known ports (:mod:`.front`) and shows no face. Each worker (:mod:`.worker`) is a whole server with
its own ports and sinks, which shows the sessions that are assigned to it (:mod:`fapengine.server.ownership`). The two
communicate over an ordered channel (:mod:`.channel`).

A worker that is silent for :data:`HUNG_TICKS` is killed. A worker that ends may leave open mouths: the parent knows its
open sessions, sends each datagram sink a neutral face, and only then assigns the sessions to other workers, on request:
senders send their hello again, pages reconnect. The worker is restarted meanwhile.

If several machines share sessions (:mod:`.bus`), the parent first finds the machine of a session. Workers are sent the
time until which their sessions are surely their own, and end when it is over.
"""

import asyncio
import logging
import os
import pickle
import signal
import socket
import sys
import time
from asyncio.subprocess import DEVNULL, Process
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace

from fapengine import errors
from fapengine._child import command
from fapengine._counters import Family
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.server.cluster import channel
from fapengine.server.cluster.bus import Bus
from fapengine.server.cluster.channel import Channel
from fapengine.server.cluster.front import Front
from fapengine.server.config import ServerConfig
from fapengine.server.intake.doors import open_doors, raise_file_limit
from fapengine.server.metrics import open_metrics, page_of_workers
from fapengine.server.ownership import Home, Placement
from fapengine.server.partitions import Machine
from fapengine.server.sinks.kinds import kind_of, parse_sink
from fapengine.server.watchdog import send_neutral
from fapengine.server.web.access import Access
from fapengine.server.web.site import Site

TICK_S = 0.5
"""Interval at which the workers are checked."""
HUNG_TICKS = 10
"""Checks in a row without a message of a worker, after which it counts as hung."""
BEGIN_S = 60.0
"""Time that a worker may take to start."""
STOP_S = 5.0
"""Time that workers may take to stop."""
AGAIN_S = (0.1, 10.0)
"""Pause before a worker is restarted: the first, and the longest if it ends repeatedly."""
STEADY_S = 10.0
"""Lifetime after which a worker counts as stable."""
SCRAPE_S = 2.0
"""Time that a worker may take to send its metrics."""

log = logging.getLogger("fapengine.server")


@dataclass(slots=True, eq=False)
class _Slot:
    """A worker: a number, and its current process. Stateful."""

    number: int
    process: Process | None = None
    link: Channel | None = None
    port: int = 0
    sinks: list[str] = field(default_factory=list)
    open_since_s: dict[str, float] = field(default_factory=dict)
    epochs: dict[str, int] = field(default_factory=dict)
    ready: "asyncio.Future[None] | None" = None
    silent_ticks: int = 0
    metrics: bytearray = field(default_factory=bytearray)
    """Received part of the metrics."""
    asked: "asyncio.Future[bytes] | None" = None
    """Requested metrics."""


class Workers:
    """The parent of a server's workers. Make, start and run it on one event loop, as a ``Server``. Stateful.

    Raises UsageError if the configuration requires a single process (:func:`check_workers`).

    Parameters
    ----------
    config : ServerConfig
        Configuration; ``config.listen.workers`` is the number of workers.
    """

    def __init__(self, config: ServerConfig) -> None:
        check_workers(config)
        self.config = config
        self.bus: Bus | None = None
        self.restarts = 0
        limits = config.limits
        most = {"front": limits.connections, "metrics": limits.connections}
        doors = open_doors(most, limits.connections_per_address, raise_file_limit())
        doors["front"].proxies = doors["metrics"].proxies = config.listen.proxies
        self._metrics_door = doors["metrics"]
        self.front = Front(self, doors["front"])
        self._slots = [_Slot(number) for number in range(config.listen.workers)]
        self._sinks = [parse_sink(url) for url in config.sinks]
        self._stop = asyncio.Event()
        self._keepers: list[asyncio.Task[None]] = []
        self._site: Site | None = None
        self._next = 0
        self._until_s: float | None = None
        if config.bus.url is not None:
            self.bus = Bus(config.bus, config.listen.host, self._extend_lease, self._stop_all)
        self.placement = Placement(self.bus, self._assign)

    @property
    def osc_address(self) -> tuple[str, int]:
        """Host and port of OSC, UDP and TCP alike."""
        return self.front.osc_address

    @property
    def sites(self) -> list[tuple[str, int]]:
        """Hosts and ports of the web page and of the metrics, as far as they are configured."""
        page_address = [self.front.page_address] if self.config.listen.web_port is not None else []
        return page_address + ([self._site.address] if self._site else [])

    @property
    def sink_names(self) -> list[str]:
        """URLs of the workers' sinks."""
        return self._slots[0].sinks

    @property
    def processes(self) -> dict[int, int]:
        """Number of each live worker to its process."""
        return {
            slot.number: slot.process.pid
            for slot in self._slots
            if slot.process is not None and slot.number in self.placement.workers
        }

    async def start(self) -> None:
        """Bind the ports and start all workers.

        Raises ResourceError if a port is in use, or a worker does not start; then nothing stays open.
        """
        listen = self.config.listen
        try:
            self.front.bind(listen.host, listen.port, listen.web_port)
            access = Access(listen.token, proxies=listen.proxies)
            self._site = await open_metrics(self.metrics, listen, self._metrics_door, access)
            await asyncio.gather(*(self._launch(slot) for slot in self._slots))
            if self.bus is not None:
                await self.bus.start(self.osc_address[1], self.front.page_address[1])
        except FapEngineError:
            await self._close()
            raise
        self.front.open()
        self._keepers = [asyncio.create_task(self._keep(slot)) for slot in self._slots]

    async def run(self) -> None:
        """Run until :meth:`stop`; then return all faces to neutral, and end the workers."""
        watching = asyncio.create_task(self._watch())
        try:
            await self._stop.wait()
        finally:
            watching.cancel()
            await self._close()

    def stop(self) -> None:
        """End :meth:`run`. Further calls do nothing."""
        self._stop.set()

    # For the front --------------------------------------------------------------------------------------------------

    def owner(self, session: str) -> Home | Machine | None:
        """Return the worker or the other machine of a session; see :meth:`Placement.owner`."""
        return self.placement.owner(session, time.monotonic())

    def settle(self, session: str, again: Callable[[], None]) -> bool:
        """Request the owner of a session if it is not known; then return True, and call ``again`` afterwards."""
        return self.bus is not None and self.bus.settle(session, again)

    def port(self, home: Home) -> int:
        """Return the OSC port of a session's worker."""
        return self._slots[home.worker].port

    def send(self, worker: int, message: channel.Message, handed: socket.socket | None = None) -> bool:
        """Send a message to a worker, with a socket, which is then closed here."""
        link = self._slots[worker].link
        if link is None and handed is not None:
            handed.close()
        return link is not None and link.put(message, handed)

    def send_any(self, message: channel.Message, handed: socket.socket) -> None:
        """Send a message to the next worker in turn."""
        alive = sorted(self.placement.workers)
        if not alive:
            handed.close()
            return
        self._next += 1
        self.send(alive[self._next % len(alive)], message, handed)

    def _assign(self, session: str, home: Home) -> None:
        slot = self._slots[home.worker]
        if slot.link is not None:
            slot.epochs[session] = home.epoch
            slot.link.put(channel.Own(session, home.epoch))

    def _extend_lease(self, until_s: float) -> None:
        self._until_s = until_s
        for slot in self._slots:
            if slot.link is not None:
                slot.link.put(channel.Until(until_s))

    def _stop_all(self) -> None:
        """Stop all workers because this machine's lease has expired. Each is restarted afterwards."""
        self._until_s = None
        for slot in self._slots:
            self.placement.pass_over(slot.number)
            _signal(slot.process, signal.SIGTERM)
            asyncio.get_running_loop().call_later(STOP_S, _signal, slot.process, signal.SIGKILL)

    # Workers --------------------------------------------------------------------------------------------------------

    async def _launch(self, slot: _Slot) -> None:
        """Start a worker, and wait until it is ready."""
        assert self.front.datagrams is not None
        loop = asyncio.get_running_loop()
        ours, theirs = Channel.pair()
        files = (theirs.fileno(), self.front.datagrams.fileno())
        program = command("fapengine.server.cluster.worker", *map(str, files))
        slot.process = await asyncio.create_subprocess_exec(*program, stdin=DEVNULL, pass_fds=files, process_group=0)
        theirs.close()
        slot.link = link = Channel(ours, is_worker=False)
        slot.ready, slot.silent_ticks = loop.create_future(), 0
        listen = replace(self.config.listen, port=0, metrics_port=None)
        config = pickle.dumps(replace(self.config, listen=listen))
        link.put(channel.Begin(config, slot.number, self.osc_address[1]))
        loop.add_reader(link.fileno(), self._read, slot)
        late = loop.call_later(BEGIN_S, self._settle, slot, f"did not start within {BEGIN_S:.0f} s")
        try:
            await slot.ready
        except FapEngineError:
            await self._end(slot)
            raise
        finally:
            late.cancel()
        self.placement.join(slot.number)
        if self.bus is not None:
            if self._until_s is not None:
                link.put(channel.Until(self._until_s))
            self.bus.step_up()

    async def _keep(self, slot: _Slot) -> None:
        """Restart a worker whenever it has ended."""
        pause_s = AGAIN_S[0]
        while True:
            assert slot.process is not None
            begun_s = time.monotonic()
            code = await slot.process.wait()
            self.placement.pass_over(slot.number)
            self.restarts += 1
            log.error(
                "worker %d has ended (%d); its faces begin again on other workers: %d",
                slot.number, code, len(slot.open_since_s), extra={"sessions": len(slot.open_since_s)},
            )  # fmt: skip
            await self._bury(slot)
            if time.monotonic() - begun_s > STEADY_S:
                pause_s = AGAIN_S[0]
            while True:
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, AGAIN_S[1])
                try:
                    await self._launch(slot)
                    break
                except FapEngineError as error:
                    log.error("worker %d does not start: %s", slot.number, error)

    async def _bury(self, slot: _Slot) -> None:
        """Send neutral frames for the sessions of a worker that has ended; then other workers may have them."""
        if slot.open_since_s:
            sinks, rate_hz = self._sinks, self.config.face.rate_hz
            await asyncio.to_thread(send_neutral, sinks, slot.open_since_s.copy(), rate_hz, slot.epochs.copy())
        await self._end(slot)
        self.placement.lose(slot.number)
        if self.bus is not None and not self.placement.workers:
            self._until_s = None
            await self.bus.step_down()
        slot.open_since_s.clear()
        slot.epochs.clear()

    async def _end(self, slot: _Slot) -> None:
        """Kill a worker's process and close its channel."""
        self._settle(slot, "was ended before it was ready")
        if slot.link is not None:
            asyncio.get_running_loop().remove_reader(slot.link.fileno())
            slot.link.close()
            slot.link = None
        if slot.process is not None:
            _signal(slot.process, signal.SIGKILL)
            await slot.process.wait()
        if slot.asked is not None and not slot.asked.done():
            slot.asked.set_result(b"")

    def _read(self, slot: _Slot) -> None:
        """Handle the messages of a worker."""
        link = slot.link
        if link is None:
            return
        for message, _ in link.take():
            slot.silent_ticks = 0
            match message:
                case channel.Ready():
                    slot.port, slot.sinks = message.port, message.sinks
                    self._settle(slot)
                case channel.Failed():
                    self._settle(slot, message.reason, getattr(errors, message.kind, ResourceError))
                case channel.Sessions():
                    now_s = time.monotonic()
                    for session in message.opened:
                        slot.open_since_s.setdefault(session, now_s)
                    for session in message.closed:
                        slot.open_since_s.pop(session, None)
                    self.placement.opened(slot.number, message.opened)
                    self.placement.closed(slot.number, message.closed, now_s)
                case channel.Left():
                    if self.placement.left(slot.number, message.session):
                        slot.epochs.pop(message.session, None)
                case channel.Metrics():
                    slot.metrics += message.text
                    if not message.text and slot.asked is not None and not slot.asked.done():
                        slot.asked.set_result(bytes(slot.metrics))
        if link.is_broken:
            asyncio.get_running_loop().remove_reader(link.fileno())
            self._settle(slot, "ended before it was ready; the log has the reason")
            if not self._stop.is_set():
                _signal(slot.process, signal.SIGKILL)  # it can no longer be reached

    def _settle(self, slot: _Slot, problem: str = "", kind: type[FapEngineError] = ResourceError) -> None:
        """Report that a worker is ready, or why it cannot be."""
        if slot.ready is None or slot.ready.done():
            return
        if problem:
            slot.ready.set_exception(kind(f"worker {slot.number}: {problem}"))
        else:
            slot.ready.set_result(None)

    async def _watch(self) -> None:
        """Kill hung workers, send what waits in channels, take back unused sessions."""
        while True:
            await asyncio.sleep(TICK_S)
            for slot in self._slots:
                if slot.link is None:
                    continue
                slot.link.flush()
                slot.silent_ticks += slot.number in self.placement.workers
                if slot.silent_ticks > HUNG_TICKS:
                    log.error("worker %d hangs and is killed", slot.number)
                    _signal(slot.process, signal.SIGKILL)
            for worker, session in self.placement.to_leave(time.monotonic()):
                self.send(worker, channel.Leave(session))

    async def _close(self) -> None:
        """Close the ports, let the workers return their faces to neutral, and end them."""
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)
        self.front.close()
        processes = [slot.process for slot in self._slots if slot.process is not None]
        for process in processes:
            _signal(process, signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(STOP_S):
                await asyncio.gather(*(process.wait() for process in processes))
        for slot in self._slots:
            await self._end(slot)
            if slot.process is not None and slot.process.returncode != 0:
                await self._bury(slot)
        if self.bus is not None:
            await self.bus.close()
        if self._site is not None:
            await self._site.close()

    # Metrics --------------------------------------------------------------------------------------------------------

    async def metrics(self) -> bytes:
        """Return the page that Prometheus reads, with all workers that answer in time."""
        alive = [slot for slot in self._slots if slot.number in self.placement.workers]
        texts = await asyncio.gather(*map(self._scrape, alive))
        return page_of_workers(
            self._families(), {slot.number: text for slot, text in zip(alive, texts, strict=True) if text}
        )

    def _families(self) -> Iterator[Family]:
        yield Family.of("workers", "Workers that live.", len(self.placement.workers), is_gauge=True)
        yield Family.of("worker_restarts", "Workers that had ended.", self.restarts)
        yield Family.of("placed", "Sessions that have a worker.", len(self.placement.homes), is_gauge=True)
        yield from self.front.counts.families()
        if self.bus is not None:
            yield from self.bus.families()

    async def _scrape(self, slot: _Slot) -> bytes:
        if slot.asked is None or slot.asked.done():
            slot.asked = asyncio.get_running_loop().create_future()
            slot.metrics.clear()
            self.send(slot.number, channel.AskMetrics())
        try:
            async with asyncio.timeout(SCRAPE_S):
                return await asyncio.shield(slot.asked)
        except TimeoutError:
            return b""


def _signal(process: Process | None, number: int) -> None:
    """Signal a process that may have ended; ``Process.kill`` would reap it before the loop does."""
    if process is not None and process.returncode is None:
        with suppress(ProcessLookupError):  # it has ended, and the loop will notice
            os.kill(process.pid, number)


def check_workers(config: ServerConfig) -> None:
    """Refuse a configuration that requires a single process.

    Raises UsageError if it has an audio device, or a sink of one face without a session; or the system is not Linux.
    """
    if sys.platform != "linux":
        raise UsageError(f"workers: got {sys.platform}, expected Linux, whose sockets they share")
    for what, value in (("sound", config.sound.session), ("microphone", config.sound.microphone)):
        if value:
            raise UsageError(f"workers: got {what} {value!r}, expected none: audio devices need a single process")
    for url in config.sinks:
        sink = parse_sink(url)
        kind = kind_of(sink)
        if kind.medium == "connections":
            raise UsageError(
                f"workers: got sink {url}, expected one that sends datagrams: connections need a single process"
            )
        if not kind.takes_all_sessions and sink.session is None:
            raise UsageError(f"workers: got sink {url}, expected {url}?session=NAME: each worker has a first session")
