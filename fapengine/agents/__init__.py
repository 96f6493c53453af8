"""The face of a voice agent: audio, words and interruptions in; FAPs, or images with their audio, out.

:func:`prewarm` starts faces before they are needed. :mod:`fapengine.host.stream` is the part without clock and threads.
"""

from fapengine.agents.warm import prewarm

__all__ = ["prewarm"]
