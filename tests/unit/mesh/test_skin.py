"""Fields of real skin: on the face they were learned from, on a larger one, and on the default head."""

import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.skin import FAPS, MIRRORED, TWINS, skin_fields
from fapengine.mesh.default_head.skin_table import ANCHORS_MM, MOVES
from fapengine.mpeg4 import fap

PLACES = np.array([place for place, _ in MOVES])
ANCHORS = {name: np.array(place) for name, place in ANCHORS_MM.items()}


def test_strong_moves_are_as_recorded_on_the_face_they_come_from():
    fields = skin_fields(PLACES, ANCHORS)
    strong = [(row, number, move) for row, (_, moves) in enumerate(MOVES) for number, move in moves.items()]
    strong = [(row, number, move) for row, number, move in strong if np.linalg.norm(move) > 0.4]
    errors = [np.linalg.norm(fields[number][row] - move) for row, number, move in strong]
    assert len(strong) > 100
    assert np.median(errors) < 0.05
    assert np.max(errors) < 0.35


def test_a_face_twice_as_large_moves_by_the_same_millimetres():
    small = skin_fields(PLACES, ANCHORS)
    large = skin_fields(2 * PLACES, {name: 2 * place for name, place in ANCHORS.items()})
    for number in FAPS:
        np.testing.assert_allclose(small[number], large[number], atol=0.02)


def test_halves_mirror_each_other():
    aside = PLACES[PLACES[:, 0] > 5]
    left, right = skin_fields(aside, ANCHORS), skin_fields(aside * MIRRORED, ANCHORS)
    for number in FAPS:
        twin = {**TWINS, **{b: a for a, b in TWINS.items()}}.get(number, number)
        np.testing.assert_allclose(left[number], right[twin] * MIRRORED, atol=0.02)


def test_the_back_of_the_head_and_the_brow_stand_still():
    fields = skin_fields(np.array([[0.0, 0.0, -90.0], [30.0, 120.0, 60.0]]), ANCHORS)
    assert not any(moves.any() for moves in fields.values())


@pytest.mark.parametrize("number", [39, 40, 41, 42])
def test_cheeks_go_with_the_mouth_but_their_points_obey_their_own_fap_alone(number):
    head = build_head()
    basis = head.basis
    point = head.feature_points[fap.spec(number).point]
    direction = np.array(fap.HEAD_AXES[fap.spec(number).positive])
    mine = slice(basis.offsets[point], basis.offsets[point + 1])
    by_fap = {
        basis.channels[channel].fap: move @ direction / head.fapu.unit(fap.spec(basis.channels[channel].fap).unit)
        for channel, move in zip(basis.entry_channels[mine], basis.entry_mm[mine], strict=True)
    }
    assert by_fap.pop(number) == pytest.approx(1.0, abs=0.02)
    assert all(abs(value) < 0.1 for value in by_fap.values())
    beside = head.feature_points["8.3" if number % 2 else "8.4"]
    away = np.linalg.norm(head.vertices_mm - head.vertices_mm[beside], axis=1)
    smile = [n for n, channel in enumerate(basis.channels) if channel.fap in (53, 54)]
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    assert (np.isin(basis.entry_channels, smile) & (away[vertex] > 20)).sum() > 100
