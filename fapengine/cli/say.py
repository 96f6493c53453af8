"""``fapengine say``: a sentence to a talking face."""

from pathlib import Path

import typer


def say(
    text: str = typer.Argument(..., help="What to say; - reads it from standard input."),
    output: Path = typer.Option(
        Path("out/talk.mp4"), "--output", "-o", help="Video (.mp4, .webm, .mkv), or .fap for the FAPs alone."
    ),
    expression: list[str] = typer.Option(
        [], "--expression", "-e", help="joy, sadness, anger, fear, disgust or surprise, with a strength: joy:0.4."
    ),
    voice: str = typer.Option("en-us", "--voice", "-v", help="Language of the voice, such as en-gb, de or fr-fr."),
    rate: int = typer.Option(160, "--rate", help="Words a minute, 80 to 450."),
    profile: str = typer.Option("grid_s1_en", "--profile", help="Whose way of speaking: a shipped name or a folder."),
    camera: str = typer.Option("front", "--camera", help="front, three-quarter, profile or mouth."),
    size: str = typer.Option("512x512", "--size", help="Width x height in pixels."),
    fps: float = typer.Option(30.0, "--fps", help="Frames a second."),
    articulation: float = typer.Option(1.0, "--articulation", help="Size of mouth movements; 1 is natural."),
    seed: int = typer.Option(1, "--seed", help="Chance of blinks and head motion; the same seed, the same face."),
    as_json: bool = typer.Option(False, "--json", help="Print the result as JSON."),
) -> None:
    """Say a sentence: writes a video of a talking face, its FAPs, the sound, and a picture of every phone.

    Beside OUT.mp4 stand OUT.fap, OUT.wav and OUT.png (contact sheet).

    Example: fapengine say "Hello there." --expression joy:0.4 -o out/hello.mp4
    """
    import sys

    from fapengine.cli.talk import Options, Report, check, print_report, talk
    from fapengine.voices.espeak import EspeakVoice

    options = Options(output, tuple(expression), profile, camera, size, fps, articulation, seed)
    check(options)
    report = Report()
    spoken = sys.stdin.read() if text == "-" else text
    with report.stage("voice"):
        speech = EspeakVoice(voice, rate).speak(spoken).padded(lead_s=0.3, tail_s=0.5)
    talk(speech.phones, (speech.samples, speech.sample_rate_hz), options, report, spoken.strip())
    print_report(report, as_json=as_json)
