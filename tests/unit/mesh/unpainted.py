"""Heads of one colour."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from fapengine.mesh.default_head import head


@contextmanager
def unpainted() -> Iterator[None]:
    """Paint nothing: painting takes longer than a coarse head. No such head stays for others, who may store it."""
    white, flat = np.full((1, 1, 3), 255, dtype=np.uint8), np.full((1, 1), 128, dtype=np.uint8)
    head._built.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(head, "paint", lambda style: white)
        patch.setattr(head, "fold_map", lambda: flat)
        yield
    head._built.cache_clear()
