"""The face around the mouth's space: its FAPU, and its expressions."""

from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, UsageError
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.laboratory.setup import Moment, Setup
from fapengine.models.viseme_space import VisemeSpace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import ExpressionTarget, Profile
from fapengine.trajectory.faps import DETERMINED

Array = NDArray[np.float64]


def measure_fapu(prepared: Prepared, setup: Setup, standard: Fapu) -> tuple[Fapu, tuple[str, ...]]:
    """Find the face's units: as the laboratory says, else from markers, else those of ``standard`` at its size.

    Returns
    -------
    fapu : Fapu
    guessed : tuple of str
        Units that come from the standard face alone.

    Raises
    ------
    DataError
        If the laboratory gives an unknown unit, or one that is not a length.
    """
    at = {point: prepared.neutral_mm[prepared.column(point)] for point in prepared.named}
    measured: dict[str, float] = {}
    if {"8.3", "8.4"} <= at.keys():
        measured["mw0_mm"] = float(at["8.3"][0] - at["8.4"][0])
    if {"9.15", "2.2"} <= at.keys():
        measured["mns0_mm"] = float(at["9.15"][1] - at["2.2"][1])
    if {"3.5", "3.6"} <= at.keys():
        measured["es0_mm"] = float(at["3.5"][0] - at["3.6"][0])
        if "9.15" in at:
            measured["ens0_mm"] = float((at["3.5"][1] + at["3.6"][1]) / 2 - at["9.15"][1])
    if {"3.1", "3.2", "3.3", "3.4"} <= at.keys():
        measured["irisd0_mm"] = float(at["3.1"][1] - at["3.3"][1] + at["3.2"][1] - at["3.4"][1]) / 2
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
    """Read the expressions that the subject held; borrow the others from ``standard``, through FAPU.

    Returns
    -------
    expressions : mapping of Expression to ExpressionTarget
    borrowed : tuple of Expression
    """
    held: dict[Expression, list[Array]] = {}
    for pose in setup.poses:
        held.setdefault(pose.expression, []).append(_frames(prepared.takes, pose.moment, prepared.rate_hz))
    found = {
        expression: _measured(np.median(np.concatenate(frames), axis=0), prepared, space, fapu)
        for expression, frames in held.items()
    }
    borrowed = {
        expression: _borrowed(target, space, fapu, standard)
        for expression, target in standard.expressions.items()
        if expression not in found
    }
    return found | borrowed, tuple(borrowed)


def _frames(takes: tuple[Displacements, ...], moment: Moment, rate_hz: float) -> Array:
    take = next(candidate for candidate in takes if candidate.name == moment.take)
    first = round(moment.start_s * rate_hz)
    return take.moved_mm[first : max(round(moment.end_s * rate_hz), first + 1)].astype(np.float64)


def _measured(moved: Array, prepared: Prepared, space: VisemeSpace, fapu: Fapu) -> ExpressionTarget:
    """Find the pose's point in the space, and the FAPs of recorded points that the space leaves."""
    weights, beyond = split(moved[None], prepared, space, fapu)
    return ExpressionTarget(target=weights[0], fap=frozen(beyond[0], "fap", (fap.FAP_COUNT,), np.float64))


def split(moved: Array, prepared: Prepared, space: VisemeSpace, fapu: Fapu) -> tuple[Array, Array]:
    """Part captured displacements, (T, M, 3) mm: weights in the space, (T, K), and FAPs beyond it, (T, 68) FAPU."""
    at = {point: moved[:, prepared.column(point)] for point in prepared.named}
    weights = space.to_space(np.stack([at[point] for point in space.points[: space.marker_count]], axis=1))
    carried = dict(zip(space.points, np.moveaxis(space.to_points_mm(weights), 1, 0), strict=True))
    beyond = np.zeros((len(moved), fap.FAP_COUNT))
    for row in fap.FAPS:
        axis = fap.HEAD_AXES.get(row.positive)
        if axis is None or row.point not in at or row.unit is fap.FapUnit.AU:
            continue
        left = at[row.point] - (carried[row.point] if row.number in DETERMINED else 0.0)
        if row.number == 18:  # the chin boss against the jaw, as in trajectory/faps.py
            left = left - (at["2.1"] - carried["2.1"] if "2.1" in at else 0.0)
        beyond[:, fap.column(row.number)] = left @ np.array(axis) / fapu.unit(row.unit)
    return weights, beyond


def _borrowed(target: ExpressionTarget, space: VisemeSpace, fapu: Fapu, standard: Profile) -> ExpressionTarget:
    moved = dict(zip(standard.space.points, standard.space.to_points_mm(target.target), strict=True))
    size = fapu.mw0_mm / standard.fapu.mw0_mm
    markers = np.stack([size * moved[point] for point in space.points[: space.marker_count]])
    return ExpressionTarget(target=space.to_space(markers), fap=target.fap)
