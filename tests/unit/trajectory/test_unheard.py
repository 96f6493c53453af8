"""Letters that nobody said in the recordings."""

import numpy as np
import pytest

from fapengine.laboratory.context_fit import add_unrecorded
from fapengine.profiles import ContextModel
from fapengine.trajectory.context import Part, alone, tokens_of
from tests.english import english
from tests.unit.trajectory.test_context import targets, track


def opening(spelling: str, index: int, each_s: float = 0.1) -> float:
    tokens, _ = tokens_of(track(spelling, each_s=each_s), english().phones)
    found = english().space.to_points_mm(targets(tokens, english().context)[index + 1, 0])
    points = dict(zip(english().space.points, found, strict=True))
    return float(points["2.2"][1] - points["2.3"][1])


@pytest.mark.parametrize("frame", ["{}", "h {} d", "t {} n"])
@pytest.mark.parametrize(("closer", "opener"), [("e", "ɛ"), ("u", "ʊ"), ("o", "ɔ"), ("y", "ø"), ("ø", "œ"), ("ʏ", "œ")])
def test_vowels_open_in_the_order_of_their_height(frame: str, closer: str, opener: str) -> None:
    index = frame.split().index("{}")
    assert opening(frame.format(closer), index) < opening(frame.format(opener), index) + 0.1  # mm: one in context


def test_e_and_o_are_told_from_open_e_and_open_o() -> None:
    assert opening("e", 0) < opening("ɛ", 0) - 0.5
    assert opening("e", 0, 0.2) < opening("ɛ", 0, 0.2) - 1.0
    assert opening("o", 0) < opening("ɔ", 0) - 0.3


def test_sh_is_the_end_of_ch_and_its_voiced_twin_looks_like_it() -> None:
    assert abs(opening("ɑ ʃ ɑ", 1) - opening("ɑ tʃ ɑ", 1)) < 1.5
    assert opening("ɑ ʒ ɑ", 1) == pytest.approx(opening("ɑ ʃ ɑ", 1), abs=0.01)
    assert opening("ɑ ʃ ɑ", 1) > opening("ɑ ɹ ɑ", 1) + 1.0, "protruded and open (Toda et al. 2003), unlike ɹ"


def model(**looks: float) -> ContextModel:
    """A model that knows these phones by nothing but themselves."""
    names = tuple(f"phone {name}" for name in looks)
    values = np.array(list(looks.values()))[:, None, None] * np.ones((1, 2, 1))
    return ContextModel(fractions=(0.2, 0.7), features=names, coefficients=values)


def value(found: ContextModel, letter: str) -> float:
    rows = [found.rows[name] for name in alone(Part(letter, letter)) if name in found.rows]
    return float(found.coefficients[rows].sum(axis=0)[0, 0])


def test_a_vowel_stands_between_those_above_and_below_it() -> None:
    found = add_unrecorded(model(i=1.0, ɛ=4.0, u=10.0, ɔ=16.0))
    assert value(found, "e") == pytest.approx(1.0 + 3.0 * 0.35 / 0.6)
    assert value(found, "o") == value(found, "ø") == pytest.approx(10.0 + 6.0 * 0.35 / 0.6)
    assert value(found, "i") == 1.0
    assert "phone a" not in found.rows, "nothing stands below it"
    assert "phone ɯ" not in found.rows, "i is in front"


def test_a_twin_lends_its_look_where_lips_do_the_same() -> None:
    found = add_unrecorded(model(θ=3.0, w=5.0, ʃ=7.0))
    assert value(found, "ð") == 3.0
    assert value(found, "ɥ") == 5.0
    assert "phone ɕ" not in found.rows, "its lips are spread"


def test_a_model_of_every_letter_stays_as_it_is() -> None:
    found = add_unrecorded(model(θ=3.0))
    assert add_unrecorded(found) is found
