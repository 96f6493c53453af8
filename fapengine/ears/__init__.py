"""Sound to phones, with the text or without it: ears.

What an ear is stands in :mod:`.protocol`. The first ones use PocketSphinx (BSD; the model is inside its wheel), which
the extra ``ear`` installs: :mod:`.sphinx_ear` hears phones in sound alone, :mod:`.sphinx_aligner` finds the phones of
a text that is known. :mod:`.recording` listens to a file of any length.
"""
