"""A corpus: a manifest in, a file an utterance out, on one machine or many, with a journal as the truth.

What is done for a row is what ``say`` and ``animate`` do for a file, to the byte. Whatever ends a run early, the next
one goes on where it was: a line of the journal says that a file is whole, and a file is replaced at once or not at
all, so a row that is done twice is the same bytes twice.
"""
