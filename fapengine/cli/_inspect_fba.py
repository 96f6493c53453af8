"""What ``fapengine inspect`` says about an FBA stream: planes and bits, the cost of each FAP, losses, a plot."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fapengine.codec.decoder import Decoded
from fapengine.codec.elementary import level_of
from fapengine.codec.fields import FIELD_FAPS
from fapengine.files.fba import load_fba, read_stream
from fapengine.files.pictures import Picture, bar_chart, save_png, under_each_other
from fapengine.mpeg4 import fap

PLANES_SHOWN = 40
BAR = 28
"""Letters of the longest bar."""


def inspect_fba(path: Path, *, as_json: bool, everything: bool = False, plot: Path | None = None) -> None:
    """Print the report of a stream; damage is shown, not refused.

    Raises
    ------
    DataError
        If not one frame can be decoded.
    """
    decoded = load_fba(path, errors="resync", with_costs=True)
    report = describe(decoded, len(read_stream(path)))
    if plot is not None:
        save_png(plot, _draw(report))
    if as_json:
        import json

        import typer

        typer.echo(json.dumps(report))
    else:
        _print(report, everything=everything)


def describe(decoded: Decoded, size: int) -> dict[str, Any]:
    """Make the report as plain values.

    Parameters
    ----------
    size : int
        Bytes of the whole stream.
    """
    planes = [
        {
            "frame": int(part.numbers[n]), "time_s": round(float(part.times_s[n]), 4),
            "kind": "I" if part.intra else "P",
            "first_bit": int(part.extents[n, 0]), "bits": int(part.extents[n, 1] - part.extents[n, 0]),
            "quant": part.header.quant, "faps": int(part.header.mask.sum()), "skipped": int(part.extents[n, 2]),
        }
        for part in decoded.planes
        for n in range(len(part))
    ]  # fmt: skip
    level = level_of(decoded)
    costs = np.bincount(FIELD_FAPS, weights=decoded.costs, minlength=fap.FAP_COUNT + 1)
    track = decoded.track
    seconds = float(track.frame_numbers[-1] - track.frame_numbers[0] + 1) / track.rate_hz
    return {
        "format": "FBA",
        "bytes": size,
        "rate_hz": track.rate_hz,
        "seconds": seconds,
        "kbit_s": 8 * size / seconds / 1000,
        "i_planes": sum(plane["kind"] == "I" for plane in planes),
        "p_planes": sum(plane["kind"] == "P" for plane in planes),
        "level": None if level is None else level.number,
        "body_planes": decoded.body_planes,
        "planes": planes,
        "fap_bits": {number: round(float(costs[number]), 1) for number in range(1, 69) if costs[number] > 0},
        "losses": [asdict(loss) for loss in decoded.losses],
    }


def _fap_name(number: int) -> str:
    return ("viseme", "expression")[number - 1] if number < 3 else fap.spec(number).name


def _draw(report: dict[str, Any]) -> Picture:
    """Bits of each plane, intra planes marked, and bits of each FAP."""
    planes: Sequence[dict[str, Any]] = report["planes"]
    by_time = bar_chart(
        [plane["bits"] for plane in planes],
        title=f"Bits a plane: {report['kbit_s']:.2f} kbit/s, I planes marked",
        marked=[plane["kind"] == "I" for plane in planes],
        first=f"{planes[0]['time_s']:.2f} s",
        last=f"{planes[-1]['time_s']:.2f} s",
    )
    costs: dict[int, float] = report["fap_bits"]
    by_fap = bar_chart(
        [costs.get(number, 0.0) for number in range(1, 69)],
        title="Bits a FAP, all planes",
        marked=[number in (1, 2) for number in range(1, 69)],
        first="FAP 1",
        last="FAP 68",
    )
    return under_each_other([by_time, by_fap])


def _print(report: dict[str, Any], *, everything: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    console.print(
        f"FBA stream, {report['bytes']} bytes, {report['i_planes']} I and {report['p_planes']} P planes, "
        f"{report['seconds']:.2f} s at {report['rate_hz']:.6g} Hz, {report['kbit_s']:.3f} kbit/s"
    )
    level = report["level"]
    console.print(f"Simple Face Animation: {f'level {level}' if level else 'within no level'}")
    if report["body_planes"]:
        console.print(f"{report['body_planes']} planes carry a body, which is left out")
    planes: Sequence[dict[str, Any]] = report["planes"]
    shown = planes if everything else planes[:PLANES_SHOWN]
    table = Table("frame", "s", "", "q", "FAPs", "skipped", "bits", "", box=None, pad_edge=False)
    longest = max(plane["bits"] for plane in planes)
    for plane in shown:
        bar = "█" * max(1, round(BAR * plane["bits"] / longest))
        cells = [plane[key] for key in ("frame", "time_s", "kind", "quant", "faps", "skipped", "bits")]
        table.add_row(*map(str, cells), f"[cyan]{bar}[/]" if plane["kind"] == "I" else bar)
    console.print(table)
    if len(shown) < len(planes):
        console.print(f"… and {len(planes) - len(shown)} more planes (--all)")
    costs: dict[int, float] = report["fap_bits"]
    table = Table("FAP", "name", "bits", "bits/plane", "", box=None, pad_edge=False)
    for number, bits in sorted(costs.items(), key=lambda item: -item[1]):
        bar = "█" * max(1, round(BAR * bits / max(costs.values())))
        table.add_row(str(number), _fap_name(number), f"{bits:.0f}", f"{bits / len(planes):.2f}", bar)
    console.print(table)
    for loss in report["losses"]:
        console.print(f"[red]lost[/] bits {loss['start_bit']} to {loss['end_bit']}: {loss['reason']}")
