"""Write ``fapengine/speech/phone_features.csv`` from panphon's table (MIT), and print the letters without a row.

Usage: python -m design.phone_features
"""

import csv
from pathlib import Path

import panphon

from fapengine.speech import ipa

ROWS = Path(ipa.__file__).with_name("phone_features.csv")
SIGNS = {1: "+", 0: "0", -1: "-"}

table = panphon.FeatureTable()
segments = {letter: table.fts(letter) for letter in ipa.SOUNDS}
with ROWS.open("w", encoding="utf-8", newline="") as file:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["letter", "features"])
    writer.writerows(
        (letter, "".join(SIGNS[value] for value in segment.numeric()))
        for letter, segment in segments.items()
        if segment
    )
print("panphon has no row; see ALIKE:", *(letter for letter, segment in segments.items() if not segment))
