"""Scores of a filmed person and of our plan for the same sentences, by the measures of ``fapengine score``.

    python -m bench.score [--train data/speech_train.npz] [--every 13]

The file is that of bench/fidelity.py. Every thirteenth sentence: its tracked lips against its phones, and the plan of
its phones against both.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

import fapengine
from bench.fidelity import NAMES, load
from design.data_files import FOLDER
from fapengine.files.profiles import load_profile
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import Contacts, mouth_of
from fapengine.scoring.score import score_mouth
from fapengine.trajectory.faps import displacements_to_faps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--train", type=Path, default=FOLDER / "speech_train.npz")
    parser.add_argument("--every", type=int, default=13)
    options = parser.parse_args()
    corpus, fapu = load(options.train), load_profile("grid_s1_en").fapu
    counts: dict[str, list[Contacts]] = defaultdict(list)
    figures: dict[str, list[float]] = defaultdict(list)

    def note(name: str, value: float | None) -> None:
        if value is not None:
            figures[name].append(value)

    for clip in corpus.clips[:: options.every]:
        faps = displacements_to_faps(clip.points, NAMES, fapu)
        filmed = FapTrack.of(np.round(faps).astype(int), rate_hz=corpus.rate_hz)
        planned = fapengine.animate(clip.phones, rate_hz=corpus.rate_hz).track
        for who, track in (("filmed", filmed), ("planned", planned)):
            found = score_mouth(mouth_of(track), phones=clip.phones).phones
            assert found is not None
            counts[f"{who}: p b m"].append(found.closures)
            counts[f"{who}: f v"].append(found.teeth)
            note(f"{who}: lag by phones, ms", found.timing.lag_ms)
        against = score_mouth(mouth_of(planned), truth=mouth_of(filmed)).truth
        assert against is not None
        note("planned against filmed: opening r", against.likeness.opening_r)
        note("planned against filmed: lag, ms", against.timing.lag_ms)
        note("planned against filmed: MTM, ms", against.timing.mtm_ms)
        note("planned against filmed: LVE, mm2", against.likeness.lve_mm2)
    for name, each in counts.items():
        precisions = [one.precision for one in each if one.precision is not None]
        shut = f", {100 * np.mean(precisions):.0f} % of the shut time called for" if precisions else ""
        print(f"{name}: {sum(one.met for one in each)} of {sum(one.wanted for one in each)}{shut}")
    for name, values in figures.items():
        print(f"{name}: median {np.median(values):.2f} of {len(values)} sentences")


if __name__ == "__main__":
    main()
