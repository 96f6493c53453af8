"""``fapengine fit``: learn a profile from a motion-capture session, with a report."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fapengine.cli.options import AsJson, WordsVoice, WriteOptions

if TYPE_CHECKING:
    from fapengine.laboratory.fit import Fitted


def fit(
    session: Path = typer.Argument(..., help="Folder with recordings, their phone timings, and session.toml."),
    output: Path = typer.Option(..., "--output", "-o", help="Profile folder to write: profiles/NAME."),
    modes: int | None = typer.Option(
        None, min=1, max=1000, help="Components of the viseme space. Default: 99 % of the variance."
    ),
    subset: int | None = typer.Option(
        None, min=1, max=10_000, help="Markers in the subset. Default: chosen by --tolerance."
    ),
    tolerance: float = typer.Option(0.35, min=0.0, max=100.0, help="Largest mean error of the marker subset, in mm."),
    held_out: float = typer.Option(0.2, min=0.0, max=0.5, help="Fraction of the takes held out for testing."),
    units: str | None = typer.Option(None, help="Units of recordings without units: mm, cm, m or inch."),
    up: str | None = typer.Option(None, help="Up axis: +y, +z, ..."),
    seed: int = typer.Option(1, min=0, help="Random seed of the split into training and held-out takes."),
    voice: WordsVoice = None,
    report: bool = typer.Option(True, "--report/--no-report", help="Write report.html into the profile folder."),
    faps: bool = typer.Option(False, "--faps", help="Also write every take as FAPs: takes/TAKE.fap."),
    adapt: bool = typer.Option(
        False, "--adapt", help="Fit the built-in head, with eyes and teeth, to the dense face, for --head PROFILE."
    ),
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Learn a face model from motion capture: marker subset, viseme space, phones, dense face.

        fapengine fit recordings/S03 -o profiles/s03
        fapengine say "Hello." --profile profiles/s03 -o hello.mp4

    SESSION contains recordings (C3D, TRC, CSV, TSV, NPZ, face landmarks, mesh sequences), each with phone timings of
    the same name. Markers named like the standard's feature points (8.1, 2.10 ...) need no configuration; everything
    else is set in session.toml.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from fapengine.app.fit import OWNED, check_folder, describe, run_fit
    from fapengine.cli._printing import print_result, spell_nearness
    from fapengine.files.outputs import files_in
    from fapengine.laboratory.fit import STEPS, FitOptions

    if output.is_file():
        check_folder(output)
    writing.check(files_in(output, OWNED), [session])
    options = FitOptions(modes=modes, k=subset, tolerance_mm=tolerance, held_out=held_out)
    console = Console(stderr=True)
    columns = (TextColumn("{task.description:32.32}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        reading = progress.add_task("reading", total=None)
        fitting = progress.add_task(STEPS[0], total=len(STEPS), visible=False)
        fitted, nearness = run_fit(
            session, output, options, units=units, up=up, seed=seed, voice=voice, report=report, faps=faps, adapt=adapt,
            on_take=lambda name, count: progress.update(reading, total=count, advance=1, description=f"reading {name}"),
            on_step=lambda step: progress.update(fitting, advance=1, description=step, visible=True),
        )  # fmt: skip
    lines = _lines(output, fitted, report=report)
    if nearness is not None:
        lines.append(f"{output / 'head'}: built-in head fitted to the dense face; {spell_nearness(nearness)}")
    if not as_json:
        for text in fitted.warnings:
            typer.echo(f"warning: {text}", err=True)
    print_result(describe(fitted, nearness) | {"output": str(output)}, *lines, as_json=as_json)


def _lines(output: Path, fitted: "Fitted", *, report: bool) -> list[str]:
    lines = [text for key, text in fitted.profile.origin.items() if key in ("takes", "variance", "held_out")]
    if fitted.selection is not None:
        markers = ", ".join(fitted.selection.prepared.labels[index] for index in fitted.selection.swapped.primary)
        lines.append(f"{fitted.selection.k} markers drive the others: {markers}")
    lines.append(f"{output}: {len(fitted.profile.phones)} phones, {len(fitted.profile.expressions)} expressions")
    return lines + ([f"report: {output / 'report.html'}"] if report else [])
