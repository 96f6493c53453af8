"""A run: what is left to do, done by some engine, and written into the journal as it is done.

Engines take shards of rows and give back what became of them, in any order. A shard whose worker was ended is split,
and its rows are tried one at a time; a row that ends its worker :data:`MAX_TRIES` times is named as the one that does.
"""

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

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
    """Make an engine of processes on this machine; one that is killed is replaced."""

    def engine(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
        waiting = deque(shards)
        suspects: deque[Shard] = deque()
        while waiting or suspects:
            # What was there when a worker ended is tried alone, so that it is known who ends it.
            queue, count, at_once = (waiting, workers, 2 * workers) if waiting else (suspects, 1, 1)
            try:
                yield from _through_pool(queue, count, at_once, job, suspects)
            except BrokenProcessPool:
                ready = [shard for shard in suspects if shard.tries >= MAX_TRIES]
                for shard in ready:
                    suspects.remove(shard)
                    yield shard.failed()

    return engine


def _through_pool(
    queue: deque[Shard], workers: int, at_once: int, job: Job, suspects: deque[Shard]
) -> Iterator[list[Done]]:
    """Give shards to a pool, so many at once; when it breaks, those go to the suspects."""
    os.environ |= ONE_THREAD
    running: dict[Future[list[Done]], Shard] = {}
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin_worker) as pool:
        try:
            while queue or running:
                while queue and len(running) < at_once:
                    shard = queue[0]  # a pool that is broken refuses it, and it stays where it is
                    running[pool.submit(do_rows, shard.rows, shard.keys, job)] = shard
                    queue.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    del running[future]
                    yield result
        except BrokenProcessPool:
            for future, shard in running.items():
                if future.done() and future.exception() is None:
                    yield future.result()
                else:
                    suspects += shard.again()
            raise
        except GeneratorExit:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin_worker() -> None:
    """Leave Ctrl-C to the process that asked, and end with it, whatever ends that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asker = parent_process()
    assert asker is not None

    def watch() -> None:
        asker.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
