"""Usual lengths of phones by their kind, from recorded speech: the table of ``fapengine/voices/pronounce.py``.

    python -m design.phone_lengths [data/speech_train.npz]

Geometric means of the phones inside words.
"""

from collections import defaultdict

import numpy as np

from design.data_files import FOLDER, asked_path
from fapengine.speech.alphabets.convert import SILENCES, from_arpabet
from fapengine.voices.pronounce import kinds

LONG = ("i", "u", "ɑ", "ɔ", "ɝ")
"""Vowels of English that are long without a mark in ARPAbet."""


def main() -> None:
    data = np.load(asked_path(__doc__, FOLDER / "speech_train.npz"))
    lengths_s: dict[str, list[float]] = defaultdict(list)
    rows = zip(*(data[f"phone{name}"].tolist() for name in ("", "_word", "_start", "_end")), strict=True)
    for label, word, start_s, end_s in rows:
        if word and label.lower() not in SILENCES:
            heard = from_arpabet(label) or label
            (kind,) = kinds(heard + "ː" if heard in LONG else heard)
            lengths_s[kind].append(end_s - start_s)
    for name, values in sorted(lengths_s.items()):
        print(f"{name:12} {len(values):5}  {np.exp(np.log(values).mean()):.3f} s")


if __name__ == "__main__":
    main()
