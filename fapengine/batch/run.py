"""A run: the remaining rows are processed by an engine, and recorded in the journal.

Engines take shards of rows and yield their results in any order. If the worker of a shard dies, the shard is split and
its rows are tried one at a time; a row that kills its worker :data:`MAX_TRIES` times fails.

At the end a table of all rows, and a page with percentiles and the worst ten.
"""

import csv
import io
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fapengine._child import Child, Parent, command, end_soon_with_parent
from fapengine._late import needed
from fapengine.batch.journal import Done, Journal, load_journals
from fapengine.batch.rows import Row
from fapengine.batch.work import Digests, Job, do_rows, key_of
from fapengine.errors import ResourceError
from fapengine.files.paths import write_bytes
from fapengine.files.report.parts import page, table

SHARD_ROWS = {"profile": 1, "mp4": 1, "glb": 4}
"""Rows per shard; other kinds take milliseconds per row, and have more."""
MAX_SHARD_ROWS, SHARDS_A_WORKER = 32, 8
MAX_TRIES = 3
ENDED = "its worker ended {tries} times: out of memory, or killed"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"), "1")
"""Environment of workers, which share the cores among themselves."""


@dataclass(slots=True)
class Shard:
    """Rows that are processed together, and how often they were tried. Stateful."""

    rows: tuple[Row, ...]
    keys: tuple[str, ...]
    tries: int = 0

    def again(self) -> "list[Shard]":
        """Split it into rows after its worker ended."""
        return [Shard((row,), (key,), self.tries + 1) for row, key in zip(self.rows, self.keys, strict=True)]

    def failed(self) -> list[Done]:
        """Return the failure of rows that end their worker."""
        error = ENDED.format(tries=self.tries)
        return [Done(id=row.id, key=key, error=error) for row, key in zip(self.rows, self.keys, strict=True)]


@dataclass(frozen=True, slots=True)
class Plan:
    """Rows of a run, and which of them remain."""

    job: Job
    rows: tuple[Row, ...]
    keys: tuple[str, ...]
    left: tuple[int, ...]
    """Indices of the rows that are not done."""
    done: dict[str, Done] = field(default_factory=dict)
    """Results of the rows that are done."""

    def shards(self, workers: int) -> list[Shard]:
        """Divide the remaining rows into shards."""
        most = max(1, min(MAX_SHARD_ROWS, len(self.left) // (workers * SHARDS_A_WORKER)))
        size = SHARD_ROWS.get(self.job.kind, most)
        places = [self.left[start : start + size] for start in range(0, len(self.left), size)]
        return [Shard(tuple(self.rows[n] for n in some), tuple(self.keys[n] for n in some)) for some in places]


def plan_run(rows: Sequence[Row], job: Job, *, retry_failed: bool = False) -> Plan:
    """Find the remaining rows: those without a line in a journal, or whose inputs, options or files have changed.

    Failed rows are skipped, unless ``retry_failed`` is set or their inputs or options have changed.
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
    """Process the remaining rows, and return the results of all rows by id.

    Raises ResourceError if the journal cannot be written, or no worker can be started.
    """
    done = dict(plan.done)
    with Journal(journal) as book:
        for some in engine(plan.shards(workers), plan.job):
            book.add(some)
            done |= {entry.id: entry for entry in some}
            on_rows(len(some))
    return done


def serially(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
    """Process shards in this process."""
    for shard in shards:
        yield do_rows(shard.rows, shard.keys, job)


def on_this_machine(workers: int) -> Engine:
    """Make an engine of child processes; a dead one is replaced."""

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
    """Run as a worker: process shards until the parent ends."""
    end_soon_with_parent()
    for _, work in parent.messages():
        do, *arguments = pickle.loads(work)
        parent.tell({}, pickle.dumps(do(*arguments)))


def on_dask(address: str) -> Engine:
    """Make an engine of a Dask scheduler's workers.

    Raises ResourceError if distributed is not installed, or no scheduler answers at the address.
    """
    distributed = needed("distributed", "distributed", "scheduler")

    def engine(shards: list[Shard], job: Job) -> Iterator[list[Done]]:
        try:
            client = distributed.Client(address, timeout="10s")
        except (OSError, ValueError, TimeoutError) as error:
            raise ResourceError(f"scheduler: no answer from {address} ({error})") from error
        with client:
            yield from through_client(client, shards, job)

    return engine


def through_client(client: Any, shards: list[Shard], job: Job) -> Iterator[list[Done]]:
    """Process shards with a Dask client; a shard that killed too many workers is split."""
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


INDEX, PAGE = "index.csv", "index.html"
ABOUT = ("alphabet", "labels", "sound", "text", "timings", "words", "other")
"""Subjects of remarks, with which they begin."""
COLUMNS = (
    "id", "state", "file", "bytes", "duration_s", "frames", "phones", "unknown", "seconds", "error", "remarks", *ABOUT
)  # fmt: skip
NONE: Mapping[str, str] = MappingProxyType({})
PERCENTILES = (5, 25, 50, 75, 95, 100)
WORST = 10


def write_report(folder: Path, rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str]) -> None:
    """Write ``index.csv`` and ``index.html`` into a run's folder.

    ``bad`` has the errors of rows that were left out, by their lines. Raises ResourceError if they cannot be written.
    """
    write_bytes(folder / INDEX, format_index(rows, done, bad))
    write_bytes(folder / PAGE, format_page(rows, done, bad))


def format_index(rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str] = NONE) -> bytes:
    """List every row in the manifest's order, done, failed or left, and then those that were left out.

    What looked wrong has columns: a count of remarks, and one for each of :data:`ABOUT`.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        entry = done.get(row.id)
        if entry is None:
            writer.writerow([row.id, "left", *[""] * (len(COLUMNS) - 2)])
            continue
        name, (size, _) = next(iter(entry.outputs.items()), ("", (0, 0)))
        state = "failed" if entry.error else "done"
        figures = (entry.duration_s, entry.frames, entry.phones, entry.unknown, entry.seconds)
        about = _by_subject(entry.remarks)
        writer.writerow([row.id, state, name, size, *figures, entry.error, len(entry.remarks), *about])
    for place, error in bad.items():
        writer.writerow([place, "bad", *[""] * COLUMNS[2:].index("error"), error])
    return buffer.getvalue().encode()


def _by_subject(remarks: Sequence[str]) -> list[str]:
    """Join the remarks on each subject; the last column has those on anything else."""
    found: dict[str, list[str]] = {name: [] for name in ABOUT}
    for remark in remarks:
        subject = remark.partition(":")[0] if not remark.startswith("unknown phone") else "labels"
        found[subject if subject in found else ABOUT[-1]].append(remark)
    return ["; ".join(some) for some in found.values()]


def format_page(rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str] = NONE) -> bytes:
    """Put percentiles, errors and the worst rows on a page that refers to nothing outside of it."""
    entries = [done[row.id] for row in rows if row.id in done]
    good, failed = [entry for entry in entries if not entry.error], [entry for entry in entries if entry.error]
    counts = f"{len(rows)} rows: {len(good)} done, {len(failed)} failed, {len(rows) - len(entries)} left."
    counts += f" {len(bad)} more were invalid and left out." if bad else ""
    parts = ["<h1>Batch</h1>", f"<p>{counts}</p>"]
    if good:
        figures = {
            "length, s": [entry.duration_s for entry in good],
            "work, s": [entry.seconds for entry in good],
            "work for a second, s": [_cost(entry) for entry in good],
            "bytes": [sum(size for size, _ in entry.outputs.values()) for entry in good],
            "unknown phones": [entry.unknown for entry in good],
        }
        header = ["", *(f"{share} %" for share in PERCENTILES[:-1]), "most"]
        shares = {name: np.percentile(np.array(numbers, float), PERCENTILES) for name, numbers in figures.items()}
        body = [[name, *(f"{value:.4g}" for value in values)] for name, values in shares.items()]
        parts += ["<h2>Percentiles</h2>", table(header, body)]
        strange = sorted((entry for entry in good if entry.unknown), key=lambda entry: (-entry.unknown, entry.id))[
            :WORST
        ]
        if strange:
            rows_of = [[entry.id, str(entry.unknown), str(entry.phones)] for entry in strange]
            parts += ["<h2>Most unknown phones</h2>", table(["id", "unknown", "phones"], rows_of)]
        slow = sorted(good, key=lambda entry: (-_cost(entry), entry.id))[:WORST]
        slow_rows = [[entry.id, f"{entry.duration_s:.2f}", f"{entry.seconds:.2f}"] for entry in slow]
        parts += ["<h2>Most work for their length</h2>", table(["id", "length, s", "work, s"], slow_rows)]
    doubtful = [[entry.id, "; ".join(entry.remarks)] for entry in good if entry.remarks]
    errors = [[entry.id, entry.error] for entry in failed], [list(each) for each in bad.items()]
    for title, listed in zip(("Remarks", "Failed", "Left out"), (doubtful, *errors), strict=True):
        if listed:
            more = len(listed) - 10 * WORST
            parts += [f"<h2>{title}</h2>", table(["id", title.lower()], listed[: 10 * WORST])]
            parts += [f"<p>and {more} more: see {INDEX}</p>"] if more > 0 else []
    return page("Batch", parts)


def _cost(entry: Done) -> float:
    return entry.seconds / max(entry.duration_s, 0.1)
