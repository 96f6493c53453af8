"""The viseme space of a session, its FAPU and expressions, and its takes as FAPs; paper 001, sections 3 and 4."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fapengine._arrays import Array
from fapengine.errors import DataError, UsageError
from fapengine.expressions import Expression
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import Setup
from fapengine.models.viseme_space import MARKERS, ComponentName, VisemeSpace, fit_viseme_space, name_components
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD, Fapu, faps_of_displacements, measure_distances
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.profiles import ExpressionTarget, Profile
from fapengine.trajectory.faps import DETERMINED_POINTS, displacements_to_faps

STAND_INS = {
    "2.2": ("8.1",), "2.3": ("8.2",), "2.4": ("8.3",), "2.5": ("8.4",), "2.6": ("8.5",), "2.7": ("8.6",),
    "2.8": ("8.7",), "2.9": ("8.8",), "8.1": ("2.2",), "8.2": ("2.3",), "8.3": ("2.4",), "8.4": ("2.5",),
    "8.5": ("2.6", "8.1"), "8.6": ("2.7", "8.1"), "8.7": ("2.8", "8.2"), "8.8": ("2.9", "8.2"), "2.1": ("2.10",),
    "2.10": ("2.1",), "5.1": ("5.3",), "5.2": ("5.4",), "5.3": ("5.1",), "5.4": ("5.2",),
}  # fmt: skip
"""Points whose motion one that was not recorded gets: those of its other lip contour, or its nearest neighbours."""
STILL = ("5.1", "5.2", "5.3", "5.4")
"""Cheeks may be without motion; lips and chin may not."""
MIN_MARKERS = 4


@dataclass(frozen=True, slots=True, eq=False)
class SpaceStudy:
    """The space, and its errors on the recording."""

    space: VisemeSpace
    share: Array
    """(3M,): variance carried by the first 1, 2, ... components."""
    spread_mm: Array
    """(K,): standard deviation of each weight."""
    names: tuple[ComponentName, ...]
    error_mm: Array
    """(3M,): mean marker distance of takes that the components were not learned from, with 1, 2, ... of them; empty if
    no take was left out."""
    error_by_take_mm: Mapping[str, Array]
    """The same of each of these takes."""
    error_from_mean_mm: Array
    """(3M,): the same, with components about the mean pose, as in other tools, not the neutral one."""
    dimensions: int
    """Number of components whose standard deviation exceeds a thousandth of the first's, the paper's limit."""
    borrowed: dict[str, str]
    """Points that were not recorded, and the points that they follow (``"nothing"``: they do not move)."""


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
    """
    markers = tuple(point for point in MARKERS if point in prepared.named)
    if len(markers) < MIN_MARKERS:
        raise DataError(
            f"feature points: got {', '.join(markers) or 'none'} of lips, chin and cheeks, expected at least"
            f" {MIN_MARKERS} of {', '.join(MARKERS)}",
            where=prepared.subject,
        )
    followers = tuple(point for point in prepared.named if point not in markers)
    frames = prepared.pick((*markers, *followers), *training)
    count = len(markers)
    whole, share = fit_viseme_space(frames[:, :count], markers, frames[:, count:], followers, mode_count=3 * count)
    kept = modes if modes is not None else int((share < variance).sum()) + 1
    if not 1 <= kept <= 3 * count:
        raise DataError(f"modes: must be 1 to {3 * count} (three for each marker), got {kept}", where=prepared.subject)
    deviations = whole.to_space(frames[:, :count]).std(axis=0)
    error, from_mean, by_take = np.zeros(0), np.zeros(0), {}
    if held_out:
        truth = prepared.pick(markers, *held_out)
        vectors = whole.modes_mm[:, :count].reshape(3 * count, -1)
        error, from_mean = _errors(vectors, truth), _errors(vectors, truth - frames[:, :count].mean(axis=0))
        by_take = {take.name: _errors(vectors, prepared.pick(markers, take)) for take in held_out}
    space, borrowed = _complete(replace(whole, modes_mm=whole.modes_mm[:kept]), prepared.subject)
    return SpaceStudy(
        space=space,
        share=share,
        spread_mm=deviations[:kept],
        names=tuple(name_components(space.modes_mm[:, :count], markers)),
        error_mm=error,
        error_by_take_mm=by_take,
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


def _complete(space: VisemeSpace, where: str) -> tuple[VisemeSpace, dict[str, str]]:
    """Add the points of :data:`fapengine.trajectory.faps.DETERMINED_POINTS` that were not recorded."""
    modes = dict(zip(space.points, np.moveaxis(space.modes_mm, 1, 0), strict=True))
    borrowed: dict[str, str] = {}
    for point in DETERMINED_POINTS:
        if point not in modes:
            source = next((other for other in STAND_INS[point] if other in modes), "nothing")
            if source == "nothing" and point not in STILL:
                raise DataError(
                    f"feature point {point}: was not recorded, nor was {' or '.join(STAND_INS[point])}", where=where
                )
            borrowed[point] = source
    modes |= {point: modes.get(source, np.zeros((space.mode_count, 3))) for point, source in borrowed.items()}
    whole = np.stack([*modes.values()], axis=1)
    return VisemeSpace(points=tuple(modes), marker_count=space.marker_count, modes_mm=whole), borrowed


def measure_fapu(prepared: Prepared, setup: Setup, standard: Fapu) -> tuple[Fapu, tuple[str, ...]]:
    """Find the face's units: those of ``session.toml``, else from markers, else those of ``standard`` at its size.

    Returns
    -------
    fapu : Fapu
    guessed : tuple of str
        Units that come from the standard face alone.
    """
    measured = measure_distances(prepared.by_point(prepared.neutral_mm))
    stated = {f"{name}_mm": length for name, length in setup.fapu_mm.items()}
    names = [field.name for field in fields(Fapu)]
    unknown = [name for name in stated if name not in names]
    if unknown:
        raise DataError(
            f"fapu_mm: got {unknown[0].removesuffix('_mm')!r}, expected {', '.join(n[:-3] for n in names)}",
            where="session.toml",
        )
    whole = {name: getattr(standard, name) / prepared.scale for name in names} | measured | stated
    try:
        fapu = Fapu(**whole)
    except UsageError as error:
        raise DataError(str(error), where=prepared.subject) from error
    return fapu, tuple(name.removesuffix("_mm") for name in names if name not in measured and name not in stated)


def find_expressions(
    prepared: Prepared, setup: Setup, space: VisemeSpace, fapu: Fapu, standard: Profile
) -> tuple[Mapping[Expression, ExpressionTarget], tuple[Expression, ...]]:
    """Measure the expressions that the subject held; take the others from ``standard``, through FAPU.

    Returns
    -------
    expressions : mapping of Expression to ExpressionTarget
    borrowed : tuple of Expression
    """
    held: dict[Expression, list[Array]] = {}
    for pose in setup.poses:
        held.setdefault(pose.expression, []).append(prepared.during(pose.moment))
    found = {}
    for expression, frames in held.items():
        weights, beyond = split(np.median(np.concatenate(frames), axis=0)[None], prepared, space, fapu)
        found[expression] = ExpressionTarget(target=weights[0], fap=beyond[0])
    borrowed = {}
    size = fapu.mw0_mm / standard.fapu.mw0_mm
    columns = [standard.space.points.index(point) for point in space.markers]
    for expression, target in standard.expressions.items():
        if expression not in found:
            moved = size * standard.space.to_points_mm(target.target)[columns]
            borrowed[expression] = ExpressionTarget(target=space.to_space(moved), fap=target.fap)
    return found | borrowed, tuple(borrowed)


def split(moved: Array, prepared: Prepared, space: VisemeSpace, fapu: Fapu) -> tuple[Array, Array]:
    """Split captured displacements, (T, M, 3) mm: weights in the space, (T, K), and FAPs beyond it, (T, 68) FAPU."""
    at = prepared.by_point(moved)
    weights = space.to_space(np.stack([at[point] for point in space.markers], axis=1))
    carried = dict(zip(space.points, np.moveaxis(space.to_points_mm(weights), 1, 0), strict=True))
    left = {point: place - carried[point] if point in DETERMINED_POINTS else place for point, place in at.items()}
    return weights, faps_of_displacements(left, fapu)


def captured_faps(take: Displacements, prepared: Prepared, profile: Profile) -> FapTrack:
    """Turn a take into FAPs: mouth, every other recorded point, and the turns of the head (FAP 48 to 50).

    The head turns yaw, then pitch, then roll about axes that move with it, as :mod:`fapengine.mesh.deform` turns it.
    Its shifts have no FAP.
    """
    weights, beyond = split(take.moved_mm.astype(np.float64), prepared, profile.space, profile.fapu)
    mouth = displacements_to_faps(profile.space.to_points_mm(weights), profile.space.points, profile.fapu)
    faps = mouth + beyond
    turns = Rotation.from_matrix(take.head.rotation).as_euler("YXZ")
    for number, angle in zip((49, 48, 50), turns.T, strict=True):
        faps[:, fap.column(number)] = angle / AU_RAD
    return FapTrack.of(np.asarray(to_codable(faps)), rate_hz=prepared.rate_hz)
