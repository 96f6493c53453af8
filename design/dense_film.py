"""Draws the film of papers 003 and 004: a dense face that few markers drive. ``python -m design.dense_film [folder]``.

The face is one of our own, cut out: twelve held postures are its scans, and a take of 45 markers, of a head that
turns in a room, drives it.
"""

import sys
from pathlib import Path

import numpy as np

from fapengine.cli.main import app
from fapengine.files.pictures import load_picture, save_png
from fapengine.files.recordings import load_markers, save_markers
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.style import PEOPLE
from tests.unit.laboratory.dense_made import make_face

SIDE, FRAMES = 300, (0, 7, 16, 24, 33)
DOT, PAPER = (40, 70, 120), 247


def main(folder: Path) -> None:
    """Write ``dense-film.png`` into a folder, and what it is made of beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    made = make_face(build_head(PEOPLE["man"]))
    profile, take = folder / "dense-face", folder / "take.npz"
    if not profile.exists():
        made.write(profile)
    save_markers(take, made.take(0.8, gaps=False, seed=3)[0])
    words = ["render", str(take), "--head", str(profile), "--no-head-motion", "-o", str(folder / "frame_%04d.png")]
    app([*words, "--size", f"{SIDE}x{SIDE}"], standalone_mode=False)
    markers = load_markers(take).markers
    driven = made.dense.driver().follow(markers)
    places = driven.markers_mm
    columns = []
    for frame in FRAMES:
        dots = np.full((SIDE, SIDE, 3), PAPER, np.uint8)
        for x, y in places[frame][:, :2]:
            column, row = round(SIDE / 2 + 1.35 * x), round(SIDE / 2 - 1.35 * (y + 5))
            dots[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3] = DOT
        face = load_picture(sorted(folder.glob("frame_*.png"))[frame])[..., :3]
        columns.append(np.concatenate([dots, face]))
    save_png(folder / "dense-film.png", np.ascontiguousarray(np.concatenate(columns, axis=1)))
    print(f"{len(made.labels)} markers, {len(made.used)} vertices")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/dense_film"))
