"""What a context model has to say of letters that nobody said in the recordings: what phonetics knows of their likes.

Theory of operation
-------------------
The ways of a letter (:func:`.context_features.ways`) give it a place by regression over all phones; a place of its own
is better where a rule can tell it. So a letter that was not heard gets a row ``phone`` of its own, which carries it

- to its twin, whose lips do the same, voiced or not: ð to θ, ʒ to ʃ, ɥ to w;
- as a consonant, to the end of a heard affricate: ʃ to the second keyframe of tʃ, protruded and yet open (Toda, Maeda,
  Carlen and Meftahi 2003);
- without a gesture of its own, as h, to the mean of the heard vowels, which its neighbours then move;
- as a vowel, between the two heard ones of the same rounding that are next above and below it: e between ɪ and ɛ, o
  between u and ɔ, and so in the order of their heights. Rounded ones may differ in place, which lips do not show (y is
  as u); unrounded ones by half of the way from front to back.

Heard phones stay as they were heard. Which two stand beside each other still comes from ways alone.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.profiles import ContextModel
from fapengine.speech import ipa
from fapengine.trajectory.context_features import GESTURELESS, Part, alone, ways

Array = NDArray[np.float64]
LIPS = ("push", "round")
"""Ways of the lips; what a tongue does is not in a viseme space."""
TWINS_APART = 0.25
"""Greatest difference of twins in one of :data:`LIPS`."""
NEAR_PLACE = 0.5
"""Greatest difference in place between an unrounded vowel and those that it stands between."""


def add_unheard(model: ContextModel) -> ContextModel:
    """Add a row for every letter of IPA that the model has no row for and that a rule tells of."""
    heard = tuple(name.removeprefix("phone ") for name in model.features if name.startswith("phone "))
    heard = tuple(name for name in heard if " " not in name)
    looks = {name: look_of(model, name) for name in heard}
    rows: dict[str, Array] = {}
    for letter in [*ipa.SOUNDS, *ipa.SOUNDS]:  # twice: a twin may itself be unheard
        if letter not in looks:
            look = _from_twin(letter, looks)
            look = _from_likes(letter, heard, looks) if look is None else look
            if look is not None:
                looks[letter] = look
                rows[f"phone {letter}"] = look - look_of(model, letter)
    if not rows:
        return model
    coefficients = np.concatenate([model.coefficients, np.stack(list(rows.values()))])
    return replace(model, features=(*model.features, *rows), coefficients=coefficients)


def look_of(model: ContextModel, name: str) -> Array:
    """(keyframes, K): a phone by itself, of typical length."""
    named = alone(Part(name, ipa.letters(name)[0]))
    total = np.zeros(model.coefficients.shape[1:])
    for feature, value in named.items():
        if feature in model.rows:
            total += value * model.coefficients[model.rows[feature]]
    return total


def _from_twin(letter: str, looks: Mapping[str, Array]) -> Array | None:
    sound = ipa.SOUNDS[letter]
    if sound.vowel or not ways(letter):
        return None
    return next((look for other, look in looks.items() if len(other) == 1 and _lips_do_the_same(letter, other)), None)


def _lips_do_the_same(letter: str, other: str) -> bool:
    one, two = (replace(ipa.SOUNDS[each], voiced=True) for each in (letter, other))
    apart = max(abs(ways(letter).get(way, 0.0) - ways(other).get(way, 0.0)) for way in LIPS)
    return one == two and apart <= TWINS_APART


def _from_likes(letter: str, heard: tuple[str, ...], looks: Mapping[str, Array]) -> Array | None:
    if ipa.SOUNDS[letter].vowel:
        return _between(letter, heard, looks)
    if letter in GESTURELESS:
        vowels = [looks[name] for name in heard if len(name) == 1 and ipa.SOUNDS[name].vowel]
        return np.mean(vowels, axis=0) if vowels else None
    affricate = next((name for name in heard if len(name) == 2 and name[1] == letter), None)
    if affricate is None:
        return None
    late = looks[affricate][-1:]
    return np.repeat(late, len(looks[affricate]), axis=0)


def _between(letter: str, heard: tuple[str, ...], looks: Mapping[str, Array]) -> Array | None:
    sound = ipa.SOUNDS[letter]

    def is_like(name: str) -> bool:
        other = ipa.SOUNDS[name[0]]
        apart = abs(other.place - sound.place)
        return len(name) == 1 and other.vowel and other.rounding == sound.rounding and (
            sound.rounding == 1.0 or apart <= NEAR_PLACE
        )  # fmt: skip

    def far(name: str) -> tuple[float, float, float]:
        other = ipa.SOUNDS[name]
        spread = abs(ways(name).get("round", 0.0) - ways(letter).get("round", 0.0))
        return abs(other.opening - sound.opening), abs(other.place - sound.place), spread

    likes = [name for name in heard if is_like(name)]
    closer = [name for name in likes if ipa.SOUNDS[name].opening <= sound.opening]
    opener = [name for name in likes if ipa.SOUNDS[name].opening >= sound.opening]
    if not closer or not opener:
        return None
    low, high = min(closer, key=far), min(opener, key=far)
    span = ipa.SOUNDS[high].opening - ipa.SOUNDS[low].opening
    share = (sound.opening - ipa.SOUNDS[low].opening) / span if span else 0.0
    between: Array = (1 - share) * looks[low] + share * looks[high]
    return between
