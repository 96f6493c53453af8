"""What ``fapengine fit`` does: read a session, learn from it, write profile and report."""

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from fapengine.errors import UsageError
from fapengine.files.fap import save_fap
from fapengine.files.paths import write_bytes
from fapengine.files.profiles import load_profile, save_profile
from fapengine.files.sessions import load_session
from fapengine.laboratory.densify import DenseStudy
from fapengine.laboratory.fit import STEPS, FitOptions, Fitted, fit_session
from fapengine.laboratory.playback import captured_faps
from fapengine.mesh.head import build_head
from fapengine.profiles import TOML_NAME

STANDARD = "grid_s1_en"
"""Lends the expressions that a session lacks."""


def run_fit(
    session: Path,
    output: Path,
    options: FitOptions,
    *,
    units: str | None,
    up: str | None,
    seed: int,
    report: bool,
    faps: bool,
    as_json: bool,
) -> None:
    """Run the chain and write what it found.

    Raises
    ------
    UsageError
        If ``output`` is there and no profile.
    DataError, ResourceError
        As reading, fitting and writing say.
    """
    if output.exists() and not (output / TOML_NAME).is_file() and (not output.is_dir() or any(output.iterdir())):
        raise UsageError(f"{output}: got something that is no profile, expected a new folder or a profile's")
    head = build_head()
    console = Console(stderr=True)
    with _bar(console) as progress:
        reading = progress.add_task("reading", total=None)

        def on_take(name: str, count: int) -> None:
            progress.update(reading, total=count, advance=1, description=f"reading {name}")

        loaded = load_session(session, units=units, up=up, on_take=on_take)
        fitting = progress.add_task(STEPS[0], total=len(STEPS))
        origin = {"source": f"session {loaded.session.subject}", "command": _command(session, output, seed)}
        if loaded.setup.attribution:
            origin["attribution"] = loaded.setup.attribution
        fitted = fit_session(
            loaded.session,
            loaded.setup,
            profile_id=output.name,
            origin=origin,
            standard=load_profile(STANDARD),
            face_mm={name: np.asarray(head.point_mm(name), np.float64) for name in head.feature_points},
            face_fapu=head.fapu,
            options=options,
            rng=np.random.default_rng(seed),
            on_step=lambda step: progress.update(fitting, advance=1, description=step),
            warnings=loaded.warnings,
        )
    _write(output, fitted, report=report, faps=faps)
    if as_json:
        typer.echo(json.dumps(describe(fitted) | {"output": str(output)}))
    else:
        _print(output, fitted, report=report)


@contextmanager
def _bar(console: Console) -> Iterator[Progress]:
    columns = (TextColumn("{task.description:32.32}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


def _command(session: Path, output: Path, seed: int) -> str:
    return f"fapengine fit {session.resolve().name} -o {output.name} --seed {seed}"


def _write(output: Path, fitted: Fitted, *, report: bool, faps: bool) -> None:
    page = None
    if report:  # before anything is written: it may lack its library
        from fapengine.files.report import write_report

        page = write_report(fitted)
    save_profile(output, fitted.profile)
    if page is not None:
        write_bytes(output / "report.html", page)
    if fitted.dense is not None:
        write_bytes(output / "dense.npz", _dense_arrays(fitted.dense))
    if faps:
        for take in fitted.prepared.takes:
            save_fap(output / "takes" / f"{take.name}.fap", captured_faps(take, fitted.prepared, fitted.profile))


def _dense_arrays(study: DenseStudy) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        mean_mm=study.modes.mean_mm.astype(np.float32),
        modes_mm=study.modes.modes_mm.astype(np.float32),
        triangles=study.triangles.astype(np.int32),
        marker_mean_mm=study.sparse.mean_mm.astype(np.float32),
        marker_modes_mm=study.sparse.modes_mm.astype(np.float32),
    )
    return buffer.getvalue()


def describe(fitted: Fitted) -> dict[str, object]:
    """Give the figures of a fit as plain values."""
    space, selection, prediction = fitted.space, fitted.selection, fitted.prediction
    kept = space.space.mode_count
    return {
        "profile": fitted.profile.id,
        "takes": len(fitted.prepared.takes),
        "held_out_takes": len(fitted.held_out),
        "markers": len(fitted.prepared.labels),
        "modes": kept,
        "variance": round(float(space.share[kept - 1]), 5),
        "marker_error_mm": round(float(space.error_mm[kept - 1]), 4) if len(space.error_mm) else None,
        "subset": None
        if selection is None
        else {
            "k": selection.k,
            "markers": [fitted.prepared.labels[index] for index in selection.swapped.primary],
            "error_mm": {name: round(value, 4) for name, value in selection.held_out_mm.items()},
        },
        "phones": {name: study.tokens for name, study in fitted.phones.items()},
        "lips_mm": None if prediction is None else round(prediction.lips_mm, 3),
        "opening_r": None if prediction is None else round(prediction.opening_r, 3),
        "dense_left_out_mm": None if fitted.dense is None else round(fitted.dense.left_out_mm[0], 3),
        "warnings": list(fitted.warnings),
    }


def _print(output: Path, fitted: Fitted, *, report: bool) -> None:
    for text in fitted.warnings:
        typer.echo(f"warning: {text}", err=True)
    told = [text for key, text in fitted.profile.origin.items() if key in ("takes", "variance", "held_out")]
    if fitted.selection is not None:
        markers = ", ".join(fitted.prepared.labels[index] for index in fitted.selection.swapped.primary)
        told.append(f"{fitted.selection.k} markers drive the others: {markers}")
    typer.echo("\n".join(told))
    typer.echo(f"{output}: {len(fitted.profile.phones)} phones, {len(fitted.profile.expressions)} expressions")
    if report:
        typer.echo(f"look at {output / 'report.html'}")
