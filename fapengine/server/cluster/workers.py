"""A server of many processes: the parent, which starts workers, gives them sessions, and sees that all goes on.

Theory of operation
-------------------
The parent holds the known ports (:mod:`.front`) and plans no face. Each worker (:mod:`.worker`) is a whole server at
ports of its own, with its own sinks, and shows the sessions that it is given (:mod:`fapengine.server.ownership`). The
two talk over a channel that keeps its order (:mod:`.channel`).

A worker that ends leaves open mouths; one of which nothing is heard any more (:data:`HUNG_TICKS`) is killed. The parent
knows which sessions it had open, sends each datagram sink a face at rest, and only then gives the sessions to others,
when they are asked for: senders greet again, pages connect again. The worker is restarted meanwhile.

Where several machines share their sessions (:mod:`.bus`), the parent first finds out whose a session is. Workers are
told until when theirs are surely their own, and end when that time is over.
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
from fapengine.server.cluster.front import Front, FrontCounts
from fapengine.server.config import ServeConfig
from fapengine.server.intake.doors import open_doors, raise_file_limit
from fapengine.server.metrics import open_metrics, page_of_workers
from fapengine.server.ownership.partitions import Machine
from fapengine.server.ownership.placement import Home
from fapengine.server.ownership.rule import Owners
from fapengine.server.sinks.kinds import kind_of, parse_sink
from fapengine.server.watchdog import send_neutral
from fapengine.server.web.site import Site

TICK_S = 0.5
"""Time from one look at the workers to the next."""
HUNG_TICKS = 10
"""Looks in a row at which nothing had been heard of a worker: it hangs."""
BEGIN_S = 60.0
"""Time that a worker may take to begin."""
STOP_S = 5.0
"""Time in which workers come to rest."""
AGAIN_S = (0.1, 10.0)
"""Pause before a worker is started again: of the first time, and the longest of one that ends again and again."""
STEADY_S = 10.0
"""A worker that lived for so long counts as one that can."""
SCRAPE_S = 2.0
"""Time that a worker has to tell its metrics."""

log = logging.getLogger("fapengine.server")


@dataclass(slots=True, eq=False)
class _Slot:
    """A worker's place; the process in it may be another one than before.

    Stateful.
    """

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
    asked: "asyncio.Future[bytes] | None" = None


class Workers:
    """The parent of a server's workers; made, started and run on one event loop, as a ``Server`` is.

    Stateful.

    Parameters
    ----------
    config : ServeConfig
        Of all; ``config.listen.workers`` says how many.

    Raises
    ------
    UsageError
        If the configuration asks for what only one process can do (:func:`check_workers`).
    """

    def __init__(self, config: ServeConfig) -> None:
        check_workers(config)
        self.config = config
        self.bus: Bus | None = None
        self.counts = FrontCounts()
        self.restarts = 0
        limits = config.limits
        most = {"front": limits.connections, "metrics": limits.connections}
        doors = open_doors(most, limits.connections_per_address, raise_file_limit())
        self._metrics_door = doors["metrics"]
        self.front = Front(self, self.counts, doors["front"])
        self._slots = [_Slot(number) for number in range(config.listen.workers)]
        self._sinks = [parse_sink(url) for url in config.sinks]
        self._stop = asyncio.Event()
        self._keepers: list[asyncio.Task[None]] = []
        self._site: Site | None = None
        self._next = 0
        self._until_s: float | None = None
        if config.bus.url is not None:
            self.bus = Bus(config.bus, config.listen.host, self._tell_lease, self._stop_all)
        self.owners = Owners(self.bus, self._tell_owner)
        self.placement = self.owners.workers

    @property
    def osc_address(self) -> tuple[str, int]:
        """Host and port of OSC, UDP and TCP alike."""
        return self.front.osc_address

    @property
    def sites(self) -> list[tuple[str, int]]:
        """Hosts and ports of the page and of the metrics, those that there are."""
        page_address = [self.front.page_address] if self.config.listen.web_port is not None else []
        return page_address + ([self._site.address] if self._site else [])

    @property
    def sink_names(self) -> list[str]:
        """Where the workers send frames, as URLs."""
        return self._slots[0].sinks

    @property
    def processes(self) -> dict[int, int]:
        """Process of each worker that lives, by number."""
        return {
            slot.number: slot.process.pid
            for slot in self._slots
            if slot.process is not None and slot.number in self.placement.workers
        }

    async def start(self) -> None:
        """Take the ports and start all workers.

        Raises
        ------
        ResourceError
            If a port is taken, or a worker does not begin; then nothing stays open.
        """
        listen = self.config.listen
        try:
            self.front.bind(listen.host, listen.port, listen.web_port)
            self._site = await open_metrics(self.metrics, listen, self._metrics_door)
            await asyncio.gather(*(self._launch(slot) for slot in self._slots))
            if self.bus is not None:
                await self.bus.start(self.osc_address[1], self.front.page_address[1])
        except FapEngineError:
            await self._close()
            raise
        self.front.open()
        self._keepers = [asyncio.create_task(self._keep(slot)) for slot in self._slots]

    async def run(self) -> None:
        """Go on until :meth:`stop`; then all faces come to rest, and the workers end."""
        watching = asyncio.create_task(self._watch())
        try:
            await self._stop.wait()
        finally:
            watching.cancel()
            await self._close()

    def stop(self) -> None:
        """Let :meth:`run` end; again changes nothing."""
        self._stop.set()

    # What the front calls -------------------------------------------------------------------------------------------

    def owner(self, session: str) -> Home | Machine | None:
        """Give the machine or the worker that shows a session; see :meth:`Owners.owner`."""
        return self.owners.owner(session, time.monotonic())

    def settle(self, session: str, again: Callable[[], None]) -> bool:
        """Find out whose a session is, if that must be asked; then True, and what is given is called afterwards."""
        return self.bus is not None and self.bus.settle(session, again)

    def port(self, worker: int) -> int:
        """Give the OSC port of a worker."""
        return self._slots[worker].port

    def send(self, worker: int, message: channel.Message, handed: socket.socket | None = None) -> bool:
        """Send to a worker, with a socket, which is closed here."""
        link = self._slots[worker].link
        if link is None and handed is not None:
            handed.close()
        return link is not None and link.put(message, handed)

    def send_any(self, message: channel.Message, handed: socket.socket) -> None:
        """Send to the next worker in turn."""
        alive = sorted(self.placement.workers)
        if not alive:
            handed.close()
            return
        self._next += 1
        self.send(alive[self._next % len(alive)], message, handed)

    def _tell_owner(self, session: str, home: Home) -> None:
        slot = self._slots[home.worker]
        if slot.link is not None:
            slot.epochs[session] = home.epoch
            slot.link.put(channel.Own(session, home.epoch))

    def _tell_lease(self, until_s: float) -> None:
        self._until_s = until_s
        for slot in self._slots:
            if slot.link is not None:
                slot.link.put(channel.Until(until_s))

    def _stop_all(self) -> None:
        """Have all workers end: this machine's lease has run out. Each is started again when it has."""
        self._until_s = None
        for slot in self._slots:
            self.placement.pass_over(slot.number)
            _signal(slot.process, signal.SIGTERM)
            asyncio.get_running_loop().call_later(STOP_S, _signal, slot.process, signal.SIGKILL)

    # Workers --------------------------------------------------------------------------------------------------------

    async def _launch(self, slot: _Slot) -> None:
        """Start a worker, and wait until everything of it is open."""
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
        try:
            async with asyncio.timeout(BEGIN_S):
                await slot.ready
        except (TimeoutError, FapEngineError) as error:
            await self._end(slot)
            if isinstance(error, TimeoutError):
                raise ResourceError(f"worker {slot.number}: did not begin within {BEGIN_S:.0f} s") from error
            raise
        self.placement.join(slot.number)
        if self.bus is not None:
            if self._until_s is not None:
                link.put(channel.Until(self._until_s))
            self.bus.step_up()

    async def _keep(self, slot: _Slot) -> None:
        """Start a worker again whenever it has ended."""
        pause_s = AGAIN_S[0]
        while True:
            assert slot.process is not None
            begun_s = time.monotonic()
            code = await slot.process.wait()
            self.placement.pass_over(slot.number)
            self.restarts += 1
            log.error(
                "worker %d has ended (%d); its faces begin again elsewhere: %d",
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
                    log.error("worker %d does not begin: %s", slot.number, error)

    async def _bury(self, slot: _Slot) -> None:
        """Put the faces of a worker that has ended to rest; then others may have them."""
        if slot.open_since_s:
            sinks, rate_hz = self._sinks, self.config.face.rate_hz
            await asyncio.to_thread(send_neutral, sinks, slot.open_since_s.copy(), rate_hz, slot.epochs.copy())
        await self._end(slot)
        self.owners.lose(slot.number)
        if self.bus is not None and not self.placement.workers:
            self._until_s = None
            await self.bus.step_down()
        slot.open_since_s.clear()
        slot.epochs.clear()

    async def _end(self, slot: _Slot) -> None:
        """End a process and its channel, if they have not ended."""
        self._settle(slot, ResourceError(f"worker {slot.number}: was ended before it began"))
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
        """Hear what a worker tells."""
        link = slot.link
        if link is None:
            return
        for message, _ in link.take():
            slot.silent_ticks = 0
            match message:
                case channel.Ready():
                    slot.port, slot.sinks = message.port, message.sinks
                    self._settle(slot, None)
                case channel.Failed():
                    kind = getattr(errors, message.kind, ResourceError)
                    self._settle(slot, kind(f"worker {slot.number}: {message.reason}"))
                case channel.Sessions():
                    self._note_sessions(slot, message)
                case channel.Left():
                    if self.owners.left(slot.number, message.session):
                        slot.epochs.pop(message.session, None)
                case channel.Metrics():
                    self._note_metrics(slot, message.text)
        if link.is_broken:
            asyncio.get_running_loop().remove_reader(link.fileno())
            self._settle(slot, ResourceError(f"worker {slot.number}: ended before it began; the log tells why"))
            if not self._stop.is_set():
                _signal(slot.process, signal.SIGKILL)  # it cannot be reached any more

    def _settle(self, slot: _Slot, trouble: FapEngineError | None) -> None:
        if slot.ready is None or slot.ready.done():
            return
        if trouble is None:
            slot.ready.set_result(None)
        else:
            slot.ready.set_exception(trouble)

    def _note_sessions(self, slot: _Slot, message: channel.Sessions) -> None:
        now_s = time.monotonic()
        for session in message.opened:
            slot.open_since_s.setdefault(session, now_s)
        for session in message.closed:
            slot.open_since_s.pop(session, None)
        self.placement.opened(slot.number, message.opened)
        self.placement.closed(slot.number, message.closed, now_s)

    async def _watch(self) -> None:
        """Kill workers that hang, send what waits in channels, take back unused sessions."""
        while True:
            await asyncio.sleep(TICK_S)
            for slot in self._slots:
                if slot.link is None:
                    continue
                slot.link.flush()
                slot.silent_ticks += slot.number in self.placement.workers
                if slot.silent_ticks > HUNG_TICKS:
                    log.error("worker %d hangs, and is ended", slot.number)
                    _signal(slot.process, signal.SIGKILL)
            for worker, session in self.placement.to_leave(time.monotonic()):
                self.send(worker, channel.Leave(session))

    async def _close(self) -> None:
        """Let nothing more in; let all faces come to rest; end."""
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
        """Ask all workers, and write the page that Prometheus reads; who does not answer in time is left out."""
        alive = [slot for slot in self._slots if slot.number in self.placement.workers]
        texts = await asyncio.gather(*map(self._scrape, alive))
        told = {slot.number: text for slot, text in zip(alive, texts, strict=True) if text}
        return page_of_workers(self._families(), told)

    def _families(self) -> Iterator[Family]:
        yield Family.of("workers", "Workers that live.", len(self.placement.workers), is_gauge=True)
        yield Family.of("worker_restarts", "Workers that had ended.", self.restarts)
        yield Family.of("placed", "Sessions that have a worker.", len(self.placement.homes), is_gauge=True)
        yield from self.counts.families()
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

    def _note_metrics(self, slot: _Slot, text: bytes) -> None:
        slot.metrics += text
        if not text and slot.asked is not None and not slot.asked.done():
            slot.asked.set_result(bytes(slot.metrics))


def _signal(process: Process | None, number: int) -> None:
    """Send a signal to a process that may have ended; ``Process.kill`` would reap it before the loop does."""
    if process is not None and process.returncode is None:
        with suppress(ProcessLookupError):  # it has ended, and the loop will see that
            os.kill(process.pid, number)


def check_workers(config: ServeConfig) -> None:
    """Refuse what only a server of one process can do.

    Raises
    ------
    UsageError
        If a sound device is asked for, or a sink of one face that does not say whose; or the system is not Linux.
    """
    if sys.platform != "linux":
        raise UsageError(f"workers: got {sys.platform}, expected Linux, whose sockets they share")
    for what, wish in (("sound", config.sound.session), ("microphone", config.sound.microphone)):
        if wish:
            raise UsageError(
                f"workers: got {what} {wish!r}, expected none: only a server of one process has a sound card"
            )
    for url in config.sinks:
        sink = parse_sink(url)
        kind = kind_of(sink)
        if kind.medium == "connections":
            raise UsageError(
                f"workers: got sink {url}, expected one that sends datagrams: connections are to one process"
            )
        if not kind.takes_all_sessions and sink.session is None:
            raise UsageError(f"workers: got sink {url}, expected {url}?session=NAME: each worker has a first session")


async def serve_with_workers(workers: Workers, ready: Callable[[], None] | None = None) -> None:
    """Start, run until stopped, and close; as :func:`fapengine.server.server.serve`."""
    await workers.start()
    if ready is not None:
        ready()
    await workers.run()
