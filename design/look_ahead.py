"""What a sender's look-ahead is worth: lip error of a stream whose phones come so long before they sound.

    python -m design.look_ahead data/speech_train.npz

Held-out sentences of bench/fidelity; each phone is fed when its start is within the look-ahead, frames at 25 Hz are
taken as they are due. Mode paths alone, without contacts.
"""

from pathlib import Path

import numpy as np

from bench.fidelity import HELD_OUT, SEED, learn, load, to_lips
from design.data_files import FOLDER, asked_path
from fapengine.trajectory.stream import StreamingPlanner, jets_at, plan_together

AHEAD_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)


def main(path: Path) -> None:
    corpus = load(path)
    out = set(np.random.default_rng(SEED).permutation(len(corpus.clips))[:HELD_OUT].tolist())
    learned = learn([clip for n, clip in enumerate(corpus.clips) if n not in out], corpus.rate_hz)
    clips = [clip for n, clip in enumerate(corpus.clips) if n in out]
    for ahead_s in AHEAD_S:
        off, late = [], 0
        for clip in clips:
            planner, waiting = StreamingPlanner(learned.profile), [p for p in clip.phones.phones if not p.is_silence]
            path_ = []
            for time in np.arange(len(clip.points)) / corpus.rate_hz:
                due = [phone for phone in waiting if phone.start_s - ahead_s <= time]
                if due:
                    planner.take(due)
                    plan_together([planner])
                    waiting = waiting[len(due) :]
                path_.append(jets_at([planner.plan_at(time)[0]], np.array([time]))[0, 0])
                planner.settle(time)
            space = learned.profile.space
            moved = space.to_points_mm(np.stack(path_)[:, : space.mode_count])
            lips = to_lips(moved, learned.lift)
            off.append(np.linalg.norm(lips - clip.lips, axis=-1)[clip.spoken].ravel())
            late += planner.counts.late
        print(f"{1000 * ahead_s:5.0f} ms ahead: lips {np.concatenate(off).mean():.3f} mm, {late} phones late")


if __name__ == "__main__":
    main(asked_path(__doc__, FOLDER / "speech_train.npz"))
