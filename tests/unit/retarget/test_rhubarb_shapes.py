"""Rhubarb's mouth shapes of a motion."""

import numpy as np
import pytest

import fapengine
from fapengine.mpeg4 import fap
from fapengine.retarget.visemes import approximate_shapes
from fapengine.speech.formats.rhubarb import cues_of_phones

OPENING_FAPU = {"B": 200, "C": 380, "D": 560}
"""Steps of 0.021 mm: 4, 8 and 12 mm."""


def mouth(*, opening: float = 0.0, narrow: float = 0.0, jaw: float = 0.0) -> np.ndarray:
    faps = np.zeros((1, fap.FAP_COUNT))
    faps[0, fap.column(3)], faps[0, fap.column(5)] = jaw, -opening
    faps[0, [fap.column(6), fap.column(7)]] = -narrow
    return faps


@pytest.mark.parametrize(("shape", "opening"), OPENING_FAPU.items())
def test_opening_tells_unrounded_shapes(shape: str, opening: float) -> None:
    assert approximate_shapes(mouth(opening=opening, jaw=200), 30.0) == [shape]


def test_a_narrow_mouth_is_round_and_shut_lips_are_a_or_rest() -> None:
    assert approximate_shapes(mouth(opening=150, narrow=60, jaw=200), 30.0) == ["F"]
    assert approximate_shapes(mouth(opening=400, narrow=60, jaw=200), 30.0) == ["E"]
    assert approximate_shapes(mouth(jaw=200), 30.0) == ["A"]
    assert approximate_shapes(mouth(), 30.0) == ["X"]


def test_a_closure_without_the_jaw_is_known_by_its_neighbours() -> None:
    rows = np.concatenate([mouth(opening=300)] * 3 + [mouth()] * 3 + [mouth(opening=300)] * 3 + [mouth()] * 9)
    assert "".join(approximate_shapes(rows, 30.0)) == "BBBAAABBBXXXXXXXXX"


def test_lips_that_touch_in_planned_speech_are_found() -> None:
    spoken = fapengine.speak("My baby fell off a boat. Father, move five big umbrellas.", rate_hz=100.0)
    seen = approximate_shapes(spoken.track.values, 100.0)
    contacts = [cue for cue in cues_of_phones(spoken.phones) if cue.shape in "AG"]
    assert len(contacts) >= 12
    assert [cue for cue in contacts if cue.shape not in seen[cue.start_cs : cue.end_cs]] == []
    assert seen[0] == seen[-1] == "X"
