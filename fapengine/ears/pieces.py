"""A long sound in pieces that can be heard one by one, cut where it is quietest."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.loudness import FRAME_HZ, HOP, loudness_db
from fapengine.ears.protocol import RATE_HZ

MIN_PIECE_S, MAX_PIECE_S = 6.0, 20.0
"""Lengths between which a piece is cut."""
_PAUSE = 25
"""Frames over which quiet is measured, 0.25 s."""
_NEARLY_DB = 3.0
"""Difference up to which a later place is as quiet as the quietest."""


def in_pieces(sound: Iterable[NDArray[np.int16]]) -> Iterator[tuple[NDArray[np.int16], bool]]:
    """Cut a sound that comes in any pieces at its quietest places.

    Parameters
    ----------
    sound : iterable of (N,) int16
        At :data:`.protocol.RATE_HZ`.

    Yields
    ------
    piece : (N,) int16
        Whole frames of 10 ms, but for the last piece.
    is_last : bool
    """
    waiting: list[NDArray[np.int16]] = []
    length, longest = 0, round(MAX_PIECE_S * RATE_HZ)
    for samples in sound:
        waiting.append(samples)
        length += len(samples)
        while length > longest:
            joined = np.concatenate(waiting)
            cut = quietest(joined[:longest])
            yield joined[:cut], False
            waiting, length = [joined[cut:]], len(joined) - cut
    yield (np.concatenate(waiting) if waiting else np.zeros(0, np.int16)), True


def quietest(samples: NDArray[np.int16]) -> int:
    """Return the sample, on a frame's edge, in the middle of the last of the quietest quarters of a second.

    ``samples`` are (N,) int16. Places before :data:`MIN_PIECE_S` do not count.
    """
    levels = loudness_db(samples)
    mean = np.convolve(levels, np.ones(_PAUSE) / _PAUSE, mode="valid")
    first = min(round(MIN_PIECE_S * FRAME_HZ), len(mean) - 1)
    nearly = np.flatnonzero(mean[first:] <= mean[first:].min() + _NEARLY_DB)
    return int(first + nearly[-1] + _PAUSE // 2) * HOP
