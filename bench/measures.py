"""Both measures of how well it speaks, millimetres and words, for words that were heard and for words that were not.

:func:`measure` serves ``bench.fidelity --json`` and ``bench.intelligible``, so that both print the same figures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.fidelity import NAMES, Clip, Corpus, Learned, captured, judge, learn, ours, to_lips
from bench.judge import EPOCHS, Example, Judge, learn_judge
from bench.new_words import Fold, learn_folds, only_words
from fapengine.profiles import Profile

READ = (*(f"8.{n}" for n in range(1, 9)), *(f"2.{n}" for n in range(2, 10)), "2.1", "2.10")
"""Feature points that the judge sees: both contours of the lips, chin and the lip's lower end."""
COMPARED = {
    "captured": captured(at_keys=False), "default": ours("context"), "paper": ours("paper"),
    "minimum-jerk": ours("minimum-jerk"), "dominance": ours("dominance"),
}  # fmt: skip
NEW = ("lips_mm", "lips_xy_mm", "lve_mm", "opening_r", "opening_slope", "width_r", "width_slope", "closed")
"""Figures that are told of new words too."""

Array = np.ndarray


@dataclass(frozen=True)
class Spoken:
    """Motion that one method planned for an utterance, and the words of it that count."""

    clip: Clip
    """Frames and phones that count; words are all of the sentence."""
    points: Array
    """(T, P, 3) mm."""
    words: frozenset[str] | None
    """The words that count, or None for all."""


def seen(points: Array, names: Sequence[str]) -> Array:
    """(T, 36) mm: x and y of what the judge sees, of (T, P, 3) points with these names."""
    columns = [list(names).index(name) for name in READ]
    return points[:, columns, :2].reshape(len(points), -1)


def train_judge(clips: Sequence[Clip], rate_hz: float) -> Judge:
    """Train the judge on captured utterances."""
    examples = [Example(seen(clip.points, NAMES), clip.phones, clip.words) for clip in clips]
    return learn_judge(examples, rate_hz, epochs=EPOCHS)


def measure(
    training: Sequence[Clip], tested: Corpus, *, methods: Sequence[str] | None = None
) -> dict[str, dict[str, float]]:
    """Measure methods on utterances that were held out, with their words heard in training and left out of it.

    Parameters
    ----------
    training : sequence of Clip
    tested : Corpus
        With words, and as many frames a second as the training.
    methods : sequence of str
        Of :data:`COMPARED`; all by default.

    Returns
    -------
    dict of str to dict of str to float
        By method. Lengths are in mm, ``word_error_...`` and ``closed`` fractions; keys that end in ``_new`` are of left
        out words, ``word_error_known`` and those without an ending of heard ones.
    """
    rate = tested.rate_hz
    learned = learn(list(training), rate)
    judging = train_judge(training, rate)
    folds = learn_folds(learned, training)
    found = {}
    for name in methods or COMPARED:
        known = [Spoken(clip, _move(name, clip, learned.profile, rate), None) for clip in tested.clips]
        fresh = [part for fold in folds for part in _speak(name, fold, tested)]
        figures = _figures(learned, tested, known)
        on_new = _figures(learned, tested, fresh)
        found[name] = {
            **figures,
            "word_error_known": _word_error(judging, learned, known),
            "word_error_new": _word_error(judging, learned, fresh),
            **{f"{key}_new": on_new[key] for key in NEW},
        }
    return found


def measure_new_words(training: Sequence[Clip], tested: Corpus) -> dict[str, dict[str, float]]:
    """Measure the default and the paper's method in millimetres, on the same words heard in training and left out."""
    learned = learn(list(training), tested.rate_hz)
    folds = learn_folds(learned, training)
    heard = [replace(fold, profile=learned.profile) for fold in folds]
    found = {}
    for name in ("default", "paper"):
        for which, used in (("heard", heard), ("left out", folds)):
            spoken = [part for fold in used for part in _speak(name, fold, tested)]
            found[f"{name}, words {which}"] = _figures(learned, tested, spoken)
    return found


def _move(name: str, clip: Clip, profile: Profile, rate_hz: float) -> Array:
    return COMPARED[name](clip, profile, np.arange(len(clip.points)) / rate_hz)


def _speak(name: str, fold: Fold, tested: Corpus) -> list[Spoken]:
    spoken = []
    for clip in tested.clips:
        counted = only_words(clip, fold.words, tested.rate_hz)
        if counted is not None:
            spoken.append(Spoken(counted, _move(name, clip, fold.profile, tested.rate_hz), fold.words))
    return spoken


def _figures(learned: Learned, tested: Corpus, spoken: Sequence[Spoken]) -> dict[str, float]:
    return judge(tested, [one.clip for one in spoken], [to_lips(one.points, learned.lift) for one in spoken])


def _word_error(judging: Judge, learned: Learned, spoken: Sequence[Spoken]) -> float:
    """Share of the words that count and were not recognised in their place."""
    heard = judging.read([seen(one.points, learned.profile.space.points) for one in spoken])
    right = [
        place < len(words) and words[place] == word.text
        for one, words in zip(spoken, heard, strict=True)
        for place, word in enumerate(one.clip.words)
        if one.words is None or word.text in one.words
    ]
    return round(1.0 - float(np.mean(right)), 4)
