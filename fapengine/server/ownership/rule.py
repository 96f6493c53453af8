"""The one rule that says whose a session is.

A parent of workers asks :meth:`Owners.owner`, whatever brings a session to it: a datagram, a stream, a page or a call.
A worker asks :class:`OwnSessions` before it opens one, wherever the request came from: the engine refuses all others.
Both find a request's session in the same way, packets by :func:`fapengine.wire.speech_osc.routing.session_of`, HTTP by
:func:`session_of_request`. Time is an argument.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol
from urllib.parse import parse_qsl, unquote

from fapengine.errors import DataError
from fapengine.server.ownership.partitions import Here, Machine, There
from fapengine.server.ownership.placement import Home, Placement
from fapengine.wire.speech_osc.routing import NAMELESS_SESSION
from fapengine.wire.speech_osc.schema import SESSION_BYTES

CALLS = ("/whep/", "/whip/")
"""Paths of calls that were begun; the query of each, which the answer to its offer names, has its session."""
WITH_SESSION = ("/ws", "/sound.wav", "/whep", "/whip")
"""Paths whose ``session`` says which process must answer."""


def session_of_request(target: str) -> str | None:
    """Find the session of an HTTP request in its target, the second word of its first line.

    Returns
    -------
    str or None
        None: any process may answer.

    Raises
    ------
    DataError
        If it has two sessions, one that no session can be called, or a path that two programs may read differently.

    Examples
    --------
    >>> session_of_request("/ws?session=anna&token=x"), session_of_request("/whip"), session_of_request("/head.bin")
    ('anna', 'face', None)
    """
    path, _, query = target.partition("?")
    if path not in WITH_SESSION and not path.startswith(CALLS):
        if (read := unquote(path.partition("#")[0])) == path:
            return None
        if read in WITH_SESSION or read.startswith(CALLS):
            raise DataError(f"path: got {path!r:.60}, expected {read!r:.60}")
        return None
    if "#" in target:
        raise DataError(f"path: got {target!r:.60}, expected one without #")
    names = [value for name, value in parse_qsl(query, keep_blank_values=True) if name == "session"]
    if len(names) > 1:
        raise DataError(f"session: got {len(names)} of them, expected one")
    return check_name(names[0] if names else NAMELESS_SESSION)


def check_name(session: str) -> str:
    """Check the name of a session.

    Raises
    ------
    DataError
        If it is empty, too long, or has anything but printable letters.
    """
    if not (session and session.isprintable() and len(session.encode("utf-8", "replace")) <= SESSION_BYTES):
        shown = repr(session) if len(repr(session)) <= 60 else f"{session!r:.57}..."
        raise DataError(f"session: got {shown}, expected 1..{SESSION_BYTES} bytes of printable letters")
    return session


class Machines(Protocol):
    """Knowledge of which machine has which sessions (:class:`fapengine.server.cluster.bus.Bus`)."""

    def find(self, session: str) -> Here | There | None:
        """Find the owner of a session; None: it is not known now."""
        ...

    def placed(self, session: str) -> None:
        """Note that a session, found here, was given to a worker."""
        ...

    def left(self, session: str) -> None:
        """Note that a session has no worker any more."""
        ...


@dataclass(slots=True)
class Owners:
    """What a parent knows of whose each session is: another machine's, or one of its workers'. Stateful.

    Examples
    --------
    >>> owners = Owners()
    >>> owners.workers.join(0)
    >>> owner = owners.owner("anna", now_s=0.0)
    >>> owner.worker, owner.epoch
    (0, 1)
    """

    machines: Machines | None = None
    """None: this machine is alone."""
    tell: Callable[[str, Home], None] = lambda session, home: None
    """Tells a worker that a session is its own, before anything else about it."""
    workers: Placement = field(default_factory=Placement)

    def owner(self, session: str, now_s: float) -> Home | Machine | None:
        """Give the machine or the worker that shows a session, which may begin with that; None: none may, now."""
        epoch = None
        if self.machines is not None:
            found = self.machines.find(session)
            if not isinstance(found, Here):
                return found.machine if found is not None else None
            epoch = found.epoch
        placed = self.workers.place(session, now_s, epoch)
        if placed is None:
            return None
        home, is_new = placed
        if is_new:
            if self.machines is not None:
                self.machines.placed(session)
            self.tell(session, home)
        return home

    def left(self, worker: int, session: str) -> bool:
        """Note that a worker has left a session, as it was asked to; False if something was sent there since."""
        self.workers.left(worker, session)
        if session in self.workers.homes:
            return False
        if self.machines is not None:
            self.machines.left(session)
        return True

    def lose(self, worker: int) -> None:
        """Note that a worker has ended: its sessions have no owner."""
        for session in self.workers.lose(worker):
            if self.machines is not None:
                self.machines.left(session)


@dataclass(slots=True)
class OwnSessions:
    """The sessions that a worker may open.

    Stateful.
    """

    front_port: int
    """Port at which others are asked for, on the same host."""
    catch_up: Callable[[], object]
    """Reads what the parent has said meanwhile."""
    epochs: dict[str, int] = field(default_factory=dict)
    """Session to its epoch."""
    until_s: float | None = None
    """Monotonic time until which they are surely its own, where several machines share them."""

    def has(self, session: str) -> bool:
        """Whether a session is this worker's."""
        if session not in self.epochs:
            self.catch_up()
        return session in self.epochs

    def elsewhere(self, session: str) -> int | None:
        """Give the port to ask for a session that is not this worker's; None: it is."""
        return None if self.has(session) else self.front_port
