"""The report of a score: tables of figures, openings over time, and missed closures."""

from collections.abc import Iterable, Mapping
from html import escape

import numpy as np

from fapengine.files.report import parts as html
from fapengine.files.report.parts import COOL, FAINT, INK, WARM
from fapengine.scoring.mouth import Mouth
from fapengine.scoring.score import Score
from fapengine.scoring.statistics import Estimate, PairedTest
from fapengine.scoring.verdict import VERTEX_MEASURES, Verdict
from fapengine.scoring.vertices import VertexErrors
from fapengine.speech.phone_track import PhoneTrack, is_bilabial, is_labiodental

ROW_S, MAX_ROWS = 6.0, 20
"""Longest time that a row of the figure shows, and largest number of rows."""

Rows = list[tuple[str, str, str]]
"""Measure, value, and meaning."""


def score_rows(score: Score) -> dict[str, Rows]:
    """Format all figures: rows of measure, value and meaning, by section."""
    sections: dict[str, Rows] = {
        "Alone": [("opening in speech", _number(score.opens_mm, "mm", 1), "5th to 95th percentile")]
    }
    if score.phones is not None:
        closures, teeth, timing = score.phones.closures, score.phones.teeth, score.phones.timing
        sections["Against the phones"] = [
            ("p b m that close", _share(closures.recall, f"{closures.met} of {closures.wanted}"), "recall"),
            ("shut time that is called for", _share(closures.precision), "precision, pauses left out"),
            ("f v that meet the teeth", _share(teeth.recall, f"{teeth.met} of {teeth.wanted}"), "recall"),
            ("lag", _number(timing.lag_ms, "ms"), "positive: late"),
        ]
    if score.truth is not None:
        closures, timing, like = score.truth.closures, score.truth.timing, score.truth.likeness
        sections["Against the other recording"] = [
            ("its closures that are made", _share(closures.recall, f"{closures.met} of {closures.wanted}"), "recall"),
            ("shut time that it shares", _share(closures.precision), "precision"),
            ("lag", _number(timing.lag_ms, "ms"), "positive: late"),
            ("mean temporal misalignment", _number(timing.mtm_ms, "ms"), f"of {_share(timing.met)} of its extrema"),
            ("opening, correlation", _number(like.opening_r, digits=3), "1 is the same course"),
            ("opening, slope", _number(like.opening_slope, digits=2), "0.5 opens half as far"),
            ("opening, mean distance", _number(like.opening_mm, "mm", 2), "MOD"),
            ("width, correlation", _number(like.width_r, digits=3), ""),
            ("width, slope", _number(like.width_slope, digits=2), ""),
            ("lip points, mean distance", _number(like.lips_mm, "mm", 2), "16 points"),
            ("LVE", _number(like.lve_mm2, "mm²", 2), "largest squared distance, mean over frames"),
            ("LVE without the square", _number(like.lve_root_mm, "mm", 2), ""),
        ]
    if score.intensity is not None:
        sections["Against the sound"] = [
            ("SLCC", _number(score.intensity.slcc, digits=2), f"over {score.intensity.windows} windows of 1 s"),
            ("opening and level", _number(score.intensity.opening_r, digits=2), "correlation, pauses left out"),
        ]
    named = [("this recording", score.behaviour)]
    if score.truth is not None:
        named.append(("the other recording", score.truth.behaviour))
    sections["Head and eyes"] = [
        (
            name,
            f"{found.blinks_per_minute:.0f} blinks a minute, of {_number(found.blink_ms, 'ms')}",
            f"head {found.head_deg[0]:.1f}°, {found.head_deg[1]:.1f}°, {found.head_deg[2]:.1f}° (standard deviation of"
            f" pitch, yaw, roll), {found.head_deg_s:.1f}°/s",
        )
        for name, found in named
    ]
    return sections


def vertex_rows(errors: VertexErrors) -> dict[str, Rows]:
    """Format the errors of meshes, as :func:`score_rows`."""
    values = [(measure.row, measure.value(errors)) for measure in VERTEX_MEASURES]
    return {
        f"Against the other meshes, {errors.frames} frames, in their unit": [
            (row.name, "none" if value is None else f"{value:.4g} {row.unit}", row.help) for row, value in values
        ]
    }


def summary_lines(
    systems: Mapping[str, Mapping[str, Estimate]], units: Mapping[str, str], tests: Mapping[str, PairedTest]
) -> list[str]:
    """Format the means of a set, their intervals, and the test of two systems."""
    lines = []
    for system, named in systems.items():
        lines.append(f"{system or 'Mean'}, with 95 % intervals over utterances")
        lines += [f"  {name:10} {spell_estimate(each)} {units[name]}, n = {each.count}" for name, each in named.items()]
    if tests:
        one, other = systems
        lines.append(f"{one} less {other}, with 95 % intervals over utterances and Wilcoxon's p")
        for name, test in tests.items():
            apart = test.difference
            lines.append(f"  {name:10} {spell_estimate(apart)} {units[name]}, p = {test.p:.3g}, n = {apart.count}")
    return lines


def spell_estimate(found: Estimate) -> str:
    """Format a mean and its interval."""
    if found.low is None or found.high is None:
        return f"{found.mean:.4g}"
    return f"{found.mean:.4g} [{found.low:.4g}, {found.high:.4g}]"


def write_score_report(
    score: Score,
    mouth: Mouth,
    verdict: Verdict,
    *,
    title: str,
    notes: Iterable[str],
    truth: Mouth | None,
    phones: PhoneTrack | None,
) -> bytes:
    """Make the page: UTF-8 HTML without external references.

    Raises
    ------
    ResourceError
        If matplotlib is not installed.
    """
    parts = [f"<h1>{escape(title)}</h1>", spell_verdict(verdict)]
    parts += [f'<p class="note">{escape(note)}</p>' for note in notes]
    for name, rows in score_rows(score).items():
        parts += [f"<h2>{name}</h2>", html.table(("", "", ""), rows)]
    caption = "Opening of the lips against rest."
    if phones is not None:
        caption += " Red bands: p b m and their kin; blue: f v; crosses: those that were not made."
    parts += ["<h2>Opening</h2>", html.picture(draw_openings(score, mouth, truth, phones), caption)]
    return html.page(f"{title}: score", parts)


def spell_verdict(verdict: Verdict) -> str:
    """Format the verdict as HTML; what could not be checked has no colour."""
    grade = "poor" if verdict.faults else "good" if verdict.said else ""
    return f'<p class="verdict {grade}"><b>{escape(str(verdict))}</b></p>'


def draw_openings(score: Score, mouth: Mouth, truth: Mouth | None, phones: PhoneTrack | None) -> bytes:
    """Draw openings over time, phones with lip contact as bands, and a cross for each missed contact."""
    end_s = max(mouth.end_s, truth.end_s if truth is not None else 0.0)
    count = int(np.clip(np.ceil(end_s / ROW_S), 1, MAX_ROWS))
    row_s = max(min(end_s / count, ROW_S), 0.1)
    figure, rows = html.new_figure(10.0, 1.9 * count + 0.3, count, 1, sharey=True)
    missed = [*score.phones.closures.missed_s, *score.phones.teeth.missed_s] if score.phones else []
    if score.phones is None and score.truth is not None:
        missed = list(score.truth.closures.missed_s)
    for index, axes in enumerate(rows):
        start, stop = index * row_s, (index + 1) * row_s
        for phone in phones.phones if phones is not None else ():
            if phone.end_s <= start or phone.start_s >= stop or phone.is_silence:
                continue
            if is_bilabial(phone) or is_labiodental(phone):
                colour = WARM if is_bilabial(phone) else COOL
                axes.axvspan(phone.start_s, phone.end_s, color=colour, alpha=0.18, linewidth=0)
            html.name_phones(axes, [(phone.label, phone.start_s, phone.end_s)], fontsize=7)
        axes.axhline(score.closed_mm, color=FAINT, linestyle=":", linewidth=1)
        if truth is not None:
            axes.plot(truth.times_s, truth.opening_mm, color=INK, linewidth=1, label="the other recording")
        axes.plot(mouth.times_s, mouth.opening_mm, color=WARM, linewidth=1.3, label="this recording")
        here = [time for time in missed if start <= time <= stop]
        axes.plot(here, np.interp(here, mouth.times_s, mouth.opening_mm), "x", color=WARM, markersize=8)
        axes.set(xlim=(start, stop), ylabel="mm")
    rows[-1].set_xlabel("s" if count * ROW_S >= end_s else f"s (the first {count * ROW_S:.0f} of {end_s:.0f} s)")
    rows[0].legend(fontsize=8, loc="upper right", framealpha=0.8, edgecolor="none")
    return html.to_svg(figure)


def _share(value: float | None, counted: str = "") -> str:
    if value is None:
        return "none"
    return f"{100 * value:.0f} %" + (f" ({counted})" if counted else "")


def _number(value: float | None, unit: str = "", digits: int = 0) -> str:
    return "none" if value is None else f"{value:.{digits}f} {unit}".strip()
