"""Two ears as one, without a text: what PocketSphinx hears counts beside what the small network hears.

Theory of operation
-------------------
The two err in different places. For each frame the small ear has a likelihood of each phone; which phone PocketSphinx's
loop hears in it is a second observation, whose likelihood given the true phone was counted on sentences that are known
(``bench/ear_join.py``). Both are multiplied, the second to the power of :data:`OTHER_WEIGHT`, for they are not
independent; then the best path is searched as in :mod:`.small_ear`.
"""

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.commit import Labelled
from fapengine.ears.loudness import FRAME_HZ
from fapengine.ears.small_ear import LOOK_AHEAD_S, SmallEar
from fapengine.ears.small_net import Weights
from fapengine.ears.sphinx_ear import BLOCK, SphinxEar

OTHER_WEIGHT = 0.6
"""Weight of what PocketSphinx hears; 0 to 1 were looked at on the sentences of ``bench/ears.py``."""


class OtherEar:
    """Which phone PocketSphinx hears in each frame, as soon as the small ear has scored it. Stateful.

    Parameters
    ----------
    labels : tuple of str
        The small ear's.

    Raises
    ------
    ResourceError
        If PocketSphinx is not installed.
    """

    def __init__(self, labels: tuple[str, ...]) -> None:
        self._numbers = {label: number for number, label in enumerate(labels)}
        self._ear = SphinxEar()
        self._heard: list[Labelled] = []

    def reset(self) -> None:
        """Forget everything."""
        self._ear.reset()
        self._heard = []

    def push(self, block: NDArray[np.int16]) -> None:
        """Hear a block, (N,) int16; N is :data:`.sphinx_ear.BLOCK`."""
        self._ear.push(block)
        self._heard = self._ear.hypothesis()

    def end(self, rest: NDArray[np.int16]) -> None:
        """Hear the rest, (N,) int16, shorter than a block."""
        phones = self._ear.push(rest) + self._ear.end()
        self._heard += [(one.label, round(one.start_s * FRAME_HZ), round(one.end_s * FRAME_HZ)) for one in phones]

    def labels(self, first: int, behind: int) -> NDArray[np.int64]:
        """Numbers of the labels of some frames, (T,); -1 where nothing is known."""
        found = np.full(behind - first, -1)
        for label, a, b in self._heard:
            if b > first and a < behind:
                found[max(a - first, 0) : b - first] = self._numbers.get(label, -1)
        return found


class JointEar(SmallEar):
    """Hears phones in sound alone, with the small network and PocketSphinx; see :class:`.protocol.Ear`. Stateful.

    Parameters
    ----------
    look_ahead_s : float
        How far behind the sound phones are told, 0.12..1 s; they come at most one block (80 ms) later.
    weights : Weights, optional
        By default those of the package.

    Raises
    ------
    UsageError
        For a look-ahead out of range.
    DataError
        If the package's weights are damaged.
    ResourceError
        If PocketSphinx is not installed.

    Examples
    --------
    >>> ear = JointEar()
    >>> told = ear.push(np.zeros(16_000, np.int16)) + ear.end()
    >>> {phone.label for phone in told}, told[-1].end_s
    ({'_'}, 1.0)
    """

    _block = BLOCK

    def __init__(self, look_ahead_s: float = LOOK_AHEAD_S, *, weights: Weights | None = None) -> None:
        super().__init__(look_ahead_s, weights=weights)
        self._other = OtherEar(self._weights.labels)

    def reset(self) -> None:
        """Forget everything: the next sample is the first."""
        super().reset()
        self._other.reset()

    def _score(self, samples: NDArray[np.int16], *, rest: int | None = None) -> NDArray[np.float32]:
        if rest is None:
            self._other.push(samples)
        else:
            self._other.end(samples[:rest])
        scores = super()._score(samples, rest=rest)
        heard = self._other.labels(self._search.now, self._search.now + len(scores))
        known = heard >= 0
        logs: NDArray[np.float32] = scores - scores.max(axis=1, keepdims=True)
        logs[known] += np.float32(OTHER_WEIGHT) * self._weights.other[heard[known]]
        return logs
