"""How far a letter opens the lips by phonetics, where recordings say little: what a model leans on beside them.

Theory of operation
-------------------
One speaker's few words are not how a vowel is said. GRID's i are letters of the alphabet, said with lips drawn back
and apart as far as for ɑ, which is heard in the letter R alone. :data:`fapengine.speech.articulation.OPENINGS` has
what is usual; it is scaled to the speaker by the mean of the vowels that he said. A letter's row ``phone`` moves to
it, by the pose that goes with a drop of the chin, and in turn every ``pair`` that was heard, of this letter and a
neighbour to one side, takes back half. So between two neighbours that it was heard beside a letter stays as it was
heard, beside one of them it goes half of the way, and among strangers, or alone, the whole. Planning costs nothing
more.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.models.viseme_space import VisemeSpace
from fapengine.profiles import ContextModel, PhoneTarget
from fapengine.speech.articulation import OPENINGS
from fapengine.speech.ipa import SOUNDS
from fapengine.trajectory.style import jaw_pose
from fapengine.trajectory.unheard import look_of

Array = NDArray[np.float64]

TAKEN_BACK = 0.5
"""Share that a heard pair takes back; a token stands in two."""
INNER_LIPS = ("2.2", "2.3")
"""Feature points in the middle of the inner lips, upper and lower."""


def lean_on_phonetics(model: ContextModel, space: VisemeSpace, phones: Mapping[str, PhoneTarget]) -> ContextModel:
    """Move letters to the openings of phonetics, but where they stand among neighbours that were heard.

    Parameters
    ----------
    model : ContextModel
    space : VisemeSpace
        Of the model's weights.
    phones : mapping of str to PhoneTarget
        Tell what pose goes with a drop of the chin.

    Returns
    -------
    ContextModel
        The same where no vowel of the table was heard, or where the inner lips are not among the space's points.
    """
    lengths = {name.split(" ")[1] for name in model.features if name.startswith("phone ") and name.endswith(" length")}
    vowels = [letter for letter in OPENINGS if letter in lengths and SOUNDS[letter].vowel]
    if not vowels or not set(INNER_LIPS) <= set(space.points):
        return model
    pose = jaw_pose(space, phones)
    reach_mm = float(_opening(pose, space))
    if reach_mm <= 0:
        return model
    looks = {letter: float(_opening(look_of(model, letter).mean(axis=0), space)) for letter in OPENINGS}
    scale = np.mean([looks[letter] for letter in vowels]) / np.mean([OPENINGS[letter] for letter in vowels])
    moves = {letter: (scale * usual - looks[letter]) / reach_mm * pose for letter, usual in OPENINGS.items()}
    coefficients = model.coefficients.copy()
    for row, name in enumerate(model.features):
        kind, *rest = name.split(" ")
        if kind == "phone" and len(rest) == 1 and rest[0] in moves:
            coefficients[row] += moves[rest[0]]
        elif kind == "pair" and rest[2] in moves:
            coefficients[row] -= TAKEN_BACK * moves[rest[2]]
    new = [letter for letter in moves if f"phone {letter}" not in model.rows]
    shape = (len(new), *coefficients.shape[1:])
    added = np.broadcast_to(np.reshape([moves[letter] for letter in new], (len(new), 1, shape[2])), shape)
    return replace(
        model,
        features=(*model.features, *(f"phone {letter}" for letter in new)),
        coefficients=np.concatenate([coefficients, added]),
    )


def _opening(weights: Array, space: VisemeSpace) -> Array:
    """Way between the inner lips, mm, of weights (K,)."""
    upper, lower = (space.points.index(name) for name in INNER_LIPS)
    moved = space.to_points_mm(weights[None])[0]
    opening: Array = moved[upper, 1] - moved[lower, 1]
    return opening
