"""Counts of the phones that PocketSphinx hears where others are said, added to the weights of the small recognizer.

    python -m bench.recognizer_join FOLDER WEIGHTS.npz [--without flite-kal16 ...] [--sentences 7]

FOLDER is that of ``bench.recognizer_speech``. A few sentences of each speaker go through PocketSphinx's loop as in
:class:`fapengine.recognition.small_recognizer.JointRecognizer`, with the same look-ahead. The counts of (heard, true)
frames become logarithms of P(heard | true) / P(heard), smoothed by 20 frames.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

from bench.recognizer_speech import EITHER, LABELS
from fapengine.recognition.loudness import HOP
from fapengine.recognition.small_recognizer import LATE, SphinxFrames
from fapengine.recognition.sphinx_recognizer import BLOCK

SPEAKERS = ("flite-rms", "flite-awb", "flite-slt", "flite-kal16", "festival-ked", "people-en")
SMOOTH = 20
STRUT = LABELS.index("ʌ")


def heard(samples: np.ndarray) -> np.ndarray:
    """(T,): label that is heard in each frame when the small recognizer has scored it, else -1."""
    recognizer, numbers = SphinxFrames(), {label: number for number, label in enumerate(LABELS)}
    found, count = np.full(len(samples) // HOP, -1), 0
    for start in range(0, len(samples) - BLOCK + 1, BLOCK):
        recognizer.push(samples[start : start + BLOCK])
        now = max((start + BLOCK) // HOP - LATE, 0)
        found[count:now] = recognizer.labels(count, now, numbers)
        count = now
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--without", nargs="*", default=[], metavar="SPEAKER")
    parser.add_argument("--sentences", type=int, default=7)
    options = parser.parse_args()
    counts = np.zeros((len(LABELS), len(LABELS)))
    for speaker in SPEAKERS:
        if speaker in options.without:
            continue
        data = np.load(options.folder / f"{speaker}.npz")
        ends = data["ends"]
        for a, b in pairwise(ends[4 : 5 + options.sentences]):
            labels = data["frames"][a:b].astype(int)
            labels[labels == EITHER] = STRUT
            told = heard(data["samples"][a * HOP : b * HOP])
            known = (told >= 0) & (labels < len(LABELS))
            np.add.at(counts, (told[known], labels[known]), 1)
        print(speaker, f"{counts.trace() / counts.sum():.3f} of the frames so far are heard right", flush=True)
    share = counts.sum(axis=1, keepdims=True) / counts.sum()
    given = (counts + SMOOTH * share) / (counts.sum(axis=0, keepdims=True) + SMOOTH)
    with np.load(options.weights) as old:
        arrays = {name: old[name] for name in old.files}
    arrays["other"] = (np.log(given + 1e-6) - np.log(share + 1e-6)).astype(np.float16)
    np.savez_compressed(options.weights, **arrays)


if __name__ == "__main__":
    main()
