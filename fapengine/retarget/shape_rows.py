"""What named shapes do in FAPs at full weight: ARKit's 52, the visemes, and MPEG-4's six expressions.

``arkit.npz`` (``design/fit_arkit.py``) was measured on ICT-FaceKit (MIT licence, University of Southern California,
Institute for Creative Technologies) through the feature points of ISO/IEC 14496-2; gaze and tongue are by definition
(30 degrees; one MW0). ``visemes.npz`` (``design/fit_visemes.py``) comes from the shipped profile's speaker: visemes as
the planner shapes them in clear speech, and full expressions, both sides made symmetric.
"""

from collections.abc import Sequence

import numpy as np

from fapengine._arrays import Array, read_table

_TABLES = read_table(__package__, "arkit.npz") | read_table(__package__, "visemes.npz")
ARKIT_NAMES: tuple[str, ...] = tuple(_TABLES["arkit_names"].tolist())
"""The 52 shapes in the order of Live Link Face and Azure, 0 to 51."""
VISEME_NAMES: tuple[str, ...] = tuple(_TABLES["viseme_names"].tolist())
"""The 14 visemes that move, 1 to 14."""
ALL_MOODS: tuple[str, ...] = tuple(_TABLES["expression_names"].tolist())
"""MPEG-4's six expressions."""
_ROWS = {
    name: row
    for key, names in (("arkit", ARKIT_NAMES), ("viseme", VISEME_NAMES), ("expression", ALL_MOODS))
    for name, row in zip(names, _TABLES[key], strict=True)
}


def shape_rows(names: Sequence[str]) -> Array:
    """(N, 68) FAPU: what shapes, visemes and expressions do at full weight, by name."""
    return np.array([_ROWS[name] for name in names])
