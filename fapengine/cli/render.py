"""``fapengine render``: FAPs, as text or as a stream, to a video, an animation, numbered pictures or one picture."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def render(
    track: Annotated[Path, typer.Argument(help="FAPs (.fap, .fba), or blend shapes (.csv, Azure's .json).")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Video (.mp4, .webm, .mkv), animation (.gif, .webp), numbered pictures (frame_%04d.png), or .png for"
            " one frame.",
        ),
    ] = Path("out/render.mp4"),
    audio: Annotated[Path | None, typer.Option("--audio", "-a", help="Sound for the video, from its start.")] = None,
    at: Annotated[float, typer.Option("--at", help="With .png: which second to draw.")] = 0.0,
    head: shared.HeadName = "default",
    camera: shared.CameraName = "front",
    size: shared.Size = "512x512",
) -> None:
    """Draw FAPs that are there already.

    Example: fapengine render talk.fba --audio talk.wav -o out/talk.mp4
    """
    import numpy as np

    from fapengine.cli.talk import parse_size, progress
    from fapengine.errors import UsageError
    from fapengine.files.animation import ENCODERS, is_sequence, write_animation, write_sequence
    from fapengine.files.heads import load_head
    from fapengine.files.motion import load_motion
    from fapengine.files.pictures import save_png
    from fapengine.files.sound import load_sound
    from fapengine.files.video import CODECS, write_video
    from fapengine.render.camera import preset
    from fapengine.render.renderer import FaceRenderer

    kinds = (*CODECS, *ENCODERS)
    if output.suffix not in (*kinds, ".png"):
        raise UsageError(f"--output: got {output}, expected a name that ends with {', '.join(kinds)} or .png")
    if audio and output.suffix not in CODECS:
        raise UsageError(f"--audio: got {audio}, but {output.suffix} holds no sound; expected {', '.join(CODECS)}")
    faps = load_motion(track)
    sound = load_sound(audio) if audio else None
    with FaceRenderer(load_head(head), size=parse_size(size), camera=preset(camera)) as renderer:
        if output.suffix == ".png" and not is_sequence(output):
            if not 0 <= at <= faps.times_s[-1] - faps.times_s[0]:
                raise UsageError(f"--at: got {at} s, the track lasts {faps.times_s[-1] - faps.times_s[0]:.2f} s")
            save_png(output, renderer.draw(faps.values[np.searchsorted(faps.times_s, faps.times_s[0] + at)]))
            typer.echo(f"{output}: one frame")
            return
        # Skipped frames show what was there before.
        shown = np.arange(faps.frame_numbers[0], faps.frame_numbers[-1] + 1)
        rows = faps.values[np.searchsorted(faps.frame_numbers, shown, side="right") - 1]
        with progress("drawing", len(rows)) as advance:
            frames = renderer.frames(rows)
            if output.suffix in CODECS:
                write_video(output, frames, rate_hz=faps.rate_hz, sound=sound, on_frame=advance)
            elif output.suffix in ENCODERS:
                write_animation(output, frames, rate_hz=faps.rate_hz, on_frame=advance)
            else:
                write_sequence(output, frames, on_frame=advance)
    typer.echo(f"{output}: {len(rows)} frames at {faps.rate_hz:g} Hz")
