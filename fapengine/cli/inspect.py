"""``fapengine inspect``: say what is in a file, whatever it is."""

from pathlib import Path

import typer

FBA_STARTS = (b"\x00\x00\x01",)


def inspect(
    path: Path = typer.Argument(..., help="File to look into: an FBA stream (.fba)."),
    everything: bool = typer.Option(False, "--all", help="Every plane, not only the first ones."),
    plot: Path | None = typer.Option(None, "--plot", help="Draw the findings into a picture (.png)."),
    as_json: bool = typer.Option(False, "--json", help="Print the findings as JSON."),
) -> None:
    """Say what is in a file; what it is, its bytes decide.

    Example: fapengine inspect talk.fba
    """
    from fapengine.errors import UnsupportedError
    from fapengine.files.paths import read_bytes

    head = read_bytes(path)[:4]
    if head.startswith(FBA_STARTS):
        from fapengine.cli._inspect_fba import inspect_fba

        inspect_fba(path, as_json=as_json, everything=everything, plot=plot)
    else:
        raise UnsupportedError(f"{path}: got {head.hex(' ')}, expected an FBA stream (00 00 01 ..)", where="byte 0")
