"""Phones out of a CTC model's frames: where each begins and ends, and how sure it is.

Theory of operation
-------------------
A model trained with connectionist temporal classification (Graves et al. 2006, doi:10.1145/1143844.1143891) tells a
phone in a few frames, a *spike*, somewhere within it, and *blank* between. Frames are labelled by their best class and
equal neighbours joined. A spike's phone reaches half way to its neighbours', at most so far that :data:`REACH_S` lie
from either end of the spike to the phone's other edge; what is left is silence, as are frames that the model itself
calls so.
"""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.commit import Labelled
from fapengine.speech.phone_track import SILENCE

BLANK = ""
"""Label of a frame in which no phone is told."""
REACH_S = 0.1
"""Longest way from a spike's end to the phone's other edge. A model that labels whole phones is thus left as it is."""


def softmax(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn scores, (T, V) of any scale, into probabilities that sum to 1 in each frame.

    Logarithms of probabilities come out as these.
    """
    raised = np.exp(scores - scores.max(axis=1, keepdims=True))
    shares: NDArray[np.float64] = raised / raised.sum(axis=1, keepdims=True)
    return shares


def segments_of(labels: Sequence[str], frame_hz: float) -> list[Labelled]:
    """Turn the best label of each frame into phones without holes.

    Parameters
    ----------
    labels : sequence of str
        IPA, :data:`BLANK` or silence, one a frame.
    frame_hz : float

    Returns
    -------
    list of (label, first frame, frame behind the last)

    Examples
    --------
    >>> segments_of(["", "m", "", "", "a", "a", "", "", "", "", "", "", ""], 50.0)
    [('m', 0, 3), ('a', 3, 9), ('_', 9, 13)]
    """
    reach = max(round(REACH_S * frame_hz), 1)
    spikes: list[Labelled] = []
    at = 0
    for label, frames in groupby(labels):
        behind = at + sum(1 for _ in frames)
        if label != BLANK:
            spikes.append((label, at, behind))
        at = behind
    found: list[Labelled] = []
    for index, (label, first, behind) in enumerate(spikes):
        if label == SILENCE:
            continue
        before = spikes[index - 1] if index else (SILENCE, 0, 0)
        after = spikes[index + 1] if index + 1 < len(spikes) else (SILENCE, at, at)
        begins = before[2] if before[0] == SILENCE else (before[2] + first) // 2
        ends = after[1] if after[0] == SILENCE else (behind + after[1]) // 2
        room = max(reach - (behind - first), 0)
        _add(found, label, max(begins, first - room), min(ends, behind + room))
    if at > (found[-1][2] if found else 0):
        found.append((SILENCE, found[-1][2] if found else 0, at))
    return found


def _add(found: list[Labelled], label: str, first: int, behind: int) -> None:
    """Append a phone, and the silence before it."""
    last = found[-1][2] if found else 0
    if first > last:
        found.append((SILENCE, last, first))
    found.append((label, max(first, last), behind))
