"""Reports of ``fapengine inspect`` on face motion, sounds, films, pictures and heads: text, JSON and plots."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, UnsupportedError
from fapengine.files.pictures import Picture
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

FAPS_SHOWN = 12
BARS = 120
"""Pieces of time of a plot."""
PIECE_S, FLOOR_DB = 0.05, -60.0
"""Length of a piece of sound whose level is plotted, and the level below which nothing is drawn."""


def inspect_motion(path: Path, kind: str, *, as_json: bool, everything: bool, plot: Path | None) -> None:
    """Print the report of face motion, as FAPs; ``kind`` says what the file holds."""
    import typer

    from fapengine.files.pictures import save_png

    track = _frames_of(path)
    report = describe_track(track)
    if plot is not None:
        save_png(plot, _opening(track, report["seconds"]))
    if as_json:
        typer.echo(json.dumps(report))
        return
    skipped = f", {report['skipped']} skipped" if report["skipped"] else ""
    typer.echo(f"{kind}: {report['frames']} frames at {report['rate_hz']:g} Hz{skipped}")
    typer.echo(f"{report['seconds']:.2f} s, {len(report['faps'])} FAPs move")
    moving = sorted(report["faps"].items(), key=lambda item: -_reach(item[1]))
    for name, row in moving if everything else moving[:FAPS_SHOWN]:
        typer.echo(f"  {row['number']:>2} {name:<24} {row['low']:>7} .. {row['high']:<7} {row['unit']}")
    if len(moving) > FAPS_SHOWN and not everything:
        typer.echo(f"  ... and {len(moving) - FAPS_SHOWN} more (--all)")


def describe_motion(path: Path) -> dict[str, Any]:
    """Make the report of face motion as plain values.

    Raises
    ------
    DataError
        If there is no frame in it, or it is no such file.
    """
    return describe_track(_frames_of(path))


def _frames_of(path: Path) -> FapTrack:
    from fapengine.files.motion import load_motion

    track = load_motion(path)
    if not len(track.frame_numbers):
        raise DataError(f"{path}: got no frame, expected one or more")
    return track


def describe_track(track: FapTrack) -> dict[str, Any]:
    """Make the report of a track as plain values; ``faps`` has those that move, with their range in FAPU."""
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
        "visemes": bool(track.visemes.any()), "expressions": bool(track.expressions.any()), "faps": spans,
    }  # fmt: skip


def _reach(row: dict[str, Any]) -> float:
    """Share of a FAP's range that is used, so that angles and lengths compare."""
    spec = fap.spec(row["number"])
    return float((row["high"] - row["low"]) / (spec.intra_limit * spec.quantiser_step))


def _opening(track: FapTrack, seconds: float) -> Picture:
    """Draw the opening of the lips over time, -(FAP 4 + FAP 5)."""
    opening = -(track.values[:, fap.column(4)] + track.values[:, fap.column(5)])
    return _bars(np.maximum(opening, 0), "Opening of the lips, -(FAP 4 + FAP 5), FAPU", seconds)


def _bars(values: NDArray[np.generic], title: str, seconds: float) -> Picture:
    """Draw the highest value of each piece of time."""
    from fapengine.files.pictures import bar_chart

    highest = [float(piece.max()) for piece in np.array_split(values, min(BARS, len(values)))]
    return bar_chart(highest, title=title, marked=[False] * len(highest), first="0.00 s", last=f"{seconds:.2f} s")


def inspect_recording(path: Path, *, as_json: bool, plot: Path | None) -> None:
    """Print the report of a sound or a film; the plot is the level over time."""
    import typer

    levels: list[float] = []
    report = describe_recording(path, levels)
    if plot is not None:
        if not levels:
            raise UnsupportedError(f"{path}: has no sound, so there is nothing to plot")
        from fapengine.files.pictures import save_png

        above = np.maximum(np.array(levels) - FLOOR_DB, 0)
        title = f"Level in pieces of {PIECE_S:g} s, dB above {FLOOR_DB:g} dB of full scale"
        save_png(plot, _bars(above, title, report["sound"]["seconds"]))
    if as_json:
        typer.echo(json.dumps(report))
        return
    if film := report.get("film"):
        typer.echo(f"film: {film['width']}x{film['height']}, {film['rate_hz']:g} frames/s, {film['codec']}")
    if sound := report.get("sound"):
        channels = "mono" if sound["channels"] == 1 else f"{sound['channels']} channels"
        typer.echo(f"sound: {sound['seconds']:.2f} s, {sound['sample_rate_hz']} Hz, {channels}")
        typer.echo(f"level: {sound['level_db']:.1f} dB, peak {sound['peak_db']:.1f} dB below full scale")
        if sound["clipped"]:
            typer.echo(f"{sound['clipped']} samples at full scale: it may be clipped")
    else:
        typer.echo("no sound")


def describe_recording(path: Path, levels: list[float] | None = None) -> dict[str, Any]:
    """Make the report of a sound or a film as plain values. Levels are of the mean of all channels.

    Parameters
    ----------
    levels : list of float, optional
        Takes the level of each :data:`PIECE_S` of sound, dB against full scale.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is neither, or is damaged.
    """
    from fapengine.files.sound import inspect_sound, stream_sound
    from fapengine.files.video import inspect_film

    film = inspect_film(path)
    report: dict[str, Any] = {"format": "film" if film else "sound"}
    if film:
        report["film"] = {
            "width": film.width, "height": film.height, "rate_hz": film.rate_hz, "codec": film.codec,
        }  # fmt: skip
        if not film.has_sound:
            return report
    info = inspect_sound(path)
    count, power, peak, clipped = 0, 0.0, 0, 0
    rest = np.zeros(0)
    for piece in stream_sound(path):
        size = np.abs(piece.astype(np.int64))
        if levels is not None:
            length = max(int(PIECE_S * info.sample_rate_hz), 1)
            rest = np.concatenate([rest, size])
            whole = rest[: len(rest) // length * length].reshape(-1, length)
            levels += [_db(float(np.sqrt((block**2).mean()))) for block in whole]
            rest = rest[whole.size :]
        count, power = count + len(piece), power + float((size.astype(np.float64) ** 2).sum())
        peak, clipped = max(peak, int(size.max(initial=0))), clipped + int((size >= np.iinfo(np.int16).max).sum())
    if not count:
        raise DataError(f"{path}: holds no sound")
    if levels is not None and len(rest):
        levels.append(_db(float(np.sqrt((rest**2).mean()))))
    report["sound"] = {
        "seconds": count / info.sample_rate_hz, "sample_rate_hz": info.sample_rate_hz, "channels": info.channels,
        "level_db": _db((power / count) ** 0.5), "peak_db": _db(peak), "clipped": clipped,
    }  # fmt: skip
    return report


def _db(size: float) -> float:
    """Level against full scale, dB; -120 for silence."""
    return round(20 * float(np.log10(max(size / 32768, 1e-6))), 1)


def inspect_picture(path: Path, *, as_json: bool, plot: Path | None) -> None:
    """Print the size of a picture; of an animation its frames and length, too."""
    import typer

    if plot is not None:
        raise UnsupportedError(f"{path}: is a picture itself, so there is nothing to plot")
    report = describe_picture(path)
    if as_json:
        typer.echo(json.dumps(report))
        return
    moving = f", {report['frames']} frames, {report['seconds']:.2f} s" if report["frames"] > 1 else ""
    typer.echo(f"{report['format']}: {report['width']}x{report['height']}{moving}")


def describe_picture(path: Path) -> dict[str, Any]:
    """Make the report of a picture or an animation as plain values.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is damaged or too large.
    ResourceError
        If pillow is not installed.
    """
    from fapengine.files.gltf.images import opened
    from fapengine.files.paths import read_bytes

    with opened(read_bytes(path), ("GIF", "WEBP", "PNG", "JPEG"), str(path)) as image:
        frames, duration_ms = getattr(image, "n_frames", 1), 0
        for number in range(frames):
            image.seek(number)
            image.load()
            duration_ms += image.info.get("duration", 0)
        return {
            "format": str(image.format), "width": image.width, "height": image.height, "frames": frames,
            "seconds": duration_ms / 1000,
        }  # fmt: skip


def inspect_head(name: str, *, as_json: bool, plot: Path | None) -> None:
    """Print the report of a head; the plot is its neutral face."""
    import typer

    from fapengine.files.heads.load import load_head, load_head_info
    from fapengine.files.pictures import save_png

    head, info = load_head(name), load_head_info(name)
    if plot is not None:
        from fapengine.render.renderer import FaceRenderer

        with FaceRenderer(head) as renderer:
            save_png(plot, renderer.draw(np.zeros(fap.FAP_COUNT)))
    moving = sorted({channel.fap for channel in head.basis.channels})
    size = None if head.texture is None else [head.texture.shape[1], head.texture.shape[0]]
    report = {
        "format": "head", "source": info.source, "licence": info.licence, "vertices": len(head.vertices_mm),
        "triangles": len(head.triangles), "feature_points": len(head.feature_points), "texture": size,
        "faps_by_surface": moving, "used": list(info.used), "lacking": list(info.lacking),
    }  # fmt: skip
    if as_json:
        typer.echo(json.dumps(report))
        return
    typer.echo(f"head: from {info.source or 'an unnamed source'}, licence {info.licence or 'not stated'}")
    texture = "no texture" if size is None else f"a texture of {size[0]}x{size[1]}"
    typer.echo(f"{report['vertices']} vertices, {report['triangles']} triangles, {texture}")
    typer.echo(f"{report['feature_points']} feature points, {len(moving)} FAPs move its surface")
    if info.used:
        typer.echo(f"blendshapes used: {', '.join(info.used)}")
    if info.lacking:
        typer.echo(f"blendshapes of ARKit that it lacks: {', '.join(info.lacking)}")
