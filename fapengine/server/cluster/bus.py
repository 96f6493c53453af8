"""The store that machines share: leases and records in two key-value buckets of NATS JetStream.

This is the network part of :mod:`fapengine.server.partitions`. NATS carries only leases and records; phones,
frames and pages go from machine to machine directly. Messages between machines are lost while NATS is unreachable, so
all records of others are read again afterwards.
"""

import asyncio
import logging
import socket
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from fapengine._counters import Family
from fapengine._late import needed
from fapengine.errors import DataError, ResourceError
from fapengine.server import partitions
from fapengine.server.config import BusChoice
from fapengine.server.intake.tasks import Tasks

if TYPE_CHECKING:
    from nats.aio.msg import Msg

CONNECT_S = 5.0
"""Time in which NATS must answer at the start."""
ANSWER_S = 0.7
"""Time limit of a request to the store."""
AGAIN_S = 0.2
"""Pause between two attempts to reach NATS."""
ROUNDS = 5
"""Steps to find the owner of a session: look, claim, and again if another machine was faster."""
MAX_ASKING = 10_000
"""Packets and connections that wait for an owner; further ones are lost."""
WILDCARDS = ("0.0.0.0", "::", "")

log = logging.getLogger("fapengine.server")


class Bus:
    """Connection of one machine to the store. Make, start and close it on one event loop. Stateful.

    Parameters
    ----------
    choice : BusChoice
    host : str
        Address on which the server listens.
    on_lease : callable
        Called with the monotonic time until which this machine's sessions may be shown, at each renewal.
    on_fence : callable
        Called when that time is over: nothing may be shown any more.
    """

    def __init__(
        self, choice: BusChoice, host: str, on_lease: Callable[[float], None], on_fence: Callable[[], None]
    ) -> None:  # fmt: skip
        self._choice, self._listens = choice, host
        self._on_lease, self._on_fence = on_lease, on_fence
        self.fences = 0
        """Number of times that this machine's lease has expired."""
        self._table = partitions.Partitions(partitions.Machine("", host, 0))
        self._nats: Any = None
        self._leases: Any = None
        self._records: Any = None
        self._renewing: asyncio.Task[None] | None = None
        self._is_up = False
        self._asking: dict[int, list[Callable[[], None]]] = {}
        self._waiting = 0
        self._tasks = Tasks()

    @property
    def machines(self) -> int:
        """Number of live machines, this one included."""
        return len(self._table.machines(time.monotonic()))

    def families(self) -> Iterator[Family]:
        """Return the metrics of this machine among others."""
        yield Family.of("machines", "Machines that share the sessions.", self.machines, is_gauge=True)
        yield Family.of("partitions", "Partitions of this machine.", self._table.owned, is_gauge=True)
        yield Family.of("fences", "Times that its lease had run out.", self.fences)

    async def start(self, port: int, page_port: int) -> None:
        """Connect, and acquire a lease.

        Raises ResourceError if NATS cannot be reached, or has no JetStream.

        Parameters
        ----------
        port, page_port : int
            Ports of OSC and of the web page.
        """
        nats = needed("nats", "nats-py", "bus")
        url = self._choice.url or ""
        try:
            async with asyncio.timeout(CONNECT_S):
                self._nats = await nats.connect(
                    url.split(","), name="fapengine", max_reconnect_attempts=-1, reconnect_time_wait=AGAIN_S,
                    connect_timeout=2, ping_interval=2, max_outstanding_pings=2, pending_size=1 << 20,
                    error_cb=self._note_trouble, disconnected_cb=self._note_loss, reconnected_cb=self._note_return,
                )  # fmt: skip
                await self._open_buckets()
        except (TimeoutError, OSError, nats.errors.Error) as error:
            await self.close()
            why = "no answer" if isinstance(error, TimeoutError) else str(error) or type(error).__name__
            raise ResourceError(
                f"bus: got {_shown(url)}, expected NATS with JetStream (nats-server -js): {why}"
            ) from error
        host = self._choice.host or (_own_address(url) if self._listens in WILDCARDS else self._listens)
        self._table = partitions.Partitions(partitions.Machine(uuid.uuid4().hex, host, port, page_port))
        await self._nats.subscribe(self._subject("*"), cb=self._receive)
        self._is_up = True
        self._renewing = asyncio.create_task(self._keep_lease())
        await asyncio.sleep(partitions.RENEW_S + ANSWER_S)  # now all live machines are known

    async def close(self) -> None:
        """Release the lease, so that others need not wait for its end, and disconnect."""
        await self.step_down()
        for task in (*self._tasks, self._renewing):
            if task is not None:
                task.cancel()
        if self._nats is not None:
            with suppress(Exception):  # the connection ends, whatever NATS answers
                await asyncio.wait_for(self._nats.close(), ANSWER_S)
            self._nats = None

    async def step_down(self) -> None:
        """Release all sessions. The machine still redirects senders."""
        if not self._is_up:
            return
        self._is_up = False
        name = self._table.me.id
        self._table.begin_again(uuid.uuid4().hex)
        with suppress(Exception):  # else the lease expires by itself
            await asyncio.wait_for(self._leases.delete(name), ANSWER_S)
            await self._publish("gone", name.encode())

    def step_up(self) -> None:
        """Accept sessions again."""
        self._is_up = True

    def find(self, session: str) -> partitions.Here | partitions.Machine | None:
        """Return the owner of a session, as far as it is known; see :meth:`settle`."""
        found = self._table.find(session, time.monotonic())
        return None if isinstance(found, partitions.Look | partitions.Claim) else found

    def settle(self, session: str, again: Callable[[], None]) -> bool:
        """Request the owner of a session if it is not known; then return True, and call ``again`` afterwards."""
        found = self._table.find(session, time.monotonic())
        if not isinstance(found, partitions.Look | partitions.Claim):
            return False
        if self._waiting >= MAX_ASKING or self._nats is None or not self._nats.is_connected:
            return True  # lost
        waiting = self._asking.setdefault(partitions.partition_of(session), [])
        self._waiting += 1
        waiting.append(again)
        if len(waiting) == 1:
            self._tasks.start(self._find_out(session, waiting))
        return True

    def placed(self, session: str) -> None:
        """Note that a session of this machine was given to a worker."""
        self._table.placed(session)

    def left(self, session: str) -> None:
        """Note that a session has no worker any more."""
        released = self._table.left(session)
        if released is not None:
            self._tasks.start(self._release(released))

    async def _open_buckets(self) -> None:
        from nats.js.api import KeyValueConfig, StorageType

        store, name = self._nats.jetstream(timeout=ANSWER_S), self._choice.name
        form = KeyValueConfig("", storage=StorageType.FILE, replicas=self._choice.replicas)
        self._leases = await store.create_key_value(form.evolve(bucket=f"{name}-leases", ttl=partitions.TTL_S))
        self._records = await store.create_key_value(form.evolve(bucket=f"{name}-partitions"))

    async def _keep_lease(self) -> None:
        while True:
            asked_s, table = time.monotonic(), self._table
            if table.has_lapsed(asked_s):
                self._fence()
            elif self._is_up and self._nats is not None and self._nats.is_connected:
                await self._renew(table.me.id, asked_s)
            await asyncio.sleep(max(0.0, asked_s + partitions.RENEW_S - time.monotonic()))

    async def _renew(self, name: str, asked_s: float) -> None:
        try:
            revision = await self._leases.put(name, b"")
        except _errors() as error:
            log.debug("bus: no lease: %r", error)
            if self._table.until_s is None:  # the buckets may be gone
                with suppress(*_errors()):
                    await self._open_buckets()
            return
        table, now_s = self._table, time.monotonic()
        if table.me.id != name:
            return
        table.renewed(asked_s, revision, now_s)
        if table.may_show(now_s) and table.until_s is not None:
            self._on_lease(table.until_s)
            await self._publish("alive", partitions.encode(table.me))

    def _fence(self) -> None:
        log.error("bus: the lease has expired; faces return to neutral, and begin again on a machine with a lease")
        self.fences += 1
        self._is_up = False  # until a worker has started again
        self._table.begin_again(uuid.uuid4().hex)
        self._on_fence()

    async def _find_out(self, session: str, waiting: list[Callable[[], None]]) -> None:
        try:
            with suppress(*_errors()):
                for _ in range(ROUNDS):
                    found = self._table.find(session, time.monotonic())
                    if not isinstance(found, partitions.Look | partitions.Claim):
                        break
                    if isinstance(found, partitions.Look):
                        self._table.saw_record(await self._look(found.partition))
                    elif not await self._claim(found):
                        break
        finally:
            self._asking.pop(partitions.partition_of(session), None)
            self._waiting -= len(waiting)
        for again in waiting:
            again()

    async def _look(self, partition: int) -> partitions.Record:
        from nats.js.errors import KeyNotFoundError

        try:
            entry = await self._records.get(str(partition))
        except KeyNotFoundError as error:
            deleted = getattr(error, "entry", None)
            return partitions.Record(partition, "", deleted.revision if deleted is not None else 0)
        return partitions.Record(partition, (entry.value or b"").decode(errors="replace"), entry.revision or 0)

    async def _claim(self, claim: partitions.Claim) -> bool:
        """Carry out a claim; False if its owner lives."""
        from nats.js.errors import KeyNotFoundError, KeyWrongLastSequenceError

        if claim.over:
            with suppress(KeyNotFoundError):
                await self._leases.get(claim.over)
                return False
        try:
            revision = await self._records.update(str(claim.partition), claim.owner.encode(), last=claim.revision)
        except KeyWrongLastSequenceError:
            self._table.saw_record(await self._look(claim.partition))
            return True
        record = partitions.Record(claim.partition, claim.owner, revision)
        self._table.saw_record(record)
        await self._publish("record", partitions.encode(record))
        return True

    async def _release(self, record: partitions.Record) -> None:
        with suppress(*_errors()):
            await self._records.delete(str(record.partition), last=record.revision)

    def _subject(self, kind: str) -> str:
        return f"fapengine.{self._choice.name}.{kind}"

    async def _publish(self, kind: str, data: bytes) -> None:
        if self._nats is not None:
            with suppress(*_errors()):
                await self._nats.publish(self._subject(kind), data)

    async def _receive(self, message: "Msg") -> None:
        """Note what another machine reports."""
        with suppress(DataError):
            match message.subject.rpartition(".")[2]:
                case "alive":
                    self._table.saw(partitions.decode(message.data, partitions.Machine), time.monotonic())
                case "gone":
                    self._table.saw_end(message.data.decode(errors="replace"))
                case "record":
                    self._table.heard_record(partitions.decode(message.data, partitions.Record))

    async def _note_trouble(self, error: Exception) -> None:
        log.debug("bus: %r", error)
        self._table.forget()  # a slow consumer has missed messages

    async def _note_loss(self) -> None:
        if self._is_up:  # else it is closed
            log.warning("bus: NATS cannot be reached")

    async def _note_return(self) -> None:
        log.info("bus: NATS can be reached again")
        self._table.forget()


def _own_address(url: str) -> str:
    """Return the address of this machine that it uses to reach NATS."""
    first = urlsplit(url.split(",")[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((first.hostname or "127.0.0.1", first.port or 4222))
        return str(probe.getsockname()[0])


def _errors() -> tuple[type[Exception], ...]:
    """Return the errors that NATS raises if it cannot be reached or refuses a request."""
    import nats.errors

    return nats.errors.Error, OSError, TimeoutError


def _shown(url: str) -> str:
    """Return addresses without their passwords."""
    return ",".join(part.rpartition("@")[2] if "@" in part else part for part in url.split(","))
