"""Faces that two workers keep talking for each that one process keeps: ratios, in one run.

    python -m bench.workers [--sessions 120] [--workers 2] [--shares 1.0 1.7 2.0] [--seconds 10] [--rounds 2]

The server is ``fapengine serve``, once as one process with SESSIONS faces that speak without end
(:mod:`bench.live_load`), then with workers and SHARES times as many; again in each round. Where it is allowed, servers
and senders go before other work on the machine (SCHED_FIFO).

*p99*: of what a frame of all sessions takes, of the histogram that the metrics tell, over all workers. It is wall time:
where workers and senders have fewer cores than they need, it grows.
*Equal p99*: how many times the faces of one process the workers show with its p99, between the measured shares.
*By processor*: the same from processor time of the busiest worker for a face, as if each had a core of its own: other
work on the machine does not count, what the parent and an uneven placement cost does.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from typing import Any

import numpy as np

from bench.live import go_before, serving
from bench.live_load import listening, warming_s

TICK = "fapengine_tick_seconds"


def p99_ms(before: dict[str, float], after: dict[str, float]) -> float:
    """Find the p99 of a tick, of all workers, linear within its bucket."""
    counts: dict[float, float] = {}
    for key in after:
        if key.startswith(f"{TICK}_bucket"):
            bound = re.search(r'le="([^"]+)"', key)
            edge = float(bound[1]) if bound else float("nan")
            counts[edge] = counts.get(edge, 0.0) + after[key] - before.get(key, 0.0)
    edges = sorted(edge for edge in counts if np.isfinite(edge))
    wanted = 0.99 * counts[float("inf")]
    return 1e3 * float(np.interp(wanted, [0.0, *(counts[edge] for edge in edges)], [0.0, *edges]))


def measure(workers: int, sessions: int, seconds: float) -> dict[str, Any]:
    """Let so many faces speak."""
    frames, eyes = listening(), listening()
    frames_port = frames.getsockname()[1]
    frames.close()
    with serving(frames_port, eyes.getsockname()[1], workers=workers) as server:
        command = [
            sys.executable, "-m", "bench.live_load", "--to", "{}:{}".format(*server.address),
            "--hear", str(frames_port), "--sessions", str(sessions), "--seconds", str(seconds),
        ]  # fmt: skip
        load = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        go_before(load.pid)
        time.sleep(warming_s(sessions))
        everybody = {server.process.pid, *server.processes}
        before, begun_s = server.metrics(), time.monotonic()
        spent = {process: server.cpu_s(process) for process in everybody}
        time.sleep(seconds - 1.0)
        spent = {process: server.cpu_s(process) - spent[process] for process in everybody}
        took_s, after = time.monotonic() - begun_s, server.metrics()
        heard = json.loads(load.communicate()[0])
    eyes.close()
    skipped = sum(after[key] - before[key] for key in after if key.startswith("fapengine_skipped_total"))
    ticks = sum(after[key] - before[key] for key in after if key.startswith(f"{TICK}_count"))
    workers_cpu = [spent[process] / took_s for process in server.processes]
    parent = spent[server.process.pid] / took_s if workers > 1 else 0.0
    return {
        "workers": workers, "sessions": sessions, "p99_ms": p99_ms(before, after), "cores": sorted(workers_cpu),
        "parent": parent, "skipped": int(skipped), "frames": int(ticks), "missing": heard["missing"],
        "load": os.getloadavg()[0],
    }  # fmt: skip


def equal_p99(one: float, shares: list[float], found: list[float]) -> float:
    """Share at which the workers' p99 is that of one process; beyond the measured ones, the last of them."""
    return float(np.interp(one, np.maximum.accumulate(found), shares, left=0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=120)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--shares", type=float, nargs="+", default=[1.0, 1.7, 2.0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=2)
    wanted = parser.parse_args()
    print(f"cores: {len(os.sched_getaffinity(0))}; workers, senders and parent share them")
    print("workers sessions  p99 ms  busiest  idlest  parent  skipped  frames  lost  load")
    results = []
    for _ in range(wanted.rounds):
        for workers, share in [(1, 1.0), *((wanted.workers, share) for share in wanted.shares)]:
            row = measure(workers, round(wanted.sessions * share), wanted.seconds)
            results.append(row | {"share": share})
            print(
                f"{workers:>7} {row['sessions']:>8} {row['p99_ms']:>7.1f} {row['cores'][-1]:>8.1%}"
                f" {row['cores'][0]:>7.1%} {row['parent']:>7.1%} {row['skipped']:>8} {row['frames']:>7}"
                f" {row['missing']:>5} {row['load']:>5.1f}",
                flush=True,
            )
    ones = [row for row in results if row["workers"] == 1]
    one_p99 = float(np.median([row["p99_ms"] for row in ones]))
    a_face = float(np.median([row["cores"][-1] / row["sessions"] for row in ones]))
    shares = sorted(wanted.shares)
    many = [[row for row in results if row["workers"] > 1 and row["share"] == share] for share in shares]
    found = [float(np.median([row["p99_ms"] for row in rows])) for rows in many]
    by_processor = float(np.median([a_face * row["sessions"] / row["cores"][-1] for row in many[-1]]))
    print(f"equal p99 ({one_p99:.1f} ms): {equal_p99(one_p99, shares, found):.2f} times the faces")
    print(f"by processor: {by_processor:.2f} times the faces")


if __name__ == "__main__":
    main()
