"""The live server over real sockets: how late a frame is, and how many faces one core keeps talking.

    python -m bench.live [--sessions 1 50 200 500] [--seconds 20] [--phones] [--json FILE] [--plot FILE]

The server is ``fapengine serve`` in a process of its own, kept to one core; the senders (:mod:`bench.live_load`) and
the probe have the other cores; where it is allowed, all go before other work on the machine (SCHED_FIFO). Every session
speaks all the time, and every frame of every session leaves as ``/fap/1/frame`` and is counted where it arrives.

*Latency*: the probe turns the eyes of a session of its own at random moments and looks for the first frame in which
they have turned: from the moment before the datagram is sent to the kernel's time stamp on the frame's arrival. At 60
frames a second a datagram waits 8.3 ms on average for its frame, and 16.7 ms at most.
*Missed*: frames that the server skipped, and frames that did not arrive.
*Core*: CPU time of the server, per second. Other work on the machine delays frames; the load average is told.
"""

import argparse
import json
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from bench.live_load import listening, warming_s
from fapengine.wire import osc

GOAL_SESSIONS, GOAL_LATE_MS = 500, 1000 / 60 + 5
PROBE = "probe"
EYES_AT = 16 + 72 + 8 + 28 + 4 * (23 - 3)
"""FAP 23 in a frame of the probe's session: address, tags, name, number, time and mask, 20 FAPs."""
WAIT_S = (0.06, 0.14)
SO_TIMESTAMPNS = 35
TICKS_HZ = os.sysconf("SC_CLK_TCK")


class Server:
    """Stateful: a server in a process of its own."""

    def __init__(
        self,
        frames_to: int,
        probe_to: int,
        *,
        cores: set[int] | None = None,
        sinks: Sequence[str] = (),
        config: str = "",
        workers: int = 1,
    ) -> None:
        command = [
            sys.executable, "-m", "fapengine", "serve", "--port", "0", "--no-page",
            "--metrics-port", "0", "--log", "json",
            "--sink", f"osc://127.0.0.1:{frames_to}",
            "--sink", f"osc://127.0.0.1:{probe_to}?session={PROBE}",
            *(word for sink in sinks for word in ("--sink", sink)),
        ]  # fmt: skip
        self.config = tempfile.NamedTemporaryFile("w", suffix=".toml")  # noqa: SIM115  closed by stop()
        self.config.write(config)
        self.config.flush()
        command += ["--config", self.config.name, "--workers", str(workers)]
        one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        self.log = tempfile.NamedTemporaryFile("w+", suffix=".jsonl")  # noqa: SIM115  closed by stop()
        self.process = subprocess.Popen(command, stderr=self.log, env=os.environ | one_thread)
        while not (text := Path(self.log.name).read_text()).endswith("\n"):
            if self.process.poll() is not None:
                sys.exit(f"the server did not start: {text}")
            time.sleep(0.05)
        line = json.loads(text.splitlines()[0])
        where = {one["what"]: one["where"] for one in line["listens"]}
        host, port = where["OSC in"].split()[0].rsplit(":", 1)
        self.address, self.metrics_url = (host, int(port)), where["metrics"]
        told = where.get("workers", "").split()
        self.processes = [int(part.partition(":")[2]) for part in told] or [self.process.pid]
        """Those that show faces."""
        if cores:
            os.sched_setaffinity(self.process.pid, cores)
        for process in {self.process.pid, *self.processes}:
            go_before(process)

    def cpu_s(self, process: int | None = None) -> float:
        """CPU time spent so far, by the server's first process or by one that is named."""
        fields = Path(f"/proc/{process or self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICKS_HZ

    def metrics(self) -> dict[str, float]:
        """Read what Prometheus would."""
        text = urllib.request.urlopen(self.metrics_url, timeout=10).read().decode()
        return {key: float(value) for key, value in re.findall(r"^([^#\s]\S*) (\S+)$", text, re.M)}

    def stop(self) -> int:
        """End it; gives its exit code."""
        self.process.terminate()
        try:
            return self.process.wait(10)
        finally:
            text = Path(self.log.name).read_text().splitlines()
            if len(text) > 1 + len(self.processes):
                print(f"the server's log has {len(text)} lines, the second: {text[1]:.200}", file=sys.stderr)
            self.log.close()
            self.config.close()


def go_before(process: int) -> None:
    """Let a process go before others, if that is allowed, as if its core were its own."""
    with suppress(PermissionError):
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(10))


@contextmanager
def serving(*ports: int, **options: Any):
    """Run a server for a while; see :class:`Server`."""
    server = Server(*ports, **options)
    try:
        yield server
    finally:
        server.stop()


def probe(server: tuple[str, int], receiver: socket.socket, seconds: float, seed: int = 0) -> list[float]:
    """Turn the eyes again and again; seconds from each datagram to the frame that shows it."""
    rng = np.random.default_rng(seed)
    receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    receiver.setblocking(True)
    receiver.settimeout(1.0)
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.connect(server)
    for key in ("gaze", "head_motion", "blinks", "idle"):
        out.send(osc.message("/fap/1/param", "ssf", PROBE, key, 0.0))
    found: list[float] = []
    side, stop_s = 1.0, time.monotonic() + seconds
    time.sleep(1.0)
    while time.monotonic() < stop_s:
        side = -side
        gaze = osc.message("/fap/1/gaze", "sffi", PROBE, 5.0 * side, 0.0, 10_000)
        try:
            found.append(_turn(receiver, out, gaze, float(rng.uniform(*WAIT_S)), float(rng.uniform(0.0, 1 / 60))))
        except TimeoutError:  # no frame for a second
            found.append(float("inf"))
    out.close()
    return found


def _turn(receiver: socket.socket, out: socket.socket, gaze: bytes, wait_s: float, phase_s: float) -> float:
    """Turn the eyes once, at any moment between two frames; seconds to the frame that shows it, inf: lost."""
    still = _until_still(receiver, wait_s)
    time.sleep(phase_s)
    sent_ns = time.time_ns()
    out.send(gaze)
    while time.time_ns() - sent_ns < 1_000_000_000:
        eyes, arrived_ns = _frame(receiver)
        if arrived_ns > sent_ns and eyes != still:
            return (arrived_ns - sent_ns) * 1e-9
    return float("inf")


def _until_still(receiver: socket.socket, wait_s: float) -> int:
    stop_ns = time.time_ns() + int(wait_s * 1e9)
    while True:
        eyes, arrived_ns = _frame(receiver)
        if arrived_ns >= stop_ns:
            return eyes


def _frame(receiver: socket.socket) -> tuple[int, int]:
    """Read a frame: where the eyes look, and the kernel's time of its arrival."""
    data, extra, _, _ = receiver.recvmsg(2048, 64)
    seconds, nanoseconds = struct.unpack("qq", extra[0][2][:16])
    return struct.unpack_from(">i", data, EYES_AT)[0], seconds * 1_000_000_000 + nanoseconds


def measure(sessions: int, seconds: float, *, chunked: bool) -> dict[str, Any]:
    """All figures of so many sessions."""
    frames, eyes = listening(), listening()
    cores = sorted(os.sched_getaffinity(0))
    others = set(cores[1:]) or set(cores)
    os.sched_setaffinity(0, others)
    frames_port = frames.getsockname()[1]
    frames.close()
    with serving(frames_port, eyes.getsockname()[1], cores={cores[0]}) as server:
        to = "{}:{}".format(*server.address)
        command = [
            sys.executable, "-m", "bench.live_load", "--to", to,
            "--hear", str(frames_port), "--sessions", str(sessions), "--seconds", str(seconds),
            *(["--phones"] if chunked else []),
        ]  # fmt: skip
        load = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        go_before(load.pid)
        go_before(os.getpid())
        time.sleep(warming_s(sessions))
        before, cpu_s, start_s = server.metrics(), server.cpu_s(), time.monotonic()
        late_s = probe(server.address, eyes, seconds - 1.5)
        used = (server.cpu_s() - cpu_s) / (time.monotonic() - start_s)
        after = server.metrics()
        heard = json.loads(load.communicate()[0])
    eyes.close()
    os.sched_setaffinity(0, set(cores))

    def gained(name: str) -> int:
        return int(after[name] - before[name])

    ticks = gained("fapengine_tick_seconds_count")
    late = np.array(late_s) * 1e3
    return heard | {
        "sessions": sessions, "probes": len(late), "late_ms": np.round(late, 3).tolist(),
        "p50_ms": float(np.median(late)), "p99_ms": float(np.quantile(late, 0.99, method="higher")),
        "max_ms": float(late.max()),
        "core": used, "frames": ticks, "skipped": gained("fapengine_skipped_total"),
        "tick_ms": 1e3 * (after["fapengine_tick_seconds_sum"] - before["fapengine_tick_seconds_sum"]) / max(ticks, 1),
        "datagrams_in": gained('fapengine_intake_total{kind="datagrams"}'), "load": os.getloadavg()[0],
        "unsent": gained(next(key for key in after if key.startswith("fapengine_unsent_total"))),
    }  # fmt: skip


def plot(results: list[dict[str, Any]], path: Path) -> None:
    """Draw how late frames are: for each number of sessions, the share of datagrams shown by then."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "live"
    figure, axes = plt.subplots(figsize=(7.0, 3.6))
    shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.8, len(results)))
    for one, shade in zip(results, shades, strict=True):
        late = np.sort(one["late_ms"])
        share = np.arange(1, len(late) + 1) / len(late)
        label = f"{one['sessions']} sessions: p50 {one['p50_ms']:.1f}, p99 {one['p99_ms']:.1f} ms"
        axes.step([0.0, *late], [0.0, *share], where="post", color=shade, label=label)
    axes.axvline(1000 / 60, color="0.6", lw=0.8, ls="--")
    axes.text(1000 / 60, 0.02, " one frame", color="0.4", fontsize=8)
    axes.set(xlim=(0, 40), ylim=(0, 1), xlabel="from the datagram to the arrival of its frame, ms", ylabel="share")
    axes.legend(frameon=False, fontsize=8, loc="upper left" if results[0]["p50_ms"] > 20 else "lower right")
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, nargs="+", default=[1, 50, 200, 500])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--phones", action="store_true", help="feed phone by phone, not clause by clause")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path)
    wanted = parser.parse_args()
    widths = {
        "sessions": 8, "p50 ms": 7, "p99 ms": 7, "max ms": 7, "tick ms": 8, "core": 6, "skipped": 8, "of": 6,
        "lost": 6, "in/s": 6, "load": 5,
    }  # fmt: skip
    print(" ".join(f"{name:>{width}}" for name, width in widths.items()))
    results = []
    for sessions in wanted.sessions:
        one = measure(sessions, wanted.seconds, chunked=wanted.phones)
        results.append(one)
        print(
            f"{sessions:>8} {one['p50_ms']:7.1f} {one['p99_ms']:7.1f} {one['max_ms']:7.1f} {one['tick_ms']:8.2f}"
            f" {one['core']:6.0%} {one['skipped']:>8} {one['frames']:>6} {one['missing']:>6}"
            f" {60 * one['datagrams_in'] / max(one['frames'], 1):6.0f} {one['load']:5.1f}",
            flush=True,
        )
    if wanted.json:
        wanted.json.write_text(json.dumps(results, indent=1))
    if wanted.plot:
        plot(results, wanted.plot)


if __name__ == "__main__":
    main()
