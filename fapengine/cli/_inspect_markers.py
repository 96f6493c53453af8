"""Report of ``fapengine inspect`` on a recording of markers: text, JSON and a plot."""

import json
from pathlib import Path

import numpy as np
import typer

SHOWN = 12
WIDTH_PX, ROW_PX = 800, 6
SEEN, GAP = (64, 110, 160), (235, 225, 215)


def inspect_markers(path: Path, *, as_json: bool, everything: bool, plot: Path | None) -> None:
    """Print what a recording holds, and a ``session.toml`` to start from."""
    from fapengine.files.pictures import save_png
    from fapengine.files.recordings import load_markers
    from fapengine.laboratory.look import look_over, session_lines

    mesh = path.is_dir()
    recording = load_markers(path, rate_hz=60.0 if mesh else None)
    track, look = recording.markers, look_over(recording.markers)
    if plot is not None:
        columns = np.linspace(0, track.frame_count - 1, min(WIDTH_PX, track.frame_count)).astype(int)
        rows = np.where(track.valid[columns].T[..., None], SEEN, GAP).astype(np.uint8)
        save_png(plot, np.ascontiguousarray(np.repeat(rows, ROW_PX, axis=0)))
    lines = session_lines(look, track, path.stem, mesh=mesh)
    if as_json:
        markers = {
            name: {"seen": round(float(seen), 4), "gaps": int(gaps), "longest_s": round(float(longest), 3)}
            for name, seen, gaps, longest in zip(track.labels, look.seen, look.gaps, look.longest_s, strict=True)
        }
        facts = {
            "format": "markers", "frames": track.frame_count, "rate_hz": track.rate_hz, "seconds": track.duration_s,
            "size_mm": [round(float(side), 1) for side in look.size_mm], "markers": markers, "named": look.named,
            "head": look.head, "quiet_s": look.quiet_s, "warnings": recording.warnings, "session": "\n".join(lines),
        }  # fmt: skip
        typer.echo(json.dumps(facts))
        return
    for text in recording.warnings:
        typer.echo(f"warning: {text}", err=True)
    wide, high, deep = look.size_mm
    typer.echo(
        f"recording: {len(track.labels)} markers, {track.frame_count} frames at {track.rate_hz:g} Hz,"
        f" {track.duration_s:.2f} s; {wide:.0f} x {high:.0f} x {deep:.0f} mm, +y up"
    )
    worst = np.argsort(look.seen, kind="stable")
    for index in worst if everything else worst[:SHOWN]:
        longest = f", the longest {look.longest_s[index]:.2f} s" if look.gaps[index] else ""
        seen = f"seen in {100 * look.seen[index]:.1f} %, {look.gaps[index]} gaps"
        typer.echo(f"  {track.labels[index]:<16} {seen}{longest}")
    if len(worst) > SHOWN and not everything:
        typer.echo(f"  ... and {len(worst) - SHOWN} that are seen no less (--all)")
    typer.echo(f"feature points among the labels: {', '.join(look.named) or 'none'}")
    typer.echo("\n# session.toml to start from\n" + "\n".join(lines))
