"""Scores of a filmed person and of our plan for the same sentences, by the measures of ``fapengine score``.

    python -m bench.score [--train data/speech_train.npz] [--every 13]

The file is that of bench/fidelity.py. Every thirteenth sentence: its tracked lips against its phones, and the plan of
its phones against both; means with 95 % intervals over sentences, weighted as in a test set.
"""

import argparse
from pathlib import Path

import numpy as np

import fapengine
from bench.fidelity import NAMES, load
from design.data_files import FOLDER
from fapengine.files.profiles import load_profile
from fapengine.files.report.score_page import spell_estimate
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import mouth_of
from fapengine.scoring.score import Score, score_mouth
from fapengine.scoring.statistics import estimate
from fapengine.scoring.verdict import MEASURES, judge
from fapengine.trajectory.faps import displacements_to_faps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--train", type=Path, default=FOLDER / "speech_train.npz")
    parser.add_argument("--every", type=int, default=13)
    options = parser.parse_args()
    corpus, fapu = load(options.train), load_profile("grid_s1_en").fapu
    scores: dict[str, list[Score]] = {"filmed": [], "planned": [], "planned against filmed": []}
    for clip in corpus.clips[:: options.every]:
        faps = displacements_to_faps(clip.points, NAMES, fapu)
        filmed = mouth_of(FapTrack.from_values(np.round(faps).astype(int), rate_hz=corpus.rate_hz))
        planned = mouth_of(fapengine.animate(clip.phones, rate_hz=corpus.rate_hz).track)
        scores["filmed"].append(score_mouth(filmed, phones=clip.phones))
        scores["planned"].append(score_mouth(planned, phones=clip.phones))
        scores["planned against filmed"].append(score_mouth(planned, truth=filmed))
    for who, found in scores.items():
        verdicts = [judge(score, MEASURES) for score in found]
        print(f"{who}: {sum(verdict.passes for verdict in verdicts)} of {len(found)} sentences pass")
        for measure in MEASURES:
            weighed = [(value, measure.weight(score)) for score in found if (value := measure.value(score)) is not None]
            if any(weight for _, weight in weighed):
                values, weights = zip(*weighed, strict=True)
                line = f"{spell_estimate(estimate(values, weights))} {measure.row.unit}, median {np.median(values):.4g}"
                print(f"  {measure.row.help}: {line}, {len(values)} sentences")


if __name__ == "__main__":
    main()
