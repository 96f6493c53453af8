"""``fapengine fit``: a capture session to a face model, with a report."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fapengine.cli.options import AsJson, WriteOptions

if TYPE_CHECKING:
    from fapengine.app.fit import FitJob
    from fapengine.laboratory.fit import Fitted
    from fapengine.models.adapted_head import Nearness


def fit(
    session: Path = typer.Argument(..., help="Folder of recordings with phone timings beside them, and session.toml."),
    output: Path = typer.Option(..., "--output", "-o", help="Profile to write, a folder: profiles/NAME."),
    modes: int | None = typer.Option(None, "--modes", help="Components of the space; by default 99 % of the variance."),
    subset: int | None = typer.Option(None, "--subset", help="Markers in the subset; by default the error decides."),
    tolerance: float = typer.Option(0.35, "--tolerance", help="Mean error in mm that the subset may leave."),
    held_out: float = typer.Option(0.2, "--held-out", help="Share of takes to judge by, 0 to 0.5."),
    units: str | None = typer.Option(None, "--units", help="mm, cm, m or inch, for recordings that do not say."),
    up: str | None = typer.Option(None, "--up", help="Axis that points up: +y, +z, ..."),
    seed: int = typer.Option(1, "--seed", min=0, help="Chance of the split into takes to learn from and to judge by."),
    voice: str = typer.Option("en-us", "--voice", "-v", help="Who pronounces timings that have words only."),
    report: bool = typer.Option(True, "--report/--no-report", help="Write report.html beside the profile."),
    faps: bool = typer.Option(False, "--faps", help="Write every take as captured FAPs too: takes/TAKE.fap."),
    adapt: bool = typer.Option(
        False,
        "--adapt",
        help="Put our own head, with its eyes and teeth, on to the dense face: --head takes the profile.",
    ),
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Learn a face model from motion capture: markers that matter, viseme space, phones, dense face.

        fapengine fit recordings/S03 -o profiles/s03
        fapengine say "Hello." --profile profiles/s03 -o hello.mp4

    SESSION holds recordings (C3D, TRC, CSV, TSV, NPZ, face landmarks, mesh sequences) and, for each, phone timings of
    the same name. Markers named as feature points of the standard (8.1, 2.10 ...) need nothing more; what the files
    do not say stands in session.toml.
    """
    from fapengine.app.fit import OWNED, FitJob, check_folder, describe
    from fapengine.files.outputs import files_in
    from fapengine.laboratory.fit import FitOptions

    if output.is_file():
        check_folder(output)
    writing.check(files_in(output, OWNED), [session])
    options = FitOptions(modes=modes, k=subset, tolerance_mm=tolerance, held_out=held_out)
    job = FitJob(
        session=session, output=output, options=options, units=units, up=up, seed=seed, voice=voice, report=report,
        faps=faps, adapt=adapt,
    )  # fmt: skip
    fitted, nearness = _run(job)
    if as_json:
        import json

        typer.echo(json.dumps(describe(fitted, nearness) | {"output": str(output)}))
    else:
        _print(output, fitted, report=report)
        if nearness is not None:
            from fapengine.cli._nearness import spell_nearness

            typer.echo(f"{output / 'head'}: our own head on the dense face; {spell_nearness(nearness)}")


def _run(job: "FitJob") -> "tuple[Fitted, Nearness | None]":
    """Run the job under a progress bar, on a terminal only."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from fapengine.app.fit import run_fit
    from fapengine.laboratory.fit import STEPS

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:32.32}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        reading = progress.add_task("reading", total=None)
        fitting = progress.add_task(STEPS[0], total=len(STEPS), visible=False)
        return run_fit(
            job,
            on_take=lambda name, count: progress.update(reading, total=count, advance=1, description=f"reading {name}"),
            on_step=lambda step: progress.update(fitting, advance=1, description=step, visible=True),
        )


def _print(output: Path, fitted: "Fitted", *, report: bool) -> None:
    for text in fitted.warnings:
        typer.echo(f"warning: {text}", err=True)
    lines = [text for key, text in fitted.profile.origin.items() if key in ("takes", "variance", "held_out")]
    if fitted.selection is not None:
        markers = ", ".join(fitted.selection.prepared.labels[index] for index in fitted.selection.swapped.primary)
        lines.append(f"{fitted.selection.k} markers drive the others: {markers}")
    typer.echo("\n".join(lines))
    typer.echo(f"{output}: {len(fitted.profile.phones)} phones, {len(fitted.profile.expressions)} expressions")
    if report:
        typer.echo(f"look at {output / 'report.html'}")
