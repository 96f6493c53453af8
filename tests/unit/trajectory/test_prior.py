"""Vowels open in the order of their height, but where the speaker was heard to say otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.laboratory.context_fit import TAKEN_BACK, lean_on_phonetics
from fapengine.mpeg4 import fap
from fapengine.profiles import ContextModel
from fapengine.speech.articulation import OPENINGS, OPENINGS_ALONE
from fapengine.speech.ipa import SOUNDS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.context import tokens_of
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.trajectory.test_context import targets, track

HEARD = {"phone i": 5.0, "phone i length": 0.0, "phone ɑ": 5.0, "phone ɑ length": 0.0, "pair -1 b i": 0.0,
         "pair 1 t i": 0.0}  # fmt: skip
"""A speaker whose i, heard between b and t, opens as far as his ɑ; mm of the jaw's drop."""


def opening_mm(spelling: str, vowel: str, each_s: float) -> float:
    """Way between the inner lips over the middle half of a vowel."""
    mm = pose_mm(spelling, vowel, each_s)
    return float(-(mm[fap.column(4)] + mm[fap.column(5)]))


def pose_mm(spelling: str, vowel: str, each_s: float) -> np.ndarray:
    """(68,) mm: mean over the middle half of a vowel."""
    labels = spelling.format(vowel).split()
    edges = 0.3 + each_s * np.arange(len(labels) + 1)
    spoken = [Phone(label, *span) for label, *span in zip(labels, edges[:-1], edges[1:], strict=True)]
    phones = PhoneTrack.from_phones([Phone(SILENCE, 0.0, 0.3), *spoken, Phone(SILENCE, edges[-1], edges[-1] + 0.3)])
    faps = plan(phones, english(), rng=np.random.default_rng(0), rate_hz=100.0, style=Style.speech_only()).track.values
    at = 0.3 + each_s * (labels.index(vowel) + np.array([0.25, 0.75]))
    return np.asarray(faps[round(100 * at[0]) : round(100 * at[1]) + 1].mean(axis=0) * english().fapu.steps())


@pytest.mark.parametrize(("frame", "each_s"), [("{}", 0.4), ("h {} d", 0.15)])
def test_unrounded_vowels_open_in_the_order_of_their_height(frame: str, each_s: float) -> None:
    found = {vowel: opening_mm(frame, vowel, each_s) for vowel in "iɪeɛæaɑɨɯ"}
    assert max(found[vowel] for vowel in "iɪeɨɯ") < min(found[vowel] for vowel in "ɛæaɑ") - 1.5, found
    assert found["i"] < found["ɑ"] - 2.5, "a stranger does not see ee gape as ah does"
    assert found["i"] < min(found["ɪ"], found["e"]) + 0.5
    assert found["ɛ"] < max(found["æ"], found["a"])


@pytest.mark.parametrize("each_s", [0.2, 0.3, 0.4])
def test_vowels_said_alone_open_in_steps_that_are_seen(each_s: float) -> None:
    found = [opening_mm("{}", vowel, each_s) for vowel in "ieɛæaɑ"]
    assert np.diff(found).min() >= 0.8, found
    assert found[0] + 0.4 < opening_mm("{}", "ɪ", each_s) < found[1] - 0.4
    assert 4.5 < opening_mm("{}", "ɹ", each_s) < found[0], "2.9 before: it hardly opened"


@pytest.mark.parametrize("each_s", [0.2, 0.4])
def test_the_closer_a_front_vowel_the_wider(each_s: float) -> None:
    corners = [fap.column(number) for number in (53, 54)]
    found = [float(pose_mm("{}", vowel, each_s)[corners].sum()) for vowel in "æɛei"]
    assert np.diff(found)[0] >= 0.3, "as captured between at and set"
    assert np.diff(found)[1:].min() >= 0.6, found


@pytest.mark.parametrize("frame", ["s {} t", "p {} t", "k {} n", "h {} d"])
def test_vowels_open_by_height_between_consonants_of_letters_names(frame: str) -> None:
    """The speaker said i between s or p and t in the letters C and P alone; "seat" opened farther than "pot"."""
    found = {vowel: opening_mm(frame, vowel, 0.15) for vowel in "iɛæɑ"}
    assert found["i"] + 0.5 < found["ɛ"] < found["æ"] < found["ɑ"] - 0.5, found


def test_a_vowel_opens_farther_in_the_name_of_a_letter() -> None:
    def opens_mm(word: str) -> float:
        said = [Phone("s", 0.3, 0.45, word=word), Phone("i", 0.45, 0.6, word=word), Phone("t", 0.6, 0.7, word="to")]
        faps = plan(
            PhoneTrack.from_phones(said),
            english(),
            rng=np.random.default_rng(0),
            rate_hz=100.0,
            style=Style.speech_only(),
        )
        mm = faps.track.values[45:60] * english().fapu.steps()
        return float((-mm[:, fap.column(4)] - mm[:, fap.column(5)]).max())

    assert opens_mm("C") == opens_mm("c") > opens_mm("sea") + 1.0
    assert opens_mm("") == opens_mm("sea")


def made(**changes: float) -> ContextModel:
    """A model of HEARD alone, in English's space."""
    values = {**HEARD, **changes}
    drop = -english().space.modes_mm[:, english().space.points.index("2.1"), 1]
    pose = drop / (drop @ drop)
    rows = np.array(list(values.values()))[:, None, None] * np.ones((1, 2, 1)) * pose
    return ContextModel(fractions=(0.2, 0.7), features=tuple(values), coefficients=rows)


def moved(spelling: str, index: int) -> np.ndarray:
    tokens, _ = tokens_of(track(spelling), english().phones)
    before = made()
    after = lean_on_phonetics(before, english().space, english().phones)
    return np.asarray(targets(tokens, after)[index + 1] - targets(tokens, before)[index + 1])


def test_what_was_heard_on_both_sides_goes_least_and_what_was_heard_on_one_side_farther() -> None:
    whole = moved("s i m", 1)
    assert np.abs(whole).max() > 0.1
    np.testing.assert_allclose(moved("b i t", 1), whole * (1 - 2 * TAKEN_BACK))
    np.testing.assert_allclose(moved("b i m", 1), whole * (1 - TAKEN_BACK))
    np.testing.assert_allclose(moved("s i t", 1), whole * (1 - TAKEN_BACK))
    assert (moved("s ɑ m", 1) * whole < 0).any(), "the other way"


def test_alone_a_letter_opens_as_the_table_has_it_but_beside_a_pause_that_it_was_heard_beside() -> None:
    tokens = {letter: tokens_of(track(letter, each_s=0.3), english().phones)[0] for letter in "iɛɑ"}
    space = english().space
    rows = [space.points.index(name) for name in ("2.2", "2.3")]

    def opening(letter: str, **heard: float) -> float:
        model = lean_on_phonetics(made(**heard), space, english().phones)
        points = space.to_points_mm(targets(tokens[letter], model)[1].mean(axis=0))
        return float(np.subtract(*points[rows, 1]))

    scale = (opening("ɑ") - opening("i")) / (OPENINGS_ALONE["ɑ"] - OPENINGS_ALONE["i"])
    assert scale > 0.0
    assert opening("ɛ") - opening("i") == pytest.approx(scale * (OPENINGS_ALONE["ɛ"] - OPENINGS_ALONE["i"]))
    before, behind = "pair -1 _ i", "pair 1 _ i"
    assert opening("i", **{before: 0.0, behind: 0.0}) > opening("i", **{before: 0.0}) > opening("i")


def test_consonants_and_round_vowels_stay() -> None:
    assert OPENINGS_ALONE.keys() == OPENINGS.keys()
    for label in "tsuoθ":
        np.testing.assert_array_equal(moved(label, 0), 0.0)


def test_an_unheard_vowel_gets_a_row_of_its_own() -> None:
    found = lean_on_phonetics(made(), english().space, english().phones)
    assert {f"phone {letter}" for letter in OPENINGS} <= set(found.features)
    assert len(set(found.features)) == len(found.features)


def test_without_vowels_or_a_jaw_nothing_is_said() -> None:
    space, phones = english().space, english().phones
    names = ("phone t", "phone t length")
    silent = ContextModel(fractions=(0.2, 0.7), features=names, coefficients=np.zeros((2, 2, space.mode_count)))
    assert lean_on_phonetics(silent, space, phones) is silent
    still = {name: replace(phone, targets=np.zeros_like(phone.targets)) for name, phone in phones.items()}
    model = made()
    assert lean_on_phonetics(model, space, still) is model, "no pose drops the chin"


def test_the_table_is_of_unrounded_vowels_and_rises_with_the_chart() -> None:
    assert set(OPENINGS) - set("ɹl") == {
        letter for letter, sound in SOUNDS.items() if sound.vowel and sound.rounding == 0
    }
    for one, other in (("i", "ɪ"), ("e", "ɛ"), ("ɛ", "æ"), ("æ", "a"), ("ɨ", "ə"), ("ə", "ɐ"), ("ʌ", "ɑ")):
        assert OPENINGS[one] < OPENINGS[other]
        assert OPENINGS_ALONE[one] < OPENINGS_ALONE[other]
    assert max(abs(OPENINGS_ALONE[letter] - mm) for letter, mm in OPENINGS.items()) <= 1.5
