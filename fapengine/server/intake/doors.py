"""Limits on connections: in total and per address, and below the number of files that the system lets a process open.

Silent connections are closed by their owners (:mod:`.listeners`, :mod:`fapengine.server.web.site`) and only counted
here.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from fapengine._counters import Counts, metric

SPARE_FILES = 96
"""Files reserved for everything but connections: listeners, sinks, audio, a profile being read, growth."""
MAX_FILES = 65_536
"""Soft limit of open files to ask for; more is useless, and some libraries iterate over all of them."""


@dataclass(slots=True)
class DoorCounts(Counts):
    """Counts of connections at one port. Stateful."""

    METRIC = "connections_lost", "Those refused or hung up on."

    open: int = metric("connections", "Open connections, by port.", is_gauge=True)
    refused: int = 0
    """Connections beyond the total limit, or beyond that of one address."""
    timed_out: int = 0
    """Connections closed because they were silent."""


@dataclass(slots=True)
class Door:
    """The connection limit of one port. Stateful.

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
        """Accept a connection if there is room; each accepted one must :meth:`leave`."""
        if self.counts.open >= self.most or self._inside[address] >= self.most_an_address:
            self.counts.refused += 1
            return False
        self.counts.open += 1
        self._inside[address] += 1
        return True

    def leave(self, address: str) -> None:
        """Free the place of a connection."""
        self.counts.open -= 1
        self._inside[address] -= 1
        if not self._inside[address]:
            del self._inside[address]


def open_doors(most: Mapping[str, int], most_an_address: int, files: int | None = None) -> dict[str, Door]:
    """Make the limits of several ports, reduced in proportion so that all connections fit below the limit of files.

    Parameters
    ----------
    most : mapping of str to int
        Connections of each port.
    most_an_address : int
        Connections of each port from one address.
    files : int, optional
        Files that the process may open; None: unlimited.

    Examples
    --------
    >>> [door.most for door in open_doors({"osc": 256, "page": 512, "metrics": 512}, 128, files=256).values()]
    [32, 64, 64]
    """
    total = sum(most.values())
    room = total if files is None else min(total, max(files - SPARE_FILES, len(most)))
    shares = {name: max(1, number * room // total) for name, number in most.items()}
    return {name: Door(share, min(share, most_an_address)) for name, share in shares.items()}


def raise_file_limit() -> int | None:
    """Let this process open as many files as the system allows; return that number, or None if it is unlimited."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        return wanted
    return None if soft == resource.RLIM_INFINITY else soft
