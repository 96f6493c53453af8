"""Which machine has which sessions: what one machine of several knows, and what it asks of the store that all share.

Theory of operation
-------------------
Sessions belong to partitions by their names (:func:`partition_of`), partitions to machines by records in a store, each
with a revision that grows with every change in the store. A machine holds a lease there, under a name of this life of
it, and renews it every :data:`RENEW_S`; the store forgets a lease :data:`TTL_S` after it came. Three rules keep a
session from being in two places:

- A machine shows its sessions only while less than :data:`FENCE_S` has passed since it *sent* the last renewal that was
  answered. Then the store still has its lease. A machine whose time has run out takes another name; it has nothing.
- A record is changed only if its revision is the one that was known (compare and swap), and only if the store has no
  lease of its owner any more, or by the owner itself.
- What machines tell each other is a hint. A record counts only if its revision is greater than the one known.

A machine that is asked for a session of a partition without owner gives the partition to the machine with the greatest
hash with it (rendezvous hashing), which may be another one. The record's revision is the epoch of sessions that are
placed under it. Once one of them has left its worker, the owner renews the record before it places the next, so that
the epoch of a session grows each time.

Time is an argument; the store is elsewhere (:mod:`fapengine.server.cluster.bus`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import TypeVar

import msgspec

from fapengine.errors import DataError

PARTITIONS = 4096
TTL_S, RENEW_S, FENCE_S = 2.5, 0.5, 2.0
"""Life of a lease in the store; time between renewals; time after the sending of the last renewal that was answered, at
which a machine shows nothing more. Workers need up to 0.3 s for a face to come to rest."""


class Machine(msgspec.Struct, frozen=True):
    """One server of several, in one life."""

    id: str
    """Name of this life."""
    host: str
    port: int
    """Known OSC port, UDP and TCP."""
    page_port: int = 0
    """Port of the page; 0: none."""


class Record(msgspec.Struct, frozen=True):
    """Who has a partition."""

    partition: int
    owner: str
    """Name of a machine's life; empty: none."""
    revision: int


@dataclass(frozen=True, slots=True)
class Here:
    """The session is this machine's."""

    epoch: int


@dataclass(frozen=True, slots=True)
class There:
    """The session is another machine's."""

    machine: Machine


@dataclass(frozen=True, slots=True)
class Look:
    """To be done: read a partition's record in the store."""

    partition: int


@dataclass(frozen=True, slots=True)
class Claim:
    """To be done: give a partition to a machine.

    Only if the store has no lease of ``over`` (if that is not empty), and the record is still of ``revision``.
    """

    partition: int
    owner: str
    over: str
    revision: int


@dataclass(frozen=True, slots=True)
class Release:
    """To be done: delete a partition's record, if it is still of ``revision``."""

    partition: int
    revision: int


def partition_of(session: str) -> int:
    """Give the partition of a session, by its name.

    Examples
    --------
    >>> [partition_of(name) for name in ("anna", "ben")]
    [1300, 2565]
    """
    return int.from_bytes(blake2b(session.encode(), digest_size=4).digest()) % PARTITIONS


def decode_machine(data: bytes) -> Machine:
    """Read what a machine tells of itself.

    Raises
    ------
    DataError
        If it is no such message.
    """
    return _decoded(data, _machine_decoder, "machine")


def decode_record(data: bytes) -> Record:
    """Read a message about a record.

    Raises
    ------
    DataError
        If it is no such message.
    """
    record = _decoded(data, _record_decoder, "record")
    if not 0 <= record.partition < PARTITIONS:
        raise DataError(f"record: got partition {record.partition}, expected 0..{PARTITIONS - 1}")
    return record


_machine_decoder, _record_decoder = msgspec.json.Decoder(Machine).decode, msgspec.json.Decoder(Record).decode
encode = msgspec.json.Encoder().encode
"""Writes a machine or a record."""
_Told = TypeVar("_Told", Machine, Record)


def _decoded(data: bytes, decode: Callable[[bytes], _Told], what: str) -> _Told:
    try:
        return decode(data)
    except msgspec.DecodeError as error:
        raise DataError(f"{what}: {error}") from error


@dataclass(slots=True)
class _Known:
    """What is known of a record.

    Stateful.
    """

    owner: str
    revision: int
    is_sure: bool = True
    """False: the record has changed since, or may have."""
    is_worn: bool = False
    """True where a session that was placed under this revision has left its worker."""
    sessions: set[str] = field(default_factory=set)
    """Those that have a worker here."""


class Partitions:
    """What one machine knows of who has what.

    Stateful.

    Parameters
    ----------
    me : Machine
        Its ``id`` must be one that no machine ever had.

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
        """Time until which this machine may show its sessions; None: it has no lease yet."""
        self._lease_revision = 0
        self._seen: dict[str, tuple[Machine, float]] = {}
        self._records: dict[int, _Known] = {}

    # The lease ------------------------------------------------------------------------------------------------------

    def renewed(self, asked_s: float, revision: int, now_s: float) -> None:
        """Note that a renewal was answered, with the store's revision of it; it may be too late.

        A revision that does not grow tells of a store that has lost what it knew: then the time has run out at once.
        """
        if self.has_lapsed(now_s):
            return
        if revision <= self._lease_revision:
            self.until_s = now_s
            return
        self._lease_revision = revision
        self.until_s = max(asked_s + FENCE_S, self.until_s or 0.0)

    def may_show(self, now_s: float) -> bool:
        """Whether the sessions of this machine are surely its own."""
        return self.until_s is not None and now_s < self.until_s

    def has_lapsed(self, now_s: float) -> bool:
        """Whether this life's time has run out: :meth:`begin_again` is to follow."""
        return self.until_s is not None and now_s >= self.until_s

    def begin_again(self, name: str) -> None:
        """Begin another life, with nothing."""
        self.me = Machine(name, self.me.host, self.me.port, self.me.page_port)
        self.until_s = None
        self._lease_revision = 0
        self._records.clear()

    # What others tell -----------------------------------------------------------------------------------------------

    def saw(self, machine: Machine, now_s: float) -> None:
        """Note that a machine lives."""
        if machine.id != self.me.id:
            self._seen[machine.id] = machine, now_s

    def saw_end(self, name: str) -> None:
        """Note that a machine has said goodbye."""
        self._seen.pop(name, None)

    def saw_record(self, record: Record) -> None:
        """Note a record, as the store or another machine tells it."""
        known = self._records.get(record.partition)
        if known is None:
            self._records[record.partition] = _Known(record.owner, record.revision)
        elif record.revision > known.revision:
            known.owner, known.revision, known.is_sure, known.is_worn = record.owner, record.revision, True, False
        elif record.revision == known.revision and record.owner in (known.owner, self.me.id):
            known.is_worn |= record.owner != known.owner  # it was given back, and that has not reached the store
            known.owner, known.is_sure = record.owner, True

    def forget(self) -> None:
        """Trust only this machine's own records from now on: a change of others may have been missed."""
        for known in self._records.values():
            known.is_sure = known.owner == self.me.id

    def machines(self, now_s: float) -> list[Machine]:
        """Give those that live, this one included if it may show anything."""
        self._seen = {name: seen for name, seen in self._seen.items() if now_s - seen[1] < TTL_S}
        alive = [machine for machine, _ in self._seen.values()]
        return [*alive, self.me] if self.may_show(now_s) else alive

    # Sessions -------------------------------------------------------------------------------------------------------

    def find(self, session: str, now_s: float) -> Here | There | Look | Claim | None:
        """Find the machine of a session, or what must be done to know it; None: no machine may show it now."""
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
            return There(alive[known.owner])
        if not alive:
            return None
        chosen = max(alive.values(), key=lambda machine: _weight(partition, machine))
        return Claim(partition, chosen.id, known.owner, known.revision)

    def placed(self, session: str) -> None:
        """Note that a session, found here, was given to a worker."""
        self._records[partition_of(session)].sessions.add(session)

    def left(self, session: str) -> Release | None:
        """Note that a session has no worker any more; a partition that has none left is given back."""
        partition = partition_of(session)
        known = self._records.get(partition)
        if known is None or session not in known.sessions:
            return None
        known.sessions.discard(session)
        known.is_worn = True
        if known.sessions or known.owner != self.me.id:
            return None
        known.owner, known.is_sure = "", False
        return Release(partition, known.revision)

    @property
    def owned(self) -> int:
        """Number of partitions that are this machine's."""
        return sum(known.owner == self.me.id for known in self._records.values())


def _weight(partition: int, machine: Machine) -> bytes:
    name = f"{machine.host}:{machine.port}".encode()
    return blake2b(name, digest_size=8, salt=partition.to_bytes(8)).digest()
