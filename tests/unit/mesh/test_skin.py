"""Fields of real skin: over the template, and on the default head."""

import numpy as np
import pytest

from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.skin import FAPS, TWINS, skin_fields, skin_table
from fapengine.mpeg4 import fap

CHEEK = np.array([0.55, -9.0])
"""Angle, rad, and height, mm, of a place beside the mouth."""


def test_skin_follows_the_corner_of_the_mouth_less_and_less_with_the_distance():
    away = np.linspace(0.0, 0.9, 10)
    size = np.linalg.norm(skin_fields(np.stack([0.32 + away, -28.0 + 0 * away], axis=-1))[59], axis=1)
    assert size[0] > 0.5  # mm per mm
    assert size[-1] < 0.05
    assert (np.diff(size) < 0.05).all()


def test_a_raised_corner_lifts_the_cheek_and_pushes_it_out():
    _, up, out = skin_fields(CHEEK[None])[59][0]
    assert up > 0.1
    assert out > 0.05


def test_halves_mirror_each_other():
    table_angles, table_heights, _ = skin_table()
    heights, angles = np.meshgrid(table_heights, table_angles[1:])
    places = np.stack([angles.ravel(), heights.ravel()], axis=-1)
    left, right = skin_fields(places), skin_fields(places * [-1, 1])
    for number in FAPS:
        twin = {**TWINS, **{b: a for a, b in TWINS.items()}}.get(number, number)
        np.testing.assert_allclose(left[number], right[twin] * [-1, 1, 1], atol=1e-9)


def test_the_back_of_the_head_and_the_brow_stand_still():
    fields = skin_fields(np.array([[3.0, 0.0], [0.4, 70.0], [np.nan, np.nan]]))
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
        if basis.channels[channel].start <= 0  # a broad smile lifts the cheek as well
    }
    assert by_fap.pop(number) == pytest.approx(1.0, abs=0.02)
    assert all(abs(value) < 0.1 for value in by_fap.values())
    beside = head.feature_points["8.3" if number % 2 else "8.4"]
    away = np.linalg.norm(head.vertices_mm - head.vertices_mm[beside], axis=1)
    smile = [n for n, channel in enumerate(basis.channels) if channel.fap in (53, 54)]
    vertex = np.repeat(np.arange(len(head.vertices_mm)), np.diff(basis.offsets))
    assert (np.isin(basis.entry_channels, smile) & (away[vertex] > 20)).sum() > 100
