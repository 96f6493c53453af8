"""Cost of a fit: processor time and memory of ``fapengine fit`` for sessions of growing size.

    python -m bench.fit [--all] [--json FILE]

Sessions are made here: the shipped profile speaks random phones on our own head, and markers beyond its feature points
follow them by random weights, with 0.1 mm of noise. Each fit is a process of its own; its processor time and greatest
memory are what the system counted. ``--all`` adds the large ones: 520 takes of 229 markers, and mesh sequences of 2,000
and 5,023 vertices. Goals: four times the frames in at most four times the time, 520 takes of 229 markers in 600 MB, a
sequence of 5,023 vertices in 2 GB.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from fapengine.files.heads.built import load_built
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.targets import weights_of

RATE_HZ = 25.0
SIZES = ((40, 75, 57), (40, 300, 57), (40, 75, 229), (40, 300, 229))
"""Takes, frames a take, markers."""
LARGE = ((520, 75, 229), (15, 40, 2000), (15, 40, 5023))


def make_session(folder: Path, takes: int, frames: int, markers: int) -> None:
    """Write a session: NPZ recordings with phones beside them."""
    rng = np.random.default_rng(takes + markers)
    profile, head = load_profile("grid_s1_en"), load_built(HeadStyle())
    points = profile.space.points
    neutral = np.stack([np.asarray(head.point_mm(name), np.float64) for name in points])
    extra = rng.uniform(neutral.min(axis=0), neutral.max(axis=0), (markers - len(points), 3))
    away = np.linalg.norm(extra[:, None] - neutral, axis=-1)
    weights = np.exp(-((away / 20) ** 2)) * rng.uniform(0.5, 1.0, away.shape)
    names = (*points, *(f"m{n}" for n in range(len(extra))))
    spoken = [name for name, target in profile.phones.items() if len(target.targets) == 1]
    folder.mkdir(parents=True)
    for index in range(takes):
        edges = np.linspace(0.2, frames / RATE_HZ - 0.2, max(3, frames // 3))
        phones = [Phone(str(rng.choice(spoken)), a, b) for a, b in pairwise(edges)]
        track = PhoneTrack.from_phones(
            [Phone("_", 0.0, 0.2), *phones, Phone("_", edges[-1], frames / RATE_HZ)], tolerance_s=1e-6
        )
        moved = profile.space.to_points_mm(weights_of(track, profile, np.arange(frames) / RATE_HZ, context=False))
        moved = np.concatenate([moved, np.einsum("mp,tpa->tma", weights, moved)], axis=1)
        places = np.concatenate([neutral, extra]) + moved + rng.normal(0, 0.1, moved.shape)
        np.savez(folder / f"t{index:03d}.npz", positions_mm=places, labels=np.array(names), rate_hz=RATE_HZ)
        lines = (f"{phone.start_s:.4f} {phone.end_s:.4f} {phone.label}" for phone in track.phones)
        (folder / f"t{index:03d}.lab").write_text("\n".join(lines) + "\n")


def measure(takes: int, frames: int, markers: int) -> dict[str, float]:
    """CPU seconds and greatest memory of one fit."""
    with tempfile.TemporaryDirectory() as place:
        make_session(Path(place) / "session", takes, frames, markers)
        command = [sys.executable, "-m", "fapengine", "fit", f"{place}/session", "-o", f"{place}/profile"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"fit of {takes} x {frames} x {markers} ended with {status}")
    size = takes * frames * markers * 24 / 1e6
    return {"takes": takes, "frames": frames, "markers": markers, "data_mb": size,
            "cpu_s": used.ru_utime + used.ru_stime, "memory_mb": used.ru_maxrss / 1024}  # fmt: skip


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    print(f"{'takes':>6} {'frames':>7} {'markers':>8} {'data, MB':>9} {'CPU, s':>7} {'memory, MB':>11}")
    rows = []
    for size in (*SIZES, *(LARGE if asked.all else ())):
        row = measure(*size)
        rows.append(row)
        print("{takes:6.0f} {frames:7.0f} {markers:8.0f} {data_mb:9.0f} {cpu_s:7.1f} {memory_mb:11.0f}".format(**row))
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=2))
    failed = [f"4 x the frames take {b['cpu_s'] / a['cpu_s']:.1f} x the time, goal 4"
              for a, b in (rows[:2], rows[2:4]) if b["cpu_s"] > 4 * a["cpu_s"]]  # fmt: skip
    for row, goal_mb in zip(rows[4:], (600, 2048, 2048), strict=False):
        if row["memory_mb"] > goal_mb:
            failed.append(f"{row['takes']} x {row['markers']}: {row['memory_mb']:.0f} MB, goal {goal_mb}")
    print("\n".join(failed) or "all goals met")
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main())
