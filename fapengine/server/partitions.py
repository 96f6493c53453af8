"""The machine of each session: what one machine of several knows, and what it must request from the shared store.

Theory of operation
-------------------
Sessions belong to partitions by their names (:func:`partition_of`), partitions to machines by records in a store. Each
record has a revision that increases with every change in the store. A machine holds a lease in the store, under a name
that is new each time it begins, and renews it every :data:`RENEW_S`; the store deletes a lease :data:`TTL_S` after it
was received. Three rules keep a session from being in two places:

- A machine shows its sessions only while less than :data:`FENCE_S` has passed since it *sent* the last renewal that was
  answered. Then the store still has its lease. A machine whose lease has expired begins again with a new name and
  without sessions.
- A record is changed only if its revision is the known one (compare and swap), and only by its owner, or if the store
  has no lease of its owner any more.
- Messages between machines are hints. A record that another machine reports is read again from the store, and counts
  only if its revision is greater than the known one.

A machine that is asked for a session in a partition without owner assigns the partition to the machine with the
greatest hash (rendezvous hashing), which may be another one. The record's revision is the epoch of the sessions that
are placed under it. Once one of them has left its worker, the owner renews the record before it places the next, so
that the epoch of a session always increases.

Time is an argument; the store is in :mod:`fapengine.server.cluster.bus`.
"""

from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Annotated, TypeVar

import msgspec

from fapengine.errors import DataError

PARTITIONS = 4096
MAX_MACHINES = 1000
TTL_S, RENEW_S, FENCE_S = 2.5, 0.5, 2.0
"""Lifetime of a lease in the store; time between renewals; time after the sending of the last answered renewal when a
machine stops showing its sessions. Workers need up to 0.3 s to return a face to neutral."""


class Machine(msgspec.Struct, frozen=True):
    """One of several servers, from its start to the loss of its lease."""

    id: str
    """Name, new each time it begins."""
    host: str
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)]
    """Known OSC port, UDP and TCP."""
    page_port: Annotated[int, msgspec.Meta(ge=0, le=65535)] = 0
    """Port of the web page; 0: none."""


class Record(msgspec.Struct, frozen=True):
    """The owner of a partition."""

    partition: Annotated[int, msgspec.Meta(ge=0, lt=PARTITIONS)]
    owner: str
    """Name of a machine; empty: none."""
    revision: int


@dataclass(frozen=True, slots=True)
class Here:
    """The session is this machine's."""

    epoch: int


@dataclass(frozen=True, slots=True)
class Look:
    """Request: read a partition's record from the store."""

    partition: int


@dataclass(frozen=True, slots=True)
class Claim:
    """Request: give a partition to a machine.

    Only if the store has no lease of ``over`` (unless that is empty), and the record still has ``revision``.
    """

    partition: int
    owner: str
    over: str
    revision: int


def partition_of(session: str) -> int:
    """Return the partition of a session.

    Examples
    --------
    >>> [partition_of(name) for name in ("anna", "ben")]
    [1300, 2565]
    """
    return int.from_bytes(blake2b(session.encode(), digest_size=4).digest()) % PARTITIONS


encode = msgspec.json.Encoder().encode
"""Writes a machine or a record."""
_Message = TypeVar("_Message", Machine, Record)


def decode(data: bytes, kind: type[_Message]) -> _Message:
    """Read a message about a machine or a record. Raises DataError if it is not such a message."""
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{kind.__name__.lower()}: {error}") from error


@dataclass(slots=True)
class _Known:
    """State of a record, as this machine knows it. Stateful."""

    owner: str
    revision: int
    is_sure: bool = True
    """False: the record may have changed since."""
    is_worn: bool = False
    """True if a session that was placed under this revision has left its worker."""
    sessions: set[str] = field(default_factory=set)
    """Sessions that have a worker here."""


class Partitions:
    """State of all machines and records, as one machine knows it. Stateful.

    Parameters
    ----------
    me : Machine
        Its ``id`` must never have been used.

    Examples
    --------
    >>> table = Partitions(Machine("a1", "10.0.0.1", 9110))
    >>> table.renewed(asked_s=0.0, revision=1, now_s=0.01)
    >>> table.find("anna", now_s=0.1)
    Look(partition=1300)
    >>> table.saw_record(Record(1300, "", 0))
    >>> table.find("anna", now_s=0.1)
    Claim(partition=1300, owner='a1', over='', revision=0)
    >>> table.saw_record(Record(1300, "a1", 7))
    >>> table.find("anna", now_s=0.1), table.find("anna", now_s=2.1)
    (Here(epoch=7), None)
    """

    def __init__(self, me: Machine) -> None:
        self.me = me
        self.until_s: float | None = None
        """Time until which this machine may show its sessions; None: it has no lease."""
        self._lease_revision = 0
        self._seen: dict[str, tuple[Machine, float]] = {}
        self._records: dict[int, _Known] = {}

    # The lease ------------------------------------------------------------------------------------------------------

    def renewed(self, asked_s: float, revision: int, now_s: float) -> None:
        """Note the answer to a renewal, with the lease's revision in the store; it may be too late.

        A revision that does not increase means that the store has lost its data: then the lease expires at once.
        """
        if self.has_lapsed(now_s):
            return
        if revision <= self._lease_revision:
            self.until_s = now_s
            return
        self._lease_revision = revision
        self.until_s = max(asked_s + FENCE_S, self.until_s or 0.0)

    def may_show(self, now_s: float) -> bool:
        """Return whether the sessions of this machine are surely its own."""
        return self.until_s is not None and now_s < self.until_s

    def has_lapsed(self, now_s: float) -> bool:
        """Return whether the lease has expired; then call :meth:`begin_again`."""
        return self.until_s is not None and now_s >= self.until_s

    def begin_again(self, name: str) -> None:
        """Begin with a new name and without sessions."""
        self.me = msgspec.structs.replace(self.me, id=name)
        self.until_s = None
        self._lease_revision = 0
        self._records.clear()

    # Messages -------------------------------------------------------------------------------------------------------

    def saw(self, machine: Machine, now_s: float) -> None:
        """Note that a machine lives."""
        if machine.id != self.me.id and (machine.id in self._seen or len(self._seen) < MAX_MACHINES):
            self._seen[machine.id] = machine, now_s

    def saw_end(self, name: str) -> None:
        """Note that a machine has ended."""
        self._seen.pop(name, None)

    def saw_record(self, record: Record) -> None:
        """Note a record, as the store has it."""
        known = self._records.get(record.partition)
        if known is None:
            self._records[record.partition] = _Known(record.owner, record.revision)
        elif record.revision > known.revision:
            known.owner, known.revision, known.is_sure, known.is_worn = record.owner, record.revision, True, False
        elif record.revision == known.revision and record.owner in (known.owner, self.me.id):
            known.is_worn |= record.owner != known.owner  # it was released, and the store does not know yet
            known.owner, known.is_sure = record.owner, True

    def heard_record(self, record: Record) -> None:
        """Note that another machine reports a record; only the store tells whether it is so."""
        known = self._records.get(record.partition)
        if known is not None and known.owner != self.me.id and record.revision > known.revision:
            known.is_sure = False

    def forget(self) -> None:
        """Trust only this machine's own records, because changes of others may have been missed."""
        for known in self._records.values():
            known.is_sure = known.owner == self.me.id

    def machines(self, now_s: float) -> list[Machine]:
        """Return the live machines, this one included if it may show sessions."""
        self._seen = {name: seen for name, seen in self._seen.items() if now_s - seen[1] < TTL_S}
        alive = [machine for machine, _ in self._seen.values()]
        return [*alive, self.me] if self.may_show(now_s) else alive

    # Sessions -------------------------------------------------------------------------------------------------------

    def find(self, session: str, now_s: float) -> Here | Machine | Look | Claim | None:
        """Return the owner of a session, or the request that finds it; None: no machine may show it now."""
        partition = partition_of(session)
        known = self._records.get(partition)
        if known is None or not known.is_sure:
            return Look(partition)
        if known.owner == self.me.id:
            if not self.may_show(now_s):
                return None
            if session in known.sessions or not known.is_worn:
                return Here(known.revision)
            return Claim(partition, self.me.id, "", known.revision)
        alive = {machine.id: machine for machine in self.machines(now_s)}
        if known.owner in alive:
            return alive[known.owner]
        if not alive:
            return None
        chosen = max(alive.values(), key=lambda machine: _weight(partition, machine))
        return Claim(partition, chosen.id, known.owner, known.revision)

    def placed(self, session: str) -> None:
        """Note that a session of this machine was given to a worker."""
        self._records[partition_of(session)].sessions.add(session)

    def left(self, session: str) -> Record | None:
        """Note that a session has no worker any more.

        Returns
        -------
        Record or None
            Record without owner: delete it in the store if it still has that revision, as the partition has no session.
        """
        partition = partition_of(session)
        known = self._records.get(partition)
        if known is None or session not in known.sessions:
            return None
        known.sessions.discard(session)
        known.is_worn = True
        if known.sessions or known.owner != self.me.id:
            return None
        known.owner, known.is_sure = "", False
        return Record(partition, "", known.revision)

    @property
    def owned(self) -> int:
        """Number of this machine's partitions."""
        return sum(known.owner == self.me.id for known in self._records.values())


def _weight(partition: int, machine: Machine) -> bytes:
    name = f"{machine.host}:{machine.port}".encode()
    return blake2b(name, digest_size=8, salt=partition.to_bytes(8)).digest()
