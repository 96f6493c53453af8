"""The small network and PocketSphinx together, without a text.

Theory of operation
-------------------
The two err in different places. For each frame the small network gives a likelihood of each phone. The phone that
PocketSphinx's loop finds in the frame is a second observation; its likelihood given the true phone was counted on known
sentences (``bench/ear_join.py``). Both are multiplied, the second to the power of :data:`OTHER_WEIGHT`, because they
are not independent; then the best path is searched as in :mod:`.small_recognizer`.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition.loudness import FRAME_HZ
from fapengine.recognition.protocol import Labelled
from fapengine.recognition.small_net import Weights, shipped
from fapengine.recognition.small_recognizer import LOOK_AHEAD_S, SmallRecognizer
from fapengine.recognition.sphinx_recognizer import BLOCK, SphinxRecognizer

OTHER_WEIGHT = 0.6
"""Weight of PocketSphinx's phones; 0 to 1 were tried on the sentences of ``bench/ears.py``."""


class SphinxFrames:
    """Phone numbers that PocketSphinx finds, for frames that the small network has scored. Stateful."""

    def __init__(self, labels: tuple[str, ...]) -> None:
        self._numbers = {label: number for number, label in enumerate(labels)}
        self._recognizer = SphinxRecognizer()
        self._found: list[Labelled] = []

    def reset(self) -> None:
        """Start again."""
        self._recognizer.reset()
        self._found = []

    def push(self, block: NDArray[np.int16]) -> None:
        """Process a block, (N,) int16; N is :data:`.sphinx_recognizer.BLOCK`."""
        self._recognizer.push(block)
        self._found = self._recognizer.hypothesis()

    def end(self, rest: NDArray[np.int16]) -> None:
        """Process the rest, (N,) int16, shorter than a block."""
        phones = self._recognizer.push(rest) + self._recognizer.end()
        self._found += [(one.label, round(one.start_s * FRAME_HZ), round(one.end_s * FRAME_HZ)) for one in phones]

    def labels(self, first: int, behind: int) -> NDArray[np.int64]:
        """Label numbers of frames ``first`` to ``behind``, (T,); -1 where unknown."""
        found = np.full(behind - first, -1)
        for label, a, b in self._found:
            if b > first and a < behind:
                found[max(a - first, 0) : b - first] = self._numbers.get(label, -1)
        return found


class JointRecognizer(SmallRecognizer):
    """The small network and PocketSphinx as one :class:`.protocol.Recognizer`. Stateful.

    Parameters
    ----------
    look_ahead_s : float
        Delay of phones after their audio, 0.12 to 1 s; they come at most one block (80 ms) later.
    weights : Weights, optional
        By default those of the package.

    Examples
    --------
    >>> recognizer = JointRecognizer()
    >>> told = recognizer.push(np.zeros(16_000, np.int16)) + recognizer.end()
    >>> {phone.label for phone in told}, told[-1].end_s
    ({'_'}, 1.0)
    """

    _block = BLOCK

    def __init__(self, look_ahead_s: float = LOOK_AHEAD_S, *, weights: Weights | None = None) -> None:
        self._other = SphinxFrames((weights or shipped()).labels)
        super().__init__(look_ahead_s, weights=weights)

    def reset(self) -> None:
        """Start again: the next sample is the first."""
        super().reset()
        self._other.reset()

    def _score(self, samples: NDArray[np.int16], *, rest: int | None = None) -> NDArray[np.float32]:
        if rest is None:
            self._other.push(samples)
        else:
            self._other.end(samples[:rest])
        scores = super()._score(samples, rest=rest)
        found = self._other.labels(self._search.now, self._search.now + len(scores))
        known = found >= 0
        logs: NDArray[np.float32] = scores - scores.max(axis=1, keepdims=True)
        logs[known] += np.float32(OTHER_WEIGHT) * self._weights.other[found[known]]
        return logs
