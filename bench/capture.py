"""Reading C3D against ezc3d, in the same run: time and peak memory of a recording with analog channels.

    python -m bench.capture [--minutes 5]

The file: 200 points and 32 analog channels at ten times their rate, 120 Hz, floats. Each reader runs in a process of
its own; memory is the growth of its largest resident size while it reads.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import ezc3d
import numpy as np

POINTS, ANALOGS, PER_FRAME, RATE_HZ = 200, 32, 10, 120
GOAL = 2.0
"""Times faster, and times less memory: ezc3d holds every analog sample as a double."""

READ = """
import json, re, sys, time
import numpy as np, ezc3d
from pathlib import Path
from fapengine.files.recordings import load_markers
peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
idle = peak()
best = float("inf")
for _ in range(3):
    start = time.perf_counter()
    if sys.argv[2] == "ours":
        points = load_markers(Path(sys.argv[1])).markers.positions_mm
    elif sys.argv[2] == "ezc3d":
        points = ezc3d.c3d(sys.argv[1])["data"]["points"]
    else:
        points = np.zeros(1)
    best = min(best, time.perf_counter() - start)
print(json.dumps({"s": best, "MiB": (peak() - idle) / 1024}))
"""


def write(path: Path, minutes: float) -> int:
    frames = round(60 * minutes * RATE_HZ)
    rng = np.random.default_rng(0)
    c3d = ezc3d.c3d()
    point, analog = c3d["parameters"]["POINT"], c3d["parameters"]["ANALOG"]
    point["RATE"]["value"], analog["RATE"]["value"] = [RATE_HZ], [RATE_HZ * PER_FRAME]
    point["LABELS"]["value"] = [f"m{n}" for n in range(POINTS)]
    point["UNITS"]["value"] = ["mm"]
    analog["LABELS"]["value"] = [f"a{n}" for n in range(ANALOGS)]
    points = np.ones((4, POINTS, frames))
    points[:3] = np.cumsum(rng.normal(0, 0.3, (3, POINTS, frames)), axis=2) + rng.normal(0, 60, (3, POINTS, 1))
    c3d["data"]["points"] = points
    c3d["data"]["analogs"] = rng.normal(0, 1, (1, ANALOGS, frames * PER_FRAME))
    c3d.write(str(path))
    return frames


def measure(path: Path, reader: str) -> dict[str, float]:
    done = subprocess.run([sys.executable, "-c", READ, str(path), reader], capture_output=True, check=True, text=True)
    return json.loads(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--minutes", type=float, default=2.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.c3d"
        frames = write(path, options.minutes)
        ours, theirs = measure(path, "ours"), measure(path, "ezc3d")
        size = path.stat().st_size / 2**20
    faster, leaner = theirs["s"] / ours["s"], theirs["MiB"] / ours["MiB"]
    print(f"{frames} frames of {POINTS} points and {ANALOGS} channels, {size:.0f} MiB")
    print(f"ours {ours['s']:.2f} s, {ours['MiB']:.0f} MiB; ezc3d {theirs['s']:.2f} s, {theirs['MiB']:.0f} MiB")
    print(f"{faster:.1f} x faster, {leaner:.1f} x less memory (goal {GOAL:g} x each)")
    return int(faster < GOAL or leaner < GOAL)


if __name__ == "__main__":
    sys.exit(main())
