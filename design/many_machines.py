"""Sessions over machines that fail, on virtual time: who moves, how long mouths stay open, who is shown twice.

    python -m design.many_machines [--sessions 10000 100000] [--machines 50] [--hours 168]

What is simulated is ``serve --nats`` (docs/live.md, "Many machines") over weeks, with its partitions and its times
(``server/partitions.py``); its protocol, message by message, is in tests/simulation/test_partitions.py.
A machine holds a lease, which it renews in a store. It shows nothing more (it fences itself) when it could not renew
for so long that, by the slowest clock, the lease may be over; its partitions go to others when, by the store's, it is.

A machine fails in one of three ways, each at random moments (one failure in two days a machine, far more than machines
do):

- *process*: the parent is killed, and its workers put the faces to rest;
- *power*: it is gone, and its faces stay as they were until another machine shows them;
- *cut off*: it runs on and cannot reach the store for a while; senders and receivers still reach it.

Every session speaks all the time. Its sender notices as :class:`fapengine.Client` does: a question twice a second, lost
after one without an answer for a second, then a hello a second until it is told a machine that lives.
"""

import argparse
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fapengine.clients.connection import AWAY_PING_S, LOST_S
from fapengine.server.ownership import Home, Placement
from fapengine.server.partitions import FENCE_S, PARTITIONS, RENEW_S, TTL_S, partition_of

DRIFT = 200e-6
"""Share by which clocks may run fast or slow."""
ROUND_S = (0.0005, 0.02)
"""Shortest and longest way of a renewal to the store; an answer takes as long."""
GUARD_S = 0.3
"""Time in which workers without a parent put faces to rest (docs/live.md)."""
HELLO_S = 1.0
"""Time from one hello to the next."""
TOLD_S = 0.05
"""Time from the right hello to a mouth that moves: two round trips, a plan, a frame."""
BACK_S = {"process": 2.0, "power": 120.0, "cut off": 0.0}
"""Time until a machine takes sessions again."""
CUT_S = (0.5, 20.0)
FAILURE_S = 2 * 86_400.0
"""Mean time from one failure of a machine to its next."""


@dataclass
class Result:
    """Counts and times of a simulated week."""

    failures: Counter[str] = field(default_factory=Counter)
    moved: list[int] = field(default_factory=list)
    """Sessions that a failure moved."""
    rest_s: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)
    """Times from each failure to lips at rest, of those sessions."""
    resume_s: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)
    doubled: int = 0
    """Sessions that were shown by two machines at one time."""
    busiest: float = 1.0
    """Greatest number of sessions of a machine, over the mean."""
    misplaced: int = 0
    """Partitions that moved although their machine had not lost its lease."""


class Cluster:
    """Machines, their leases and their partitions. Stateful."""

    def __init__(self, sessions: int, machines: int, rng: np.random.Generator) -> None:
        self.rng, self.machines = rng, machines
        self.rates = 1.0 + rng.uniform(-DRIFT, DRIFT, machines + 1)
        """Rates of the machines' clocks, and of the store's."""
        self.renewed_s = rng.uniform(0.0, RENEW_S, machines)
        """Phase of each machine's renewals."""
        self.ways_s = rng.uniform(*ROUND_S, machines)
        self.table = Placement()
        for machine in range(machines):
            self.table.join(machine)
        partitions = np.array([partition_of(f"s{number:06d}") for number in range(sessions)])
        self.sizes = np.bincount(partitions, minlength=PARTITIONS)
        """Sessions of each partition."""
        self.homes = np.array([self._home(partition, 0.0) for partition in range(PARTITIONS)])
        self.result = Result()

    def _home(self, partition: int, now_s: float) -> int:
        home = self.table.owner(f"p{partition}", now_s)
        assert isinstance(home, Home)
        return home.worker

    def fail(self, machine: int, kind: str, at_s: float) -> None:
        """Let a machine fail; its partitions go to others, if its lease ends by that."""
        result, rng = self.result, self.rng
        result.failures[kind] += 1
        asked_s = at_s - (at_s - self.renewed_s[machine]) % RENEW_S  # the last renewal that it sent and that came
        came_s = asked_s + self.ways_s[machine]
        over_s = came_s + TTL_S * self.rates[-1]  # by the store
        fenced_s = asked_s + FENCE_S * self.rates[machine]  # by itself
        if kind == "process":
            rest_s, free_s = at_s + GUARD_S, over_s
        elif kind == "power":
            rest_s, free_s = over_s, over_s
        else:
            back_s = at_s + rng.uniform(*CUT_S)
            if back_s < fenced_s - RENEW_S:  # a renewal comes through before it is too late
                return
            rest_s, free_s = fenced_s, over_s
        gone = self.homes == machine
        before = self.homes.copy()
        self.table.lose(machine)
        for partition in np.flatnonzero(gone):
            self.homes[partition] = self._home(int(partition), free_s)
        result.misplaced += int((self.homes != before)[~gone].sum())
        moved = int(self.sizes[gone].sum())
        result.moved.append(moved)
        silent_s = rest_s if kind == "cut off" else at_s  # until then it answers its senders
        noticed_s = silent_s + LOST_S + rng.uniform(0.0, AWAY_PING_S, moved)
        waits = np.maximum(np.ceil((free_s - noticed_s) / HELLO_S), 0.0)
        resume_s = noticed_s + waits * HELLO_S + TOLD_S
        rests_s = resume_s if kind == "power" else np.full(moved, rest_s)
        shown_until_s = rest_s if kind == "cut off" else at_s
        result.doubled += int((resume_s < shown_until_s).sum()) + moved * (free_s < shown_until_s)
        result.rest_s.setdefault(kind, []).append(rests_s - at_s)
        result.resume_s.setdefault(kind, []).append(resume_s - at_s)
        held = np.bincount(self.homes, weights=self.sizes, minlength=self.machines)
        alive = len(self.table.workers)
        result.busiest = max(result.busiest, float(held.max()) * alive / self.sizes.sum())

    def back(self, machine: int) -> None:
        """Let a machine take new partitions again; none is moved to it."""
        self.table.join(machine)


def simulate(sessions: int, machines: int, hours: float, seed: int = 1) -> Result:
    """Let machines fail for so long."""
    rng = np.random.default_rng(seed)
    cluster = Cluster(sessions, machines, rng)
    count = rng.poisson(machines * 3600 * hours / FAILURE_S)
    times = np.sort(rng.uniform(10.0, 3600 * hours, count))
    returns: dict[int, float] = {}
    for at_s in times:
        for machine in [one for one, back_s in returns.items() if back_s <= at_s]:
            cluster.back(machine)
            del returns[machine]
        alive = [machine for machine in range(machines) if machine not in returns]
        machine, kind = int(rng.choice(alive)), str(rng.choice(list(BACK_S)))
        cluster.fail(machine, kind, float(at_s))
        if machine not in cluster.table.workers:
            returns[machine] = at_s + BACK_S[kind] + TTL_S
    return cluster.result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--machines", type=int, default=50)
    parser.add_argument("--hours", type=float, default=168.0)
    wanted = parser.parse_args()
    for sessions in wanted.sessions:
        result = simulate(sessions, wanted.machines, wanted.hours)
        print(f"{sessions} sessions, {wanted.machines} machines, {wanted.hours:g} h; failures: {dict(result.failures)}")
        print(
            f"  moved by a failure: {np.mean(result.moved):.0f} on average, {max(result.moved)} at most; by nothing:"
            f" {result.misplaced}; shown twice: {result.doubled}; busiest machine: {result.busiest:.2f} of the mean"
        )
        for kind in result.rest_s:
            rest, resume = np.concatenate(result.rest_s[kind]), np.concatenate(result.resume_s[kind])
            print(
                f"  {kind:8} lips at rest {np.median(rest):.2f} s, at most {rest.max():.2f}; speech again"
                f" {np.median(resume):.2f} s, 99 % {np.quantile(resume, 0.99):.2f}, at most {resume.max():.2f}"
            )


if __name__ == "__main__":
    main()
