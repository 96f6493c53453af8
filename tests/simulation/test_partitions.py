"""Machines that share sessions through a store, on virtual time: what they meet, and that nobody is shown twice."""

import heapq
import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fapengine.server import partitions
from fapengine.server.partitions import (
    FENCE_S,
    RENEW_S,
    TTL_S,
    Claim,
    Here,
    Look,
    Machine,
    Partitions,
    Record,
    partition_of,
)

WAY_S = (0.0005, 0.02)
"""Shortest and longest way of a message."""
ANSWER_S = 0.7
"""Time after which a machine gives up on an answer of the store."""
REST_S = 0.3
"""Time in which a worker that was stopped shows its last frames."""
AGAIN_S = 1.5
"""Time until workers have begun again."""
ASK_S = 1.0
"""Time from one hello of a sender to the next, and at most until it notices that nobody answers."""


class World:
    """Time, chance, and the network between all."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.now_s = 0.0
        self.cut: set[str] = set()
        """Who cannot reach the store now."""
        self.slow_s: dict[str, float] = {}
        """Greatest delay of each one's messages."""
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, time_s: float, work: Callable[[], None]) -> None:
        self._count += 1
        heapq.heappush(self._queue, (time_s, self._count, work))

    def send(self, name: str, work: Callable[[], None]) -> None:
        """Let a message between a machine and the store arrive, some time, or never."""
        if name not in self.cut:
            way_s = self.rng.uniform(WAY_S[0], self.slow_s.get(name, WAY_S[1]))
            self.at(self.now_s + way_s, lambda: None if name in self.cut else work())

    def run(self, until_s: float) -> None:
        while self._queue and self._queue[0][0] <= until_s:
            self.now_s, _, work = heapq.heappop(self._queue)
            work()
        self.now_s = until_s


@dataclass
class Store:
    """Leases that end, and records with revisions. Stateful."""

    world: World
    leases: dict[str, float] = field(default_factory=dict)
    records: dict[int, tuple[str, int]] = field(default_factory=dict)
    revision: int = 0

    def renew(self, name: str) -> int:
        self.leases[name] = self.world.now_s
        self.revision += 1
        return self.revision

    def has_lease(self, name: str) -> bool:
        return self.world.now_s - self.leases.get(name, -math.inf) < TTL_S

    def look(self, partition: int) -> Record:
        return Record(partition, *self.records.get(partition, ("", 0)))

    def swap(self, partition: int, owner: str, revision: int) -> Record | None:
        if self.look(partition).revision != revision:
            return None
        self.revision += 1
        self.records[partition] = owner, self.revision
        return Record(partition, owner, self.revision)


@dataclass
class Shown:
    """That a machine shows a session, until it stops."""

    machine: str
    epoch: int
    from_s: float
    until_s: float = math.inf


class Node:
    """One machine: the pure core, and around it what the bus and the workers do. Stateful."""

    def __init__(self, name: str, stage: "Stage") -> None:
        self.name, self.stage, self.world = name, stage, stage.world
        self.lives = 0
        self.table = Partitions(Machine(self._life(), name, 9110))
        self.shown: dict[str, Shown] = {}
        self.is_dead, self.is_up = False, True
        self.paused_until_s = 0.0
        self.busy: set[int] = set()
        self._renew()

    def _life(self) -> str:
        self.lives += 1
        return f"{self.name}.{self.lives}"

    def do(self, work: Callable[[], None]) -> None:
        """Work now, or behind a pause; never when dead."""
        if self.is_dead:
            return
        if self.world.now_s < self.paused_until_s:
            self.world.at(self.paused_until_s, lambda: self.do(work))
        else:
            work()

    def ask_store(self, question: Callable[[Store], Any], answered: Callable[[Any], None]) -> None:
        def arrive() -> None:
            answer = question(self.stage.store)
            self.world.send(self.name, lambda: self.do(lambda: answered(answer)))

        self.world.send(self.name, arrive)

    def _renew(self) -> None:
        asked_s, table = self.world.now_s, self.table
        if table.has_lapsed(asked_s):
            self.fence()
        elif self.is_up:
            life = table.me.id

            def answered(revision: int) -> None:
                if self.table.me.id == life:
                    self.table.renewed(asked_s, revision, self.world.now_s)

            self.ask_store(lambda store: store.renew(life), answered)
            if table.may_show(asked_s):
                me = table.me
                self.stage.tell(self, lambda other: other.table.saw(me, other.world.now_s))
        self.world.at(asked_s + RENEW_S, lambda: self.do(self._renew))

    def fence(self) -> None:
        """Stop all workers; begin another life when they have begun again."""
        self._stop_workers()
        self.table.begin_again(self._life())
        self.is_up = False
        self.world.at(self.world.now_s + AGAIN_S, lambda: self.do(lambda: setattr(self, "is_up", True)))

    def kill(self) -> None:
        """End without a word; the workers notice, and shut the mouths."""
        self._stop_workers()
        self.is_dead = True

    def _stop_workers(self) -> None:
        """Shut all mouths, at the latest when the lease had run out: the workers look at the time themselves."""
        for shown in self.shown.values():
            shown.until_s = min(self.world.now_s, self.table.until_s or 0.0) + REST_S
        self.shown.clear()

    def ask(self, session: str, rounds: int = 4) -> Machine | None:
        """Be asked for a session; gives where else to ask, if that is known by now."""
        found = self.table.find(session, self.world.now_s)
        if isinstance(found, Machine):
            return found
        if isinstance(found, Here) and session not in self.shown:
            self.table.placed(session)
            self.shown[session] = Shown(self.name, found.epoch, self.world.now_s)
            self.stage.shown[session].append(self.shown[session])
        partition = partition_of(session)
        if isinstance(found, Look | Claim) and partition not in self.busy:
            self.busy.add(partition)
            self.world.at(self.world.now_s + ANSWER_S, lambda: self.busy.discard(partition))
            self._carry_out(found, lambda: self.stage.answer(self, session, rounds - 1) if rounds else None)
        return None

    def _carry_out(self, found: Look | Claim, then: Callable[[], object]) -> None:
        def note(record: Record | None) -> None:
            self.busy.discard(found.partition)
            if record is not None:
                self.table.saw_record(record)
                then()

        def claimed(record: Record | None) -> None:
            note(record)
            if record is not None:
                self.stage.tell(self, lambda other: other.table.heard_record(record))
            else:
                self.ask_store(lambda store: store.look(found.partition), note)

        if isinstance(found, Look):
            self.ask_store(lambda store: store.look(found.partition), note)
            return
        claim = found

        def swap() -> None:
            self.ask_store(lambda store: store.swap(claim.partition, claim.owner, claim.revision), claimed)

        if claim.over:
            self.ask_store(lambda store: store.has_lease(claim.over), lambda has: None if has else swap())
        else:
            swap()

    def leave(self, session: str) -> None:
        """Close a session that nobody uses."""
        shown = self.shown.pop(session, None)
        if shown is None:
            return
        shown.until_s = min(self.world.now_s, (self.table.until_s or 0.0) + REST_S)
        release = self.table.left(session)
        if release is not None:
            self.ask_store(lambda store: store.swap(release.partition, "", release.revision), lambda _: None)


class Stage:
    """Machines, their store, and a sender for each session. Stateful."""

    def __init__(self, seed: int, machines: int, sessions: int) -> None:
        self.world = World(seed)
        self.store = Store(self.world)
        self.shown: dict[str, list[Shown]] = defaultdict(list)
        self.nodes: dict[str, Node] = {}
        for number in range(machines):
            self.add(f"m{number}")
        self.world.run(1.0)
        self.sessions = [f"s{number}" for number in range(sessions)]
        self.asked: dict[str, str] = {}
        for session in self.sessions:
            self.world.at(self.world.now_s + self.world.rng.uniform(0, ASK_S), partial(self._ask, session))

    def add(self, name: str) -> None:
        self.nodes[name] = Node(name, self)

    def tell(self, teller: Node, work: Callable[[Node], None]) -> None:
        for node in self.nodes.values():
            if node is not teller and teller.name not in self.world.cut:
                self.world.send(node.name, partial(node.do, partial(work, node)))

    def _ask(self, session: str) -> None:
        alive = [name for name, node in self.nodes.items() if not node.is_dead]
        name = self.asked.get(session)
        if name not in alive:
            name = str(self.world.rng.choice(alive))
        node = self.nodes[name]

        self.asked.pop(session, None)  # without an answer, the next time anybody is asked
        node.do(lambda: self.answer(node, session))
        self.world.at(self.world.now_s + ASK_S, lambda: self._ask(session))

    def answer(self, node: Node, session: str, rounds: int = 4) -> None:
        """Let a machine answer a sender, which goes where it is told at once."""
        elsewhere = node.ask(session, rounds)
        if session in node.shown:
            self.asked[session] = node.name
        elif elsewhere is not None and rounds:
            other = self.nodes[elsewhere.host]
            way_s = float(self.world.rng.uniform(*WAY_S))
            self.world.at(self.world.now_s + way_s, lambda: other.do(lambda: self.answer(other, session, rounds - 1)))

    def finish(self) -> None:
        """Stop at the time that is now what machines would show that were paused until now, and look at all of it."""
        for node in self.nodes.values():
            for shown in node.shown.values():
                if node.table.until_s is not None and not node.is_dead:
                    shown.until_s = min(shown.until_s, node.table.until_s + REST_S)

    def doubled(self) -> list[tuple[str, Shown, Shown]]:
        """Sessions that two showed at once, or whose epochs did not grow."""
        self.finish()
        found = []
        for session, turns in self.shown.items():
            for before, after in pairwise(turns):
                if after.from_s < before.until_s or after.epoch <= before.epoch:
                    found.append((session, before, after))
        return found

    def unshown(self) -> list[str]:
        now_s = self.world.now_s
        return [name for name in self.sessions if not (self.shown[name] and self.shown[name][-1].until_s > now_s)]


def test_sessions_are_placed_once_and_spread() -> None:
    stage = Stage(1, machines=5, sessions=300)
    stage.world.run(4.0)
    assert stage.unshown() == []
    assert {len(turns) for turns in stage.shown.values()} == {1}
    share = [len(node.shown) for node in stage.nodes.values()]
    assert min(share) > 30
    stage.world.run(60.0)
    assert {len(turns) for turns in stage.shown.values()} == {1}


def test_sessions_of_a_machine_that_is_gone_begin_again_elsewhere_in_time() -> None:
    stage = Stage(2, machines=5, sessions=300)
    stage.world.run(10.0)
    gone = list(stage.nodes["m2"].shown)
    killed_s = stage.world.now_s
    stage.nodes["m2"].kill()
    stage.world.run(killed_s + 4.0)
    assert stage.unshown() == []
    assert stage.doubled() == []
    assert {name for name, turns in stage.shown.items() if len(turns) > 1} == set(gone)
    assert max(stage.shown[name][-1].from_s for name in gone) - killed_s > TTL_S - RENEW_S - 0.1  # not before


def test_a_machine_without_the_store_stops_in_time_and_its_sessions_go_on_elsewhere() -> None:
    stage = Stage(3, machines=3, sessions=100)
    stage.world.run(10.0)
    gone, cut_s = list(stage.nodes["m0"].shown), stage.world.now_s
    stage.world.cut.add("m0")
    stage.world.run(cut_s + FENCE_S + RENEW_S + 0.1)
    assert not stage.nodes["m0"].shown
    assert max(stage.shown[name][0].until_s for name in gone) <= cut_s + FENCE_S + REST_S + 0.1
    stage.world.run(cut_s + 15.0)  # senders ask anybody, the machine without the store too
    assert stage.unshown() == []
    stage.world.cut.clear()
    stage.world.run(cut_s + 25.0)
    assert stage.doubled() == []
    assert {len(turns) for turns in stage.shown.values()} == {1, 2}  # none was moved back


def test_a_store_that_is_gone_for_a_moment_changes_nothing_and_for_longer_stops_all() -> None:
    stage = Stage(4, machines=3, sessions=100)
    stage.world.run(10.0)
    stage.world.cut.update(stage.nodes)
    stage.world.run(10.9)
    stage.world.cut.clear()
    stage.world.run(20.0)
    assert {len(turns) for turns in stage.shown.values()} == {1}
    stage.world.cut.update(stage.nodes)
    stage.world.run(26.0)
    assert len(stage.unshown()) == 100
    stage.world.cut.clear()
    stage.world.run(32.0)
    assert stage.unshown() == []
    assert stage.doubled() == []


def test_a_machine_that_stood_still_has_nothing_when_it_goes_on() -> None:
    stage = Stage(5, machines=3, sessions=100)
    stage.world.run(10.0)
    node = stage.nodes["m1"]
    gone = list(node.shown)
    node.paused_until_s = 16.0
    stage.world.run(16.5)
    assert not set(gone) & set(node.shown)
    assert stage.unshown() == []
    assert stage.doubled() == []


def test_a_session_that_is_closed_may_begin_elsewhere_under_a_higher_epoch() -> None:
    stage = Stage(6, machines=3, sessions=50)
    stage.world.run(10.0)
    stage.add("m3")
    for _ in range(3):
        for node in stage.nodes.values():
            for session in list(node.shown):
                node.leave(session)
        stage.world.run(stage.world.now_s + 5.0)
    assert stage.unshown() == []
    assert stage.doubled() == []
    assert {len(turns) for turns in stage.shown.values()} == {4}
    assert len(stage.nodes["m3"].shown) > 5  # it has its share of what begins


def meet_everything(seed: int, seconds: float = 120.0) -> Stage:
    """Machines that are killed, cut off, slowed, paused and added, and sessions that are closed, all at random."""
    stage = Stage(seed, machines=4, sessions=60)
    rng, world = np.random.default_rng(seed + 1000), stage.world
    while world.now_s < seconds:
        world.run(world.now_s + rng.exponential(1.5))
        name = str(rng.choice([name for name, node in stage.nodes.items() if not node.is_dead]))
        what = rng.integers(7)
        if what == 0 and sum(not node.is_dead for node in stage.nodes.values()) > 2:
            stage.nodes[name].kill()
        elif what == 1:
            world.cut.add(name)
        elif what == 2:
            world.cut.clear()
            world.slow_s.clear()
        elif what == 3:
            world.slow_s[name] = float(rng.uniform(0.1, 3.0))
        elif what == 4:
            stage.nodes[name].paused_until_s = world.now_s + float(rng.uniform(0.1, 5.0))
        elif what == 5:
            for session in list(stage.nodes[name].shown)[::2]:
                stage.nodes[name].leave(session)
        elif len(stage.nodes) < 20:
            stage.add(f"m{len(stage.nodes)}")
    world.cut.clear()
    world.slow_s.clear()
    world.run(world.now_s + 15.0)
    return stage


@pytest.mark.parametrize("seed", range(15))
def test_whatever_happens_no_session_is_in_two_places_and_all_come_back(seed: int) -> None:
    stage = meet_everything(seed)
    assert stage.doubled() == []
    assert stage.unshown() == []
    assert sum(len(turns) for turns in stage.shown.values()) > 200  # much happened


@pytest.mark.parametrize("rule", ["fence", "late", "lease"])
def test_without_one_of_its_rules_somebody_is_shown_twice(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if rule == "fence":
        monkeypatch.setattr(partitions, "FENCE_S", TTL_S + 0.5)
    elif rule == "late":
        monkeypatch.setattr(Partitions, "has_lapsed", lambda self, now_s: False)
        monkeypatch.setattr(Partitions, "may_show", lambda self, now_s: self.until_s is not None)
    else:
        monkeypatch.setattr(Store, "has_lease", lambda self, name: False)
    assert any(meet_everything(seed).doubled() for seed in range(8))
