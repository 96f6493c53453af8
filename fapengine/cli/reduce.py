"""``fapengine reduce``: reduce a recording to via points."""

from pathlib import Path

import typer

from fapengine.cli.options import AsJson, WriteOptions

MIN_BOUND_MM, MAX_BOUND_MM = 0.001, 100.0


def reduce(
    take: Path = typer.Argument(..., help="Marker recording without gaps (.c3d, .trc, .csv, .npz)."),
    bound: str = typer.Option("0.5mm", "--max-error", help="Largest error of any marker in any frame, such as 0.5mm."),
    output: Path = typer.Option(..., "--output", "-o", help="Via points and the reduction curve (.npz)."),
    back: Path | None = typer.Option(
        None, help="Write the curve through the via points as a recording (.trc, .c3d, .npz)."
    ),
    fps: float | None = typer.Option(
        None, min=1.0, max=1000.0, help="Frame rate of --back. Default: that of the take."
    ),
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Reduce a motion to a few poses, connected by minimum-jerk motion (paper 004).

    fapengine reduce take.c3d --max-error 0.5mm -o via.npz
    fapengine reduce take.c3d -o via.npz --back take60.trc --fps 60
    """
    from dataclasses import asdict

    from fapengine.app.reduce import reduce_take
    from fapengine.cli._printing import print_result
    from fapengine.errors import UsageError

    try:
        bound_mm = float(bound.removesuffix("mm"))
    except ValueError as error:
        raise UsageError(f"--max-error: must be millimetres such as 0.5mm, got {bound!r}") from error
    if not MIN_BOUND_MM <= bound_mm <= MAX_BOUND_MM:
        raise UsageError(f"--max-error: must be {MIN_BOUND_MM:g} to {MAX_BOUND_MM:g} mm, got {bound!r}")
    writing.check([path for path in (output, back) if path is not None], [take])
    curve = reduce_take(take, bound_mm, output, back=back, rate_hz=fps)
    lines = ["bound, mm   points   of frames   mean, mm   largest, mm"]
    for row in curve:
        shares = f"{row.point_count:8}   {100 * row.share:7.1f} %"
        lines.append(f"{row.tolerance_mm:9.2f} {shares}   {row.mean_mm:8.3f}   {row.max_mm:11.3f}")
    print_result([asdict(row) for row in curve], *lines, as_json=as_json)
