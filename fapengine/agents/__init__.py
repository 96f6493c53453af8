"""The face of a voice agent: sound, words and interruptions in, FAPs or pictures and their sound out.

:mod:`fapengine.host.stream` is the part that has neither clock nor thread.
"""
