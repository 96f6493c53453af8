"""The renderer in C against OpenGL: thirty images, and processor time per frame.

    python -m bench.native [--images] [--speed] [--rounds N] [--json FILE]

``--images`` draws the images of tests/native/images.py with both and shows how far they differ. ``--speed`` draws a
default head, ``woman`` and an imported head with moving FAPs at 512 x 512, antialiased, with both and every set of
instructions that this processor has; the cases take turns in one process. Milliseconds are processor time of the least
busy round, ratios medians over the rounds. Without either option it does both.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fapengine.files.heads.load import load_head_for_calls
from fapengine.mpeg4 import fap
from fapengine.render.drawing import RenderOptions
from fapengine.render.native import NativeRenderer
from fapengine.render.renderer import FaceRenderer
from tests.native import built
from tests.native.images import ALIKE, MIN_ALIKE, alike, faps_of, head_of, images, imported_head

FRAMES = 12
"""In a round of one case."""
MAX_RATIO = {"x86-64-v4": 0.38, "x86-64-v3": 0.5}
"""Of processor time to OpenGL's in software, by instructions."""


def compare_images() -> list[dict[str, Any]]:
    rows = []
    print(f"{'pixels within ' + str(ALIKE) + '/255':>24} {'mean':>6} {'most':>5}  image")
    for image in images():
        head = head_of(image.head, max(image.size))
        with FaceRenderer(head, image.drawing) as gl, NativeRenderer(head, image.drawing) as native:
            pictures = [renderer.draw(faps_of(image.pose)) for renderer in (gl, native)]
        change = np.abs(pictures[0].astype(int) - pictures[1])
        share = alike(pictures[0], pictures[1])
        rows.append({"image": image.name, "alike": share, "mean": change.mean(), "most": int(change.max())})
        print(f"{share:24.4%} {change.mean():6.3f} {change.max():5}  {image.name}", flush=True)
    print(f"least {min(row['alike'] for row in rows):.4%} of {len(rows)}, asked {MIN_ALIKE:.1%}")
    return rows


def moving(count: int) -> np.ndarray:
    """(count, 68): FAPs that all move."""
    size = np.random.default_rng(1).uniform(-100, 100, fap.FAP_COUNT)
    size[:2] = 0
    return size * np.sin(np.arange(count)[:, None] / 7 + np.arange(fap.FAP_COUNT))


def time_frames(rounds: int) -> list[dict[str, Any]]:
    rows = []
    library = built.imported()
    drawing = RenderOptions(size=(512, 512))
    for name in ("default", "woman", "imported"):
        head = imported_head() if name == "imported" else load_head_for_calls(name, drawing.size)
        cases: dict[str, FaceRenderer | NativeRenderer] = {"OpenGL": FaceRenderer(head, drawing)}
        for instructions in ("x86-64-v4", "x86-64-v3", "x86-64"):
            try:
                library.select(instructions)
            except ValueError:
                continue
            cases[instructions] = NativeRenderer(head, drawing)
        library.select()
        faps = moving(FRAMES)
        spent_s: dict[str, list[float]] = {case: [] for case in cases}
        for renderer in cases.values():
            renderer.draw(faps[0])
        for _ in range(rounds):
            for case, renderer in cases.items():
                spent_s[case].append(_cpu_s(renderer.draw, faps))
        for case, renderer in cases.items():
            ratio = float(np.median(np.divide(spent_s[case], spent_s["OpenGL"])))
            least_ms = 1e3 * min(spent_s[case])
            rows.append({"head": name, "case": case, "ms": least_ms, "ratio": ratio})
            asked = f", asked {MAX_RATIO[case]}" if case in MAX_RATIO else ""
            print(f"{name:10} {case:10} {least_ms:7.2f} ms  {ratio:.3f} of OpenGL{asked}", flush=True)
            renderer.release()
    return rows


def _cpu_s(draw: Callable[[Any], object], faps: np.ndarray) -> float:
    started_s = time.process_time()
    for row in faps:
        draw(row)
    return (time.process_time() - started_s) / len(faps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", action="store_true")
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    os.environ.setdefault("LP_NUM_THREADS", "0")
    built.imported()
    both = not options.images and not options.speed
    found: dict[str, Any] = {}
    if options.images or both:
        found["images"] = compare_images()
    if options.speed or both:
        found["speed"] = time_frames(options.rounds)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))
    if any(row["alike"] < MIN_ALIKE for row in found.get("images", [])):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
