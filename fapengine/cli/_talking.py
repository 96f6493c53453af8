"""The part that ``say`` and ``animate`` share: writing under a progress bar, and printing the report."""

import json
import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from fapengine.app.outputs import SaveOptions, find_kind
from fapengine.app.performance import Performance
from fapengine.app.report import Report
from fapengine.app.talk import write_talk
from fapengine.cli._progress import progress, working


def write(performance: Performance, output: Path, options: SaveOptions, *, inputs: Collection[Path] = ()) -> None:
    """Write every file of a performance under a progress bar, and fill in the report of the options."""
    frames = len(performance.track)
    bar = progress("drawing", frames) if find_kind(output).is_image else working(f"writing {frames} frames")
    with bar as advance:
        write_talk(performance, output, replace(options, on_frame=advance or (lambda: None)), inputs=inputs)


def print_reports(reports: Sequence[Report], *, as_json: bool, err: bool = False) -> None:
    """Print what was written, how long it took, and which phones are unknown; several are a list in JSON.

    ``err``: to standard error, as the files themselves go to standard output.
    """
    if as_json:
        told = [report.as_dict() for report in reports]
        whole = json.dumps(told[0] if len(told) == 1 else told, indent=2, ensure_ascii=False)
        print(whole, file=sys.stderr if err else sys.stdout)
        return
    for report in reports:
        _print_report(report, err=err)


def _print_report(report: Report, *, err: bool) -> None:
    console = Console(highlight=False, stderr=err)
    for path, kind in report.files:
        console.print(f"[bold]{kind:>14}[/]  {path}", soft_wrap=True)
    stages = "  ".join(f"{name} {seconds:.2f} s" for name, seconds in report.stages.items())
    console.print(f"{'time':>14}  {stages}", soft_wrap=True)
    drawing_s = report.stages.get("draw", 0.0)
    drawn_at = f", drawn at {report.frames / drawing_s:.0f} frames/s" if drawing_s else ""
    console.print(
        f"{'speech':>14}  {report.duration_s:.2f} s, {report.phones} phones, {report.frames} frames at"
        f" {report.rate_hz:g} Hz{drawn_at}; all in {report.total_s:.2f} s,"
        f" {report.duration_s / report.total_s:.1f} times real time",
        soft_wrap=True,
    )
    if report.moved:
        console.print(f"{'motion':>14}  {report.moved}", soft_wrap=True)
    for note in report.notes:
        console.print(f"[yellow]{'heard':>14}[/]  {escape(note)}", soft_wrap=True)
    if report.level != "phone":
        console.print(f"{'timings':>14}  of each {report.level}, not of each phone", soft_wrap=True)
    if report.reading is not None and report.reading.guessed:
        console.print(f"{'alphabet':>14}  {report.reading}", soft_wrap=True)
    for unknown in report.unknown:
        console.print(f"[yellow]{'unknown phone':>14}[/]  {unknown}", soft_wrap=True)
