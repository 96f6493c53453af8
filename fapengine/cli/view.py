"""``fapengine view``: show a face in a window."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine import speaking
from fapengine.cli import options as shared

if TYPE_CHECKING:
    from fapengine.app.view import Source

CHECKED_HZ = 22_050
"""Sample rate at which a named device is tried first."""


def view(
    live_output: shared.LiveOptions,
    voices: shared.VoiceList,
    source: Annotated[
        str | None,
        typer.Argument(
            help="FAPs (.fap, .fba, .csv, .json), a server (http://127.0.0.1:8110/, as `fapengine serve` prints it), or"
            " a port for OSC frames (osc://127.0.0.1:9100). Default: a local face that says --say."
        ),
    ] = None,
    audio: Annotated[Path | None, typer.Option(help="Sound of the file. The face follows it.")] = None,
    session: Annotated[str | None, typer.Option(help="Session to show, of a server or a port.")] = None,
    say: Annotated[list[str], typer.Option(help="Text to say first. Repeatable.")] = [],  # noqa: B006
    voice: speaking.Voice = speaking.DEFAULT_VOICE,
    wpm: speaking.Rate = speaking.DEFAULT_RATE_WPM,
    ssml: speaking.Ssml = False,
    profile: speaking.ProfileName = speaking.DEFAULT_PROFILE,
    head: shared.HeadName = "default",
    camera: shared.CameraName = "front",
    size: shared.Size = "900x660",
    fps: speaking.Fps = 60.0,
    without: speaking.Without = (),
    seed: speaking.Seed = 1,
    seconds: Annotated[
        float | None,
        typer.Option("--duration", min=0.001, max=86_400.0, help="Close the window after this time, in seconds."),
    ] = None,
    shot: Annotated[
        Path | None, typer.Option("--screenshot", help="Save the window as a PNG file when it closes.")
    ] = None,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Show a face in a window: a local face, a file, or a live session.

        fapengine view --say "Hello there."
        fapengine view out/demo.fap --audio out/demo.wav
        fapengine view http://127.0.0.1:8110/

    Drag the face to turn it, use the wheel to zoom; 1 to 4 cameras, R front, space pause, B blink, S stop, Q closes.
    Sliders and a text line are on the page of `fapengine serve`.
    """
    from fapengine.app.manner import Manner
    from fapengine.app.view import run_window
    from fapengine.audio.device import open_output
    from fapengine.cli._printing import print_result
    from fapengine.errors import UsageError
    from fapengine.files.heads.load import load_levels
    from fapengine.render.drawing import RenderOptions
    from fapengine.trajectory.style import Style
    from fapengine.voices.choice import VoiceChoice

    if audio is not None and (source is None or "://" in source):
        raise UsageError(f"--audio: got {audio}, expected a file of FAPs before it")
    if shot is not None:
        writing.check([shot], [source, audio, head, profile])
    drawing = RenderOptions.parse(size=size, camera=camera)
    manner = Manner(profile=profile, style=Style().without(without), seed=seed, rate_hz=fps)
    chosen = VoiceChoice(voice, wpm, ssml)
    device, silent = live_output.device, live_output.silent
    if device is not None and not silent:
        open_output(CHECKED_HZ, device=device).close()  # report a wrong device now, not at the first sentence
    finest, coarser = load_levels(head)

    def open_source() -> "Source":
        from fapengine.app.face import LEAD_S, TAIL_S
        from fapengine.app.view import FaceSource, open_file, open_url

        if source is None:
            spoken = [chosen.load().speak(text).padded(lead_s=LEAD_S, tail_s=TAIL_S) for text in say]
            face = live_output.open_face(manner)
            for text, speech in zip(say, spoken, strict=True):
                face.say(speech, text=text)
            return FaceSource(face)
        if "://" in source:
            return open_url(source, session=session, texts=say, voice=chosen.name, device=device, silent=silent)
        return open_file(Path(source), audio, device=device, silent=silent)

    done = run_window(finest, coarser, open_source, drawing, rate_hz=fps, seconds=seconds, shot=shot)
    line = f"{done['frames']} frames in {done['seconds']:.1f} s, {done['frame_ms']:.1f} ms each to draw"
    print_result(done, line, as_json=as_json)
