"""A corpus: a manifest in, one file per utterance out, on one machine or many, with a journal of what is done.

A row gives the same bytes as ``say`` or ``animate`` with the same options. An interrupted run continues where it
stopped: a line of the journal means that a file is complete, and a file is replaced as a whole or not at all, so
processing a row twice is harmless.
"""
