"""Speech recognition: sound to phones, with the text or without it.

:mod:`.protocol` says what a recognizer is, :mod:`.choice` which one runs. A small network of our own
(:mod:`.small_recognizer`) needs only NumPy, or adds PocketSphinx. The others use
PocketSphinx (BSD; the model is inside its wheel), which the extra ``recognizer`` installs: :mod:`.sphinx_recognizer`
finds phones in audio alone, :mod:`.sphinx_aligner` finds the phones of a known text. :mod:`.recording` recognizes a
file of any length.
"""
