"""Words that were never heard: what is learned without them, and how they are then spoken.

Every word of the training sentences is left out once. Words are dealt to :data:`FOLDS` folds, place by place of the
sentence, by a seeded draw. A fold's sentences keep their other words: only the phones of its own words teach nothing,
neither their medians nor what neighbours do to them; a phone that only these words hold is unknown then. The viseme
space and the map to all lip points, which know no phones, stay those of all sentences.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.fidelity import Clip, Learned, learn_phones
from fapengine.profiles import Profile
from fapengine.speech.phone_track import Phone, PhoneTrack

FOLDS, SEED = 5, 3


@dataclass(frozen=True)
class Fold:
    """Words that were left out, and what was learned without them."""

    words: frozenset[str]
    lost: tuple[str, ...]
    """Phones that nobody says then."""
    profile: Profile


def deal_words(clips: Sequence[Clip]) -> list[frozenset[str]]:
    """Deal the words of these utterances to folds; words of one place of the sentence go to different ones."""
    places: list[set[str]] = []
    for clip in clips:
        for place, word in enumerate(clip.words):
            if len(places) <= place:
                places.append(set())
            places[place].add(word.text)
    rng = np.random.default_rng(SEED)
    folds: list[set[str]] = [set() for _ in range(FOLDS)]
    for words in places:
        for index, word in enumerate(rng.permutation(sorted(words)).tolist()):
            folds[index % FOLDS].add(word)
    return [frozenset(fold) for fold in folds]


def learn_folds(learned: Learned, clips: Sequence[Clip]) -> list[Fold]:
    """Learn a profile without the words of each fold."""
    folds = []
    for words in deal_words(clips):
        profile = learn_phones(learned, clips, without=words)
        lost = tuple(name for name in learned.profile.phones if name not in profile.phones)
        folds.append(Fold(words, lost, profile))
    return folds


def only_words(clip: Clip, words: frozenset[str], rate_hz: float) -> Clip | None:
    """Let only these words count in an utterance: its frames and phones; None if it has none of them."""
    mine = [word for word in clip.words if word.text in words]
    if not mine:
        return None
    times = np.arange(len(clip.lips)) / rate_hz
    shown = np.any([(times >= word.start_s) & (times <= word.end_s) for word in mine], axis=0) & clip.spoken
    phones = [
        phone for phone in clip.phones.phones if any(word.start_s <= middle(phone) <= word.end_s for word in mine)
    ]
    return replace(clip, spoken=shown, phones=PhoneTrack.from_phones(phones, tolerance_s=0.01)) if shown.any() else None


def middle(phone: Phone) -> float:
    """Time of a phone's middle, s."""
    return (phone.start_s + phone.end_s) / 2
