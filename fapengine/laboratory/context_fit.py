"""Learning a context model: least squares on captured phones, and what phonetics knows about the others.

Theory of operation
-------------------
**Regression** (:func:`fit_context`). The features of a phone between its neighbours
(:mod:`fapengine.trajectory.context`) add up to its targets. Ridge regression finds what each adds; the rarer
and the farther a feature, the more it is shrunk. How much each kind is shrunk was chosen by leaving words out, not
sentences: all that a user makes a face say is new words, while the words of a held-out sentence are in other sentences
(``bench/new_words``). What evenly spaced tokens add as examples is found with the features, in one system of equations
(subset of regressors: Smola and Bartlett 2001). Fitted afterwards, to what the sum leaves, they would learn from words
that the sum has learned by heart.

**Letters that were not recorded** (:func:`add_unrecorded`). The gestures of a letter
(:func:`fapengine.trajectory.context.ways`) give it a shape by regression over all phones; a shape of its own is
better where a rule gives one. So such a letter gets a row ``phone``:

- the row of its twin, whose lips do the same, voiced or not: ð from θ, ʒ from ʃ, ɥ from w;
- as a consonant, the end of a recorded affricate: ʃ from the second keyframe of tʃ, protruded and yet open (Toda,
  Maeda, Carlen and Meftahi 2003);
- without a gesture of its own, as h, the mean of the recorded vowels, which its neighbours then move;
- as a vowel, a mix of the two recorded ones of the same rounding that are next above and below it: e between ɪ and ɛ, o
  between u and ɔ, in the order of their heights. Rounded ones may differ in place, which lips do not show (y is as u);
  unrounded ones by half of the distance from front to back.

Recorded phones do not change. The effect of neighbours still comes from gestures alone.

**Openings of the lips** (:func:`lean_on_phonetics`). One speaker's few words do not show how a vowel is usually said.
GRID's ɑ is recorded in the letter R alone. :data:`fapengine.speech.articulation.OPENINGS` has the usual openings; they
are scaled to the speaker by the mean of the recorded vowels. The row ``phone`` of a letter moves to its usual opening,
along the pose of a jaw drop; the keyframes of a diphthong move to those of its letters. Each recorded ``pair`` of the
letter and a neighbour undoes a part of that move (:data:`TAKEN_BACK`): between two neighbours with recorded pairs
the letter moves least, with one more, with none fully. Planning needs no extra time.

Few letters are recorded alone, between pauses, and the sum for such a place is mostly noise. So a letter without a
recorded pair with a pause gets one for each side, with half of what is missing at :data:`ALONE_S`. Letters said alone
then open as :data:`fapengine.speech.articulation.OPENINGS_ALONE` says.
"""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.errors import UsageError
from fapengine.models.viseme_space import VisemeSpace
from fapengine.profiles import ContextModel, Examples, PhoneTarget
from fapengine.speech import ipa
from fapengine.speech.articulation import OPENINGS, OPENINGS_ALONE
from fapengine.speech.ipa import SOUNDS
from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.trajectory.context import (
    GESTURELESS,
    IN_NAME,
    REACH,
    Likeness,
    Part,
    Token,
    alone,
    features,
    lengths_around,
    letters_around,
    ways,
)
from fapengine.trajectory.style import jaw_pose

VOWELS = frozenset(letter for letter, sound in SOUNDS.items() if sound.vowel)
LIPS = ("push", "round")
"""Gestures of the lips; the tongue is not in a viseme space."""
TWINS_APART = 0.25
"""Largest difference of twins in one of :data:`LIPS`."""
NEAR_PLACE = 0.5
"""Largest difference in place between an unrounded vowel and the two that it is between."""
FRACTIONS = (0.2, 0.7)
"""Fractions of a phone's duration at which its keyframes stand; splines through captured values there are within 0.35
mm of the captured lips (through those at 30 % alone, 0.79)."""
PENALTIES: Mapping[str, tuple[float, ...]] = {
    "bias": (0.03,), "phone": (10.0,), "length": (3.0,), "way": (1.0, 10.0, 20.0, 40.0),
    "letter": (0.0, 30.0, 60.0, 120.0), "cross": (0.0, 60.0), "pair": (30.0,), "triple": (10.0,),
}  # fmt: skip
"""Ridge of each kind of feature by its distance in steps, the first for a kind without one. Found by leaving words out,
within training sentences of one speaker; of those tried, none a third of it or thrice it lowers the error at the keys
by more than 0.6 %."""
SENTENCE = 6.0
"""Ridge of each sentence's offset of the whole face and its drift: timing does not predict them (none of their
variance in other sentences), and phones need not bend to them. 3 and 10 measure the same."""
EXAMPLES = 512
"""Tokens that others are compared with; all 7,111 lower errors at the keys by another 0.9 %, of new words by 0.1 %."""
EXAMPLES_PENALTY, ALIKE_PENALTY = 2.0, 0.01
"""Ridge of what examples add, by how alike they are, and more for each, since some are the same. With 1.2 errors fall
by another 0.1 %, but æ is hardly less wide than ɛ."""
MIN_TOKENS = 3
"""Least number of tokens with a feature; rarer ones are noise."""
BLOCK = 256
"""Columns of the normal matrix that are computed at a time."""


def fit_context(sentences: Sequence[Sequence[Token]], weights: Sequence[Array]) -> ContextModel:
    """Learn the model.

    Parameters
    ----------
    weights : sequence of (N, keyframes, K) arrays
        Captured weights at :data:`FRACTIONS` of each token. Rows of silences are ignored, and so are rows with NaN:
        tokens that were not captured, but are neighbours of others. Letters without a gesture (h) are left out: one
        speaker's were all before w, and looked like it.
    """
    goals: list[Array] = []
    letters: list[str] = []
    lengths: list[tuple[float, float, float]] = []
    said: list[tuple[int, float]] = []
    column_of: dict[str, int] = {}
    columns, values, ends = array("i"), array("d"), array("i", [0])  # not lists: some 250 features a token
    for sentence, (tokens, captured) in enumerate(zip(sentences, weights, strict=True)):
        for index, token in enumerate(tokens):
            if token.name == SILENCE or not ways(token.heard[0]) or np.isnan(captured[index]).any():
                continue
            named = features(tokens, index)
            columns.extend(column_of.setdefault(name, len(column_of)) for name in named)
            values.extend(named.values())
            ends.append(len(columns))
            goals.append(captured[index])
            letters.append(letters_around(tokens, index))
            lengths.append(lengths_around(tokens, index))
            said.append((sentence, token.start_s))
    if not goals:
        raise UsageError("sentences: contain no spoken phone")
    from scipy.linalg import solve  # only fitting needs them: planning starts without
    from scipy.sparse import csr_array

    goal = np.stack(goals).reshape(len(goals), -1)
    seen = np.bincount(columns, minlength=len(column_of))
    names = sorted(name for name, column in column_of.items() if seen[column] >= min(MIN_TOKENS, len(goals)))
    design = csr_array((values, columns, ends), shape=(len(goals), len(column_of)))
    design = design[:, [column_of[name] for name in names]]
    own = csr_array(_of_sentences(said))
    shared = own.T @ design
    near, picked = _likeness(letters, np.array(lengths))
    shared_near = own.T @ near
    size = len(names)
    normal = np.empty((size + len(picked), size + len(picked)), order="F")
    for start in range(0, size, BLOCK):  # as a sparse matrix it would be larger than as a full one
        part = slice(start, min(start + BLOCK, size))
        normal[:size, part] = (design.T @ design[:, part]).toarray() - (shared.T @ shared[:, part]).toarray()
    normal[:size, size:] = design.T @ near - shared.T @ shared_near
    normal[size:, :size] = normal[:size, size:].T
    normal[size:, size:] = near.T @ near - shared_near.T @ shared_near + EXAMPLES_PENALTY * near[picked]
    normal[np.diag_indices_from(normal)] += [*map(_penalty, names), *np.full(len(picked), ALIKE_PENALTY)]
    wanted = np.concatenate(
        [design.T @ goal - shared.T @ (own.T @ goal), near.T @ goal - shared_near.T @ (own.T @ goal)]
    )
    found = solve(normal, wanted, assume_a="pos", overwrite_a=True).reshape(-1, *goals[0].shape)
    examples = Examples(
        letters=tuple(letters[row] for row in picked), lengths=np.array(lengths)[picked], adds=found[size:]
    )
    return add_unrecorded(
        ContextModel(fractions=FRACTIONS, features=tuple(names), coefficients=found[:size], examples=examples)
    )


def _likeness(letters: Sequence[str], lengths: Array) -> tuple[Array, NDArray[np.intp]]:
    """(N, M) likeness of N tokens with the examples among them, and (M,) indices of these."""
    picked = np.unique(np.linspace(0, len(letters) - 1, min(EXAMPLES, len(letters))).round().astype(np.intp))
    likeness = Likeness([letters[row] for row in picked], lengths[picked])
    near = np.zeros((len(letters), len(picked)))
    unlike = cache(likeness.unlike)
    for row, one in enumerate(letters):
        near[row] = likeness.of(np.sum([unlike(*at) for at in enumerate(one)], axis=0), lengths[row])
    return near, picked


def _of_sentences(said: Sequence[tuple[int, float]]) -> tuple[Array, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Values, rows and columns of each sentence's offset and drift, for tokens of ``(sentence, time in s)``.

    A column of ones and one of times from their mean for each sentence, orthogonal, so that ridge regression on them
    with others is what their products, divided by sums of squares and :data:`SENTENCE`, subtract from the others'.
    """
    sentences, times_s = np.array(said).T
    _, sentence, count = np.unique(sentences, return_inverse=True, return_counts=True)
    drift = times_s - (np.bincount(sentence, times_s) / count)[sentence]
    ones = 1.0 / np.sqrt(count + SENTENCE)
    slopes = 1.0 / np.sqrt(np.bincount(sentence, drift**2) + SENTENCE)
    values = np.concatenate([ones[sentence], slopes[sentence] * drift])
    tokens = np.arange(len(sentence))
    return values, (np.concatenate([tokens, tokens]), np.concatenate([sentence, sentence + len(count)]))


def _penalty(name: str) -> float:
    kind, *rest = name.split(" ")
    by_distance = PENALTIES[kind]
    return by_distance[abs(int(rest[0]))] if len(by_distance) > 1 else by_distance[0]


def add_unrecorded(model: ContextModel) -> ContextModel:
    """Add a row for every IPA letter that is missing in the model and that a rule covers."""
    recorded = tuple(name.removeprefix("phone ") for name in model.features if name.startswith("phone "))
    recorded = tuple(name for name in recorded if " " not in name and not name.startswith(IN_NAME))
    looks = {name: look_of(model, name) for name in recorded}
    rows: dict[str, Array] = {}
    for letter in [*ipa.SOUNDS, *ipa.SOUNDS]:  # twice: a twin may itself be derived
        look = None if letter in looks else _from_others(letter, recorded, looks)
        if look is not None:
            looks[letter] = look
            rows[f"phone {letter}"] = look - look_of(model, letter)
    return _with_rows(model, rows)


def look_of(model: ContextModel, name: str) -> Array:
    """(keyframes, K): a phone by itself, of typical length."""
    return _added_up(model, alone(Part(name, ipa.letters(name)[0])))


def _added_up(model: ContextModel, named: Mapping[str, float]) -> Array:
    """(keyframes, K): sum of the features that the model has."""
    total = np.zeros(model.coefficients.shape[1:])
    for feature, value in named.items():
        if feature in model.rows:
            total += value * model.coefficients[model.rows[feature]]
    return total


def _from_others(letter: str, recorded: tuple[str, ...], looks: Mapping[str, Array]) -> Array | None:
    """(keyframes, K): a letter that was not recorded, by the rules of the theory of operation; None if none fits."""
    if ipa.SOUNDS[letter].vowel:
        return _between(letter, recorded, looks)
    if ways(letter):
        twin = next((other for other in looks if len(other) == 1 and _lips_do_the_same(letter, other)), None)
        if twin is not None:
            return looks[twin]
    if letter in GESTURELESS:
        vowels = [looks[name] for name in recorded if len(name) == 1 and ipa.SOUNDS[name].vowel]
        return np.mean(vowels, axis=0) if vowels else None
    affricate = next((name for name in recorded if len(name) == 2 and name[1] == letter), None)
    return None if affricate is None else np.repeat(looks[affricate][-1:], len(looks[affricate]), axis=0)


def _lips_do_the_same(letter: str, other: str) -> bool:
    one, two = (replace(ipa.SOUNDS[each], voiced=True) for each in (letter, other))
    apart = max(abs(ways(letter).get(way, 0.0) - ways(other).get(way, 0.0)) for way in LIPS)
    return one == two and apart <= TWINS_APART


def _between(letter: str, recorded: tuple[str, ...], looks: Mapping[str, Array]) -> Array | None:
    sound = ipa.SOUNDS[letter]

    def far(name: str) -> tuple[float, float, float]:
        other = ipa.SOUNDS[name]
        spread = abs(ways(name).get("round", 0.0) - ways(letter).get("round", 0.0))
        return abs(other.opening - sound.opening), abs(other.place - sound.place), spread

    vowels = [(name, ipa.SOUNDS[name]) for name in recorded if len(name) == 1 and ipa.SOUNDS[name].vowel]
    likes = [
        (name, other.opening) for name, other in vowels
        if other.rounding == sound.rounding and (sound.rounding == 1.0 or abs(other.place - sound.place) <= NEAR_PLACE)
    ]  # fmt: skip
    closer = [name for name, opening in likes if opening <= sound.opening]
    opener = [name for name, opening in likes if opening >= sound.opening]
    if not closer or not opener:
        return None
    low, high = min(closer, key=far), min(opener, key=far)
    span = ipa.SOUNDS[high].opening - ipa.SOUNDS[low].opening
    part = (sound.opening - ipa.SOUNDS[low].opening) / span if span else 0.0
    return np.asarray((1 - part) * looks[low] + part * looks[high])


TAKEN_BACK = 0.35
"""Fraction of the move that a recorded pair undoes; a token is in two pairs. With half, i opens by 0.3 mm less than ɪ
in running English, where 0.5 mm are seen."""
ALONE_S = 0.3
"""Length of a letter said alone."""
INNER_LIPS = ("2.2", "2.3")
"""Feature points in the middle of the inner lips, upper and lower."""


def lean_on_phonetics(model: ContextModel, space: VisemeSpace, phones: Mapping[str, PhoneTarget]) -> ContextModel:
    """Move letters to the openings of phonetics, except between recorded neighbours.

    Parameters
    ----------
    space : VisemeSpace
        Of the model's weights.
    phones : mapping of str to PhoneTarget
        Have the pose that goes with a drop of the chin.

    Returns
    -------
    ContextModel
        The same if no vowel of the table was recorded, or where the inner lips are not among the space's points.
    """
    lengths = {name.split(" ")[1] for name in model.features if name.startswith("phone ") and name.endswith(" length")}
    vowels = [letter for letter in OPENINGS if letter in lengths and SOUNDS[letter].vowel]
    if not vowels or not set(INNER_LIPS) <= set(space.points):
        return model
    pose = jaw_pose(space, phones)
    reach_mm = float(_opening(pose, space))
    if reach_mm <= 0:
        return model
    diphthongs = [name for name in lengths if len(name) == 2 and VOWELS.issuperset(name)]
    looks = {
        name: _opening(look_of(model, name) + _added_by_examples(model, name), space)
        for name in (*OPENINGS, *diphthongs)
    }
    scale = np.mean([looks[letter] for letter in vowels]) / np.mean([OPENINGS[letter] for letter in vowels])
    moves: dict[str, Array] = {}
    for name, opens_mm in looks.items():
        if name in OPENINGS:
            lacks_mm = np.full(len(opens_mm), scale * OPENINGS[name] - opens_mm.mean())
        else:  # each keyframe by its letter; a rounded one stays
            usual = [OPENINGS.get(letter, np.nan) for letter in name]
            lacks_mm = np.nan_to_num(scale * np.array(usual) - opens_mm)
        moves[name] = np.outer(lacks_mm / reach_mm, pose)
    coefficients = model.coefficients.copy()
    for row, name in enumerate(model.features):
        kind, *rest = name.split(" ")
        if kind == "phone" and len(rest) == 1 and rest[0] in moves:
            coefficients[row] += moves[rest[0]]
        elif kind == "pair" and rest[2] in moves:
            coefficients[row] -= TAKEN_BACK * moves[rest[2]]
    leaning = _with_rows(
        replace(model, coefficients=coefficients), {f"phone {letter}": move for letter, move in moves.items()}
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


def _added_by_examples(model: ContextModel, name: str) -> Array:
    """(keyframes, K): what examples add to a phone in place of each of them, of typical length; the mean."""
    examples = model.examples
    letters, likeness = ipa.letters(name), Likeness(examples.letters, examples.lengths)
    if not examples.letters:
        return np.zeros(model.coefficients.shape[1:])
    unlike = cache(likeness.unlike)
    own = f"{letters[0]}{letters[-1]}"
    placed = [f"{one[:REACH]}{own}{one[REACH + 2 :]}" for one in examples.letters]
    alike = [likeness.of(np.sum([unlike(*at) for at in enumerate(one)], axis=0), np.zeros(3)) for one in placed]
    return np.asarray(np.tensordot(np.mean(alike, axis=0), examples.adds, axes=1))


def _with_rows(model: ContextModel, rows: Mapping[str, Array]) -> ContextModel:
    """Add rows of coefficients, (keyframes, K) each, that are missing in a model; those that it has do not change."""
    new = [name for name in rows if name not in model.rows]
    if not new:
        return model
    coefficients = np.concatenate([model.coefficients, np.stack([rows[name] for name in new])])
    return replace(model, features=(*model.features, *new), coefficients=coefficients)


def _alone(model: ContextModel, letter: str) -> Array:
    """(K,): a letter between pauses, the mean of its keyframes."""
    phone = Phone(letter, 0.0, ALONE_S)
    named = features([Token(phone, letter, (letter,), 0.0, ALONE_S)], 0)
    return np.asarray(_added_up(model, named).mean(axis=0))


def _opening(weights: Array, space: VisemeSpace) -> Array:
    """Distance between the inner lips, mm, (...), of weights (..., K)."""
    upper, lower = (space.points.index(name) for name in INNER_LIPS)
    moved = space.to_points_mm(np.atleast_2d(weights))
    return np.asarray(moved[:, upper, 1] - moved[:, lower, 1]).reshape(weights.shape[:-1])
