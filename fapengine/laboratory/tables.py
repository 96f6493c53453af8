"""A fit as tables in long format, one observation per row, for R, pandas and spreadsheets.

Lengths are in mm, times in s, shares from 0 to 1; ``low`` and ``high`` are the ends of a 95 % interval. A component is
numbered from 1. An empty cell is a value that is not known.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fapengine.laboratory.fit import Fitted
from fapengine.laboratory.predict import SENTENCE_RATE_HZ, Sentence

Cell = str | int | float


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under named columns."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def to_csv(self) -> bytes:
        """Write it as UTF-8: commas, full stops, a header, numbers to 6 significant digits."""
        lines = [self.columns, *self.rows]
        return "".join(f"{','.join(map(_cell, line))}\n" for line in lines).encode()


def _cell(value: Cell) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.6g}"
    text = str(value)
    return f'"{text.replace(chr(34), chr(34) * 2)}"' if set(text) & set(',"\n') else text


def _table(columns: str, rows: Iterable[Sequence[Cell]]) -> Table:
    return Table(tuple(columns.split()), tuple(map(tuple, rows)))


def tables_of(fitted: Fitted) -> Mapping[str, Table]:
    """Make the tables of a fit, by name; one that has nothing to tell is left out.

    ``takes`` ``held_out`` ``components`` ``component_errors`` ``loadings`` ``phones`` ``subset`` ``subset_errors``
    ``trials`` ``via`` ``sentence`` ``scans``: see the documentation's page on the laboratory.
    """
    space, via = fitted.space, fitted.via
    points = space.space.points[: space.space.marker_count]
    tables = {
        "takes": _table(
            "take held_out frames duration_s phones",
            [
                (take.name, int(take.name in fitted.held_out), len(take.moved_mm),
                 len(take.moved_mm) / fitted.prepared.rate_hz, len(take.phones))
                for take in fitted.prepared.takes
            ],
        ),
        "held_out": _held_out(fitted),
        "components": _table(
            "component moves standard_deviation_mm variance_share",
            [
                (index + 1, name.name, float(space.spread_mm[index]), float(share))
                for index, (name, share) in enumerate(
                    zip(space.names, np.diff(space.share, prepend=0.0), strict=False)
                )
            ],
        ),
        "component_errors": _table(
            "take k error_mm",
            [
                (take, k, float(error))
                for take, errors in {**space.error_by_take_mm, "all": space.error_mm}.items()
                for k, error in enumerate(errors, 1)
            ],
        ),
        "loadings": _table(
            "component point x_mm y_mm z_mm",
            [
                (index + 1, point, *map(float, mode[column]))
                for index, mode in enumerate(space.space.modes_mm)
                for column, point in enumerate(points)
            ],
        ),
        "phones": _phones(fitted),
        **_subset(fitted),
        "via": _table(
            "take bound_mm points share mean_mm largest_mm",
            [
                (via.take, row.tolerance_mm, row.point_count, row.share, row.mean_mm, row.max_mm)
                for row in via.curve
            ] if via else [],
        ),
        "sentence": _sentence(fitted.sentence),
        "scans": _table(
            "scan landmarks_mm surface_mm met_share settled",
            [
                (name, fit.landmark_rms_mm, fit.surface_rms_mm, float(met), int(fit.settled))
                for name, fit, met in fitted.dense.fits
            ] if fitted.dense else [],
        ),
    }  # fmt: skip
    return {name: table for name, table in tables.items() if table.rows}


def weights_of_takes(fitted: Fitted) -> Mapping[str, Table]:
    """Weights of every take in the viseme space, mm: a row for each frame, a column for each component."""
    space, prepared = fitted.space.space, fitted.prepared
    names = " ".join(("time_s", *(f"component_{k + 1}" for k in range(space.mode_count))))
    return {
        take.name: _table(
            names,
            (
                (frame / prepared.rate_hz, *map(float, row))
                for frame, row in enumerate(space.to_space(prepared.pick(space.markers, take).astype(np.float64)))
            ),
        )
        for take in prepared.takes
    }


def _held_out(fitted: Fitted) -> Table:
    study = fitted.prediction
    scores = (*study.by_take, study.whole) if study else ()
    return _table(
        "take measure value low high",
        [
            (score.take, measure, *getattr(score, measure))
            for score in scores
            for measure in ("lips_mm", "mean_pose_mm", "opening_r", "opening_slope")
        ],
    )


def _phones(fitted: Fitted) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for name, study in sorted(fitted.phones.items()):
        for fraction, weights, errors in zip(study.target.fractions, study.target.targets, study.error, strict=True):
            for k, (weight, error) in enumerate(zip(weights.tolist(), errors.tolist(), strict=True), 1):
                rows.append((name, fraction, k, weight, error, study.tokens, study.target.contact))
    return _table("phone fraction component weight_mm standard_error_mm tokens contact", rows)


def _subset(fitted: Fitted) -> dict[str, Table]:
    study = fitted.selection
    if study is None:
        return {}
    names = [point or label for point, label in zip(study.prepared.points, study.prepared.labels, strict=True)]
    curve, nothing = study.curve, (np.nan, np.nan)
    errors = {k: (curve.mean_mm[row], curve.standard_error_mm[row]) for row, k in enumerate(curve.k.tolist())}
    return {
        "subset": _table(
            "k marker r_kk_mm error_mm standard_error_mm chosen",
            [
                (k, names[column], float(r), *map(float, errors.get(k, nothing)), int(k == study.k))
                for k, (column, r) in enumerate(zip(study.factor.order, study.factor.diagonal, strict=True), 1)
            ],
        ),
        "subset_errors": _table("method error_mm", list(study.held_out_mm.items())),
        "trials": _table(
            "trial place marker",
            [
                (trial, place, names[column])
                for trial, row in enumerate(study.trials, 1)
                for place, column in enumerate(row, 1)
            ],
        ),
    }


def _sentence(sentence: Sentence) -> Table:
    paths = {"none": sentence.plain} | {mood.label: path for mood, path in sentence.moods.items()}
    return _table(
        "expression time_s component weight_mm",
        [
            (mood, frame / SENTENCE_RATE_HZ, k, weight)
            for mood, path in paths.items()
            for frame, row in enumerate(path.tolist())
            for k, weight in enumerate(row, 1)
        ],
    )
