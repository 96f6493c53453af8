"""``fapengine reduce``: a recording as a few via points, and back at any rate."""

from pathlib import Path

import typer

from fapengine.cli.options import AsJson, WriteOptions


def reduce(
    take: Path = typer.Argument(..., help="Recording of markers (.c3d, .trc, .csv, .npz) without gaps."),
    bound: str = typer.Option("0.5mm", "--bound", help="Largest distance of any marker in any frame, mm."),
    output: Path = typer.Option(..., "--output", "-o", help="Via points and the reduction curve (.npz)."),
    back: Path | None = typer.Option(None, "--back", help="The curve through them as a recording (.trc, .c3d, .npz)."),
    fps: float | None = typer.Option(None, "--fps", min=1.0, help="Frames a second of --back; by default the take's."),
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Keep a motion as a few poses, between which it moves with the least jerk (paper 004).

    fapengine reduce take.c3d --bound 0.5mm -o via.npz
    fapengine reduce take.c3d -o via.npz --back take60.trc --fps 60
    """
    from fapengine.app.reduce import ReduceJob, run_reduce
    from fapengine.errors import UsageError

    try:
        bound_mm = float(bound.removesuffix("mm"))
    except ValueError as error:
        raise UsageError(f"--bound: got {bound!r}, expected millimetres such as 0.5mm") from error
    writing.check([path for path in (output, back) if path is not None], [take])
    curve = run_reduce(ReduceJob(take=take, bound_mm=bound_mm, output=output, back=back, rate_hz=fps))
    if as_json:
        import json
        from dataclasses import asdict

        typer.echo(json.dumps([asdict(row) for row in curve]))
        return
    typer.echo("bound, mm   points   of frames   mean, mm   largest, mm")
    for row in curve:
        shares = f"{row.point_count:8}   {100 * row.share:7.1f} %"
        typer.echo(f"{row.tolerance_mm:9.2f} {shares}   {row.mean_mm:8.3f}   {row.max_mm:11.3f}")
