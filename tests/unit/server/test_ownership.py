"""Whose a session is: parent and worker read a request alike, and no session is in two places."""

import random
from collections import Counter, deque
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.http_parser import HttpRequestParser, RawRequestMessage
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from fapengine.errors import DataError
from fapengine.server.cluster.front import _target_of
from fapengine.server.ownership import UNUSED_S, WITH_SESSION, Home, Placement, session_of_request
from fapengine.server.partitions import Here, Machine

LOOP: Any = SimpleNamespace()
"""The parser only keeps it."""
WORDS = st.sampled_from(
    ["/ws", "/whep", "/whip/", "/sound.wav", "/", "//", "/.", "?", "&", ";", "=", "#", "+", "session=", "sessio%6e=",
     "session=", "anna", "ben", "%00", "%ff", "%C3%A9", "%2577s", "/w%73", "%2Fws", "http://h", "utterance=1", "*"]
)  # fmt: skip
TARGETS = st.lists(WORDS | st.text(st.characters(codec="latin-1"), max_size=3), min_size=1, max_size=7).map("".join)


def read_by_worker(request: bytes) -> RawRequestMessage | None:
    """Read the head of a request as a worker's web server does; None: it refuses it."""
    try:
        messages, _, _ = HttpRequestParser(protocol=None, loop=LOOP, limit=2**16).feed_data(request)
    except (HttpProcessingError, ValueError):
        return None
    return messages[0][0] if messages else None


@settings(max_examples=400, deadline=None)
@given(TARGETS)
@example("/ws?session=s0&session=other1")
@example("/w%73?session=s2")
@example("/ws?sessio%6e=s2")
@example("http://127.0.0.1/ws?session=a")
@example("/ws?session=a#b")
@example("/ws?session=\xe9")
def test_parent_and_worker_find_the_same_session(target: str) -> None:
    request = b"GET " + target.encode("latin-1") + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    message = read_by_worker(request)
    given_to = _target_of(request)
    if message is None or given_to is None:
        return
    try:
        of_parent = session_of_request(given_to)
    except DataError:
        with pytest.raises(DataError):
            session_of_request(message.path)
        return
    assert session_of_request(message.path) == of_parent
    path = message.url.path
    if path in WITH_SESSION and of_parent is not None:
        assert message.url.query.getall("session", ["face"]) == [of_parent]


PIECES = (
    "/ws", "/whep", "/sound.wav", "/w%73", "//", "?session=anna", "?session=", "&session=ben", "?", "&", ";", "#",
    "session=", "sessio%6e=", "Session=", "anna", "ben", "%61nna", "+", "%00", "http://h", "x=1", "\t", "\xe9",
)  # fmt: skip


@pytest.mark.parametrize("requests", [3000, pytest.param(100_000, marks=pytest.mark.nightly)])
def test_no_random_request_shows_a_session_twice(requests: int) -> None:
    """A worker shows what it reads, if the parent has handed the connection over for just that."""
    rng, shown = random.Random(1), Counter[bool]()
    for _ in range(requests):
        target = rng.choice(PIECES[:4]) + "".join(rng.choices(PIECES, k=rng.randrange(7)))
        request = f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode("latin-1")
        message, given = read_by_worker(request), _target_of(request)
        if message is None or given is None:
            continue
        try:
            handed_for, read = session_of_request(given), session_of_request(message.path)
        except DataError:
            continue
        assert handed_for == read  # else 421, which no client would understand
        if message.url.path in WITH_SESSION and read is not None:
            assert message.url.query.getall("session", ["face"]) == [read]
            shown[read == "face"] += 1
    assert min(shown[False], shown[True]) > requests / 100


@pytest.mark.parametrize(
    "target",
    ["/ws?session=a&session=b", "/ws?session=a&sessio%6e=a", "/w%73?session=a", "/ws?session=", "/ws?session=a#b",
     "/whep?session=%0A", "/%77hip/name?session=a", "/sound.wav?session=" + 33 * "x"],
)  # fmt: skip
def test_what_could_be_read_in_two_ways_is_refused(target: str) -> None:
    with pytest.raises(DataError, match=r"session|path"):
        session_of_request(target)


@pytest.mark.parametrize("target", ["/", "/index.html?session=a", "//ws?session=a", "*", "/ws/?session=a", "/%70.js"])
def test_what_is_for_no_session_may_be_answered_by_any(target: str) -> None:
    assert session_of_request(target) is None


@dataclass
class Worker:
    """A worker's end: what it was told and has not read, what it has, what it has open, what it answers."""

    inbox: deque[tuple[str, str]] = field(default_factory=deque)
    own: set[str] = field(default_factory=set)
    open: set[str] = field(default_factory=set)
    outbox: deque[str] = field(default_factory=deque)


class Machines:
    """Another machine has every session whose name says so."""

    def __init__(self) -> None:
        self.mine: set[str] = set()
        self.epoch = 0

    def find(self, session: str) -> Here | Machine | None:
        if session == "theirs":
            return Machine("other", "10.0.0.2", 9110)
        self.epoch += 1
        return Here(self.epoch)

    def placed(self, session: str) -> None:
        assert session not in self.mine
        self.mine.add(session)

    def left(self, session: str) -> None:
        self.mine.remove(session)


SESSIONS = st.sampled_from(["anna", "ben", "cleo", "theirs"])
NUMBERS = st.integers(0, 2)


class Cluster(RuleBasedStateMachine):
    """A parent and its workers, whose messages are read in order and whenever."""

    @initialize(is_alone=st.booleans())
    def begin(self, is_alone: bool) -> None:
        self.now_s, self.machines = 0.0, None if is_alone else Machines()
        self.living: dict[int, Worker] = {}
        self.epochs: dict[str, int] = {}
        self.owners = Placement(self.machines, self.tell)

    def tell(self, session: str, home: Home) -> None:
        assert home.epoch > self.epochs.get(session, 0)
        self.epochs[session] = home.epoch
        self.living[home.worker].inbox.append(("own", session))

    @rule(number=NUMBERS)
    def a_worker_joins(self, number: int) -> None:
        if number not in self.living:
            self.living[number] = Worker()
            self.owners.join(number)

    @rule(number=NUMBERS)
    def a_worker_ends(self, number: int) -> None:
        if self.living.pop(number, None) is not None:
            self.owners.lose(number)

    @rule(session=SESSIONS)
    def something_comes(self, session: str) -> None:
        owner = self.owners.owner(session, self.now_s)
        if isinstance(owner, Home):
            self.living[owner.worker].inbox.append(("use", session))
        else:
            assert (owner is not None) == (self.machines is not None and session == "theirs") or (
                owner is None and not self.living
            )

    @rule(pause_s=st.sampled_from([0.1, UNUSED_S + 0.1]))
    def time_passes(self, pause_s: float) -> None:
        self.now_s += pause_s
        for number, session in self.owners.to_leave(self.now_s):
            self.living[number].inbox.append(("leave", session))

    @rule(number=NUMBERS)
    def a_worker_reads(self, number: int) -> None:
        worker = self.living.get(number)
        if worker is None or not worker.inbox:
            return
        kind, session = worker.inbox.popleft()
        if kind == "own":
            worker.own.add(session)
        elif kind == "use":
            assert session in worker.own
            worker.open.add(session)
            self.owners.opened(number, [session])
        elif session not in worker.open:
            worker.own.discard(session)
            worker.outbox.append(session)

    @rule(number=NUMBERS, session=SESSIONS)
    def a_session_is_closed(self, number: int, session: str) -> None:
        if number in self.living and session in self.living[number].open:
            self.living[number].open.discard(session)
            self.owners.closed(number, [session], self.now_s)

    @rule(number=NUMBERS)
    def the_parent_reads(self, number: int) -> None:
        if number in self.living and self.living[number].outbox:
            self.owners.left(number, self.living[number].outbox.popleft())

    @invariant()
    def no_session_is_in_two_places(self) -> None:
        living = getattr(self, "living", {})
        owned = [session for worker in living.values() for session in worker.own]
        assert len(owned) == len(set(owned))


TestCluster = Cluster.TestCase
TestCluster.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
