"""``fapengine say``: a sentence to a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def say(
    text: Annotated[str, typer.Argument(help="What to say; - reads it from standard input.")],
    output: shared.Output = Path("out/talk.mp4"),
    expression: shared.Expressions = [],  # noqa: B006  typer copies it
    voice: Annotated[str, typer.Option("--voice", "-v", help="Language, such as en-gb, de or fr-fr.")] = "en-us",
    rate: Annotated[int, typer.Option("--rate", help="Words a minute, 80 to 450.")] = 160,
    profile: shared.ProfileName = "grid_s1_en",
    head: shared.HeadName = "default",
    camera: shared.CameraName = "front",
    background: shared.BackgroundName = "studio",
    edges: shared.Edges = "fine",
    size: shared.Size = "512x512",
    fps: shared.Fps = 30.0,
    articulation: shared.Articulation = 1.0,
    jaw: shared.Jaw = 1.0,
    lips: shared.Lips = 1.0,
    loudness: shared.Loudness = 0.0,
    method: shared.Method = "context",
    without: shared.Without = [],  # noqa: B006
    seed: shared.Seed = 1,
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    live: Annotated[
        bool, typer.Option("--live", help="Speak and move now, in a window or on the terminal; writes no file.")
    ] = False,
    device: shared.Device = None,
    silent: shared.Silent = False,
    window: Annotated[
        bool | None, typer.Option("--window/--no-window", help="Of --live; by default where there is a display.")
    ] = None,
    sink: shared.Sinks = [],  # noqa: B006
) -> None:
    """Say a sentence: writes a video of a talking face, its FAPs, the sound, and a picture of every phone.

    Beside OUT.mp4 stand OUT.fap, OUT.wav and OUT.png (contact sheet); so they do beside an animation, or a folder of
    numbered pictures. With --live nothing is written: the sound is
    played, and the face follows the sound card's clock.

    Example: fapengine say "Hello there." --expression joy:0.4 -o out/hello.mp4; fapengine say "Hello there." --live
    """
    import sys

    from fapengine.cli.talk import Options, Report, check, manner_of, print_report, refuse_unknown, talk
    from fapengine.voices.espeak import EspeakVoice

    manner = manner_of(articulation, jaw, lips, loudness, method, without)
    options = Options(output, tuple(expression), profile, head, camera, size, fps, manner, seed, background, edges)
    check(options)
    report = Report()
    spoken = sys.stdin.read() if text == "-" else text
    with report.stage("voice"):
        speech = EspeakVoice(voice, rate).speak(spoken).padded(lead_s=0.3, tail_s=0.5)
    refuse_unknown(speech.phones, f"voice {voice}", strict=strict)
    if live:
        from fapengine.cli._say_live import LiveOptions, print_live, say_live

        done = say_live(speech, spoken.strip(), options, LiveOptions(device, silent, window, tuple(sink)))
        print_live(done, as_json=as_json)
        return
    talk(speech.phones, (speech.samples, speech.sample_rate_hz), options, report, spoken.strip())
    print_report(report, as_json=as_json)
