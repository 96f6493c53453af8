"""How far a letter opens the lips by phonetics, where recordings say little: what a model leans on beside them.

Theory of operation
-------------------
One speaker's few words are not how a vowel is said. GRID's i are letters of the alphabet, said with lips drawn back
and apart as far as for ɑ, which is heard in the letter R alone. :data:`fapengine.speech.articulation.OPENINGS` has
what is usual; it is scaled to the speaker by the mean of the vowels that he said. A letter's row ``phone`` moves to
it, by the pose that goes with a drop of the chin, and in turn every ``pair`` that was heard, of this letter and a
neighbour to one side, takes back half. So between two neighbours that it was heard beside a letter stays as it was
heard, beside one of them it goes half of the way, and among strangers the whole. Planning costs nothing more.

Alone, between pauses, few letters were ever heard, and what the sums make of a pause differs from letter to letter by
what stood there by chance. So a letter that was not heard beside a pause gets a ``pair`` with it, before and behind,
of half of what it lacks alone at :data:`ALONE_S`, so that letters said alone open as
:data:`fapengine.speech.articulation.OPENINGS_ALONE` has it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fapengine.models.viseme_space import VisemeSpace
from fapengine.profiles import ContextModel, PhoneTarget
from fapengine.speech.articulation import OPENINGS, OPENINGS_ALONE
from fapengine.speech.ipa import SOUNDS
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.trajectory.context_features import features
from fapengine.trajectory.style import jaw_pose
from fapengine.trajectory.tokens import Token
from fapengine.trajectory.unheard import look_of

Array = NDArray[np.float64]

TAKEN_BACK = 0.5
"""Share that a heard pair takes back; a token stands in two."""
ALONE_S = 0.3
"""Length of a letter that is said alone."""
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
    leaning = _with_rows(
        replace(model, coefficients=coefficients),
        {f"phone {letter}": np.broadcast_to(move, coefficients.shape[1:]) for letter, move in moves.items()},
    )
    halves = {
        letter: (scale * usual - _opening(_alone(leaning, letter), space)) / 2 / reach_mm * pose
        for letter, usual in OPENINGS_ALONE.items()
    }
    beside_pauses = {
        f"pair {step} {SILENCE} {letter}": np.broadcast_to(half, coefficients.shape[1:])
        for letter, half in halves.items()
        for step in (-1, 1)
    }
    return _with_rows(leaning, beside_pauses)


def _with_rows(model: ContextModel, rows: Mapping[str, Array]) -> ContextModel:
    """Add rows of coefficients, (keyframes, K) each, that a model lacks; those that it has stay."""
    new = [name for name in rows if name not in model.rows]
    if not new:
        return model
    coefficients = np.concatenate([model.coefficients, np.stack([rows[name] for name in new])])
    return replace(model, features=(*model.features, *new), coefficients=coefficients)


def _alone(model: ContextModel, letter: str) -> Array:
    """(K,): a letter between pauses, the mean of its keyframes."""
    phone = Phone(letter, 0.0, ALONE_S)
    named = features([Token(phone, letter, (letter,), 0.0, ALONE_S)], 0)
    total = sum(value * model.coefficients[model.rows[name]] for name, value in named.items() if name in model.rows)
    mean: Array = np.asarray(total).mean(axis=0)
    return mean


def _opening(weights: Array, space: VisemeSpace) -> Array:
    """Way between the inner lips, mm, of weights (K,)."""
    upper, lower = (space.points.index(name) for name in INNER_LIPS)
    moved = space.to_points_mm(weights[None])[0]
    opening: Array = moved[upper, 1] - moved[lower, 1]
    return opening
