"""Articulatory features against panphon (MIT), which they were written down from."""

import itertools
import warnings

import pytest

from fapengine.speech import ipa
from fapengine.speech.ipa import ALIKE, FEATURES, ROWS, feature_distance, features


@pytest.fixture(scope="module")
def table():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # panphon's own imports warn
        import panphon

        return panphon.FeatureTable()


def test_every_letter_has_features() -> None:
    assert set(ipa.SOUNDS) == set(ROWS) | set(ALIKE)
    assert len(ROWS) >= 95
    assert all(len(features(letter)) == len(FEATURES) == 24 for letter in ipa.SOUNDS)


def test_rows_are_panphons(table) -> None:
    assert tuple(table.names) == FEATURES
    for letter in ROWS:
        assert tuple(table.fts(letter).numeric()) == features(letter), letter


def test_distances_rank_as_panphons_do(table) -> None:
    segments = {letter: table.fts(letter) for letter in ROWS}
    for one, other in itertools.combinations(ROWS, 2):
        assert segments[one].distance(segments[other]) == feature_distance(one, other), (one, other)
