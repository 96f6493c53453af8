"""A mesh's painted picture."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.default_head.head import build_head
from fapengine.mesh.default_head.mesh_builder import skin_places
from fapengine.mesh.default_head.painting import paint
from fapengine.mesh.default_head.style import HeadStyle


def test_a_texture_is_kept_read_only() -> None:
    head = build_head()
    picture = np.full((4, 6, 3), 200, dtype=np.uint8)
    painted = replace(head, texture=picture)
    assert painted.texture is not None
    assert np.array_equal(painted.texture, picture)
    assert not painted.texture.flags.writeable
    assert replace(head, texture=None).texture is None


def test_refuses_what_is_no_picture() -> None:
    head = build_head()
    with pytest.raises(UsageError, match=r"texture: got shape \(4, 6, 2\), expected \(H, W, 3\) or \(H, W, 4\)"):
        replace(head, texture=np.zeros((4, 6, 2), dtype=np.uint8))
    with pytest.raises(UsageError, match=r"texture: got shape \(0, 6, 3\)"):
        replace(head, texture=np.zeros((0, 6, 3), dtype=np.uint8))
    with pytest.raises(UsageError, match="texture: got shape"):
        replace(head, texture=np.zeros((4, 6), dtype=np.uint8))


def test_a_beard_grows_on_chin_and_jaw_and_nowhere_else() -> None:
    angle, y = np.abs(skin_places()[0]), -skin_places()[1]  # y down from the middle
    shaven, bearded = (paint(HeadStyle(beard=beard))[:, : angle.shape[1]].astype(float) for beard in (0.0, 1.0))
    darker = 1 - bearded.mean(axis=-1) / shaven.mean(axis=-1)
    for part, (low_rad, high_rad), (low_mm, high_mm) in (
        ("chin", (0.0, 0.2), (60.0, 75.0)), ("jaw", (0.9, 1.2), (45.0, 60.0)),
    ):  # fmt: skip
        here = (angle >= low_rad) & (angle < high_rad) & (y > low_mm) & (y < high_mm)
        assert darker[here].mean() > 0.3, part
    for part, (low_rad, high_rad), (low_mm, high_mm) in (
        ("lips", (0.0, 0.15), (32.0, 40.0)), ("cheek", (0.5, 0.8), (0.0, 15.0)),
        ("forehead", (0.0, 0.3), (-90.0, -70.0)),
    ):  # fmt: skip
        here = (angle >= low_rad) & (angle < high_rad) & (y > low_mm) & (y < high_mm)
        assert darker[here].mean() < 0.03, part


def test_brows_are_painted_alike_on_both_sides() -> None:
    angle, y = skin_places()
    rows = np.flatnonzero((y[:, 0] > 50.0) & (y[:, 0] < 64.0))
    brows = paint(HeadStyle(freckles=0.0, brow_thickness=1.5))[rows][:, : angle.shape[1]].astype(float).mean(axis=-1)
    right, left = brows[:, : angle.shape[1] // 2][:, ::-1], brows[:, -(angle.shape[1] // 2) :]
    both = np.minimum(right, left) < 150
    assert both.sum() > 300
    assert np.abs(right - left)[both].mean() < 12
