"""``fapengine inspect``: describe a file, a profile or a head."""

from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from rich.console import RenderableType

    from fapengine.app.inspection.report import Report, Table


def inspect(
    path: Path = typer.Argument(
        ...,
        help="FAPs, an FBA stream, a table of weights, phone timings, audio, video, an image, a marker recording, a"
        " session, face landmarks or an OpenFace table, an avatar, a scan, a profile or a head.",
    ),
    everything: bool = typer.Option(False, "--all", help="Show every row, not only the first ones."),
    plot: Path | None = typer.Option(None, help="Plot the content to an image (.png)."),
    sliders: Path | None = typer.Option(
        None, help="For a profile: write a web page with a slider for each component (.html)."
    ),
    weights: str | None = typer.Option(
        None, help="For a profile: weights of its components, in mm, from the page of --sliders."
    ),
    pose: Path | None = typer.Option(None, help="Write the face of --weights as FAPs (.fap)."),
    strict: shared.Strict = False,
    as_json: bool = typer.Option(False, "--json", help="Print the result as JSON."),
    timings: shared.TimingOptions = shared.TimingOptions(),
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Describe a file, a profile or a head. The file type is detected from the content.

    fapengine inspect talk.fba
    fapengine inspect take.c3d
    fapengine inspect grid_s1_en --plot faces.png --sliders components.html
    fapengine inspect grid_s1_en --weights "12 0 -3 0 0 0 0 0" --pose face.fap
    """
    from fapengine.app.inspection.kinds import find_kind
    from fapengine.app.inspection.report import Source
    from fapengine.cli._printing import print_result
    from fapengine.errors import UsageError
    from fapengine.files.motion import save_fap
    from fapengine.files.paths import write_bytes
    from fapengine.files.pictures import save_png
    from fapengine.speech.plausible import refuse

    writing.check([output for output in (plot, sliders, pose) if output is not None], [path])
    source = Source(path, **timings.how)
    report = find_kind(source).describe(source)
    if strict:
        refuse(report.warnings, str(path))
    if sliders is not None:
        if report.sliders is None:
            raise UsageError(f"--sliders: {path} is not a profile")
        write_bytes(sliders, report.sliders())
    if (weights is None) != (pose is None):
        raise UsageError("--weights, --pose: got one, expected both or neither")
    if weights is not None and pose is not None:
        if report.pose is None:
            raise UsageError(f"--weights: {path} is not a profile")
        save_fap(pose, report.pose(weights))
    if plot is not None:
        save_png(plot, report.draw(path), source=None)
    if as_json:
        print_result(report.facts, as_json=True)
    else:
        _print(report, everything=everything)


def _print(report: "Report", *, everything: bool) -> None:
    """Print the lines and tables of a report."""
    from rich.console import Console

    console = Console(highlight=False)
    for warning in report.warnings:
        typer.echo(f"warning: {warning}", err=True)
    for part in report.text:
        if isinstance(part, str):
            console.print(_shown(part), soft_wrap=True)
            continue
        count = len(part.rows) if everything or part.shown is None else part.shown
        for row in _drawn(part, count):
            console.print(row, soft_wrap=not part.columns)
        if count < len(part.rows):
            console.print(part.more.format(len(part.rows) - count), soft_wrap=True)


def _drawn(table: "Table", count: int) -> "list[RenderableType]":
    """Make the first rows of a table: lines, or one table."""
    from rich import table as rich_table

    if not table.columns:
        return [_shown(str(row)) for row in table.rows[:count]]
    drawn = rich_table.Table(*table.columns, box=None, pad_edge=False)
    for column in drawn.columns[: table.right]:
        column.justify = "right"
    for row, style in zip_longest(table.rows[:count], table.styles[:count]):
        drawn.add_row(*map(_shown, row), style=style)
    return [drawn]


def _shown(text: str) -> "RenderableType":
    from rich.text import Text

    from fapengine.app.inspection.report import Markup

    return str(text) if isinstance(text, Markup) else Text(text)
