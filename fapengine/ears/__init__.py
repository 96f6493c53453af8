"""Sound to phones, with the text or without it: ears.

What an ear is stands in :mod:`.protocol`, and which one hears in :mod:`.choice`. A small network of our own
(:mod:`.small_ear`) needs nothing but NumPy; :mod:`.joint_ear` adds PocketSphinx to it. The others use PocketSphinx
(BSD; the model is inside its wheel), which the extra ``ear`` installs: :mod:`.sphinx_ear` hears phones in sound alone,
:mod:`.sphinx_aligner` finds the phones of a text that is known. :mod:`.recording` listens to a file of any length.
"""
