"""The rule that assigns each session to one process.

Theory of operation
-------------------
The parent of a server with workers asks :meth:`Placement.owner` for every request, be it a datagram, a stream, a page
or a call. A worker asks :class:`OwnSessions` before it opens a session: the engine refuses all others. Both find a
request's session in the same way, packets by :func:`fapengine.wire.speech_osc.routing.session_of`, HTTP by
:func:`session_of_request`. Time is an argument.

A session's worker is chosen by rendezvous hashing (Thaler and Ravishankar 1998, doi:10.1109/90.663936): the live worker
whose hash with the session's name is greatest. When a worker ends, only its own sessions move; a new worker gets its
part of the sessions that are placed from then on. A placed session stays: no face moves in the middle of a word because
a worker came back.

A session is in one place at most. It is given to another worker only if

- the process that had it has ended (:meth:`Placement.lose`), or
- its worker was asked to leave it, and confirmed that (:meth:`Placement.to_leave`, :meth:`Placement.left`). A message
  that was sent to the worker meanwhile keeps it there, because the channel between the two is ordered.

Each assignment has a higher epoch than the one before, which the session's frames carry.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Protocol
from urllib.parse import parse_qsl, unquote

from fapengine.errors import DataError
from fapengine.server.partitions import Here, Machine
from fapengine.wire.speech_osc.routing import NAMELESS_SESSION
from fapengine.wire.speech_osc.schema import SESSION_BYTES

UNUSED_S = 10.0
"""Time after which a placed session that is not open is taken back."""
MAX_PLACED = 100_000
"""Maximum number of placed sessions."""
CALLS = ("/whep/", "/whip/")
"""Paths of running calls; their query, as in the answer to the offer, has the session."""
WITH_SESSION = ("/ws", "/sound.wav", "/whep", "/whip")
"""Paths whose ``session`` determines which process must answer."""


def session_of_request(target: str) -> str | None:
    """Return the session of an HTTP request, given its target, the second word of its first line.

    Raises DataError if it has two sessions, an invalid one, or a path that two programs may read differently.

    Returns
    -------
    str or None
        None: any process may answer.

    Examples
    --------
    >>> session_of_request("/ws?session=anna&token=x"), session_of_request("/whip"), session_of_request("/head.bin")
    ('anna', 'face', None)
    """
    path, _, query = target.partition("?")
    if path not in WITH_SESSION and not path.startswith(CALLS):
        read = unquote(path.partition("#")[0])
        if read != path and (read in WITH_SESSION or read.startswith(CALLS)):
            raise DataError(f"path: got {path!r:.60}, expected {read!r:.60}")
        return None
    if "#" in target:
        raise DataError(f"path: got {target!r:.60}, expected one without #")
    names = [value for name, value in parse_qsl(query, keep_blank_values=True) if name == "session"]
    if len(names) > 1:
        raise DataError(f"session: got {len(names)} of them, expected one")
    return check_name(names[0] if names else NAMELESS_SESSION)


def check_name(session: str) -> str:
    """Check the name of a session, and return it.

    Raises DataError if it is empty, too long, or has unprintable characters.
    """
    if not (session and session.isprintable() and len(session.encode("utf-8", "replace")) <= SESSION_BYTES):
        shown = repr(session) if len(repr(session)) <= 60 else f"{session!r:.57}..."
        raise DataError(f"session: got {shown}, expected 1 to {SESSION_BYTES} bytes of printable characters")
    return session


def worker_of(session: str, workers: Iterable[int]) -> int:
    """Choose the worker of a session by rendezvous hashing.

    Examples
    --------
    >>> [worker_of(name, [0, 1, 2]) for name in ("anna", "ben", "cleo", "dora")]
    [0, 0, 2, 1]
    >>> [worker_of(name, [0, 1]) for name in ("anna", "ben", "cleo", "dora")]  # only the one on 2 has moved
    [0, 0, 0, 1]
    """
    name = session.encode()
    return max(workers, key=lambda worker: blake2b(name, digest_size=8, salt=worker.to_bytes(8)).digest())


@dataclass(slots=True)
class Home:
    """The place of a session. Stateful."""

    worker: int
    epoch: int
    used_s: float
    """Time at which something was last sent there, or it was last known to be open."""
    is_open: bool = False
    leaves: bool = False
    """True if its worker was asked to leave it, and nothing was sent there since."""


class Machines(Protocol):
    """The machine of each session (:class:`fapengine.server.cluster.bus.Bus`)."""

    def find(self, session: str) -> Here | Machine | None:
        """Return the owner of a session, as far as it is known."""

    def placed(self, session: str) -> None:
        """Note that a session of this machine was given to a worker."""

    def left(self, session: str) -> None:
        """Note that a session has no worker any more."""


@dataclass(slots=True)
class Placement:
    """The owners of all sessions, as the parent knows them: other machines, or its workers. Stateful.

    Examples
    --------
    >>> table = Placement()
    >>> table.join(0); table.join(1)
    >>> home = table.owner("anna", now_s=0.0)
    >>> home.worker, home.epoch
    (0, 1)
    >>> table.lose(0)
    >>> home = table.owner("anna", now_s=1.0)
    >>> home.worker, home.epoch
    (1, 2)
    """

    machines: Machines | None = None
    """None: there is only this machine."""
    assign: Callable[[str, Home], None] = lambda session, home: None
    """Tells a worker that it owns a session; called before anything else is sent to it for that session."""
    workers: set[int] = field(default_factory=set)
    """Workers that accept sessions."""
    homes: dict[str, Home] = field(default_factory=dict)
    _epoch: int = 0

    def join(self, worker: int) -> None:
        """Assign sessions to a worker from now on."""
        self.workers.add(worker)

    def pass_over(self, worker: int) -> None:
        """Assign no more sessions to a worker; it keeps those that it has."""
        self.workers.discard(worker)

    def lose(self, worker: int) -> None:
        """Forget a worker whose process has ended, and its sessions."""
        self.pass_over(worker)
        for session in [session for session, home in self.homes.items() if home.worker == worker]:
            self._remove(session)

    def owner(self, session: str, now_s: float) -> Home | Machine | None:
        """Return the worker or the other machine of a session; a new session is assigned.

        Returns
        -------
        Home, Machine or None
            None: the machine is not known now, no worker lives, or too many sessions are placed.
        """
        epoch = self._epoch + 1
        if self.machines is not None:
            found = self.machines.find(session)
            if not isinstance(found, Here):
                return found
            epoch = found.epoch
        home = self.homes.get(session)
        if home is not None:
            home.used_s, home.leaves = now_s, False
            return home
        if not self.workers or len(self.homes) >= MAX_PLACED:
            return None
        self._epoch = epoch
        home = self.homes[session] = Home(worker_of(session, self.workers), epoch, now_s)
        if self.machines is not None:
            self.machines.placed(session)
        self.assign(session, home)
        return home

    def opened(self, worker: int, sessions: Iterable[str]) -> None:
        """Note the sessions that a worker has opened."""
        for session in sessions:
            if (home := self._home(worker, session)) is not None:
                home.is_open = True

    def closed(self, worker: int, sessions: Iterable[str], now_s: float) -> None:
        """Note the sessions that a worker has closed; it may open them again until it has left them."""
        for session in sessions:
            if (home := self._home(worker, session)) is not None:
                home.is_open, home.used_s = False, now_s

    def to_leave(self, now_s: float) -> list[tuple[int, str]]:
        """Return unused sessions, each with its worker, which must be asked to leave it; call it once per second."""
        unused = [
            (session, home)
            for session, home in self.homes.items()
            if not home.is_open and not home.leaves and now_s - home.used_s > UNUSED_S
        ]
        for _, home in unused:
            home.leaves = True
        return [(home.worker, session) for session, home in unused]

    def left(self, worker: int, session: str) -> bool:
        """Release a session that its worker has left; return False if something was sent there since."""
        home = self._home(worker, session)
        if home is None or not home.leaves:
            return False
        self._remove(session)
        return True

    def _home(self, worker: int, session: str) -> Home | None:
        home = self.homes.get(session)
        return home if home is not None and home.worker == worker else None

    def _remove(self, session: str) -> None:
        del self.homes[session]
        if self.machines is not None:
            self.machines.left(session)


@dataclass(slots=True)
class OwnSessions:
    """The sessions that a worker may open. Stateful."""

    front_port: int
    """Port of the parent on the same host, for all other sessions."""
    catch_up: Callable[[], object]
    """Reads the parent's pending messages."""
    epochs: dict[str, int] = field(default_factory=dict)
    """Session to its epoch."""
    until_s: float | None = None
    """Monotonic time until which they are surely its own, if several machines share sessions."""

    def has(self, session: str) -> bool:
        """Return whether a session is this worker's."""
        if session not in self.epochs:
            self.catch_up()
        return session in self.epochs

    def elsewhere(self, session: str) -> int | None:
        """Return the port for a session of another process; None if it is this worker's."""
        return None if self.has(session) else self.front_port
