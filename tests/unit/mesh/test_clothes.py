"""Clothes: no neck comes through a collar, and collars follow the neck."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.mesh.default_head import faces
from fapengine.mesh.default_head.clothes import build_clothes, neck_weight
from fapengine.mesh.default_head.mesh_builder import MeshBuilder
from fapengine.mesh.default_head.style import GARMENTS, PEOPLE, random_person
from fapengine.mesh.default_head.surface import AXIS_Z_MM

COLUMNS = 44
EDGE = slice(COLUMNS, 2 * COLUMNS)
"""Vertices of the second ring, at the upper edge inside."""


@pytest.mark.parametrize("garment", GARMENTS)
@pytest.mark.parametrize("who", ["default", "man", "child", *range(12)])
def test_no_neck_comes_through_a_collar(who: str | int, garment: str) -> None:
    person = PEOPLE[who] if isinstance(who, str) else random_person(who)
    style, builder = replace(person, garment=garment), MeshBuilder()
    build_clothes(builder, style, 1.0)
    x, y, z = builder.column("points_mm")[EDGE].T
    around = np.linspace(-np.pi, np.pi, COLUMNS + 1)[:-1]
    angle, height = np.meshgrid(np.linspace(-np.pi, np.pi, 181)[:-1], np.arange(-140.0, -70.0, 1.0))
    neck = faces.position(angle, height, style) - [0.0, 0.0, AXIS_Z_MM]
    azimuth, away = np.arctan2(neck[..., 0], neck[..., 2]), np.hypot(neck[..., 0], neck[..., 2])
    level, edge = (np.interp(azimuth, around, ring, period=2 * np.pi) for ring in (y, np.hypot(x, z - AXIS_Z_MM)))
    near = np.abs(neck[..., 1] - level) < 1.0
    assert near.sum() > 200
    assert (edge - away)[near].min() > 0.3  # mm


@pytest.mark.parametrize("garment", GARMENTS)
def test_a_collar_follows_the_neck_and_shoulders_stay(garment: str) -> None:
    builder = MeshBuilder()
    build_clothes(builder, replace(PEOPLE["default"], garment=garment), 1.0)
    (_, y, z), weight = builder.column("points_mm").T, builder.column("head_weight")
    assert weight[EDGE] == pytest.approx(neck_weight(y, z)[EDGE])
    assert weight[EDGE].max() > 0.2
    assert not weight[y < -165.0].any()
