"""Where in a text a piece of a recording ends, also through a telephone and in noise.

Theory of operation
-------------------
A recording is aligned in pieces (:mod:`.recording`), so its words are first shared among them. States are the phones of
the next words, in order, with gaps before, between and after words: in a gap anything may sound, at a cost, and words
may be left out, at a cost. The best path through two pieces is searched (Viterbi 1967), and the first ends where that
path is at its last frame. Frames are scored by both recognizers (:class:`.small_recognizer.JointRecognizer`). In noise
a frame says little, but many frames, in order and with an end on both sides, say enough.
"""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition import small_net
from fapengine.recognition.protocol import Labelled
from fapengine.recognition.small_recognizer import Floats, KnownFrames, phone_bonus, weighed, whole_scores
from fapengine.recognition.sphinx import ipa_of

WORST = -8.0
"""Least score of a phone, natural logarithm below the best phone of the frame: no single frame decides."""
GAP, LEFT_OUT = 3.0, 3.0
"""Costs of a frame of other sound between words, and of each phone of a word that is left out."""


def frame_scores(samples: NDArray[np.int16], heard: Sequence[Labelled]) -> Floats:
    """Score the network's labels in each frame of a piece.

    Parameters
    ----------
    samples : (N,) int16
        The piece, at :data:`.protocol.RATE_HZ`.
    heard : sequence of (label, first, end)
        What the phone loop found in it.

    Returns
    -------
    (T, C) float32
        Natural logarithms; 0 for the best label of a frame.
    """
    weights, known = small_net.shipped(), KnownFrames()
    known.add(heard)
    scores = whole_scores(samples)
    numbers = {label: number for number, label in enumerate(weights.labels)}
    scores = weighed(scores, known.labels(0, len(scores), numbers), weights, known.weight) + phone_bonus(weights)
    raised: NDArray[np.float32] = np.maximum(scores - scores.max(axis=1, keepdims=True), np.float32(WORST))
    return raised


def words_said(piece: Floats, following: Floats | None, words: Sequence[Sequence[str]], *, is_whole: bool) -> int:
    """Count the words of a text that a piece contains.

    Parameters
    ----------
    piece, following : (T, C) float32
        Scores of the piece and of the next one, if there is one.
    words : sequence of sequences of str
        The model's phones of the next words, at least those that the two can contain.
    is_whole : bool
        These are the rest of the text, and the two pieces are the rest of the recording.

    Returns
    -------
    int
        0..len(words).
    """
    numbers = {label: number for number, label in enumerate(small_net.shipped().labels)}
    gaps = np.array([0, *accumulate(len(word) + 1 for word in words)])
    """State of the gap before each word, and of the one after the last."""
    is_gap = np.zeros(gaps[-1] + 1, bool)
    is_gap[gaps] = True
    columns = np.zeros(len(is_gap), int)
    columns[~is_gap] = [numbers[ipa_of(name)] for word in words for name in word]
    past_gap = np.full(len(is_gap), -np.inf, np.float32)  # from a word to the next, without a gap
    past_gap[2:][is_gap[1:-1]] = 0.0
    left_out = (LEFT_OUT * (gaps - np.arange(len(gaps)))).astype(np.float32)
    states = np.arange(len(is_gap))
    best = np.full(len(states), -np.inf, np.float32)
    best[0] = 0.0
    ways = np.full((3, len(states)), -np.inf, np.float32)
    origin = states  # state at the end of the piece
    scores = piece if following is None else np.concatenate([piece, following])
    for frame, row in enumerate(scores):
        ways[0] = best
        ways[1, 1:] = best[:-1]
        ways[2, 2:] = best[:-2]
        ways[2] += past_gap
        back = ways.argmax(axis=0)
        best, source = ways[back, states], states - back
        reached = best[gaps] + left_out
        before = np.maximum.accumulate(np.where(reached >= np.maximum.accumulate(reached), np.arange(len(gaps)), 0))
        best[gaps], source[gaps] = reached[before] - left_out, source[gaps[before]]
        best += np.where(is_gap, max(row[0], -GAP), row[columns])
        if frame >= len(piece):
            origin = origin[source]
    state = int(origin[-1 if is_whole and following is not None else best.argmax()])
    word = int(np.searchsorted(gaps, state, side="right")) - 1
    return word + (2 * (state - int(gaps[word])) > len(words[word]) if not is_gap[state] else 0)
