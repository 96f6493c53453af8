"""Where sessions live: names to workers, and what a worker needs to know that a session is its own.

Theory of operation
-------------------
A session's home is found by rendezvous hashing (Thaler and Ravishankar 1998, doi:10.1109/90.663936): of the workers
that live, the one whose hash with the session's name is greatest. When a worker goes, only its own sessions move; when
one comes, it takes its share of the sessions that are placed from then on. What is placed stays: no face is moved in
the middle of a word because a worker came back.

A session is in one place at most. It is given to another worker only if

- the process that had it has ended (:meth:`Placement.lose`), or
- its worker was asked to leave it, and said that it had (:meth:`Placement.to_leave`, :meth:`Placement.left`); whatever
  was sent there meanwhile keeps it there, for the channel between the two keeps its order.

Each time it is given away it has a higher epoch, which its frames carry.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from hashlib import blake2b

UNUSED_S = 10.0
"""A session that is placed and not open for so long is taken back."""
MAX_PLACED = 100_000
"""Sessions that are placed at once; more are refused."""


def owner(session: str, workers: Iterable[int]) -> int:
    """Choose the worker of a session by rendezvous hashing.

    Examples
    --------
    >>> [owner(name, [0, 1, 2]) for name in ("anna", "ben", "cleo", "dora")]
    [0, 0, 2, 1]
    >>> [owner(name, [0, 1]) for name in ("anna", "ben", "cleo", "dora")]  # only what was on 2 has moved
    [0, 0, 0, 1]
    """
    name = session.encode()
    return max(workers, key=lambda worker: blake2b(name, digest_size=8, salt=worker.to_bytes(8)).digest())


@dataclass(slots=True)
class Home:
    """Where a session is.

    Stateful.
    """

    worker: int
    epoch: int
    used_s: float
    """Time at which something was last sent there, or it was last known to be open."""
    is_open: bool = False
    leaves: bool = False
    """True where its worker was asked to leave it, and nothing was sent there since."""


@dataclass(slots=True)
class Placement:
    """A table of homes; time is an argument.

    Stateful.

    Examples
    --------
    >>> table = Placement()
    >>> table.join(0); table.join(1)
    >>> home, is_new = table.place("anna", now_s=0.0)
    >>> home.worker, home.epoch, is_new
    (0, 1, True)
    >>> table.lose(0)
    ['anna']
    >>> home, is_new = table.place("anna", now_s=1.0)
    >>> home.worker, home.epoch
    (1, 2)
    """

    workers: set[int] = field(default_factory=set)
    """Those that live."""
    homes: dict[str, Home] = field(default_factory=dict)
    _epoch: int = 0

    def join(self, worker: int) -> None:
        """Give a worker sessions from now on."""
        self.workers.add(worker)

    def pass_over(self, worker: int) -> None:
        """Give a worker no more sessions; those that it has stay its own."""
        self.workers.discard(worker)

    def lose(self, worker: int) -> list[str]:
        """Forget a worker whose process has ended; its sessions, which have no home any more."""
        self.pass_over(worker)
        gone = [session for session, home in self.homes.items() if home.worker == worker]
        for session in gone:
            del self.homes[session]
        return gone

    def place(self, session: str, now_s: float, epoch: int | None = None) -> tuple[Home, bool] | None:
        """Find a session's home, to send something there, or give it one.

        Parameters
        ----------
        session : str
        now_s : float
        epoch : int, optional
            Of a new home, where several machines count them together; by default the next.

        Returns
        -------
        tuple of Home and bool, or None
            True: the home is new, and its worker must be told. None: no worker lives, or the table is full.
        """
        home = self.homes.get(session)
        if home is not None:
            home.used_s, home.leaves = now_s, False
            return home, False
        if not self.workers or len(self.homes) >= MAX_PLACED:
            return None
        self._epoch = self._epoch + 1 if epoch is None else epoch
        home = self.homes[session] = Home(owner(session, self.workers), self._epoch, now_s)
        return home, True

    def opened(self, worker: int, sessions: Iterable[str]) -> None:
        """Note what a worker has opened."""
        for session in sessions:
            home = self.homes.get(session)
            if home is not None and home.worker == worker:
                home.is_open = True

    def closed(self, worker: int, sessions: Iterable[str], now_s: float) -> None:
        """Note what a worker has closed; it may open it again until it has left it."""
        for session in sessions:
            home = self.homes.get(session)
            if home is not None and home.worker == worker:
                home.is_open, home.used_s = False, now_s

    def to_leave(self, now_s: float) -> list[tuple[int, str]]:
        """List unused sessions, each with its worker; to be called once a second or so."""
        unused = [
            (session, home)
            for session, home in self.homes.items()
            if not home.is_open and not home.leaves and now_s - home.used_s > UNUSED_S
        ]
        for _, home in unused:
            home.leaves = True
        return [(home.worker, session) for session, home in unused]

    def left(self, worker: int, session: str) -> None:
        """Take a session back: its worker will not open it before it is given it again."""
        home = self.homes.get(session)
        if home is not None and home.worker == worker and home.leaves:
            del self.homes[session]
