"""``fapengine fit``: a capture session to a face model, with a report."""

from pathlib import Path

import typer

from fapengine.cli.options import AsJson


def fit(
    session: Path = typer.Argument(..., help="Folder of recordings with phone timings beside them, and session.toml."),
    output: Path = typer.Option(..., "--output", "-o", help="Profile to write, a folder: profiles/NAME."),
    modes: int | None = typer.Option(None, "--modes", help="Components of the space; by default 99 % of the variance."),
    subset: int | None = typer.Option(None, "--subset", help="Markers in the subset; by default the error decides."),
    tolerance: float = typer.Option(0.35, "--tolerance", help="Mean error in mm that the subset may leave."),
    held_out: float = typer.Option(0.2, "--held-out", help="Share of takes to judge by, 0 to 0.5."),
    units: str | None = typer.Option(None, "--units", help="mm, cm, m or inch, for recordings that do not say."),
    up: str | None = typer.Option(None, "--up", help="Axis that points up: +y, +z, ..."),
    seed: int = typer.Option(1, "--seed", help="Chance of the split into takes to learn from and to judge by."),
    report: bool = typer.Option(True, "--report/--no-report", help="Write report.html beside the profile."),
    faps: bool = typer.Option(False, "--faps", help="Write every take as captured FAPs too: takes/TAKE.fap."),
    as_json: AsJson = False,
) -> None:
    """Learn a face model from motion capture: markers that matter, viseme space, phones, dense face.

    SESSION holds recordings (C3D, TRC, CSV, TSV, NPZ, face landmarks, mesh sequences) and, for each, phone timings of
    the same name. Markers named as feature points of the standard (8.1, 2.10 ...) need nothing more; what the files
    do not say stands in session.toml.

    Example: fapengine fit recordings/S03 -o profiles/s03 && fapengine say "Hello." --profile profiles/s03 -o hello.mp4
    """
    from fapengine.cli._fit import run_fit
    from fapengine.laboratory.fit import FitOptions

    options = FitOptions(modes=modes, k=subset, tolerance_mm=tolerance, held_out=held_out)
    run_fit(session, output, options, units=units, up=up, seed=seed, report=report, faps=faps, as_json=as_json)
