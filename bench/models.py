"""The laboratory's speed and accuracy against named peers, in the same run, on motion made from fixed seeds.

    python -m bench.models [--frames 39000] [--json FILE]

Seconds are process time, best of a few rounds (one where a peer takes long). The peers: scikit-learn's IterativeImputer
(BayesianRidge, 20 nearest columns, 3 rounds), ppca, SciPy's pivoted QR and, in a loop, Rotation.align_vectors,
trimesh's nricp_amberg with the same landmarks, and via points inserted one at a time.
"""

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from ppca import PPCA
from scipy.linalg import qr
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation
from sklearn.experimental import enable_iterative_imputer  # noqa: F401
from sklearn.impute import IterativeImputer

from fapengine.geometry.rigid import RigidMotion, fit_rigid
from fapengine.geometry.surface import Surface
from fapengine.models.missing import GapModel, fit_gaps
from fapengine.models.scans import fit_scan
from fapengine.models.subset import factorise_gram, gram
from fapengine.models.via_points import ViaPoints, extract_via_points

Row = dict[str, float | str]


def timed(call: Callable[[], object], rounds: int = 3) -> tuple[float, object]:
    """Least process time in s, and the last result."""
    best, result = np.inf, None
    for _ in range(rounds):
        start = time.process_time()
        result = call()
        best = min(best, time.process_time() - start)
    return best, result


def motion(frames: int, markers: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Sixty modes, each 0.85 of the one before, 120 Hz, 4.6 mm, 0.15 mm noise; and the jaw, the first of them."""
    rng = np.random.default_rng(seed)
    low_pass = butter(4, 5, fs=120, output="sos")
    z = sosfiltfilt(low_pass, rng.normal(0, 1, (frames + 200, 60)), axis=0)[100:-100]
    z /= z.std(axis=0)
    moved = ((z * 0.85 ** np.arange(60)) @ rng.normal(0, 1, (60, 3 * markers))).reshape(frames, markers, 3)
    moved *= 4.6 / np.sqrt((moved**2).sum(axis=-1).mean())
    return moved + rng.normal(0, 0.15, moved.shape), z[:, 0]


def gaps(frames: int) -> list[Row]:
    """Markers that hide because of the jaw: 77 % always seen, 17 % in 70 to 95 %, 6 % in 10 to 49 % of frames."""
    truth, jaw = motion(frames, 209)
    rng = np.random.default_rng(1)
    hidden = rng.permutation(209)[:49]
    rates = np.concatenate([rng.uniform(0.1, 0.49, 13), rng.uniform(0.7, 0.95, 36)])
    seen = np.ones((frames, 209), bool)
    for marker, rate in zip(hidden, rates, strict=True):
        drive = 0.6 * jaw + 0.8 * np.repeat(rng.normal(0, 1, frames // 10 + 1), 10)[:frames]
        seen[:, marker] = drive > np.quantile(drive, 1 - rate)
    holed = np.where(seen[..., None], truth, np.nan)
    ours_s, ours = timed(lambda: fit_gaps(holed, seen, 28, max_steps=0).fill(holed, seen), rounds=2)

    def peer() -> np.ndarray:
        imputer = IterativeImputer(n_nearest_features=20, max_iter=3, random_state=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # three rounds do not converge
            return imputer.fit_transform(holed.reshape(frames, -1)).reshape(truth.shape)

    peer_s, theirs = timed(peer, rounds=1)

    def rms(filled: object) -> float:
        return float(np.sqrt(((np.asarray(filled) - truth)[~seen] ** 2).sum(-1).mean()))

    def package() -> np.ndarray:
        """Probabilistic PCA of seven modes, as the package gives it: standardised, its rows refilled."""
        np.random.seed(0)  # noqa: NPY002  # the package draws from the global generator
        model = PPCA()
        model.fit(holed.reshape(frames, -1).copy(), d=7, tol=1e-4)
        return (model.data * model.stds + model.means).reshape(truth.shape)

    package_s, packaged = timed(package, rounds=1)
    return [
        row("gaps filled, rank 28", "IterativeImputer", ours_s, peer_s, rms(ours), rms(theirs), 10.0),
        row(
            "gaps filled, rank 28", "ppca, 7 modes", ours_s, package_s, rms(ours), rms(packaged), 3.0
        ),  # it stops early, far off
    ]


def selection(frames: int) -> Row:
    """Pivots of 57 markers."""
    data, _ = motion(frames, 57)
    tall = np.swapaxes(data, 1, 2).reshape(-1, 57)
    ours_s, ours = timed(lambda: factorise_gram(gram(data)), rounds=5)
    peer_s, theirs = timed(lambda: qr(tall, mode="r", pivoting=True), rounds=2)
    same = float((ours.order == theirs[1]).mean())  # type: ignore[attr-defined,index]
    return row("marker selection", "scipy.linalg.qr", ours_s, peer_s, 1 - same, 0.0, 10.0)


def head(frames: int) -> Row:
    """Head motion from a band of five markers with 0.25 mm noise; error of the turn in degrees."""
    rng = np.random.default_rng(2)
    band = np.array([[70.0, 20, 0], [40, 24, 55], [0, 28, 75], [-42, 23, 54], [-70, 19, 2]])
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (frames, 3)))
    moved = band @ np.swapaxes(turns.as_matrix(), 1, 2) + rng.normal(0, 0.25, (frames, 5, 3))
    some = frames // 20
    ours_s, ours = timed(lambda: fit_rigid(band, moved), rounds=5)
    centred = band - band.mean(axis=0)

    def peer() -> list[Rotation]:
        return [Rotation.align_vectors(frame - frame.mean(axis=0), centred)[0] for frame in moved[:some]]

    peer_s, theirs = timed(peer, rounds=1)

    def off(found: Rotation) -> float:
        return float(np.degrees((found * turns[: len(found)].inv()).magnitude()).mean())

    ours_off = off(Rotation.from_matrix(ours.rotation[:some]))  # type: ignore[attr-defined]
    result = row("head motion", "align_vectors", ours_s, 20 * peer_s, ours_off, off(Rotation.concatenate(theirs)), 10.0)  # type: ignore[arg-type]
    result["us_per_frame"] = round(1e6 * ours_s / frames, 2)
    return result


def scan() -> Row:
    """Lay a sparse model onto a noisy scan, with eight landmarks; error of its points in mm."""
    rng = np.random.default_rng(3)
    turn, y = np.meshgrid(np.linspace(-1.4, 1.4, 100), np.linspace(-90, 90, 130))
    radius = 70 + 25 * np.exp(-((turn / 0.25) ** 2) - ((y / 30) ** 2))
    vertices = np.stack([radius * np.sin(turn), y, radius * np.cos(turn)], axis=-1).reshape(-1, 3)
    at = np.arange(13000).reshape(130, 100)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    centres = rng.uniform([-60, -80, 30], [60, 80, 90], (7, 3))
    fall = np.exp(-((vertices - centres[:, None]) ** 2).sum(-1) / 900)
    modes = fall[..., None] * rng.normal(0, 3, (7, 1, 3))
    rows = at[4:-4:9, 4:-4:7]
    sparse = rows.ravel()
    grid = np.arange(sparse.size).reshape(rows.shape)
    facet = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1).reshape(-1, 4)
    coarse = np.concatenate([facet[:, [0, 1, 2]], facet[:, [0, 2, 3]]])
    model = GapModel(vertices[sparse], modes[:, sparse], 0.1)
    pose = RigidMotion(Rotation.from_rotvec([0.1, -0.15, 0.08]).as_matrix(), np.array([5.0, -8.0, 6.0]))
    face = pose.apply(vertices + np.tensordot(rng.normal(0, 1, 7), modes, axes=1))
    truth = face[sparse]
    noisy = face + rng.normal(0, 0.3, face.shape)
    marks = rng.permutation(len(sparse))[:8]
    found = truth[marks] + rng.normal(0, 1, (8, 3))
    ours_s, ours = timed(lambda: fit_scan(model, Surface(noisy, triangles), marks, found))
    start = trimesh.Trimesh(fit_rigid(model.mean_mm[marks], found).apply(model.mean_mm), coarse, process=False)
    target = trimesh.Trimesh(noisy, triangles, process=False)
    peer_s, theirs = timed(
        lambda: trimesh.registration.nricp_amberg(start, target, source_landmarks=marks, target_positions=found),
        rounds=1,
    )
    off = [float(np.linalg.norm(np.asarray(p) - truth, axis=1).mean()) for p in (ours.points_mm, theirs)]  # type: ignore[attr-defined]
    return row("scan registration", "nricp_amberg", ours_s, peer_s, off[0], off[1], 1.0)


def via_points() -> Row:
    """Points for 16.7 s of 18 markers within 0.5 mm; instead of an error their number."""
    data, _ = motion(2000, 18)
    data = sosfiltfilt(butter(4, 12, fs=120, output="sos"), data, axis=0)
    times = np.arange(len(data)) / 120.0

    def peer() -> int:
        frames = [0, 1000, 1999]
        while True:
            curve = ViaPoints(times_s=times[frames], positions_mm=data[frames]).sample(times)
            off = np.linalg.norm(curve - data, axis=-1).max(axis=1)
            off[frames] = 0.0
            if off.max() <= 0.5:
                return len(frames)
            frames = sorted([*frames, int(off.argmax())])

    ours_s, ours = timed(lambda: len(extract_via_points(data, 120.0, 0.5).times_s))
    peer_s, theirs = timed(peer, rounds=1)
    return row("via points", "greedy insertion", ours_s, peer_s, float(ours), float(theirs), 3.0)  # type: ignore[arg-type]


def row(what: str, peer: str, ours_s: float, peer_s: float, ours: float, theirs: float, goal: float) -> Row:
    """One line of the report; ``times_faster`` is the ratio that travels between machines."""
    return {
        "what": what,
        "peer": peer,
        "ours_s": round(ours_s, 4),
        "peer_s": round(peer_s, 4),
        "times_faster": round(peer_s / ours_s, 1),
        "goal": goal,
        "ours": round(ours, 4),
        "theirs": round(theirs, 4),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=39000, help="of the long recordings; as many as the papers' had")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = [via_points(), scan(), head(20000), selection(max(options.frames, 16000)), *gaps(options.frames)]
    for one in rows:
        print(
            f"{one['what']:22} {one['ours_s']:9.4f} s {one['times_faster']:7.1f} x {one['peer']:17}"
            f" (goal {one['goal']:4.1f} x)   error or count {one['ours']:.4f} against {one['theirs']:.4f}"
        )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    bad = [one["what"] for one in rows if one["times_faster"] < one["goal"] or one["ours"] > one["theirs"]]  # type: ignore[operator]
    if bad:
        print("short of the goal:", ", ".join(map(str, bad)))
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
