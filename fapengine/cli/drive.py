"""``fapengine drive``: drive a face from a few of its markers."""

from pathlib import Path

import typer

from fapengine.cli import options as shared


def drive(
    drawing: shared.DrawingOptions,
    grid: Path = typer.Argument(
        ...,
        help="Recording of all markers to learn from (.c3d, .trc, .npz, .csv), a session: a folder of recordings, or a"
        " folder of meshes.",
    ),
    markers: str | None = typer.Option(
        None,
        "--markers",
        help="Driving markers: names such as 8.2,2.1,5.3, or a number such as 9, chosen by QR with column pivoting."
        " Default: chosen by --tolerance.",
    ),
    take: Path | None = typer.Option(
        None,
        "--take",
        help="Driving recording. Default: the last quarter of the takes (of one take: its last quarter), which is then"
        " not used for learning.",
    ),
    output: Path = typer.Option(..., "--output", "-o", help="Motion of all markers, weights and surface (.npz)."),
    film: Path | None = typer.Option(
        None,
        "--film",
        help="Video of the surface with the markers as dots (.mp4, .gif ...), beside a head that moves likewise if"
        " 10 of the 14 points of lips, chin and cheeks are recorded.",
    ),
    skull: str | None = typer.Option(
        None,
        "--skull",
        help="Markers on the skull, such as LFHD,RFHD,TOP. Default: head in session.toml; without it the head does not"
        " move.",
    ),
    scale: list[str] = typer.Option([], "--scale", help="Scale the motion of a driving marker: 8.2=1.5. Repeatable."),
    delay: list[str] = typer.Option([], "--delay", help="Delay a driving marker: 8.2=40ms. Repeatable."),
    remove: list[str] = typer.Option([], "--remove", help="Remove the motion of a driving marker: 8.2. Repeatable."),
    columns: int = typer.Option(48, "--columns", min=4, max=400, help="Points of the surface from left to right."),
    tolerance: float = typer.Option(
        0.35, "--tolerance", min=0.0, max=100.0, help="Largest mean error for the chosen number of markers, in mm."
    ),
    fps: float | None = typer.Option(None, "--fps", min=1.0, max=1000.0, help="Frame rate of a folder of meshes."),
    without: shared.WithoutMark = [],  # noqa: B006
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Drive a face from a few of its markers, and report the error of the others (paper 000).

        fapengine drive talk.c3d --skull LFHD,RFHD,TOP --markers 9 -o driven.npz
        fapengine drive recordings/S03 --markers 9 -o driven.npz --film driven.mp4
        fapengine drive recordings/S03 --markers 9 --scale 8.2=1.5 -o edited.npz

    Each chosen marker moves every other marker by one weight, and the surface between them by cubic interpolation. The
    first frame of the recording is the neutral position.
    """
    from dataclasses import asdict

    from fapengine.app.drive_grid import DriveOptions, run_drive
    from fapengine.cli._printing import print_result

    writing.check([path for path in (output, film) if path is not None], [grid, take, drawing.background])
    chosen: tuple[str, ...] | int | None = None
    if markers is not None:
        listed = tuple(name.strip() for name in markers.split(",") if name.strip())
        chosen = int(markers) if markers.strip().isdigit() else listed
    options = DriveOptions(
        markers=chosen,
        skull=tuple(name.strip() for name in skull.split(",") if name.strip()) if skull else (),
        tolerance_mm=tolerance,
        scale=_values("scale", scale) | dict.fromkeys(remove, 0.0),
        delay_s={name: ms / 1000 for name, ms in _values("delay", delay, unit="ms").items()},
    )
    report = run_drive(grid, output, options, drawing.value(), take=take, film=film, columns=columns, rate_hz=fps)
    takes = f" of {report.learned_takes} takes" if report.learned_takes > 1 else ""
    lines = [
        f"{len(report.markers)} markers drive the face ({report.reason}): {', '.join(report.markers)}",
        f"learned from {report.learned_frames} frames{takes}; {report.driven_frames} driven,"
        f" {report.points} points of the surface",
    ]
    if report.mean_mm is not None:
        lines.append(
            f"driven markers: mean {report.mean_mm:.3f} mm, 95 % within {report.p95_mm:.2f}, largest"
            f" {report.largest_mm:.2f}, worst {report.worst}; a still face {report.still_mm:.3f}"
        )
    shown = "a head, and the surface with its markers" if report.has_face else "the surface with its markers"
    print_result(asdict(report), *lines, f"{output}" + (f", {film} ({shown})" if film else ""), as_json=as_json)


def _values(option: str, texts: list[str], unit: str = "") -> dict[str, float]:
    """Read ``NAME=NUMBER`` with a unit."""
    from math import isfinite, nan

    from fapengine.errors import UsageError

    values: dict[str, float] = {}
    for text in texts:
        name, _, number = text.rpartition("=")
        try:
            value = float(number.removesuffix(unit))
        except ValueError:
            value = nan
        if not name or not isfinite(value):
            raise UsageError(f"--{option}: must be NAME=NUMBER{unit} such as 8.2=1{unit}, got {text!r}")
        values[name] = value
    return values
