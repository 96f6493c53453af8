"""The renderer's speed: its parts, its growth, and other renderers on the same mesh, all in one interleaved run.

    python -m bench.render [--peers PYTHON] [--rounds N] [--json FILE] [--page]

Frames are drawn as they are for a video: all FAPs live, full shading, softened edges, read back into an array. Every
case and every peer draws in each round, the default head before and after each of them, so that a neighbour on the same
cores slows both sides of a ratio. Ratios are medians over the rounds, with the quarters of the rounds beside them;
frames a second are of a case's best round, which is the one with the fewest neighbours. Processor time is that of all
processes of a case, a browser's too. PYTHON is an interpreter with
the group ``peers`` of pyproject.toml (by default this one); a peer that does not install or start is reported as
absent. ``--page`` writes the part of docs/measurements.md about drawing, and its plot.
"""

import argparse
import contextlib
import json
import os
import platform
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.finer import finer, only_faps
from bench.render_goals import (
    BROWSER_PEERS,
    FILM,
    FINE,
    GOALS_FPS,
    MAX_DEFORMING,
    MIN_PEER_RATIO,
    MIN_PEER_RATIOS,
    NATIVE,
    PEERS,
    REFERENCE,
    SAME_QUALITY,
    SOFT,
    STAIRS,
)
from bench.render_page import write_page
from bench.talking import talking_face
from fapengine.files.moving import write_moving
from fapengine.geometry.surface import vertex_normals
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.context import create_context
from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS, RenderOptions
from fapengine.render.native import NativeRenderer
from fapengine.render.renderer import FaceRenderer

PEER_FILE = Path(__file__).with_name("render_peers.py")
START_LIMIT_S, ROUND_LIMIT_S, END_LIMIT_S = 90.0, 60.0, 5.0
SLICE_S = 0.15
"""How long a contender draws in a round."""
HD, FULL_HD = (1280, 720), (1920, 1080)
REFERENCE_DRAWING = DEFAULT_RENDER_OPTIONS
"""Drawing of the commands, where nothing else is asked."""
PARTS = {
    "without a painting": "its texture",
    SOFT: "light at vertices (saved)",
    "edges as they are": "softening edges",
    "multisampled": "softening in place of multisampling (saved)",
    "undeformed": "deforming",
}
"""Case to what the default head has and it has not."""
FRAMES = talking_face(100).values
Draw = Callable[[int], float]
"""Draws so many frames; returns the seconds."""


class AbsentError(Exception):
    """A peer that cannot take part; the message says why."""


class Peer:
    """Stateful: one peer in a process of its own."""

    def __init__(self, python: str, name: str, folder: Path) -> None:
        self.name, self._folder = name, folder
        self._complaints = (folder / f"{name}.log").open("w+b")
        program = [sys.executable, "-m", "bench.browser_peers"] if name in BROWSER_PEERS else [python, str(PEER_FILE)]
        command = [*program, name, str(folder)]
        surroundings = {**os.environ, "PYTHONPATH": "", "XDG_RUNTIME_DIR": str(folder)}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._complaints, env=surroundings
        )
        if self._answer(START_LIMIT_S) != "ready":
            raise AbsentError("answered nonsense")
        self.cpu_s, self.frames = 0.0, 0
        self._look()

    def _look(self) -> None:
        """Refuse a picture without a head: the middle must differ from the corner, in many pixels."""
        picture = np.load(self._folder / f"{self.name}.npy").astype(int)
        share = (np.abs(picture - picture[0, 0]).max(axis=-1) > 12).mean()
        if not 0.3 < share < 0.97:  # a wall that is lighter in the middle counts too
            raise AbsentError(f"drew no head: {100 * share:.0f} % of its picture is not background")

    def draw(self, count: int) -> float:
        """Seconds for ``count`` frames, by the peer's own clock."""
        assert self._process.stdin is not None
        before_s = processors_s(self._process.pid)
        self._process.stdin.write(f"{count}\n".encode())
        self._process.stdin.flush()
        took_s = float(self._answer(ROUND_LIMIT_S))
        self.cpu_s += processors_s(self._process.pid) - before_s
        self.frames += count
        return took_s

    @property
    def cpu_ms(self) -> float:
        """Milliseconds of all cores for a frame, of the peer and of every process that it has started."""
        return 1000 * self.cpu_s / max(self.frames, 1)

    def _answer(self, limit_s: float) -> str:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], limit_s)
        line = self._process.stdout.readline().decode().strip() if ready else ""
        if not line:
            self.close()
            self._complaints.seek(0)
            said = self._complaints.read().decode(errors="replace").strip().splitlines()
            raise AbsentError(f"silent for {limit_s:g} s" if not ready else (said or ["stopped"])[-1])
        return line

    def close(self) -> None:
        """End the process; one that has a browser closes it first."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@dataclass(frozen=True)
class Case:
    """One of ours."""

    mesh: FaceMesh
    drawing: RenderOptions = REFERENCE_DRAWING

    @property
    def is_usual(self) -> bool:
        """Whether its painting, edges and light are those of the default head."""
        return (self.drawing.samples, self.drawing.shading) == (0, "auto") and self.mesh.texture is not None


def cases(head: FaceMesh, coarse: FaceMesh, fine: FaceMesh) -> dict[str, Case]:
    """Ours, by name: the default head, its coarse and its fine level, and what changes one thing about the first."""
    numbers = sorted({channel.fap for channel in head.basis.channels})
    made = {
        REFERENCE: Case(head),
        "undeformed": Case(only_faps(head, set())),
        "26,000 vertices": Case(finer(head, 26_000)),
        "71,000 vertices": Case(finer(fine, 71_000)),
        "720p": Case(head, replace(REFERENCE_DRAWING, size=HD)),
        "without a painting": Case(replace(head, texture=None)),
        SOFT: Case(head, replace(REFERENCE_DRAWING, shading="pixels")),
        STAIRS: Case(head, replace(REFERENCE_DRAWING, samples=1, shading="pixels")),
        FINE: Case(head, replace(REFERENCE_DRAWING, samples=4, shading="pixels")),
        "edges as they are": Case(head, replace(REFERENCE_DRAWING, samples=1)),
        "multisampled": Case(head, replace(REFERENCE_DRAWING, samples=4)),
        f"{len(coarse.vertices_mm):,} vertices": Case(coarse),
    }
    for count in (40_000, 55_000):
        made[f"{count:,} vertices"] = Case(finer(fine, count))
    for count in (4, 12, 24, 36, 48):
        live = set(numbers[:: max(1, round(len(numbers) / count))][:count])
        made[f"{len(live)} FAPs"] = Case(only_faps(head, live))
    for size in ((128, 128), (256, 256), (384, 384), (768, 768), FULL_HD):
        made[f"{size[0]}x{size[1]}"] = Case(head, replace(REFERENCE_DRAWING, size=size))
    return made


def live_faps(mesh: FaceMesh) -> set[int]:
    """FAPs that move a vertex by a channel."""
    basis = mesh.basis
    moving = basis.entry_channels[np.abs(basis.entry_mm).max(axis=1, initial=0.0) > 0]
    return {basis.channels[channel].fap for channel in np.unique(moving)}


def growth(made: dict[str, Case], best_ms: dict[str, float]) -> dict[str, list]:
    """For each quantity: its value and milliseconds, over the cases that differ from the default head in it alone."""
    kinds = ("vertices", "faps", "pixels")
    rows = {
        name: (
            len(case.mesh.vertices_mm),
            len(live_faps(case.mesh)),
            case.drawing.size[0] * case.drawing.size[1],
        )
        for name, case in made.items()
        if case.is_usual
    }
    own = np.array(rows[REFERENCE])
    return {
        kind: sorted(
            (row[axis], best_ms[name]) for name, row in rows.items() if all(np.delete(np.array(row) == own, axis))
        )
        for axis, kind in enumerate(kinds)
    }


def processors_s(root: int) -> float:
    """Processor time, s, that a process and its descendants have taken until now (Linux)."""
    parents: dict[int, int] = {}
    taken: dict[int, float] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has just ended
            values = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(values[1])
            taken[int(folder.name)] = (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")

    def is_below(process: int) -> bool:
        while process in parents and process != root:
            process = parents[process]
        return process == root

    return sum(seconds for process, seconds in taken.items() if is_below(process))


class OurDraw:
    """Stateful: draws with one of our renderers; beside the seconds it keeps what the processors did."""

    def __init__(self, renderer: FaceRenderer | NativeRenderer, film: Path | None = None) -> None:
        self._renderer, self._film = renderer, film
        self.cpu_ms: list[float] = []
        """Milliseconds of all cores together for a frame, of each call."""

    def __call__(self, count: int) -> float:
        """Seconds for ``count`` frames."""
        cpu_s, started = time.process_time(), time.perf_counter()
        pictures = self._renderer.frames(FRAMES[np.arange(count) % len(FRAMES)])
        if self._film is None:
            for _ in pictures:
                pass
        else:
            write_moving(self._film, pictures, rate_hz=30.0)
        took_s = time.perf_counter() - started
        self.cpu_ms.append(1000 * (time.process_time() - cpu_s) / count)
        return took_s


@contextlib.contextmanager
def started_peers(python: str, head: FaceMesh) -> Iterator[tuple[dict[str, Peer], dict[str, str]]]:
    """Those that take part, and why the others do not."""
    peers: dict[str, Peer] = {}
    absent: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder, moved = Path(name), deform(head, FRAMES[:20])
        np.savez(
            folder / "mesh.npz",
            positions=moved.astype("f4"),
            normals=np.stack([vertex_normals(points, head.triangles) for points in moved]).astype("f4"),
            colours=(255 * np.sqrt(head.albedo)).astype("u1"),
            triangles=head.triangles.astype("i4"),
            size=REFERENCE_DRAWING.size,
        )
        for peer in PEERS + BROWSER_PEERS:
            try:
                peers[peer] = Peer(python, peer, folder)
                stack.callback(peers[peer].close)
            except (AbsentError, OSError, ValueError) as error:
                absent[peer] = str(error)
        yield peers, absent


def interleaved(contenders: dict[str, Draw], rounds: int) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Milliseconds a frame, and how many times the reference's around it, by name and round.

    A contender that falls silent is left out of the rounds that follow.
    """
    counts = {name: max(3, round(SLICE_S / (draw(3) / 3))) for name, draw in contenders.items()}
    times: dict[str, list[float]] = {name: [] for name in contenders}
    ratios: dict[str, list[float]] = {name: [] for name in contenders}

    def measured(name: str) -> float:
        times[name].append(1000 * contenders[name](counts[name]) / counts[name])
        return times[name][-1]

    for number in range(rounds):
        before = measured(REFERENCE)
        for name in contenders:
            if name == REFERENCE:
                continue
            taken = measured(name)
            after = measured(REFERENCE)
            ratios[name].append(2 * taken / (before + after))
            before = after
        print(f"\rround {number + 1} of {rounds}", end="", file=sys.stderr, flush=True)
    print("", file=sys.stderr)
    return times, ratios


def spread(ratios: list[float]) -> dict[str, float]:
    """Median and quarters."""
    low, middle, high = np.percentile(ratios, (25, 50, 75))
    return {"ratio": float(middle), "low": float(low), "high": float(high)}


def measure(python: str, rounds: int) -> dict[str, object]:
    head, load = build_head(), os.getloadavg()[0]
    with contextlib.ExitStack() as stack:
        context = stack.enter_context(create_context())
        machine: dict[str, Any] = {
            "renderer": context.info["GL_RENDERER"],
            "driver": context.info["GL_VERSION"],
            "cores": len(os.sched_getaffinity(0)),
            "python": platform.python_version(),
            "load": [load],
        }
        made = cases(head, build_head(level="coarse"), build_head(level="fine"))
        ours = {
            name: OurDraw(stack.enter_context(FaceRenderer(case.mesh, case.drawing))) for name, case in made.items()
        }
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ours[NATIVE] = OurDraw(stack.enter_context(NativeRenderer(head, REFERENCE_DRAWING)))
        ours[FILM] = OurDraw(stack.enter_context(FaceRenderer(head)), folder / "film.mp4")
        theirs, absent = stack.enter_context(started_peers(python, head))
        contenders: dict[str, Draw] = {**ours, **{name: peer.draw for name, peer in theirs.items()}}
        times, ratios = interleaved(contenders, rounds)
    machine["load"].append(os.getloadavg()[0])
    best_ms = {name: min(times[name]) for name in ours}
    cpu_ms = {name: float(np.median(draw.cpu_ms)) for name, draw in ours.items()}
    cpu_ms |= {name: peer.cpu_ms for name, peer in theirs.items()}
    inverse = {name: spread([1 / ratio for ratio in ratios[name]]) for name in PARTS}
    return {
        "machine": machine,
        "vertices": len(head.vertices_mm),
        "triangles": len(head.triangles),
        "best_ms": best_ms,
        "cpu_ms": cpu_ms,
        "ours": {name: spread(ratios[name]) for name in (NATIVE, FILM, STAIRS, SOFT, FINE)},
        "growth": growth(made, best_ms),
        "deforming": inverse["undeformed"]["ratio"],
        "parts": {PARTS[name]: found for name, found in inverse.items()},
        "peers": {
            name: {
                "best_ms": min(times[name]),
                **spread(ratios[name]),
                "alike": cpu_ms[name] / cpu_ms[SAME_QUALITY[name]],
            }
            for name in theirs
        },
        "absent": absent,
        "rounds": rounds,
    }


def print_result(result: dict) -> None:
    machine, best = result["machine"], result["best_ms"]
    print(
        f"{machine['renderer']}, {machine['driver']}, {machine['cores']} cores; {result['rounds']} rounds,"
        f" load {machine['load'][0]:.1f} before and {machine['load'][1]:.1f} after"
    )
    for name, goal in GOALS_FPS.items():
        fps = 1000 / best[name]
        judged = f"(goal {goal}: {'met' if fps >= goal else 'MISSED'})"
        print(f"{name:>20} {best[name]:7.1f} ms {fps:5.0f} fps {judged}, {result['cpu_ms'][name]:.1f} ms of processors")
    for name, found in result["ours"].items():
        cpu_ms = result["cpu_ms"][name]
        print(f"{name:>30} {best[name]:7.1f} ms, {found['ratio']:.2f} times, {cpu_ms:.1f} ms of processors")
    print(f"{'deforming':>20} {result['deforming']:7.2f} times undeformed (goal: at most {MAX_DEFORMING})")
    for what, found in result["parts"].items():
        print(f"{what:>44} {100 * (found['ratio'] - 1):+5.0f} % ({_percents(found)})")
    for name, peer in result["peers"].items():
        goal = MIN_PEER_RATIOS.get(name, MIN_PEER_RATIO)
        judged = f" (goal {goal:g}: {'met' if peer['alike'] >= goal else 'MISSED'})" if goal else ""
        quarters = f"{peer['low']:.1f}..{peer['high']:.1f}"
        print(
            f"{name:>20} {peer['best_ms']:7.1f} ms, {result['cpu_ms'][name]:.1f} ms of processors, {peer['ratio']:.1f}"
            f" times ours ({quarters}), {peer['alike']:.1f} times our processors at the same quality{judged}"
        )
    for name, why in result["absent"].items():
        print(f"{name:>20} absent: {why}")


def _percents(found: dict[str, float]) -> str:
    return f"{100 * (found['low'] - 1):+.0f}..{100 * (found['high'] - 1):+.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", default=sys.executable, metavar="PYTHON")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", action="store_true")
    wanted = parser.parse_args()
    result = measure(wanted.peers, wanted.rounds)
    print_result(result)
    if wanted.json:
        wanted.json.write_text(json.dumps(result, indent=2))
    if wanted.page:
        write_page(result)
    if result["deforming"] > MAX_DEFORMING:
        sys.exit("deforming costs too much")


if __name__ == "__main__":
    main()
