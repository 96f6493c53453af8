"""``fapengine view``: a window with a live face and its controls."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from fapengine.app.view_sources import Source

CHECKED_HZ = 22_050
"""Sample rate at which a named device is tried; one that does not know it is opened with its own."""


def view(
    live_output: shared.LiveOptions,
    voice: shared.VoiceOptions,
    source: Annotated[
        str | None,
        typer.Argument(
            help="FAPs (.fap, .fba, .csv, .json), a server (http://127.0.0.1:8110/, as `fapengine serve` prints it),"
            " or a port for OSC frames (osc://127.0.0.1:9100). Without one, a face that speaks what you type."
        ),
    ] = None,
    audio: Annotated[Path | None, typer.Option("--audio", help="Sound of the file; the face follows it.")] = None,
    session: Annotated[str | None, typer.Option("--session", help="Whose face, of a server or a port.")] = None,
    say: Annotated[list[str], typer.Option("--say", help="Say this first. May be given again.")] = [],  # noqa: B006
    profile: shared.ProfileName = "grid_s1_en",
    head: shared.HeadName = "default",
    camera: shared.CameraName = "front",
    size: shared.Size = "900x660",
    fps: shared.Fps = 60.0,
    without: shared.Without = [],  # noqa: B006
    seed: shared.Seed = 1,
    seconds: Annotated[float | None, typer.Option("--for", help="Close after so many seconds.")] = None,
    shot: Annotated[Path | None, typer.Option("--shot", help="Save the window as a PNG when it closes.")] = None,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Open a window with a face: your own words, a file, or a live session.

        fapengine view
        fapengine view out/demo.fap --audio out/demo.wav
        fapengine view http://127.0.0.1:8110/

    Pull the face to turn it, wheel to come nearer; 1 to 4 cameras, R front, space pause, B blink, S stop, Enter types,
    Tab hides the panel, Q closes.
    """
    from fapengine.app.manner import Manner
    from fapengine.app.view import ViewOptions, run_window
    from fapengine.errors import UsageError
    from fapengine.files.heads.load import load_levels
    from fapengine.live.audio.device import open_output
    from fapengine.render.drawing import Drawing
    from fapengine.trajectory.style import Style

    if audio is not None and (source is None or "://" in source):
        raise UsageError(f"--audio: got {audio}, expected a file of FAPs before it")
    if seconds is not None and not seconds > 0:
        raise UsageError(f"--for: got {seconds} s, expected a positive time")
    if shot is not None:
        writing.check([shot], [source, audio, head, profile])
    options = ViewOptions(
        drawing=Drawing.parse(size=size, camera=camera), rate_hz=fps, seconds=seconds, shot=shot, sentences=tuple(say)
    )  # fmt: skip
    manner = Manner(profile=profile, style=Style().without(without), seed=seed, rate_hz=fps)
    device, silent = live_output.device, live_output.silent
    if device is not None and not silent:
        open_output(CHECKED_HZ, device=device).close()  # a wrong one is an error now, not at the first sentence
    finest, coarser = load_levels(head)

    def open_source() -> "Source":
        from fapengine.app import view_sources
        from fapengine.app.say_live import open_face

        if source is None:
            face = open_face(manner, live_output.value())
            return view_sources.SpeakingSource(face, lambda text: voice.value().load().speak(text))
        if "://" in source:
            return view_sources.open_url(source, session=session, voice=voice.voice, device=device, silent=silent)
        return view_sources.open_file(Path(source), audio, device=device, silent=silent)

    report = run_window(finest, coarser, open_source, options)
    if as_json:
        import json

        typer.echo(json.dumps(asdict(report), indent=2))
    else:
        typer.echo(f"{report.frames} frames in {report.seconds:.1f} s, {report.frame_ms:.1f} ms each to draw")
