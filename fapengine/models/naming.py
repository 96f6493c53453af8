"""Names for components by what they move: paper 001, section 4.2 and figure 3, done by measuring instead of by eye.

Each of :data:`MOVES` is a displacement of feature points that articulation knows. A component gets the name of the move
that it is most parallel to, over the points that both know; below :data:`CLEAR` it is called mixed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import frozen

CLEAR = 0.5
"""|cosine| from which a component is named after a move."""

UP, DOWN, LEFT, RIGHT, OUT = (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)
_LOWER_LIP, _UPPER_LIP = ("8.2", "8.7", "8.8", "2.3", "2.8", "2.9"), ("8.1", "8.5", "8.6", "2.2", "2.6", "2.7")
_CHIN = ("2.1", "2.10")
_LIPS = ("8.1", "8.2", "8.5", "8.6", "8.7", "8.8")
_ALL = (*_LOWER_LIP, *_UPPER_LIP, "8.3", "8.4")


def _all(points: Sequence[str], way: Sequence[float]) -> dict[str, tuple[float, ...]]:
    return dict.fromkeys(points, tuple(map(float, way)))


MOVES: Mapping[str, Mapping[str, tuple[float, ...]]] = MappingProxyType(
    {
        "jaw opening": _all((*_LOWER_LIP, *_CHIN), DOWN) | _all(("8.3", "8.4", "2.4", "2.5"), (0, -0.5, 0)),
        "lip spreading": _all(("8.3", "2.4"), LEFT) | _all(("8.4", "2.5"), RIGHT)
        | _all(("8.5", "8.7", "5.1", "5.3"), (0.4, 0, 0)) | _all(("8.6", "8.8", "5.2", "5.4"), (-0.4, 0, 0)),
        "lip protrusion": _all(_LIPS, OUT) | _all(("8.3", "8.4"), (0, 0, 0.6)),
        "lip opening": _all(_LOWER_LIP, DOWN) | _all(_UPPER_LIP, (0, 0.6, 0)),
        "upper lip raising": _all(_UPPER_LIP, UP),
        "lower lip lowering": _all(_LOWER_LIP, DOWN),
        "corner raising": _all(("8.3", "8.4", "2.4", "2.5"), UP) | _all(("5.1", "5.2"), (0, 0.5, 0)),
        "cheek puffing": _all(("5.1", "5.2", "5.3", "5.4"), OUT),
        "mouth to one side": _all((*_ALL, *_CHIN), LEFT),
        "jaw thrust": _all((*_CHIN, "8.2", "2.3"), OUT),
        "skew": _all(("8.3", "2.4"), UP) | _all(("8.4", "2.5"), DOWN),
    }
)  # fmt: skip
"""Directions of feature points in head axes (+x the subject's left, +y up, +z out); points not listed stay."""


@dataclass(frozen=True, slots=True)
class ComponentName:
    """What a component does."""

    name: str
    likeness: float
    """|cosine| with the move, 0..1."""
    busiest: tuple[str, ...]
    """The three points that it moves farthest."""


def name_components(modes_mm: ArrayLike, points: Sequence[str]) -> list[ComponentName]:
    """Propose a name for each component.

    Parameters
    ----------
    modes_mm : (K, P, 3) array_like
        Displacement of P points per unit of each component; sign and length do not matter.
    points : sequence of str
        P feature point names.

    Raises
    ------
    UsageError
        If shapes differ.

    Examples
    --------
    >>> name_components([[[0, 0, 0], [0, -2, 0], [0, -2, 0]]], ("8.1", "8.2", "2.1"))[0].name
    'jaw opening'
    """
    modes = frozen(modes_mm, "modes_mm", ("K", len(points), 3), np.float64)
    names = []
    for mode in modes:
        length = float(np.linalg.norm(mode))
        best, likeness = "nothing moves", 0.0
        for name, moves in MOVES.items():
            move = np.array([moves.get(point, (0.0, 0.0, 0.0)) for point in points])
            size = float(np.linalg.norm(move)) * length
            alike = abs(float((mode * move).sum())) / size if size > 0 else 0.0
            if alike > likeness:
                best, likeness = name, alike
        order = np.argsort(-np.linalg.norm(mode, axis=1), kind="stable")[:3]
        clear = best if likeness >= CLEAR else f"mixed, most like {best}"
        names.append(ComponentName(clear, likeness, tuple(points[index] for index in order)))
    return names
