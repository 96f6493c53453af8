"""The face of a voice agent: sound, words and interruptions in, FAPs or pictures and their sound out.

:mod:`.stage` is the part that has neither clock nor thread.
"""
