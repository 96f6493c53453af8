"""Cost of a corpus beyond that of its rows: ``python -m bench.batch [--rows 10000] [--workers 1 2]``.

Short rows of timings become FBA streams: in one loop that does nothing else (the yardstick), then as a run with a
journal, checksums, files replaced at once and worker processes. Processor time counts, of workers too, so other work on
the machine changes little. What 64 workers would do is reckoned from the client's own share, which they wait for.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

from fapengine.batch.rows import Options, Row
from fapengine.batch.run import on_this_machine, plan_run, run
from fapengine.batch.work import Job, perform_row, save_row

MAX_OVERHEAD = 1.3


def cpu_s() -> tuple[float, float]:
    """Processor time of this process, and of children that have ended."""
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


def rows_in(folder: Path, count: int) -> tuple[Row, ...]:
    rows = []
    for number in range(count):
        path = folder / f"{number}.pho"
        path.write_text(f"_ 80\nb {60 + number % 50}\na {90 + number % 70}\nm 70\n@ 80\ns 110\ni 90\n_ 100\n")
        rows.append(Row(id=f"{number // 1000}/{number}", timings=path, options=Options(seed=number)))
    return tuple(rows)


def serial_s(rows: tuple[Row, ...], folder: Path) -> float:
    """Do the rows in a loop."""
    before = cpu_s()[0]
    for row in rows:
        save_row(perform_row(row), row.output(folder, "fba"), row.options)
    return cpu_s()[0] - before


def main() -> None:
    """Print a line for each number of workers; fail above the bound."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = rows_in(folder, asked.rows)
        serial_s(rows[:50], folder / "warm")
        yardstick = serial_s(rows, folder / "serial")
        print(f"serial: {asked.rows} rows, {yardstick:.1f} s of processor, {1e3 * yardstick / asked.rows:.2f} ms a row")
        worst = 0.0
        for workers in asked.workers:
            target = folder / f"run-{workers}"
            before, started_s = cpu_s(), time.perf_counter()
            plan = plan_run(rows, Job(target, "fba"))
            done = run(plan, on_this_machine(workers), workers, target / "journal.jsonl")
            wall_s = time.perf_counter() - started_s
            client_s, workers_s = (after - first for after, first in zip(cpu_s(), before, strict=True))
            assert sum(not entry.error for entry in done.values()) == asked.rows
            ratio = (client_s + workers_s) / yardstick
            worst = max(worst, ratio)
            print(
                f"{workers} workers: {wall_s:.1f} s; client {client_s:.1f} s, workers {workers_s:.1f} s of processor:"
                f" {ratio:.2f} of serial; 64 workers would be kept busy {min(1.0, workers_s / 64 / client_s):.0%}"
            )
    if worst > MAX_OVERHEAD:
        raise SystemExit(f"overhead: got {worst:.2f}, expected at most {MAX_OVERHEAD}")


if __name__ == "__main__":
    main()
