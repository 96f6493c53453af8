"""``fapengine decode``: decode an FBA stream into FAPs."""

from pathlib import Path

import typer

from fapengine.cli import options as shared


def decode(
    stream: Path = typer.Argument(..., help="FBA stream (.fba)."),
    output: Path = typer.Option(..., "--output", "-o", help="FAPs as text (.fap)."),
    resync: bool = typer.Option(False, "--resync", help="Continue after damage, and report what was lost."),
    exact_rate: bool = typer.Option(
        False, "--exact-rate", help="Write frame rates such as 30000/1001 exactly instead of rounded."
    ),
    fill: bool = typer.Option(
        False,
        "--fill",
        help="Write what a face shows: visemes and expressions as low-level FAPs; FAPs that were not sent are held, or"
        " copied from the other side.",
    ),
    fit: Path | None = typer.Option(
        None, help="FAP interpolation table (.fit) that computes FAPs that were not sent; implies --fill."
    ),
    single_numbers: bool = typer.Option(
        False, "--greta", help="Write FAP 1 and 2 as one number each, as Greta reads them."
    ),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Decode an MPEG-4 FBA stream into FAPs.

    fapengine decode talk.fba -o talk.fap
    fapengine decode visemes.fba --fill -o talk.fap
    """
    from dataclasses import asdict, replace

    from fapengine.cli._printing import print_result, working
    from fapengine.codec.fit import fill_track
    from fapengine.files.fba import load_fba, load_fit
    from fapengine.files.motion import save_fap, shown
    from fapengine.files.paths import is_standard, standard_output

    output = standard_output(output, ".fap")
    writing.check([output], [stream, fit])
    table = None if fit is None else load_fit(fit)
    with working(f"decoding {stream.name}"):
        decoded = load_fba(stream, errors="resync" if resync else "strict")
    track, unreal = decoded.track, 0
    if fill or fit is not None:
        track, unreal = fill_track(decoded, shown(track), table)
    rate = next((part.header.rate for part in decoded.planes if part.header.rate is not None), None)
    if rate is not None and rate.whole and not exact_rate:  # what all readers of .fap understand
        track = replace(track, rate_hz=float(rate.whole))
        if rate.hz != rate.whole:
            typer.echo(f"{stream}: {rate.hz:.6g} Hz is written as {rate.whole}; --exact-rate keeps it", err=True)
    with working(f"writing {len(track)} frames"):
        save_fap(output, track, single_numbers=single_numbers)
    losses = [asdict(loss) for loss in decoded.losses]
    facts = {"output": str(output), "frames": len(track), "losses": losses, "not_real": unreal}
    print_result(facts, f"{output}: {len(track)} frames", as_json=as_json, err=is_standard(output))
    if as_json:
        return
    if unreal:
        typer.echo(f"{fit}: gives no real number for {unreal} values, which are held", err=True)
    if decoded.body_planes:
        typer.echo(f"{stream}: {decoded.body_planes} planes contain body parameters, which are ignored", err=True)
    for loss in decoded.losses:
        typer.echo(
            f"lost: bits {loss.start_bit} to {loss.end_bit}, {loss.frames_dropped} frames dropped: {loss.reason}",
            err=True,
        )
