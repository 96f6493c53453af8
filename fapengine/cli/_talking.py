"""The part that ``say`` and ``animate`` share: writing under a progress bar, and printing the report."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from fapengine.app.outputs import SaveOptions, find_kind
from fapengine.app.performance import Performance
from fapengine.app.report import Report
from fapengine.app.talk import write_talk
from fapengine.cli._printing import as_flags, print_result, print_rows, progress, working


def write(performance: Performance, output: Path, options: SaveOptions, *, inputs: Collection[Path] = ()) -> None:
    """Write every file of a performance under a progress bar, and fill in the report of the options."""
    frames = len(performance.track)
    bar = progress("drawing", frames) if find_kind(output).is_image else working(f"writing {frames} frames")
    with bar as advance:
        on_frame = advance if callable(advance) else options.on_frame
        write_talk(performance, output, replace(options, on_frame=on_frame), inputs=inputs)


def print_reports(reports: Sequence[Report], *, as_json: bool, err: bool = False) -> None:
    """Print what was written, how long it took, and which phones are unknown; several reports are a list in JSON.

    ``err`` prints to standard error, for when the files themselves go to standard output.
    """
    if as_json:
        facts = [report.as_dict() for report in reports]
        print_result(facts[0] if len(facts) == 1 else facts, as_json=True, err=err)
        return
    for report in reports:
        print_rows(_rows(report), err=err)


def _rows(report: Report) -> Iterator[tuple[str, ...]]:
    for path, kind in report.files:
        yield kind, str(path), "bold"
    yield "time", "  ".join(f"{name} {seconds:.2f} s" for name, seconds in report.stages.items())
    drawing_s = report.stages.get("draw", 0.0)
    drawn_at = f", drawn at {report.frames / drawing_s:.0f} frames/s" if drawing_s else ""
    yield (
        "speech",
        f"{report.duration_s:.2f} s, {report.phones} phones, {report.frames} frames at {report.rate_hz:g} Hz{drawn_at};"
        f" all in {report.total_s:.2f} s, {report.duration_s / report.total_s:.1f} times real time",
    )
    if report.moved:
        yield "motion", report.moved
    if report.level != "phone":
        yield "timings", f"of each {report.level}, not of each phone"
    for note in report.reading.notes:
        yield "heard" if report.level == "phone" else "words", as_flags(note.removeprefix("words "))
    if report.reading.guessed:
        yield "alphabet", str(report.reading)
