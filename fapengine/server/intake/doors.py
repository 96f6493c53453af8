"""Who may come in: connections in all and from one address, below what the system lets a process open.

Silent connections are closed by their owners (:mod:`.listeners`, :mod:`fapengine.server.web.site`); here they are only
counted.
"""

from collections import Counter
from dataclasses import dataclass, field

from fapengine._counters import Counts, metric

SPARE_FILES = 96
"""Files that are kept for all but connections: listeners, sinks, sound, a profile that is read, a second of growth."""
WISHED_FILES = 65_536
"""Soft limit of open files that is asked for; more is of no use, and some libraries walk through all of them."""


@dataclass(slots=True)
class DoorCounts(Counts):
    """Counts of connections at one port.

    Stateful.
    """

    METRIC = "connections_lost", "Those refused or hung up on."

    open: int = metric("connections", "Open connections, by port.", is_gauge=True)
    refused: int = 0
    """Connections beyond the limit of all, or of one address."""
    timed_out: int = 0
    """Connections that were hung up on for their silence."""


@dataclass(slots=True)
class Door:
    """One port's connections.

    Stateful.

    Examples
    --------
    >>> door = Door(most=3, most_an_address=2)
    >>> [door.enter(address) for address in ("10.0.0.1", "10.0.0.1", "10.0.0.1", "10.0.0.2", "10.0.0.3")]
    [True, True, False, True, False]
    >>> door.leave("10.0.0.1")
    >>> door.enter("10.0.0.3"), door.counts
    (True, DoorCounts(open=3, refused=2, timed_out=0))
    """

    most: int
    most_an_address: int
    counts: DoorCounts = field(default_factory=DoorCounts)
    _inside: Counter[str] = field(default_factory=Counter)

    def enter(self, address: str) -> bool:
        """Let a connection in, if there is room; whoever is let in must :meth:`leave`."""
        if self.counts.open >= self.most or self._inside[address] >= self.most_an_address:
            self.counts.refused += 1
            if not self._inside[address]:
                del self._inside[address]
            return False
        self.counts.open += 1
        self._inside[address] += 1
        return True

    def leave(self, address: str) -> None:
        """Give the place back."""
        self.counts.open -= 1
        self._inside[address] -= 1
        if not self._inside[address]:
            del self._inside[address]


def shared_out(wished: list[int], files: int | None) -> list[int]:
    """Cut the numbers of connections that ports may hold, so that all together stay below the limit of files.

    Parameters
    ----------
    wished : list of int
        Connections of each port.
    files : int, optional
        Files that the process may open; None: as many as it likes.

    Examples
    --------
    >>> shared_out([256, 512, 512], 65_536), shared_out([256, 512, 512], 256)
    ([256, 512, 512], [32, 64, 64])
    """
    if files is None:
        return wished
    room = max(files - SPARE_FILES, len(wished))
    total = sum(wished)
    return wished if total <= room else [max(1, number * room // total) for number in wished]


def raise_file_limit() -> int | None:
    """Let this process open as many files as the system allows it; None where there is no such limit."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wished = WISHED_FILES if hard == resource.RLIM_INFINITY else min(hard, WISHED_FILES)
    if soft != resource.RLIM_INFINITY and soft < wished:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wished, hard))
        return wished
    return None if soft == resource.RLIM_INFINITY else soft
