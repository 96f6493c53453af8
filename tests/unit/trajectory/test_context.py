"""Targets that depend on neighbours."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.laboratory import context_fit
from fapengine.laboratory.context_fit import FRACTIONS, fit_context
from fapengine.profiles import ContextModel, Profile
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.context import (
    PAUSE_S,
    REACH,
    UNLIKE_LENGTHS,
    UNLIKE_WAYS,
    Token,
    features,
    lengths_around,
    letters_around,
    tables_of,
    tokens_of,
    ways,
)
from fapengine.trajectory.targets import weights_of
from tests.english import english


def track(spelling: str, *, each_s: float = 0.1, lead_s: float = 0.3) -> PhoneTrack:
    labels = spelling.split()
    times = lead_s + each_s * np.arange(len(labels) + 1)
    return PhoneTrack.from_phones([Phone(label, *span) for label, *span in zip(labels, times, times[1:], strict=False)])


def targets(tokens: list[Token], model: ContextModel) -> np.ndarray:
    """(N, keyframes, K): weights at the model's fractions of every token of a track; 0 for silences."""
    tables, around = tables_of(model), [tables_of(model).silence] * REACH
    kinds = np.array([*around, *(tables.kind(token.heard) for token in tokens), *around])
    lengths_s = [PAUSE_S if token.name == SILENCE else token.end_s - token.start_s for token in tokens]
    own = np.array([n for n, token in enumerate(tokens) if token.name != SILENCE], np.intp)
    found = np.zeros((len(tokens), *model.coefficients.shape[1:]))
    around_s = [PAUSE_S] * REACH
    found[own], _ = tables.targets(kinds, np.array([*around_s, *lengths_s, *around_s]), own + REACH)
    return found


def look(spelling: str, index: int) -> np.ndarray:
    """Weights of one phone at its first key."""
    tokens, _ = tokens_of(track(spelling), english().phones)
    return targets(tokens, english().context)[index + 1, 0]


def width(weights: np.ndarray) -> float:
    points = dict(zip(english().space.points, english().space.to_points_mm(weights), strict=True))
    return float(points["8.3"][0] - points["8.4"][0])


def added_by_examples(tokens: list[Token], index: int, model: ContextModel) -> np.ndarray:
    """(keyframes, K): what examples add to a token, one by one."""

    def apart(one: str, other: str) -> float:
        return sum((ways(one).get(way, 0.0) - ways(other).get(way, 0.0)) ** 2 for way in {*ways(one), *ways(other)})

    total, own = np.zeros(model.coefficients.shape[1:]), letters_around(tokens, index)
    for letters, lengths, adds in zip(model.examples.letters, model.examples.lengths, model.examples.adds, strict=True):
        unlike = sum(weight * apart(*pair) for weight, *pair in zip(UNLIKE_WAYS, own, letters, strict=True))
        unlike += ((np.array(lengths_around(tokens, index)) - lengths) ** 2) @ UNLIKE_LENGTHS
        total += np.exp(-unlike) * adds
    return total


def test_targets_are_the_sum_of_the_features() -> None:
    """What is summed beforehand for each kind of token is what the features and the examples say one by one."""
    model = english().context
    for spelling in ("b aɪ m", "s _ ŋ ɔɪ _ _ tʃ", "ʁ", "_", "p b p b p b p"):
        tokens, _ = tokens_of(track(spelling, each_s=0.07), english().phones)
        for token, found in zip(tokens, targets(tokens, model), strict=True):
            named = features(tokens, tokens.index(token)) if token.name != SILENCE else {}
            known = {name: value for name, value in named.items() if name in model.rows}
            wanted = sum((value * model.coefficients[model.rows[name]] for name, value in known.items()), 0 * found)
            if named:
                wanted += added_by_examples(tokens, tokens.index(token), model)
            np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert targets([], model).shape == (0, *model.coefficients.shape[1:])


def test_a_vowel_that_is_held_for_a_minute_opens_no_farther_than_a_long_one() -> None:
    looks = []
    for each_s in (0.2, 0.4, 60.0):
        tokens, _ = tokens_of(track("m ɑ b", each_s=each_s), english().phones)
        looks.append(targets(tokens, english().context))
    np.testing.assert_allclose(looks[2], looks[1])
    assert np.abs(looks[1] - looks[0]).max() > 0.5


def test_lips_foresee_the_vowel() -> None:
    assert width(look("s uː", 0)) < width(look("s iː", 0)) - 0.5  # mm
    assert width(look("uː s", 1)) < width(look("iː s", 1)) - 2.0


def test_phones_that_were_never_heard_look_like_their_likes() -> None:
    def apart(one: str, other: str) -> float:
        a, b = (look(f"ɑ {phone} ɑ", 1) for phone in (one, other))
        return float(np.linalg.norm(a - b))

    assert apart("ʃ", "tʃ") < apart("ʃ", "m")
    assert apart("ŋ", "n") < apart("ŋ", "w")
    assert apart("ʊ", "u") < apart("ʊ", "æ")
    for label in ("ɹ̩", "ʁ", "y", "ɓ", "ɔɪ"):
        tokens, _ = tokens_of(track(f"t {label} t"), english().phones)
        found = targets(tokens, english().context)
        reach = np.stack([phone.targets[0] for phone in english().phones.values()])
        room = 0.6 * np.ptp(reach, axis=0).max()
        assert (found >= reach.min(axis=0) - room).all()
        assert (found <= reach.max(axis=0) + room).all()


def test_silence_has_no_target_and_its_length_no_effect() -> None:
    short, long = (tokens_of(track("b aɪ", lead_s=lead), english().phones)[0] for lead in (0.2, 3.0))
    np.testing.assert_allclose(targets(short, english().context), targets(long, english().context), atol=1e-9)
    assert not targets(short, english().context)[0].any()


def test_tokens_share_a_strange_labels_time() -> None:
    tokens, strange = tokens_of(track("ɔɪ %"), english().phones)
    assert [token.name for token in tokens] == [SILENCE, "ɔ", "ɪ", "ə"]
    assert [token.start_s for token in tokens] == pytest.approx([0.0, 0.3, 0.35, 0.4])
    assert [token.end_s for token in tokens[:-1]] == pytest.approx([token.start_s for token in tokens[1:]])
    assert strange == ["%"]
    assert tokens[1].heard == ("ɔ",)


@pytest.mark.parametrize(
    ("word", "spelling", "is_name"),
    [
        ("B", "b iː", True), ("z", "z ɛ d", True), ("x", "ɛ k s", True), ("(C),", "s iː", True), ("’T’", "t iː", True),
        ("", "b iː", False), ("bee", "b iː", False),
        ("m", "m iː t ə z", False), ("g", "ɡ ɹ a m z", False), ("B", "b eː", False), ("b", "%", False),
    ],
)  # fmt: skip
def test_a_vowel_has_a_kind_of_its_own_in_the_english_name_of_a_letter(word: str, spelling: str, is_name: bool) -> None:
    """An m that is said as metres, or the German name of B, is like any other word."""
    said, plain = (poses_of_word(spelling, one, english()) for one in (word, "word"))
    assert (np.abs(said - plain).max() > 1e-3) == is_name


def test_a_model_that_heard_no_letters_says_their_names_like_words() -> None:
    model = english().context
    rows = [row for row, name in enumerate(model.features) if "+" not in name]
    kept = tuple(model.features[row] for row in rows)
    wordless = replace(
        english(), context=replace(model, features=kept, coefficients=np.asarray(model.coefficients)[rows])
    )
    np.testing.assert_array_equal(poses_of_word("b iː", "b", wordless), poses_of_word("b iː", "", wordless))


def poses_of_word(spelling: str, word: str, profile: Profile) -> np.ndarray:
    spoken = PhoneTrack.from_phones(
        [replace(phone, word=word) for phone in track(spelling).phones if not phone.is_silence]
    )
    return weights_of(spoken, profile, np.arange(0.0, spoken.phones[-1].end_s, 0.02))


def test_features_say_who_stands_where() -> None:
    tokens, _ = tokens_of(track("b aɪ m"), english().phones)
    found = features(tokens, 2)
    assert found["phone aɪ"] == found["letter -1 b"] == found["letter 1 m"] == found["pair -1 b aɪ"] == 1.0
    assert found["letter 2 _"] == found["way 2 silent"] == found["triple b aɪ m"] == 1.0
    assert found["way 0 opening"] == ways("a")["opening"]
    assert found["cross -1 opening lips"] == ways("a")["opening"] * ways("b")["lips"]
    assert found["cross 1 opening nasal"] == ways("ɪ")["opening"], "its last letter stands beside m"
    assert found["length 0"] == pytest.approx(0.0)
    assert "letter 0 a" not in found


def test_what_follows_rules_is_learned() -> None:
    """Weights made from identity and the vowel ahead come back, on sentences that were not shown."""
    rng = np.random.default_rng(0)
    own = {name: rng.normal(0, 3, 2) for name in english().phones}
    ahead = {name: rng.normal(0, 1, 2) for name in (*english().phones, SILENCE)}
    names = [name for name in english().phones if len(name) == 1 and ways(name)]

    def sentence() -> tuple[list, np.ndarray]:
        tokens, _ = tokens_of(track(" ".join(rng.choice(names, 9))), english().phones)
        following = [*(token.name for token in tokens[1:]), SILENCE]
        weights = [
            own.get(token.name, np.zeros(2)) + ahead[after] for token, after in zip(tokens, following, strict=True)
        ]
        return tokens, np.tile(np.array(weights)[:, None], (1, len(FRACTIONS), 1))

    shown = [sentence() for _ in range(200)]
    model = fit_context([tokens for tokens, _ in shown], [weights for _, weights in shown])
    tokens, weights = sentence()
    error = np.abs(targets(tokens, model)[1:] - weights[1:])
    assert error.mean() < 0.35
    assert error.mean() < 0.17 * np.abs(weights).mean()  # of nine phones a sentence's own takes a little


def test_examples_teach_what_no_sum_can_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short phone before a short one is an exception; others are as their letters say."""
    rng = np.random.default_rng(0)

    def sentence() -> tuple[list, np.ndarray]:
        lengths_s = rng.choice([0.05, 0.2], 12)
        times = 0.3 + np.append(0.0, np.cumsum(lengths_s))
        phones = [Phone(str(rng.choice(["i", "s"])), *span) for span in pairwise(times)]
        tokens, _ = tokens_of(PhoneTrack.from_phones(phones), english().phones)
        after = [*(token.end_s - token.start_s for token in tokens[1:]), PAUSE_S]
        said = [
            4.0 * (token.end_s - token.start_s < 0.1 and next_s < 0.1)
            for token, next_s in zip(tokens, after, strict=True)
        ]
        return tokens, np.tile(np.array(said)[:, None, None], (1, len(FRACTIONS), 1))

    shown, (tokens, weights) = [sentence() for _ in range(100)], sentence()

    def error() -> float:
        model = fit_context([tokens for tokens, _ in shown], [weights for _, weights in shown])
        return float(np.abs(targets(tokens, model)[1:] - weights[1:]).mean())

    with_examples = error()
    monkeypatch.setattr(context_fit, "EXAMPLES", 1)
    assert with_examples < 0.5 * error()


@pytest.mark.parametrize("seed", range(3))
def test_what_is_a_sentences_own_does_not_bend_its_phones(seed: int) -> None:
    """Sentences of nine phones, each with an offset and a drift; errors of others without, 2.0 to 2.4 if they count."""
    rng = np.random.default_rng(seed)
    names = [name for name in english().phones if len(name) == 1 and ways(name)]
    own = {name: rng.normal(0, 3) for name in names}

    def sentence(offset: float, drift: float) -> tuple[list, np.ndarray]:
        tokens, _ = tokens_of(track(" ".join(rng.choice(names, 9))), english().phones)
        said = [own.get(token.name, 0.0) + offset + drift * (token.start_s - 0.75) for token in tokens]
        return tokens, np.tile(np.array(said)[:, None, None], (1, len(FRACTIONS), 1))

    shown = [sentence(*rng.normal(0, 6, 2)) for _ in range(60)]
    model = fit_context([tokens for tokens, _ in shown], [weights for _, weights in shown])
    others = [sentence(0.0, 0.0) for _ in range(20)]
    errors = [np.abs(targets(tokens, model)[1:] - weights[1:]).mean() for tokens, weights in others]
    assert np.mean(errors) < 1.8


def test_what_was_not_captured_teaches_nothing_but_stands_beside_others() -> None:
    tokens, _ = tokens_of(track("b i b i b i b i"), english().phones)
    weights = np.ones((len(tokens), 2, 1))
    weights[2::2] = np.nan
    model = fit_context([tokens], [weights])
    assert "phone i" not in model.features
    assert "letter 1 i" in model.features
    assert np.isfinite(model.coefficients).all()


def test_h_is_as_its_neighbours_make_it() -> None:
    """The recorded speaker said h before w alone; a face that learned that would round its lips for every h."""
    rows = [english().space.points.index(name) for name in ("2.2", "2.3")]
    opening = {
        vowel: float(np.subtract(*english().space.to_points_mm(look(f"h {vowel}", 0))[rows, 1])) for vowel in "ɛiu"
    }
    assert opening["ɛ"] > opening["u"] + 1.0
    assert opening["ɛ"] > 6.0  # mm
    assert width(look("h i", 0)) > width(look("h u", 0)) + 0.4


def test_h_takes_the_shape_of_what_follows() -> None:
    """And at a track's end of what went before; it used to open by 8.9 mm before w, where the speaker has 2.1."""
    points = [english().space.points.index(name) for name in ("2.2", "2.3")]

    def opening(weights: np.ndarray) -> float:
        return float(np.subtract(*english().space.to_points_mm(weights)[points, 1]))

    def keys(spelling: str) -> np.ndarray:
        tokens, _ = tokens_of(track(spelling), english().phones)
        return targets(tokens, english().context)[1:]

    before_w = keys("h w aɪ t")
    assert opening(before_w[0, -1]) < opening(before_w[1, 0]) + 0.5 < 5.0
    between = keys("ɑ h i")
    mixed = 0.35 * between[0, -1] + 0.65 * between[2, 0]
    np.testing.assert_allclose(between[1, 0], mixed, atol=0.3 * np.abs(mixed).max())
    last = keys("b ɑ h")
    np.testing.assert_allclose(last[2, 0], last[2, -1])
    assert abs(opening(last[2, 0]) - opening(last[1, -1])) < 2.0
    alone = keys("h")
    assert opening(alone[0, 0]) > 5.0
    assert np.abs(keys("h ʔ")[0] - keys("h ɑ")[0]).max() > 0


def test_nothing_said_is_nothing_learned() -> None:
    tokens, _ = tokens_of(PhoneTrack.from_phones([Phone(SILENCE, 0.0, 1.0)]), english().phones)
    with pytest.raises(UsageError, match="no spoken phone"):
        fit_context([tokens], [np.zeros((1, 2, 3))])


def test_a_model_has_one_row_for_each_feature() -> None:
    with pytest.raises(UsageError, match="coefficients"):
        ContextModel(fractions=(0.5,), features=("a", "b"), coefficients=np.zeros((1, 1, 2)))
    with pytest.raises(UsageError, match="features: got 'a' twice"):
        ContextModel(fractions=(0.5,), features=("a", "b", "a"), coefficients=np.zeros((3, 1, 2)))


@pytest.mark.parametrize("label", ["tʃaɪ", "kptm", "ɡɡɡ"])
def test_the_letters_of_a_label_that_is_not_known_share_its_time(label):
    both, _ = tokens_of(PhoneTrack.from_phones([Phone(label, 0.5, 1.1)]), english().phones)
    tokens = [token for token in both if token.name != SILENCE]
    assert len(tokens) > 1
    assert (tokens[0].start_s, tokens[-1].end_s) == pytest.approx((0.5, 1.1))
    lengths_s = [token.end_s - token.start_s for token in tokens]
    assert lengths_s == pytest.approx([0.6 / len(tokens)] * len(tokens))
    assert [token.start_s for token in tokens[1:]] == pytest.approx([token.end_s for token in tokens[:-1]])
