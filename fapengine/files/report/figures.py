"""The figures of a fit's report, drawn with matplotlib; each function returns one as SVG."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array
from fapengine.capture.marker_track import MarkerTrack
from fapengine.files.report.parts import COOL, FAINT, GREEN, INK, WARM, name_phones, new_figure, to_picture, to_svg
from fapengine.files.report.sliders import INNER, OUTER
from fapengine.laboratory.fit import Fitted, ViaStudy
from fapengine.laboratory.look import Look
from fapengine.laboratory.predict import SENTENCE_RATE_HZ
from fapengine.laboratory.prepare import Prepared
from fapengine.laboratory.selection import Selection

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COMPONENTS = 4
"""Components that figures over time show."""
MAX_NAMED = 120
"""Number of markers above which a recording's have no names."""
VIA_S = 1.5
"""Length of the path that the figure of via points shows, as in paper 004."""

MODES_SHOWN, ARROW_MM = 8, 14.0
"""Components that the figure of components shows, and the length of its longest arrow."""


def _bare(axes: "Axes") -> None:
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)


def _mark(axes: "Axes", chosen: float) -> None:
    """Draw a dashed line at the value that was chosen."""
    axes.axvline(chosen, color=WARM, linestyle="--", linewidth=1)


def markers(prepared: Prepared, selection: Selection | None) -> bytes:
    """Draw the neutral pose from the front, feature points named, the chosen subset marked."""
    figure, (axes,) = new_figure(6.4, 6.0)
    x, y = prepared.neutral_mm[:, 0], prepared.neutral_mm[:, 1]
    axes.scatter(x, y, s=14, color=FAINT, label="marker")
    named = [index for index, point in enumerate(prepared.points) if point]
    axes.scatter(x[named], y[named], s=18, color=INK, label="feature point")
    for index in named:
        axes.annotate(prepared.points[index], (x[index], y[index]), (3, 3), textcoords="offset points", fontsize=6)
    if selection is not None:
        chosen = selection.swapped.primary
        axes.scatter(x[chosen], y[chosen], s=90, facecolors="none", edgecolors=WARM, linewidths=1.6, label="chosen")
    axes.legend(loc="upper right", fontsize=7, frameon=False)
    _bare(axes)
    return to_svg(figure)


def subset(selection: Selection) -> bytes:
    """Draw the choice of k, the diagonal of R (figure 2 of paper 000), and the effect of more sentences (figure 3)."""
    figure, (curve, diagonal, amount) = new_figure(10.5, 3.2, 1, 3)
    error = selection.curve
    curve.errorbar(error.k, error.mean_mm, error.standard_error_mm, color=COOL, marker="o", markersize=3, capsize=2)
    _mark(curve, selection.k)
    curve.annotate(
        f"k = {selection.k}", (selection.k, error.mean_mm.max()), (4, -8), textcoords="offset points", color=WARM
    )
    curve.set(
        xlabel="markers in the subset, k", ylabel="error of the others, mm", title="cross-validated", ylim=(0, None)
    )
    values = selection.factor.diagonal
    diagonal.semilogy(np.arange(1, len(values) + 1), np.maximum(values, values[0] * 1e-12), color=INK, marker=".")
    _mark(diagonal, selection.k)
    diagonal.set(xlabel="k", ylabel="R_kk, mm", title="how much each marker adds")
    amount.plot(np.arange(1, len(selection.by_amount) + 1), selection.by_amount, linewidth=1)
    amount.set(xlabel="sentences", ylabel="R_kk / norm", title="with more sentences", ylim=(0, None))
    return to_svg(figure)


def regions(prepared: Prepared, selection: Selection) -> bytes:
    """Draw what each chosen marker moves, and in which direction: figure 4 of paper 000."""
    columns, rows = selection.grid_mm
    count = len(selection.regions.weights)
    wide = min(count, 5)
    high = -(-count // wide)
    figure, axes = new_figure(2.1 * wide, 2.5 * high, high, wide)
    x, y = prepared.neutral_mm[:, 0], prepared.neutral_mm[:, 1]
    extent = (columns[0], columns[-1], rows[0], rows[-1])
    for plot, weights, marker in zip(axes, selection.regions.weights, selection.swapped.primary, strict=False):
        seen = np.where(selection.regions.inside, weights, np.nan).reshape(len(rows), len(columns))
        plot.imshow(seen, origin="lower", extent=extent, cmap="RdBu_r", vmin=-1, vmax=1)
        plot.scatter(x, y, s=2, color=INK)
        plot.scatter(x[marker], y[marker], s=40, facecolors="none", edgecolors="black")
        plot.set_title(_name(prepared, marker), fontsize=8)
    for plot in axes:
        _bare(plot)
    return to_svg(figure)


def space(fitted: Fitted) -> bytes:
    """Draw variance and held-out error by the number of components."""
    study = fitted.space
    count = min(len(study.share), 20)
    figure, (variance, error) = new_figure(8.0, 3.0, 1, 2)
    k = np.arange(1, count + 1)
    variance.plot(k, 100 * study.share[:count], color=COOL, marker="o", markersize=3)
    variance.set(xlabel="components", ylabel="variance carried, %", title="fluent speech")
    if len(study.error_mm):
        error.plot(k, study.error_mm[:count], color=COOL, marker="o", markersize=3)
    error.set(xlabel="components", ylabel="mm", title="mean marker error, held-out takes", ylim=(0, None))
    for axes in (variance, error):
        _mark(axes, study.space.mode_count)
        axes.set_xticks(k[::2])
    return to_svg(figure)


def components(fitted: Fitted) -> bytes:
    """Draw each component's influence (figure 3 of paper 001) as arrows from the neutral pose."""
    study = fitted.space
    points = study.space.points
    neutral = np.stack([_place(fitted.prepared, point, study.borrowed) for point in points])
    shown = min(study.space.mode_count, MODES_SHOWN)
    wide, high = min(shown, 4), -(-shown // 4)
    figure, axes = new_figure(2.5 * wide, 4.2 * high, 2 * high, wide)
    for index in range(shown):
        row, column = divmod(index, wide)
        mode = study.space.modes_mm[index]
        mode = ARROW_MM / np.linalg.norm(mode, axis=1).max() * mode
        front, side = (axes[(2 * row + view) * wide + column] for view in (0, 1))
        for plot, across in ((front, 0), (side, 2)):
            plot.scatter(neutral[:, across], neutral[:, 1], s=6, color=FAINT)
            for way, colour in ((1, WARM), (-1, COOL)):
                plot.quiver(
                    neutral[:, across], neutral[:, 1], way * mode[:, across], way * mode[:, 1],
                    angles="xy", scale_units="xy", scale=1, color=colour, width=0.012, headwidth=4,
                )  # fmt: skip
            plot.margins(0.18)
        name = study.names[index]
        front.set_title(f"{index + 1}: {name.name}\nstandard deviation {study.spread_mm[index]:.1f} mm", fontsize=7.5)
    for plot in axes:
        _bare(plot)
    return to_svg(figure)


def _place(prepared: Prepared, point: str, borrowed: dict[str, str]) -> Array:
    places = prepared.by_point(prepared.neutral_mm)
    return places.get(borrowed.get(point, point), places[prepared.named[0]])


def phone_map(fitted: Fitted) -> bytes:
    """Draw phones and expressions in the first two components; bars are standard errors."""
    figure, (axes,) = new_figure(6.6, 5.4)
    for name, study in sorted(fitted.phones.items()):
        x, y = study.target.targets[0, :2] if study.target.targets.shape[1] > 1 else (study.target.targets[0, 0], 0.0)
        bar = study.error[0]
        axes.errorbar(x, y, bar[1] if len(bar) > 1 else 0.0, bar[0], color=FAINT, linewidth=1)
        axes.annotate(name, (x, y), ha="center", va="center", color=WARM if study.target.contact != "none" else INK)
    axes.scatter(0, 0, marker="+", color=GREEN)
    axes.annotate("rest", (0, 0), (4, 4), textcoords="offset points", color=GREEN)
    names = fitted.space.names
    axes.set(xlabel=f"1: {names[0].name}, mm", ylabel=f"2: {names[1].name}, mm" if len(names) > 1 else "")
    axes.set_title("phones; red ones must touch", fontsize=9)
    return to_svg(figure)


def prediction(fitted: Fitted) -> bytes:
    """Draw captured and predicted mouth opening of one held-out take."""
    assert fitted.prediction is not None
    figure, (axes,) = new_figure(9.0, 2.6)
    captured, predicted = fitted.prediction.opening_mm
    times = np.arange(len(captured)) / fitted.prepared.rate_hz
    axes.plot(times, captured, color=INK, label="captured")
    axes.plot(times, predicted, color=WARM, label="from its phones alone")
    take = next(take for take in fitted.prepared.takes if take.name == fitted.prediction.by_take[0].take)
    name_phones(axes, [(p.label, p.start_s, p.end_s) for p in take.phones if p.label != "_"], fontsize=8)
    axes.set(xlabel="s", ylabel="opening against rest, mm")
    axes.legend(frameon=False, fontsize=8)
    return to_svg(figure)


def sentence(fitted: Fitted) -> bytes:
    """Draw the components of the paper's own sentence, with joy and with sadness: figures 5 to 7 of paper 001."""
    study = fitted.sentence
    colours = dict(zip(study.moods, (WARM, COOL), strict=False))
    lines = {"no expression": (study.plain, INK)}
    lines |= {f"with {mood.label}": (path, colours[mood]) for mood, path in study.moods.items()}
    shown = sorted({*range(min(COMPONENTS, study.plain.shape[1])), *study.dominant.values()})
    figure, plots = new_figure(9.0, 1.5 * len(shown), rows=len(shown), sharex=True)
    for component, axes in zip(shown, plots, strict=True):
        for label, (path, colour) in lines.items():
            axes.plot(np.arange(len(path)) / SENTENCE_RATE_HZ, path[:, component], color=colour, label=label)
        axes.set(ylabel=f"PC {component + 1}, mm")
    spoken = [phone for phone in study.phones.phones if not phone.is_silence]
    name_phones(plots[0], [(phone.label, phone.start_s, phone.end_s) for phone in spoken], fontsize=8)
    figure.legend(*plots[0].get_legend_handles_labels(), loc="outside upper left", frameon=False, fontsize=8, ncols=3)
    plots[-1].set(xlabel="s")
    return to_svg(figure)


def via_path(prepared: Prepared, via: ViaStudy) -> bytes:
    """Draw two coordinates of the marker that moves most, and its path through via points: figure 4 of paper 004."""
    last = min(len(via.motion_mm), round(VIA_S * prepared.rate_hz))
    marker = int(via.motion_mm.std(axis=0).sum(axis=-1).argmax())
    fine = np.arange(0.0, (last - 1) / prepared.rate_hz, 0.005)
    inside = via.points.times_s <= fine[-1]
    figure, plots = new_figure(9.0, 4.0, rows=2, sharex=True)
    for axis, plot in zip((1, 2), plots, strict=True):
        plot.plot(
            np.arange(last) / prepared.rate_hz, via.motion_mm[:last, marker, axis], ".", color=FAINT, markersize=4
        )
        plot.plot(fine, via.points.sample(fine)[:, marker, axis], color=COOL, linewidth=1.2)
        plot.plot(
            via.points.times_s[inside], via.points.positions_mm[inside, marker, axis], "o", color=WARM, markersize=5
        )
        plot.set(ylabel=f"{'up' if axis == 1 else 'forward'}, mm")
    names = ("captured frames", "recovered path", "via points")
    figure.legend(plots[0].lines, names, loc="outside upper left", frameon=False, fontsize=8, ncols=3)
    plots[0].set_title(f"marker {_name(prepared, marker)}, take {via.take}", fontsize=9)
    plots[1].set(xlabel="s")
    return to_svg(figure)


def via_faces(prepared: Prepared, via: ViaStudy) -> bytes:
    """Draw three via points in a row, and the faces half-way between them: figure 5 of paper 004."""
    times, keyed = via.points.times_s, via.points.positions_mm
    first = int(np.linalg.norm(keyed[2:] - keyed[:-2], axis=-1).sum(axis=1).argmax())
    one, two, three = times[first : first + 3]
    shown = (one, (one + two) / 2, two, (two + three) / 2, three)
    places = prepared.neutral_mm + via.points.sample(shown)
    rings = [
        [prepared.points.index(point) for point in (*ring, ring[0])]
        for ring in (OUTER, INNER)
        if set(ring) <= set(prepared.points)
    ]
    figure, plots = new_figure(2.0 * len(shown), 2.9, 1, len(shown), sharex=True, sharey=True)
    for number, (plot, face, time_s) in enumerate(zip(plots, places, shown, strict=True)):
        colour = COOL if number % 2 else WARM
        plot.scatter(places[0, :, 0], places[0, :, 1], s=6, color=FAINT)
        plot.scatter(face[:, 0], face[:, 1], s=8, color=colour)
        for ring in rings:
            plot.plot(face[ring, 0], face[ring, 1], color=colour, linewidth=1)
        plot.set_title(f"{'via point, ' if colour == WARM else ''}{time_s:.3f} s", fontsize=8, color=colour)
        _bare(plot)
    return to_svg(figure)


def _name(prepared: Prepared, marker: int) -> str:
    return prepared.points[marker] or prepared.labels[marker]


def recording(title: str, track: MarkerTrack, front_mm: Array, look: Look) -> NDArray[np.uint8]:
    """Draw the markers of a recording, (M, 3) mm seen from the front, and when each is seen: (H, W, 3) uint8."""
    count = len(track.labels)
    is_few = count <= MAX_NAMED
    figure, (face, time) = new_figure(13.0, max(5.5, 0.15 * count if is_few else 0.0), 1, 2)
    kinds = {"of the skull, guessed": (look.head, WARM), "feature points": (look.named, COOL)}
    colours = {name: colour for names, colour in kinds.values() for name in names}
    x, y = front_mm[:, 0], front_mm[:, 1]
    face.scatter(x, y, s=18 if is_few else 2, c=[colours.get(name, INK) for name in track.labels])
    for label, (names, colour) in kinds.items():
        if names:
            face.scatter([], [], s=18, color=colour, label=label)
    for name, place in zip(track.labels, front_mm[:, :2], strict=True) if is_few else ():
        face.annotate(name, place, (3, 3), textcoords="offset points", fontsize=7, color=colours.get(name, INK))
    face.set(xlabel="to the subject's left, mm", ylabel="up, mm")
    face.set_title(f"{title}: from the front, {look.quiet_s[0]:.2f} s", fontsize=9)
    face.set_aspect("equal")
    if face.get_legend_handles_labels()[0]:
        face.legend(loc="lower left", fontsize=7, frameon=False)
    seen = track.valid[np.linspace(0, track.frame_count - 1, min(track.frame_count, 1200)).astype(int)].T
    extent = (0.0, track.duration_s, count - 0.5, -0.5)
    time.imshow(seen, aspect="auto", extent=extent, cmap="Blues", vmin=0, vmax=1.8, interpolation="nearest")
    time.hlines(np.arange(count - 1) + 0.5, 0, track.duration_s, color="white", linewidth=1.0 if is_few else 0.0)
    time.axvspan(*look.quiet_s, color=GREEN, alpha=0.3, linewidth=0)
    time.set_title("when each is seen (blue); green: the quietest half second", fontsize=9)
    time.set(xlabel="s")
    time.set_yticks(range(count) if is_few else [], track.labels if is_few else [], fontsize=7)
    return to_picture(figure)


def gaps(prepared: Prepared) -> bytes:
    """Draw how often each marker was seen, and how well hidden entries are filled at each rank."""
    assert prepared.gaps is not None
    figure, (seen, rank) = new_figure(9.0, 2.8, 1, 2)
    order = np.argsort(prepared.gaps.seen)
    seen.bar(np.arange(len(order)), 100 * prepared.gaps.seen[order], width=1.0, color=COOL)
    seen.set(xlabel="markers, by visibility", ylabel="frames that show it, %", ylim=(0, 100))
    rank.plot(prepared.gaps.ranks, prepared.gaps.error_mm, "o-", color=COOL)
    _mark(rank, prepared.gaps.rank)
    rank.set(xlabel="rank of the model", ylabel="mm", title="error of hidden entries", ylim=(0, None))
    return to_svg(figure)
