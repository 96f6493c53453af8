"""Speed of captured lips as they part and meet: percentiles of speed and acceleration of the opening.

    python -m design.lip_speed data/speech_train.npz

Decided the bounds in ``fapengine/trajectory/planner.py``. Frames are 1/25 s apart, so true peaks are higher.
"""

import numpy as np

from bench.fidelity import load, opening
from design.data_files import FOLDER, asked_path

if __name__ == "__main__":
    corpus = load(asked_path(__doc__, FOLDER / "speech_train.npz"))
    speed, acceleration = [], []
    for clip in corpus.clips:
        gap = opening(corpus, clip.lips)
        speed.append((np.diff(gap) * corpus.rate_hz)[clip.spoken[1:]])
        acceleration.append((np.diff(gap, 2) * corpus.rate_hz**2)[clip.spoken[2:]])
    for name, parts in (("speed, mm/s", speed), ("acceleration, mm/s^2", acceleration)):
        values = np.percentile(np.abs(np.concatenate(parts)), [50, 99, 99.9, 100])
        print(f"{name:22}", "  ".join(f"{p} %: {v:.0f}" for p, v in zip((50, 99, 99.9, 100), values, strict=True)))
