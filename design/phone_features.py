"""Write the rows of ``fapengine/speech/ipa.py`` from panphon's table (MIT); run it and paste.

Usage: python design/phone_features.py
"""

import panphon

from fapengine.speech import ipa

table = panphon.FeatureTable()
for letter in ipa.SOUNDS:
    segment = table.fts(letter)
    if segment:
        print(f'    "{letter}": "{"".join({1: "+", 0: "0", -1: "-"}[value] for value in segment.numeric())}",')
    else:
        print(f"    # {letter}: panphon has no row; see ALIKE")
