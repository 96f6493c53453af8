"""The sets of shapes that a table of face motion may have: names, FAPs in and FAPs out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.retarget.arkit import ARKIT_NAMES, approximate_arkit, arkit_to_faps
from fapengine.retarget.oculus import OCULUS_NAMES, approximate_visemes, visemes_to_faps
from fapengine.retarget.vrm import VRM0_NAMES, VRM1_NAMES, approximate_presets, presets_to_faps

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ShapeSet:
    """One way to name what a face does."""

    key: str
    names: tuple[str, ...]
    """(B,), spelled as its users do."""
    from_faps: Callable[[Array], Array]
    """(T, 68) FAPU -> (T, B)."""
    to_faps: Callable[[Array], Array]
    """(T, B) -> (T, 68) FAPU."""
    aliases: tuple[tuple[str, str], ...] = ()
    """Other spellings, and the name that each stands for."""


_RPM_VOWELS = (("viseme_I", "ih"), ("viseme_O", "oh"), ("viseme_U", "ou"))
SHAPE_SETS = {
    entry.key: entry
    for entry in (
        ShapeSet(
            "arkit",
            tuple(name[0].upper() + name[1:] for name in ARKIT_NAMES),
            approximate_arkit,
            arkit_to_faps,
        ),
        ShapeSet(
            "oculus", OCULUS_NAMES, approximate_visemes, visemes_to_faps,
            tuple((f"{before}{name}", name) for before in ("viseme_", "vrc.v_") for name in OCULUS_NAMES) + _RPM_VOWELS,
        ),
        ShapeSet("vrm0", VRM0_NAMES, approximate_presets, presets_to_faps),
        ShapeSet("vrm1", VRM1_NAMES, approximate_presets, presets_to_faps),
    )
}  # fmt: skip
"""Sets by their keys."""


def shape_set(key: str) -> ShapeSet:
    """Find a set.

    Raises
    ------
    UsageError
        If there is none of that key.
    """
    if key not in SHAPE_SETS:
        raise UsageError(f"shapes: got {key!r}, expected one of {', '.join(SHAPE_SETS)}")
    return SHAPE_SETS[key]
