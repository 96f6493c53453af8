"""Can it be lip-read? A judge that was trained on captured motion names the words of planned motion.

    python -m bench.intelligible --train data/speech_train.npz [--test B.npz] [--json]

The judge (:mod:`bench.judge`) sees x and y of lips and jaw alone: depth, which nobody measured, does not count. Words
*known* stood in the training sentences of what is judged; *new* ones were left out of them, in five folds
(:mod:`bench.new_words`). The judge itself knows all words.

Without --test, 100 sentences of --train are held out (fixed seed); --test takes any file of the same layout, with
words. Training takes one to three minutes on two cores, once: its weights are kept in ~/.cache/fapengine. It needs JAX:
pip install --group judge. One judge errs by about 1.3 points from sentence sample to sentence sample.
"""

import argparse
import json
import sys

from bench.fidelity import add_files, read_files
from bench.measures import COMPARED, measure

SHOWN = {
    "word_error_known": "words known, error", "word_error_new": "words new, error", "lips_xy_mm": "x y, mm",
    "lips_xy_mm_new": "x y new, mm", "opening_slope": "slope", "opening_slope_new": "slope new",
    "closed": "p b m closed", "closed_new": "closed new",
}  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_files(parser)
    parser.add_argument("--json", action="store_true", help="print every figure as JSON, errors as fractions")
    parser.add_argument(
        "--methods", nargs="+", choices=COMPARED, metavar="METHOD", help=f"some of {', '.join(COMPARED)}; default: all"
    )
    options = parser.parse_args(arguments)
    training, tested = read_files(options, words=True)
    found = measure(training, tested, methods=options.methods)
    if options.json:
        print(json.dumps({"clips": len(tested.clips), "methods": found}, indent=1))
        return 0
    print(f"{len(tested.clips)} utterances; the judge sees x and y of lips and jaw, no depth")
    print(" " * 14, *(f"{text:>18}" for text in SHOWN.values()))
    for name, row in found.items():
        print(f"{name:14}", *(f"{row[key]:18.3f}" for key in SHOWN))
    return 0


if __name__ == "__main__":
    sys.exit(main())
