"""Measure what open mouths look like between the lips in films of people, for the test of ours.

    python -m design.mouth_patterns FILM... [-o tests/vectors/speech/mouth.npz]

FILM are recordings of a speaking face, such as the GRID corpus' (360 x 288 pixels). Lips are found by MediaPipe's face
mesh, in its own environment (``make detector``), in each frame on its own. In every frame whose lips are 5 pixels apart
and more, the middle half between their corners is sampled from lip to lip: 12 rows, 9 columns of grey levels. Written
are statistics of all of them: mean, standard deviations, the first three principal components, three percentiles.
"""

import argparse
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = ROOT / "tests" / "vectors" / "speech" / "mouth.npz"
DETECTOR = ROOT / ".venv" / "detector" / "bin" / "python", ROOT / "tests" / "detector" / "landmarks.py"
UPPER = (78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308)
LOWER = (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308)
"""Landmarks of the inner lips, from corner to corner; those in the middle of each."""
MIDDLE = 5
ROWS, COLUMNS = 12, 9
OPEN_PIXELS = 5.0
GREY = np.array([0.299, 0.587, 0.114])
COMPONENTS, PERCENTILES = 3, (10, 50, 90)


def patterns(frames: NDArray[np.uint8], landmarks: Array) -> Array:
    """(N, 12, 9): grey levels between the lips of each frame, (T, H, W, 3), that shows an open mouth."""
    found = []
    for frame, points in zip(frames, landmarks[..., :2], strict=True):
        upper, lower = points[list(UPPER)], points[list(LOWER)]
        if not lower[MIDDLE, 1] - upper[MIDDLE, 1] > OPEN_PIXELS:
            continue
        x = np.linspace(*(0.75 * upper[a, 0] + 0.25 * upper[b, 0] for a, b in ((0, -1), (-1, 0))), COLUMNS)
        top, bottom = np.interp(x, *upper.T), np.interp(x, *lower.T)
        y = top + (np.arange(ROWS) + 0.5)[:, None] / ROWS * (bottom - top)
        found.append(map_coordinates(frame @ GREY, [y, np.broadcast_to(x, y.shape)], order=1))
    return np.array(found).reshape(-1, ROWS, COLUMNS)


def landmarks_of(frames: NDArray[np.uint8]) -> Array:
    """(T, 478, 3) pixels."""
    with TemporaryDirectory() as folder:
        pictures, points = Path(folder) / "pictures.npy", Path(folder) / "points.npy"
        np.save(pictures, frames)
        subprocess.run([*DETECTOR, pictures, points], check=True, capture_output=True)
        return np.asarray(np.load(points))


def statistics(found: Array) -> dict[str, NDArray[np.generic]]:
    """Statistics of patterns, (N, 12, 9), as they are written."""
    flat = found.reshape(len(found), -1)
    _, size, components = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    return {
        "count": np.array(len(found)),
        "mean": found.mean(axis=0).astype(np.float32),
        "components": components[:COMPONENTS].reshape(-1, ROWS, COLUMNS).astype(np.float32),
        "spread": (size[:COMPONENTS] / np.sqrt(len(found))).astype(np.float32),
        "share": (size[:COMPONENTS] ** 2 / (size**2).sum()).astype(np.float32),
        "percentiles": np.percentile(found, PERCENTILES).astype(np.float32),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("films", metavar="FILM", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    found = []
    for film in options.films:
        with av.open(str(film)) as container:
            frames = np.array([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])
        found.append(patterns(frames, landmarks_of(frames)))
    measured = statistics(np.concatenate(found))
    np.savez_compressed(options.output, **measured)
    for name in ("count", "share", "percentiles"):
        print(name, np.round(measured[name], 2))


if __name__ == "__main__":
    main()
