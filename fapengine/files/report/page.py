"""The report of a fit: one HTML file with all figures."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from fapengine.files.report import figures
from fapengine.files.report.parts import Grade, image, page, picture, table, verdict
from fapengine.laboratory.fit import VIA_SHOWN_MM, Fitted
from fapengine.laboratory.predict import PIECE_S, SENTENCE, Estimate

UNCERTAINTY = (
    "Points from a video tracker are themselves uncertain by about 0.7 mm on the lips, and their depth is inferred:"
    " smaller errors are statements about the recording, not about the face."
)

ORIGIN = {"takes": "takes", "variance": "variance", "held_out": "held out"}
"""Keys of a profile's origin that the report shows, and their names there."""
GOOD, FAIR = (0.6, 0.9), (0.4, 1.0)
"""Least correlation of the opening, and largest lip error relative to a face that keeps its mean pose. Our choice: good
is what the shipped profile reaches by phone medians alone."""
FEW = 6
"""Number of held-out takes below which an interval over them is doubtful."""
SHIPPED = {False: "1.95 mm and r = 0.66", True: "1.55 mm and r = 0.88"}
"""Figures of profiles/grid_s1_en/profile.toml, held_out: by phone medians, and by targets that depend on neighbours."""


def write_report(fitted: Fitted, faces: Mapping[str, bytes] | str) -> bytes:
    """Make the page: UTF-8 HTML without external references.

    Parameters
    ----------
    faces : mapping of str to bytes, or str
        PNG images of faces, by caption; or the reason why there are none.

    Raises
    ------
    ResourceError
        If matplotlib is not installed.
    """
    profile = fitted.profile
    studied = fitted.prepared if fitted.selection is None else fitted.selection.prepared
    expressions = [
        f"{expression.label}{' (borrowed)' if expression in fitted.borrowed else ''}"
        for expression in profile.expressions
    ]
    parts = [
        f"<h1>{escape(profile.id)}</h1>",
        _verdict(fitted),
        f'<p class="note">{escape(profile.origin["source"])} · {escape(profile.language)} ·'
        f" licence: {escape(profile.licence)} · <code>{escape(profile.origin['command'])}</code></p>",
        table(
            ("", ""),
            [(name, profile.origin[key]) for key, name in ORIGIN.items() if key in profile.origin]
            + [("phones", str(len(profile.phones))), ("expressions", ", ".join(expressions) or "none")],
        ),
        _warnings(fitted.warnings),
        f'<p class="note">{UNCERTAINTY}</p>' if fitted.tracked else "",
        "<h2>Markers</h2>",
        picture(figures.markers(studied, fitted.selection), "The neutral pose, seen from the front."),
        *_gaps(fitted),
        *_selection(fitted),
        *_space(fitted),
        *_phones(fitted),
        *_prediction(fitted),
        *_dense(fitted),
        *_faces(faces),
    ]
    return page(f"{profile.id}: fit", parts)


def _verdict(fitted: Fitted) -> str:
    study, warnings = fitted.prediction, len(fitted.warnings)
    told = f" There {'is 1 warning' if warnings == 1 else f'are {warnings} warnings'} below." if warnings else ""
    if study is None:
        return verdict("", f"No take with phones was held out, so nothing says how well it speaks.{told}")
    lips, still, opening = study.whole.lips_mm, study.whole.mean_pose_mm, study.whole.opening_r
    share = lips.value / still.value if still.value else 1.0
    grades: tuple[tuple[Grade, float, float], ...] = (("good", *GOOD), ("fair", *FAIR))
    grade: Grade = next((name for name, r, most in grades if opening.value >= r and share <= most), "poor")
    return verdict(
        grade,
        f"From the phones of takes that it never saw, its lips come within {lips.value:.2f} mm (a face that keeps"
        f" its mean pose: {still.value:.2f} mm), and their opening follows with r = {opening.value:.2f}. The"
        f" profile that comes with fapengine: {SHIPPED[study.context]}.{told}",
    )


def _warnings(warnings: Sequence[str]) -> str:
    if not warnings:
        return "<p>No warnings.</p>"
    items = "".join(f"<li>{escape(text)}</li>" for text in warnings)
    return f'<div class="warn"><b>{len(warnings)} warnings</b><ul>{items}</ul></div>'


def _gaps(fitted: Fitted) -> list[str]:
    if fitted.prepared.gaps is None:
        return ["<p>Every marker is seen in every frame.</p>"]
    study = fitted.prepared.gaps
    text = (
        f"Filled by a model of rank {study.rank}; entries hidden for the trial come back within"
        f" {study.error_mm[study.ranks.index(study.rank)]:.2f} mm (root mean square)."
    )
    return ["<h2>Gaps</h2>", picture(figures.gaps(fitted.prepared), text)]


def _selection(fitted: Fitted) -> list[str]:
    study = fitted.selection
    if study is None:
        return []
    prepared = study.prepared
    names = [point or label for point, label in zip(prepared.points, prepared.labels, strict=True)]
    gaps = study.factor.gaps()[: study.factor.rank() - 1]
    judged = "takes that were held out" if fitted.held_out else "the training data"
    return [
        "<h2>Which markers matter</h2>",
        f"<p>{study.k} of {len(names)} markers: <b>{escape(', '.join(names[i] for i in study.swapped.primary))}</b>"
        f" ({escape(study.reason)})."
        f" QR alone would take {escape(', '.join(names[i] for i in study.plain.primary))}.</p>",
        f"<p>The data have rank {study.factor.rank()}; R_kk falls most after k = {int(gaps.argmax()) + 1}, to"
        f" 1/{gaps.max():.1f}.</p>",
        picture(figures.subset(study), "Dashed: the k that was chosen. Bars: one standard error over folds."),
        table((f"error of the driven markers in {judged}", "mm"), study.held_out_mm.items(), "s .3f"),
        f"<p>Ten draws of three quarters of the sentences agree on {100 * study.stability:.0f} % of the {study.k}:</p>",
        table(
            ("trial", *(f"{n + 1}." for n in range(study.trials.shape[1]))),
            [(str(n), *(names[i] for i in row)) for n, row in enumerate(study.trials, 1)],
        ),
        picture(
            figures.regions(prepared, study),
            "Kinematic regions: red moves with the circled marker, blue against it (weights −1 to 1).",
        ),
    ]


def _space(fitted: Fitted) -> list[str]:
    study = fitted.space
    shares = 100 * np.diff(study.share, prepend=0.0)
    rows = [
        (index + 1, name.name, name.likeness, ", ".join(name.busiest), study.spread_mm[index], shares[index])
        for index, name in enumerate(study.names)
    ]
    return [
        "<h2>Viseme space</h2>",
        f"<p>{study.space.mode_count} components of {3 * study.space.marker_count}; {study.dimensions} have a standard"
        " deviation above a thousandth of the first one's.</p>",
        picture(figures.space(fitted), "Dashed: what was kept."),
        *_from_mean(fitted),
        table(("", "moves", "likeness", "most", "sd, mm", "variance, %"), rows, "d s .2f s .2f .2f"),
        picture(
            figures.components(fitted),
            "Above from the front, below from the side (forward is right). Red: positive weights, blue: negative.",
        ),
    ]


def _from_mean(fitted: Fitted) -> list[str]:
    study, kept = fitted.space, fitted.space.space.mode_count
    if not len(study.error_mm):
        return []
    return [
        f"<p>{kept} components through the neutral pose leave {study.error_mm[kept - 1]:.3f} mm of held-out takes;"
        f" through the mean pose, as principal components are defined elsewhere,"
        f" {study.error_from_mean_mm[kept - 1]:.3f} mm.</p>"
    ]


def _phones(fitted: Fitted) -> list[str]:
    rows = []
    for name, study in sorted(fitted.phones.items()):
        keys = ", ".join(f"{100 * fraction:.0f} %" for fraction in study.target.fractions)
        error = "unknown" if np.isnan(study.error).any() else f"{float((study.error[0] ** 2).sum()) ** 0.5:.2f}"
        rows.append((name, str(study.tokens), keys, study.target.contact, error, study.target.origin))
    return [
        "<h2>Phones</h2>",
        picture(figures.phone_map(fitted), "Medians at 30 % of the phone."),
        table(("phone", "tokens", "keys", "touches", "standard error, mm", "origin"), rows),
    ]


def _prediction(fitted: Fitted) -> list[str]:
    parts = ["<h2>From phones back to motion</h2>"]
    study = fitted.prediction
    if study is None:
        parts.append("<p>Not judged: no take with phones was held out.</p>")
    else:
        rows = [
            (score.take, *map(_spell, (score.lips_mm, score.mean_pose_mm, score.opening_r, score.opening_slope)))
            for score in (study.whole, *study.by_take)
        ]
        few = "; with so few takes, the interval of all is only a hint"
        header = ("held-out take", "lips, mm", "mean pose, mm", "opening, r", "opening, slope")
        first = escape(study.by_take[0].take)
        parts += [
            table(header, rows, marked="all"),
            f"<p>In brackets: 95 % intervals by bootstrap over pieces of {PIECE_S:g} s of a take, and over takes"
            f"{few if len(study.by_take) < FEW else ''}. Of one look for each phone, and targets that depend on"
            " neighbours where they can be learned, the profile has what is better on these takes: that choice flatters"
            " the errors a little.</p>",
            picture(figures.prediction(fitted), f"Take {first}. Contacts are made later, on FAPs: this path has none."),
        ]
    return [*parts, *_sentence(fitted), *_via(fitted)]


def _spell(estimate: Estimate) -> str:
    interval = "" if np.isnan(estimate.low) else f" ({estimate.low:.2f} to {estimate.high:.2f})"
    return f"{estimate.value:.2f}{interval}"


def _sentence(fitted: Fitted) -> list[str]:
    study, names = fitted.sentence, fitted.space.names
    moved = [
        f"{mood.label} moves component {index + 1} ({names[index].name}) most"
        f"{', as borrowed from the standard profile' if mood in fitted.borrowed else ''}"
        for mood, index in study.dominant.items()
    ]
    return [
        "<h2>A sentence with expressions</h2>",
        picture(
            figures.sentence(fitted),
            f"“{SENTENCE}” as paper 001 plans it: one key for each phone, a cubic spline, no contacts; expressions at"
            f" full strength are added. Of them, {escape('; '.join(moved))}.",
        ),
    ]


def _via(fitted: Fitted) -> list[str]:
    via = fitted.via
    if via is None:
        return []
    rows = [
        (trial.tolerance_mm, trial.point_count, 100 * trial.share, trial.mean_mm, trial.max_mm) for trial in via.curve
    ]
    count, frames = len(via.points.times_s), len(via.motion_mm)
    return [
        "<h2>Via points</h2>",
        picture(
            figures.via_path(fitted.prepared, via),
            f"The first {figures.VIA_S:g} s; {count} of {frames} frames keep every marker within {VIA_SHOWN_MM:g} mm.",
        ),
        picture(
            figures.via_faces(fitted.prepared, via),
            "The three via points that differ most, and the faces half-way between them; grey: the first.",
        ),
        "<p>The take, low-passed at 12 Hz, as minimum-jerk splines:</p>",
        table(("bound, mm", "points", "% of frames", "mean, mm", "largest, mm"), rows, "g d .0f .2f .2f"),
    ]


def _faces(faces: Mapping[str, bytes] | str) -> list[str]:
    drawn = (
        f"<p>Not drawn: {escape(faces)}.</p>"
        if isinstance(faces, str)
        else "".join(image(png, caption) for caption, png in faces.items())
    )
    return ["<h2>Faces</h2>", drawn]


def _dense(fitted: Fitted) -> list[str]:
    study = fitted.dense
    if study is None:
        return []
    rows = [
        (name, fit.landmark_rms_mm, fit.surface_rms_mm, 100 * met, "yes" if fit.settled else "no")
        for name, fit, met in study.fits
    ]
    return [
        "<h2>Dense face</h2>",
        table(("scan", "landmarks, mm", "surface, mm", "vertices met, %", "settled"), rows, "s .2f .2f .0f s"),
        f"<p>A scan predicted from the others: {study.face.left_out_mm[0]:.2f} mm by dense modes (ridge"
        f" {study.face.modes.ridge:g}), {study.face.left_out_mm[1]:.2f} mm by the linear estimator, mean over"
        " vertices.</p>",
    ]
