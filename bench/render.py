"""The renderer's speed: its parts, its growth, and other renderers on the same mesh, all in one interleaved run.

    python -m bench.render [--peers PYTHON] [--rounds N] [--json FILE] [--page]

Frames are drawn as they are for a video: all FAPs live, full shading, softened edges, read back into an array. Every
case and every peer draws in each round, so that all see the same machine. Frames a second are of a case's best round;
ratios are medians over the rounds. PYTHON is an interpreter with the group ``peers`` of pyproject.toml (by default this
one); a peer that does not install or start is reported as absent. ``--page`` writes docs/render.md and its plot.
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
from pathlib import Path
from typing import Any

import numpy as np

from bench.finer import finer, only_faps
from bench.talking import talking_face
from fapengine.mesh.deform import deform
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.head import build_head
from fapengine.mesh.patch import vertex_normals
from fapengine.render.context import create_context
from fapengine.render.renderer import FaceRenderer

PEERS = ("PyVista", "PyVista, bare", "pygfx", "pygfx, as it comes", "pygfx, bare", "vispy, bare", "pyrender")
PEER_FILE = Path(__file__).with_name("render_peers.py")
BROWSER_PEERS = ("three.js", "three.js, bare", "three.js, morphs", "our page")
"""In headless Chromium: :mod:`bench.browser_peers`, run by this interpreter."""
START_LIMIT_S, ROUND_LIMIT_S, END_LIMIT_S = 90.0, 60.0, 5.0
SLICE_S = 0.15
"""How long a contender draws in a round."""
SQUARE, HD, FULL_HD = (512, 512), (1280, 720), (1920, 1080)
GOALS_FPS = {"default head": 60, "26,000 vertices": 40, "71,000 vertices": 20, "720p": 30}
DEFORMING_CEILING, PEER_GOAL = 1.3, 6.0
OTHER_GOALS = {"three.js": 2.0, "three.js, bare": None, "three.js, morphs": None, "our page": None}
"""Peer to how many times as long it shall take, where that is not :data:`PEER_GOAL`; None: just to know."""
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
        self._look()

    def _look(self) -> None:
        """Refuse a picture without a head: the middle must differ from the corner, in many pixels."""
        picture = np.load(self._folder / f"{self.name}.npy").astype(int)
        share = (np.abs(picture - picture[0, 0]).max(axis=-1) > 12).mean()
        if not 0.3 < share < 0.9:
            raise AbsentError(f"drew no head: {100 * share:.0f} % of its picture is not background")

    def draw(self, count: int) -> float:
        """Seconds for ``count`` frames, by the peer's own clock."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{count}\n".encode())
        self._process.stdin.flush()
        return float(self._answer(ROUND_LIMIT_S))

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


def cases(head: FaceMesh) -> dict[str, tuple[FaceMesh, tuple[int, int]]]:
    """Ours, by name: which mesh at which size."""
    numbers = sorted({channel.fap for channel in head.basis.channels})
    made = {
        "default head": (head, SQUARE),
        "undeformed": (only_faps(head, set()), SQUARE),
        "26,000 vertices": (finer(head, 26_000), SQUARE),
        "71,000 vertices": (finer(head, 71_000), SQUARE),
        "720p": (head, HD),
    }
    for count in (18_000, 40_000, 55_000):
        made[f"{count:,} vertices"] = (finer(head, count), SQUARE)
    for count in (4, 12, 24, 36, 48):
        live = set(numbers[:: max(1, round(len(numbers) / count))][:count])
        made[f"{len(live)} FAPs"] = (only_faps(head, live), SQUARE)
    for size in ((128, 128), (256, 256), (384, 384), (768, 768), FULL_HD):
        made[f"{size[0]}x{size[1]}"] = (head, size)
    return made


def growth(made: dict[str, tuple[FaceMesh, tuple[int, int]]], best_ms: dict[str, float]) -> dict[str, list]:
    """For each quantity: its value and milliseconds, over the cases that differ from the default head in it alone."""
    kinds = ("vertices", "faps", "pixels")
    rows = {
        name: (
            len(mesh.vertices_mm),
            len({mesh.basis.channels[channel].fap for channel in np.unique(mesh.basis.entry_channels)}),
            size[0] * size[1],
        )
        for name, (mesh, size) in made.items()
    }
    own = np.array(rows["default head"])
    return {
        kind: sorted(
            (row[axis], best_ms[name]) for name, row in rows.items() if all(np.delete(np.array(row) == own, axis))
        )
        for axis, kind in enumerate(kinds)
    }


def our_draw(renderer: FaceRenderer) -> Draw:
    def draw(count: int) -> float:
        started = time.perf_counter()
        for _ in renderer.frames(FRAMES[np.arange(count) % len(FRAMES)]):
            pass
        return time.perf_counter() - started

    return draw


@contextlib.contextmanager
def started_peers(python: str, head: FaceMesh) -> Iterator[tuple[dict[str, Draw], dict[str, str]]]:
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
            size=SQUARE,
        )
        for peer in PEERS + BROWSER_PEERS:
            try:
                peers[peer] = Peer(python, peer, folder)
                stack.callback(peers[peer].close)
            except (AbsentError, OSError, ValueError) as error:
                absent[peer] = str(error)
        yield {name: peer.draw for name, peer in peers.items()}, absent


def interleaved(contenders: dict[str, Draw], rounds: int) -> dict[str, list[float]]:
    """Milliseconds a frame, by name and round."""
    counts = {name: max(3, round(SLICE_S / (draw(3) / 3))) for name, draw in contenders.items()}
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, draw in contenders.items():
            times[name].append(1000 * draw(counts[name]) / counts[name])
    return times


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
        made = cases(head)
        ours = {
            name: our_draw(stack.enter_context(FaceRenderer(mesh, size=size))) for name, (mesh, size) in made.items()
        }
        theirs, absent = stack.enter_context(started_peers(python, head))
        times = interleaved({**ours, **theirs}, rounds)
    machine["load"].append(os.getloadavg()[0])
    reference = np.array(times["default head"])
    best_ms = {name: min(times[name]) for name in ours}
    return {
        "machine": machine,
        "vertices": len(head.vertices_mm),
        "triangles": len(head.triangles),
        "best_ms": best_ms,
        "growth": growth(made, best_ms),
        "deforming": float(np.median(reference / np.array(times["undeformed"]))),
        "peers": {
            name: {"best_ms": min(times[name]), "ratio": float(np.median(np.array(times[name]) / reference))}
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
        print(f"{name:>20} {best[name]:7.1f} ms {fps:5.0f} fps (goal {goal}: {'met' if fps >= goal else 'MISSED'})")
    print(f"{'deforming':>20} {result['deforming']:7.2f} times undeformed (goal: at most {DEFORMING_CEILING})")
    for name, peer in result["peers"].items():
        goal = OTHER_GOALS.get(name, PEER_GOAL)
        judged = f" (goal {goal:g}: {'met' if peer['ratio'] >= goal else 'MISSED'})" if goal else ""
        print(f"{name:>20} {peer['best_ms']:7.1f} ms, {peer['ratio']:.1f} times ours{judged}")
    for name, why in result["absent"].items():
        print(f"{name:>20} absent: {why}")


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
        from bench.render_page import write_page

        write_page(result)
    if result["deforming"] > DEFORMING_CEILING:
        sys.exit("deforming costs too much")


if __name__ == "__main__":
    main()
