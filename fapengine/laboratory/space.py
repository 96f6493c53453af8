"""The viseme space of a session, its FAPU and expressions, and its takes as FAPs; paper 001, sections 3 and 4.

The paper's 14 markers are on the outer lips, which thicken and roll: their distance is not the opening. So inner lips
that were not recorded move as the standard profile's do when its markers move as the recorded ones. In captured takes
the lips of a p, b or m touch where the outer lips are nearest to each other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError, as_data_error
from fapengine.expressions import Expression
from fapengine.geometry.rigid import yaw_pitch_roll
from fapengine.laboratory.phones import TONGUE_ON_JAW, spoken
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import Setup
from fapengine.models.viseme_space import MARKERS, ComponentName, VisemeSpace, fit_viseme_space, name_components
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FapUnit
from fapengine.mpeg4.fapu import AU_RAD, Fapu, faps_of_displacements, measure_distances
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.profiles import ExpressionTarget, Profile
from fapengine.speech.phone_track import Phone, is_bilabial
from fapengine.trajectory.closures import MIN_HOLD_S, Hold, close_lips, held
from fapengine.trajectory.faps import DETERMINED_POINTS, displacements_to_faps

STAND_INS = {
    "2.2": ("8.1",), "2.3": ("8.2",), "2.4": ("8.3", "2.5", "8.4"), "2.5": ("8.4", "2.4", "8.3"), "2.6": ("8.5", "8.1"),
    "2.7": ("8.6", "8.1"), "2.8": ("8.7", "8.2"), "2.9": ("8.8", "8.2"), "8.1": ("2.2",), "8.2": ("2.3",),
    "8.3": ("2.4", "8.4", "2.5"), "8.4": ("2.5", "8.3", "2.4"),
    "8.5": ("2.6", "8.1"), "8.6": ("2.7", "8.1"), "8.7": ("2.8", "8.2"), "8.8": ("2.9", "8.2"), "2.1": ("2.10",),
    "2.10": ("2.1",), "5.1": ("5.3",), "5.2": ("5.4",), "5.3": ("5.1",), "5.4": ("5.2",),
}  # fmt: skip
"""Points whose motion one that was not recorded gets: those of its other lip contour, its nearest neighbours, or the
other corner of the mouth, mirrored."""
LEFT, RIGHT = ("8.3", "2.4"), ("8.4", "2.5")
INNER_LIPS = tuple(f"2.{number}" for number in range(2, 10))
MIN_KNOWN = 10
"""Markers of the standard profile, recorded here, from which its space tells the inner lips."""
CLOSED_MM, BESIDE_S = 1.0, 0.02
"""Opening below which lips count as closed, and how far outside of its phone a closure may be."""
AROUND_S, NOISE_MM = 0.12, 0.7
"""Time before and after a p, b or m in which its closure is looked for (aligners are late by as much), and distance
from the nearest within which the outer lips count as equally near: the noise of a video tracker."""
MIDDLES = ("2.2", "2.3")
"""Middle of the inner lips."""
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
    inferred: tuple[str, ...]
    """Those of them that move as in the standard profile's space instead."""


def study_space(
    prepared: Prepared,
    training: tuple[Displacements, ...],
    held_out: tuple[Displacements, ...],
    *,
    modes: int | None,
    variance: float,
    standard: VisemeSpace,
) -> SpaceStudy:
    """Learn the space from ``training`` and judge it on ``held_out``.

    Parameters
    ----------
    modes : int, optional
        K; without it the fewest that carry ``variance``.
    standard : VisemeSpace
        Tells how inner lips move with outer ones, where only these were recorded.
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
    space = replace(whole, modes_mm=whole.modes_mm[:kept])
    inferred = _inner_lips(space, standard)
    space, borrowed = _complete(space, inferred, prepared.subject)
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
        inferred=tuple(inferred),
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


def _inner_lips(space: VisemeSpace, standard: VisemeSpace) -> dict[str, Array]:
    """Modes, (K, 3) mm, of the inner lips that were not recorded, as the standard's markers move them."""
    known = [point for point in standard.markers if point in space.points]
    missing = [point for point in INNER_LIPS if point not in space.points]
    if len(known) < MIN_KNOWN:
        return {}
    moved = _followed({point: space.modes_mm[:, space.points.index(point)] for point in known}, standard)
    return {point: moved[point] for point in missing}


def _followed(known: Mapping[str, Array], standard: VisemeSpace) -> dict[str, Array]:
    """How all points of a space move, (N, 3) mm, when some do: by the nearest of its faces."""
    theirs = standard.modes_mm[:, [standard.points.index(point) for point in known]].reshape(standard.mode_count, -1)
    ours = np.stack([*known.values()], axis=1).reshape(-1, theirs.shape[1])
    moved = standard.to_points_mm(np.linalg.lstsq(theirs.T, ours.T)[0].T)
    return dict(zip(standard.points, np.moveaxis(moved, 1, 0), strict=True))


def recorded_faps(moved_mm: Mapping[str, Array], standard: Profile) -> Array:
    """FAPs, (T, 68) FAPU, of feature points that moved by (T, 3) mm, on a face of the size of a profile's.

    Points of the mouth and cheeks that are not among them move as the profile's do with the others.
    """
    known = {point: moved for point, moved in moved_mm.items() if point in standard.space.points}
    return faps_of_displacements(_followed(known, standard.space) | {**moved_mm}, standard.fapu)


def _complete(space: VisemeSpace, inferred: Mapping[str, Array], where: str) -> tuple[VisemeSpace, dict[str, str]]:
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
    for point, source in borrowed.items():
        crossed = (point in LEFT and source in RIGHT) or (point in RIGHT and source in LEFT)
        motion = modes.get(source, np.zeros((space.mode_count, 3))) * ([-1.0, 1.0, 1.0] if crossed else 1.0)
        modes[point] = inferred.get(point, motion)
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
    with as_data_error(where=prepared.subject):
        fapu = Fapu(**whole)
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
    for point in TONGUE_ON_JAW.keys() & left.keys():
        left[point] = left[point] - TONGUE_ON_JAW[point] * carried["2.1"]
    return weights, faps_of_displacements(left, fapu)


def captured_faps(take: Displacements, prepared: Prepared, profile: Profile) -> FapTrack:
    """Turn a take into FAPs: mouth, every other recorded point, and the turns of the head (FAP 48 to 50).

    Where the inner lips were not recorded, p b m get their contact (:func:`contacts`). The head turns yaw, then pitch,
    then roll about axes that move with it, as :mod:`fapengine.mesh.deform` turns it. Its shifts have no FAP.
    """
    weights, beyond = split(take.moved_mm.astype(np.float64), prepared, profile.space, profile.fapu)
    mouth = displacements_to_faps(profile.space.to_points_mm(weights), profile.space.points, profile.fapu)
    faps = mouth + beyond
    if not set(MIDDLES) <= set(prepared.named):
        times_s = np.arange(len(faps)) / prepared.rate_hz
        holds = contacts(take, prepared)
        touch = held(times_s, holds)[0][:, None]
        faps += touch * (close_lips(faps, times_s, holds) - faps)
    for number, angle in zip((49, 48, 50), yaw_pitch_roll(take.head.rotation).T, strict=True):
        faps[:, fap.column(number)] = angle / AU_RAD
    return FapTrack.from_values(np.asarray(to_codable(faps)), rate_hz=prepared.rate_hz)


def contacts(take: Displacements, prepared: Prepared) -> list[Hold]:
    """List the p b m of a take at which the recorded lips are nearest to each other, each while they stay so."""
    at = prepared.by_point(take.moved_mm.astype(np.float64))
    if not {"8.1", "8.2"} <= set(at):
        return []
    opening = at["8.1"][:, 1] - at["8.2"][:, 1]
    holds = []
    for phone in _bilabials(take):
        first = max(round((phone.start_s - AROUND_S) * prepared.rate_hz), 0)
        near = opening[first : round((phone.end_s + AROUND_S) * prepared.rate_hz) + 1]
        if len(near) and 0 < (least := int(near.argmin())) < len(near) - 1:
            apart = np.flatnonzero(near > near[least] + NOISE_MM) - least
            before, after = apart[apart < 0].max(initial=-least - 1), apart[apart > 0].min(initial=len(near) - least)
            span_s = (first + least + np.array([before + 1, after - 1])) / prepared.rate_hz
            holds.append(Hold(float(span_s[0]) - MIN_HOLD_S / 2, float(span_s[1]) + MIN_HOLD_S / 2))
    return holds


def _bilabials(take: Displacements) -> list[Phone]:
    return [phone for phone in spoken(take).phones if is_bilabial(phone)]


def count_closures(prepared: Prepared, profile: Profile) -> tuple[int, int]:
    """Count the p b m of all takes, and those whose captured inner lips come within :data:`CLOSED_MM`."""
    wanted = met = 0
    for take in prepared.takes:
        phones = _bilabials(take)
        if phones:
            faps = captured_faps(take, prepared, profile).values
            opening = -profile.fapu.unit(FapUnit.MNS) * (faps[:, fap.column(4)] + faps[:, fap.column(5)])
            for phone in phones:
                first = max(int((phone.start_s - BESIDE_S) * prepared.rate_hz), 0)
                last = int(np.ceil((phone.end_s + BESIDE_S) * prepared.rate_hz))
                wanted += 1
                met += bool((opening[first : last + 1] < CLOSED_MM).any())
    return wanted, met
