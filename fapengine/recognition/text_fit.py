"""Whether a text is said in a piece of sound, where a phone loop denies it: a telephone, noise, or another text.

Theory of operation
-------------------
Noise makes each recognizer find less of any text, right or wrong. So a text is compared with others under the same
noise: its phones score better where they were aligned than other phones do there. Two recognizers that err differently
judge that: the aligner with the words in other orders (:meth:`.sphinx_aligner.SphinxAligner.misfit`), and the small
network with the text's own vowels, or consonants, in other places. The limit depends on the sound: in clear sound, a
text that the loop denies is most likely another one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine.recognition import small_net
from fapengine.recognition.loudness import HOP, loudness_db
from fapengine.recognition.small_recognizer import is_vowel, whole_scores
from fapengine.recognition.sphinx import ipa_of
from fapengine.recognition.sphinx_aligner import Aligned, SphinxAligner

PAUSE = 25
"""Frames between two words from which on they are a pause."""
WEIGHT = 0.8
"""Weight of the network's misfit beside the misfit of the order of words."""
NOISY_DB = 25.0
"""Range of loudness (10th to 95th percentile) below which a piece is noisy."""
CLEAR = 1.29
"""Entropy of the network's phones, in nats, below which it is sure: sound without noise is then clear."""
LIMIT, CLEAR_LIMIT, NOISY_LIMIT = 1.52, 1.28, 1.57
"""Largest misfit of a right text: in most sound, in clear sound, in noise. All numbers were chosen on 49 filmed
sentences, clean, through a telephone, with reverberation, and in pink noise at 5 dB: one right text was above, and one
of 116 that say something else below."""
SHORT_PHONES, SHORT_CLEAR, SHORT_DB, SHORT_LIMIT = 4, 1.4, 20.0, 1.65
"""Limits for a word or two: at least so many phones, at most this entropy and at least this range in dB, or the text is
not judged; and the misfit above which it is refused. One word has no other order, so its misfit is 1 and more. Chosen
on 200 words and pairs of flite, clean and through a telephone, checked on 80 others: none of 560 right ones is above;
of wrong ones in clean sound 128 of 200, and 47 of the 80 others."""
MIN_LOG_LIKELIHOOD = -8.0
"""Least log-likelihood of a phone in a frame: no single frame decides."""


def fits(
    aligner: SphinxAligner, aligned: Sequence[Aligned], samples: NDArray[np.int16], *, is_short: bool = False
) -> bool:
    """Judge words that were aligned.

    Parameters
    ----------
    aligner : SphinxAligner
        Contains the text.
    aligned : sequence of Aligned
        Phones of its words in the piece, at least one.
    samples : (N,) int16
        The piece, at :data:`.protocol.RATE_HZ`.
    is_short : bool
        There are too few frames to judge other than clear sound; others fit. One word alone is short in any case.
    """
    is_short = is_short or aligned[0].word == aligned[-1].word
    if is_short and len(aligned) < SHORT_PHONES:
        return True
    spans = _spans(aligned)
    said = np.concatenate([samples[first * HOP : behind * HOP] for first, behind in spans])
    in_order = aligner.misfit(said, aligned[0].word, aligned[-1].word + 1)
    likely = _log_likelihoods(samples)
    misfit = in_order + WEIGHT * _misplaced(aligned, likely)
    low_db, high_db = np.percentile(loudness_db(samples), (10, 95))
    said_frames = np.concatenate([likely[first:behind] for first, behind in spans])
    entropy = -float((np.exp(said_frames) * said_frames).sum(axis=1).mean())
    if is_short:
        return misfit <= SHORT_LIMIT or high_db - low_db < SHORT_DB or entropy >= SHORT_CLEAR
    if high_db - low_db < NOISY_DB:
        return misfit <= NOISY_LIMIT
    return misfit <= (CLEAR_LIMIT if entropy < CLEAR else LIMIT)


def _spans(aligned: Sequence[Aligned]) -> list[tuple[int, int]]:
    """Frames between pauses, first and the one after the last: pauses fit any text, and the network is sure of them.

    Examples
    --------
    >>> _spans([Aligned(0, "a", 0, *frames, "AA") for frames in ((3, 9), (20, 40), (65, 80))])
    [(3, 40), (65, 80)]
    """
    spans = [(aligned[0].first, aligned[0].behind)]
    for phone in aligned[1:]:
        if phone.first - spans[-1][1] < PAUSE:
            spans[-1] = spans[-1][0], phone.behind
        else:
            spans.append((phone.first, phone.behind))
    return spans


def _log_likelihoods(samples: NDArray[np.int16]) -> NDArray[np.float32]:
    """(T, C) log-likelihoods of the small network's labels for each frame of a piece, (N,) int16."""
    scores = whole_scores(samples)
    scores = scores - scores.max(axis=1, keepdims=True)
    likely: NDArray[np.float32] = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
    return likely


def _misplaced(aligned: Sequence[Aligned], likely: NDArray[np.float32]) -> float:
    """Misfit of phones: 0 for the best ones in each frame, 1 for the text's own in any order."""
    numbers = {label: number for number, label in enumerate(small_net.shipped().labels)}
    phones = [phone for phone in aligned if phone.model]  # a glottal stop has none
    labels = [ipa_of(phone.model.split()[0]) for phone in phones]
    chosen = np.array([numbers[label] for label in labels])
    vowels = np.array([is_vowel(label) for label in labels])
    bounded = np.maximum(likely, MIN_LOG_LIKELIHOOD)
    scores = np.array([bounded[phone.first : phone.behind].sum(axis=0) for phone in phones])[:, chosen]
    best = sum(float(likely[phone.first : phone.behind].max(axis=1).sum()) for phone in phones)
    own = float(np.trace(scores))
    others = sum(float(row[vowels == vowel].mean()) for row, vowel in zip(scores, vowels, strict=True))
    return (best - own) / (best - others) if others < best else 1.0
