"""The face of a voice agent: audio, words and interruptions in; FAPs, or images with their audio, out.

:mod:`fapengine.host.stream` is the part without clock and threads.
"""
