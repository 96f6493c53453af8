"""Face motion: FBA streams, FAPs, and tables of shapes."""

from collections.abc import Sequence
from dataclasses import asdict
from io import BytesIO
from typing import Any

import numpy as np

from fapengine.app.inspection.report import FileKind, Markup, Report, Source, Table, level_bars
from fapengine.codec.decoder import Decoded
from fapengine.codec.elementary import level_of
from fapengine.codec.fields import FIELD_FAPS
from fapengine.errors import DataError
from fapengine.files.fba import load_fba, read_fba_film, read_stream
from fapengine.files.motion import load_fap, load_motion, shown
from fapengine.files.paths import is_mp4, open_file
from fapengine.files.pictures import Picture, bar_chart
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FAP_2_EXPRESSIONS, FULL_WEIGHT, VISEMES
from fapengine.mpeg4.track import FapTrack, motion_remarks
from fapengine.retarget.blend_tracks import is_blend_table, is_vmc_recording

PLANES_SHOWN, FAPS_SHOWN = 40, 12
BAR = 28
"""Characters of the longest bar."""
FBA_START = b"\x00\x00\x01"


def _is_stream(source: Source) -> bool:
    with open_file(source.path) if source.ending == ".mp4" else BytesIO(source.data) as file:
        data = file.read(8)  # a film may be long
    return data.startswith(FBA_START) or (is_mp4(data) and read_fba_film(source.path) is not None)


def _stream(source: Source) -> Report:
    """Describe a stream; damage is reported, not an error."""
    facts = describe_stream(load_fba(source.path, errors="resync", with_costs=True), len(read_stream(source.path)))
    planes: Sequence[dict[str, Any]] = facts["planes"]
    costs: dict[int, float] = facts["fap_bits"]
    level, longest = facts["level"], max(plane["bits"] for plane in planes)
    text: list[str | Table] = [
        f"FBA stream, {facts['bytes']} bytes, {facts['i_planes']} I and {facts['p_planes']} P planes, "
        f"{facts['seconds']:.2f} s at {facts['rate_hz']:.6g} Hz, {facts['kbit_s']:.3f} kbit/s",
        f"Simple Face Animation: {f'level {level}' if level else 'within no level'}",
    ]
    text += _high_level_lines(facts)
    if facts["body_planes"]:
        text.append(f"{facts['body_planes']} planes contain a body, which is ignored")
    rows = []
    for plane in planes:
        bar = _bar(plane["bits"], longest)
        cells = [str(plane[key]) for key in ("frame", "time_s", "kind", "quant", "faps", "skipped", "bits")]
        rows.append([*cells, Markup(f"[cyan]{bar}[/]") if plane["kind"] == "I" else bar])
    columns = ("frame", "s", "", "q", "FAPs", "skipped", "bits", "")
    text.append(Table(columns=columns, rows=rows, shown=PLANES_SHOWN, more="… and {} more planes (--all)"))
    rows = [
        [str(number), _fap_name(number), f"{bits:.0f}", f"{bits / len(planes):.2f}", _bar(bits, max(costs.values()))]
        for number, bits in sorted(costs.items(), key=lambda item: -item[1])
    ]
    text.append(Table(columns=("FAP", "name", "bits", "bits/plane", ""), rows=rows))
    text += [
        Markup(f"[red]lost[/] bits {loss['start_bit']} to {loss['end_bit']}: {loss['reason']}")
        for loss in facts["losses"]
    ]
    return Report(facts=facts, text=text, plot=lambda: _plane_bars(facts))


def describe_stream(decoded: Decoded, size: int) -> dict[str, Any]:
    """Make the values of a stream of ``size`` bytes."""
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
        **high_level(track),
    }


def _bar(value: float, longest: float) -> str:
    return "█" * max(1, round(BAR * value / longest))


def _fap_name(number: int) -> str:
    return ("viseme", "expression")[number - 1] if number < 3 else fap.spec(number).name


def _plane_bars(facts: dict[str, Any]) -> Picture:
    """Draw bits of each plane, intra planes marked, and bits of each FAP."""
    planes: Sequence[dict[str, Any]] = facts["planes"]
    by_time = bar_chart(
        [plane["bits"] for plane in planes],
        title=f"Bits a plane: {facts['kbit_s']:.2f} kbit/s, I planes marked",
        marked=[plane["kind"] == "I" for plane in planes],
        first=f"{planes[0]['time_s']:.2f} s",
        last=f"{planes[-1]['time_s']:.2f} s",
    )
    costs: dict[int, float] = facts["fap_bits"]
    by_fap = bar_chart(
        [costs.get(number, 0.0) for number in range(1, 69)],
        title="Bits a FAP, all planes",
        marked=[number in (1, 2) for number in range(1, 69)],
        first="FAP 1",
        last="FAP 68",
    )
    return np.concatenate([by_time, by_fap])


def _motion(source: Source, what: str) -> Report:
    """Describe face motion as FAPs; ``what`` is what the file holds."""
    sent = load_fap(source.path) if source.ending == ".fap" else load_motion(source.path)
    track = shown(sent)
    if not len(track.frame_numbers):
        raise DataError(f"{source.path}: contains no frames")
    facts = describe_track(track) | high_level(sent)
    facts["remarks"] = list(sent.remarks or motion_remarks(track))
    skipped = f", {facts['skipped']} skipped" if facts["skipped"] else ""
    moving = sorted(facts["faps"].items(), key=lambda item: -_reach(item[1]))
    lines = [
        f"  {row['number']:>2} {name:<24} {row['low']:>7} .. {row['high']:<7} {row['unit']}" for name, row in moving
    ]
    text: list[str | Table] = [
        f"{what}: {facts['frames']} frames at {facts['rate_hz']:g} Hz{skipped}",
        f"{facts['seconds']:.2f} s, {len(facts['faps'])} FAPs move",
        *_high_level_lines(facts),
        Table(rows=lines, shown=FAPS_SHOWN, more="  ... and {} more (--all)"),
    ]
    return Report(facts=facts, text=text, plot=lambda: _opening(track, facts["seconds"]), warnings=facts["remarks"])


def describe_track(track: FapTrack) -> dict[str, Any]:
    """Make the values of a track; ``faps`` has those that move, with their range in FAPU."""
    spans = {}
    for row in fap.FAPS:
        values = track.values[track.mask[:, fap.column(row.number)], fap.column(row.number)]
        if values.any():
            low, high = int(values.min()), int(values.max())
            spans[row.name] = {"number": row.number, "low": low, "high": high, "unit": str(row.unit)}
    count = int(track.frame_numbers[-1] - track.frame_numbers[0] + 1)
    return {
        "format": "FAP", "name": track.name, "rate_hz": track.rate_hz, "frames": len(track.frame_numbers),
        "skipped": count - len(track.frame_numbers), "seconds": count / track.rate_hz,
        "faps": spans,
    }  # fmt: skip


def high_level(track: FapTrack) -> dict[str, Any]:
    """Name the visemes and expressions (FAP 1 and 2) that a track selects at some weight, in the standard's order."""
    selects = (
        ("visemes", [viseme.label for viseme in VISEMES], track.visemes[track.mask[:, 0]], ((0, 2), (1, 2))),
        ("expressions", FAP_2_EXPRESSIONS, track.expressions[track.mask[:, 1]], ((0, 1), (2, 3))),
    )
    named = {}
    for key, names, rows, places in selects:
        weights = [rows[:, weight] if select != 1 else FULL_WEIGHT - rows[:, weight] for select, weight in places]
        used = {
            int(number)
            for (select, _), weight in zip(places, weights, strict=True)
            for number in rows[weight > 0, select]
        }
        named[key] = [names[number] for number in sorted(used)]
    return named


def _high_level_lines(facts: dict[str, Any]) -> list[str]:
    return [f"{key}: {', '.join(facts[key])}" for key in ("visemes", "expressions") if facts[key]]


def _reach(row: dict[str, Any]) -> float:
    """Fraction of a FAP's range that is used, so that angles and lengths compare."""
    spec = fap.spec(row["number"])
    return float((row["high"] - row["low"]) / (spec.intra_limit * spec.quantiser_step))


def _opening(track: FapTrack, seconds: float) -> Picture:
    """Draw the opening of the lips over time, -(FAP 4 + FAP 5)."""
    opening = -(track.values[:, fap.column(4)] + track.values[:, fap.column(5)])
    return level_bars(np.maximum(opening, 0), "Opening of the lips, -(FAP 4 + FAP 5), FAPU", seconds)


FBA = FileKind(name="an FBA stream", endings=(".fba", ".mp4"), fits=_is_stream, describe=_stream)
FAPS = FileKind(
    name="FAPs",
    endings=(".fap",),
    fits=lambda source: source.ending == ".fap",
    describe=lambda source: _motion(source, "FAPs"),
)
SHAPES = FileKind(
    name="a table of weights",
    endings=(".csv", ".json", ".osc"),
    fits=lambda source: source.format is None and (is_blend_table(source.data) or is_vmc_recording(source.data)),
    describe=lambda source: _motion(source, "shapes, as FAPs"),
)
