"""A mesh's painted picture."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.mesh.default_head.head import build_head


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
