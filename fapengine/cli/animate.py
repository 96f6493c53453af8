"""``fapengine animate``: phone timings, and the sound they belong to, to a talking face."""

from pathlib import Path

import typer


def animate(
    timings: Path = typer.Argument(..., help="Praat TextGrid or MBROLA .pho; found from the content."),
    audio: Path | None = typer.Option(None, "--audio", "-a", help="The sound: WAV, MP3, FLAC, Ogg or any video."),
    output: Path = typer.Option(
        Path("out/talk.mp4"), "--output", "-o", help="Video (.mp4, .webm, .mkv), or .fap for the FAPs alone."
    ),
    tier: str | None = typer.Option(None, "--tier", help="TextGrid: the tier that holds the phones."),
    expression: list[str] = typer.Option(
        [], "--expression", "-e", help="joy, sadness, anger, fear, disgust or surprise, with a strength: joy:0.4."
    ),
    profile: str = typer.Option("grid_s1_en", "--profile", help="Whose way of speaking: a shipped name or a folder."),
    camera: str = typer.Option("front", "--camera", help="front, three-quarter, profile or mouth."),
    size: str = typer.Option("512x512", "--size", help="Width x height in pixels."),
    fps: float = typer.Option(30.0, "--fps", help="Frames a second."),
    articulation: float = typer.Option(1.0, "--articulation", help="Size of mouth movements; 1 is natural."),
    seed: int = typer.Option(1, "--seed", help="Chance of blinks and head motion; the same seed, the same face."),
    as_json: bool = typer.Option(False, "--json", help="Print the result as JSON."),
) -> None:
    """Animate phone timings that another tool made.

    Example: fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
    """
    from fapengine.cli.talk import Options, Report, check, print_report, talk
    from fapengine.files.sound import load_sound
    from fapengine.files.timings import load_timings

    options = Options(output, tuple(expression), profile, camera, size, fps, articulation, seed)
    check(options)
    report = Report()
    with report.stage("read"):
        phones = load_timings(timings, tier=tier)
        sound = load_sound(audio) if audio else None
    talk(phones, sound, options, report, timings.name)
    print_report(report, as_json=as_json)
