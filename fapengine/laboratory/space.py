"""The viseme space of a session: paper 001, sections 3 and 4, for whatever feature points were recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.models.naming import ComponentName, name_components
from fapengine.models.viseme_space import MARKERS, VisemeSpace, fit_viseme_space
from fapengine.mpeg4 import fap
from fapengine.trajectory.faps import DETERMINED

Array = NDArray[np.float64]

POINTS = tuple(dict.fromkeys(fap.spec(number).point for number in DETERMINED))
"""Feature points that a profile must move: those of the FAPs that it determines."""
STAND_INS = {
    "2.2": ("8.1",), "2.3": ("8.2",), "2.4": ("8.3",), "2.5": ("8.4",), "2.6": ("8.5",), "2.7": ("8.6",),
    "2.8": ("8.7",), "2.9": ("8.8",), "8.1": ("2.2",), "8.2": ("2.3",), "8.3": ("2.4",), "8.4": ("2.5",),
    "8.5": ("2.6", "8.1"), "8.6": ("2.7", "8.1"), "8.7": ("2.8", "8.2"), "8.8": ("2.9", "8.2"), "2.1": ("2.10",),
    "2.10": ("2.1",), "5.1": ("5.3",), "5.2": ("5.4",), "5.3": ("5.1",), "5.4": ("5.2",),
}  # fmt: skip
"""Points whose motion one borrows that was not recorded: its other lip contour, or its nearest neighbour."""
STILL = ("5.1", "5.2", "5.3", "5.4")
"""Cheeks may stand still; lips and chin may not."""
MIN_MARKERS = 4


@dataclass(frozen=True, slots=True, eq=False)
class SpaceStudy:
    """The space, and how well it holds the recording."""

    space: VisemeSpace
    share: Array
    """(3M,): variance carried by the first 1, 2, ... components."""
    spread_mm: Array
    """(K,): standard deviation of each weight."""
    names: tuple[ComponentName, ...]
    error_mm: Array
    """(3M,): mean marker distance of takes that the components were not learned from, with 1, 2, ... of them; empty if
    no take was left out."""
    error_from_mean_mm: Array
    """(3M,): the same components laid through the mean pose, as other tools do, not through the neutral one."""
    dimensions: int
    """Components whose standard deviation exceeds a thousandth of the first's: what the paper counts as not zero."""
    borrowed: dict[str, str]
    """Points that were not recorded, and whose motion they follow (``"nothing"``: they stand still)."""


def study_space(
    prepared: Prepared,
    training: tuple[Displacements, ...],
    held_out: tuple[Displacements, ...],
    *,
    modes: int | None,
    variance: float,
) -> SpaceStudy:
    """Learn the space from ``training`` and judge it on ``held_out``.

    Parameters
    ----------
    modes : int, optional
        K; without it the fewest that carry ``variance``.

    Raises
    ------
    DataError
        If too few of the paper's points were recorded, or lips or chin cannot be told from any.
    """
    markers = tuple(point for point in MARKERS if point in prepared.named)
    if len(markers) < MIN_MARKERS:
        raise DataError(
            f"feature points: got {', '.join(markers) or 'none'} of lips, chin and cheeks, expected at least"
            f" {MIN_MARKERS} of {', '.join(MARKERS)}",
            where=prepared.subject,
        )
    followers = tuple(point for point in prepared.named if point not in markers)
    frames = pick(training, prepared, (*markers, *followers))
    count = len(markers)
    whole, share = fit_viseme_space(frames[:, :count], markers, frames[:, count:], followers, mode_count=3 * count)
    kept = modes if modes is not None else int((share < variance).sum()) + 1
    if not 1 <= kept <= 3 * count:
        raise DataError(f"modes: got {kept}, expected 1..{3 * count}, three for each marker", where=prepared.subject)
    deviations = whole.to_space(frames[:, :count]).std(axis=0)
    error = from_mean = np.zeros(0)
    if held_out:
        truth = pick(held_out, prepared, markers)
        vectors = whole.modes_mm[:, :count].reshape(3 * count, -1)
        error, from_mean = _errors(vectors, truth), _errors(vectors, truth - frames[:, :count].mean(axis=0))
    space, borrowed = _complete(
        VisemeSpace(points=whole.points, marker_count=count, modes_mm=whole.modes_mm[:kept]), prepared.subject
    )
    return SpaceStudy(
        space=space,
        share=share,
        spread_mm=deviations[:kept],
        names=tuple(name_components(space.modes_mm[:, :count], markers)),
        error_mm=error,
        error_from_mean_mm=from_mean,
        dimensions=int((deviations > 1e-3 * deviations[0]).sum()),
        borrowed=borrowed,
    )


def _errors(vectors: Array, truth: Array) -> Array:
    """Mean marker distance, (3M,) mm, that 1, 2, ... of some orthonormal rows, (3M, 3M), leave of (T, M, 3)."""
    flat = truth.reshape(len(truth), -1)
    errors = np.empty(len(vectors))
    left = flat.copy()
    for index, vector in enumerate(vectors):
        left -= np.outer(flat @ vector, vector)
        errors[index] = np.linalg.norm(left.reshape(truth.shape), axis=-1).mean()
    return errors


def pick(takes: tuple[Displacements, ...], prepared: Prepared, points: tuple[str, ...]) -> Array:
    """All frames of some feature points: (T, P, 3) mm."""
    columns = [prepared.column(point) for point in points]
    return np.concatenate([take.moved_mm[:, columns] for take in takes])


def _complete(space: VisemeSpace, where: str) -> tuple[VisemeSpace, dict[str, str]]:
    """Add the points of :data:`POINTS` that were not recorded."""
    modes = dict(zip(space.points, np.moveaxis(space.modes_mm, 1, 0), strict=True))
    borrowed: dict[str, str] = {}
    for point in POINTS:
        if point in modes:
            continue
        source = next((stand_in for stand_in in STAND_INS[point] if stand_in in modes), None)
        if source is None and point not in STILL:
            raise DataError(
                f"feature point {point}: was not recorded, nor was {' or '.join(STAND_INS[point])} in its stead",
                where=where,
            )
        borrowed[point] = source or "nothing"
    for point, source in borrowed.items():
        modes[point] = modes[source] if source in modes else np.zeros((space.mode_count, 3))
    return (
        VisemeSpace(points=tuple(modes), marker_count=space.marker_count, modes_mm=np.stack([*modes.values()], axis=1)),
        borrowed,
    )
