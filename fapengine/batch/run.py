"""A run: what is left to do, done by some engine, and written into the journal as it is done.

Engines take shards of rows and give back what became of them, in any order. A shard whose worker was ended is split,
and its rows are tried one at a time; a row that ends its worker :data:`MAX_TRIES` times is named as the one that does.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fapengine._child import Child, Parent, command, end_soon_with_parent
from fapengine.batch.journal import Done, Journal, load_journals
from fapengine.batch.rows import Row
from fapengine.batch.work import Digests, Job, do_rows, key_of
from fapengine.errors import ResourceError

SHARD_ROWS = {"profile": 1, "mp4": 1, "glb": 4}
"""Rows that a worker is given at once; of other kinds, which take milliseconds, more."""
MAX_SHARD_ROWS, SHARDS_A_WORKER = 32, 8
MAX_TRIES = 3
ENDED = "its worker ended, and did so {tries} times: out of memory, or killed"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"), "1")
"""Surroundings of workers, who share the cores among themselves."""


@dataclass(slots=True)
class Shard:
    """Rows that go together, and how often they were tried. Stateful."""

    rows: tuple[Row, ...]
    keys: tuple[str, ...]
    tries: int = 0

    def again(self) -> "list[Shard]":
        """Split it after its worker ended."""
        pairs = zip(self.rows, self.keys, strict=True)
        return [Shard((row,), (key,), self.tries + 1) for row, key in pairs]

    def failed(self) -> list[Done]:
        """Name the row that ends its worker."""
        told = ENDED.format(tries=self.tries)
        return [Done(id=row.id, key=key, error=told) for row, key in zip(self.rows, self.keys, strict=True)]


@dataclass(frozen=True, slots=True)
class Plan:
    """Rows of a run, and what of them is left to do."""

    job: Job
    rows: tuple[Row, ...]
    keys: tuple[str, ...]
    left: tuple[int, ...]
    """Places of the rows that are not done."""
    done: dict[str, Done] = field(default_factory=dict)
    """Lines of the journals about rows that are."""

    def shards(self, workers: int) -> list[Shard]:
        """Share what is left among workers."""
        most = max(1, min(MAX_SHARD_ROWS, len(self.left) // (workers * SHARDS_A_WORKER)))
        size = SHARD_ROWS.get(self.job.kind, most)
        places = [self.left[start : start + size] for start in range(0, len(self.left), size)]
        return [Shard(tuple(self.rows[n] for n in some), tuple(self.keys[n] for n in some)) for some in places]


def plan_run(rows: Sequence[Row], job: Job, *, retry_failed: bool = False) -> Plan:
    """Tell what is left: rows that no journal has, whose inputs or options have changed, or whose files have.

    Rows that failed are left out too, unless they shall be tried again or something of theirs has changed.
    """
    digests, known = Digests(), load_journals(job.folder)
    keys = tuple(key_of(row, job.kind, digests) for row in rows)
    done = {
        row.id: known[row.id]
        for row, key in zip(rows, keys, strict=True)
        if row.id in known and known[row.id].key == key
    }

    def is_left(row: Row) -> bool:
        entry = done.get(row.id)
        if entry is None:
            return True
        return retry_failed if entry.error else not entry.stands(job.folder)

    left = tuple(place for place, row in enumerate(rows) if is_left(row))
    for place in left:
        done.pop(rows[place].id, None)
    return Plan(job, tuple(rows), keys, left, done)


Engine = Callable[[list[Shard], Job], Iterator[list[Done]]]


def run(
    plan: Plan, engine: Engine, workers: int, journal: Path, on_rows: Callable[[int], None] = lambda _: None
) -> dict[str, Done]:
    """Do what is left; returns what became of every row, by its id.

    Raises
    ------
    ResourceError
        If the journal cannot be written, or there is no worker.
    """
    done = dict(plan.done)
    with Journal(journal) as book:
        for some in engine(plan.shards(workers), plan.job):
            book.add(some)
            done |= {entry.id: entry for entry in some}
            on_rows(len(some))
    return done


def serially(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
    """Do shards in this process."""
    for shard in shards:
        yield do_rows(shard.rows, shard.keys, job)


def on_this_machine(workers: int) -> Engine:
    """Make an engine of child processes; one that ends is replaced."""

    def engine(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
        waiting = deque(shards)
        idle = [_worker() for _ in range(min(workers, len(shards)))]
        running: dict[Future[list[Done]], tuple[Shard, Child]] = {}
        with ThreadPoolExecutor(max(workers, 1)) as pool:
            try:
                while waiting or running:
                    while waiting and idle:
                        shard, child = waiting.popleft(), idle.pop()
                        running[pool.submit(_asked, child, shard, job)] = shard, child
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        shard, child = running.pop(future)
                        try:
                            result = future.result()
                        except EOFError:
                            child.close()
                            idle.append(_worker())
                            waiting += (again := shard.again())
                            if len(again) == 1 and again[0].tries >= MAX_TRIES:
                                yield waiting.pop().failed()
                        else:
                            idle.append(child)
                            yield result
            finally:
                for child in (*idle, *(child for _, child in running.values())):
                    child.close()

    return engine


def _worker() -> Child:
    return Child("batch", command(__name__), environment=ONE_THREAD)


def _asked(child: Child, shard: Shard, job: Job) -> list[Done]:
    work = pickle.dumps((do_rows, shard.rows, shard.keys, job))
    done: list[Done] = pickle.loads(child.ask({}, work)[1])
    return done


def main(parent: Parent) -> None:
    """Be a worker: do the shards that come."""
    end_soon_with_parent()
    for _, work in parent.messages():
        do, *arguments = pickle.loads(work)
        parent.tell({}, pickle.dumps(do(*arguments)))


def on_dask(address: str) -> Engine:
    """Make an engine of a Dask scheduler's workers.

    Raises
    ------
    ResourceError
        If distributed is not installed, or nobody answers at the address.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ResourceError(
            'scheduler: distributed is not installed; mend it with: pip install "fapengine[batch]"'
        ) from error

    def engine(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
        try:
            client: Any = Client(address, timeout="10s")  # type: ignore[no-untyped-call]
        except (OSError, ValueError, TimeoutError) as error:
            raise ResourceError(f"scheduler: nobody answers at {address} ({error})") from error
        with client:
            yield from through_client(client, shards, job)

    return engine


def through_client(client: Any, shards: list[Shard], job: Job) -> Iterator[list[Done]]:
    """Give shards to a Dask client; one that ended too many workers is split."""
    from distributed import KilledWorker, as_completed

    def submitted(shard: Shard) -> Any:
        return client.submit(do_rows, shard.rows, shard.keys, job, pure=False)

    running = {submitted(shard): shard for shard in shards}
    order: Any = as_completed(running)  # type: ignore[no-untyped-call]
    for future in order:
        shard = running.pop(future)
        try:
            yield future.result()
        except KilledWorker:
            if len(shard.rows) == 1:
                shard.tries = MAX_TRIES
                yield shard.failed()
                continue
            for part in shard.again():
                running[again := submitted(part)] = part
                order.add(again)
