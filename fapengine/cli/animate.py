"""``fapengine animate``: phone timings, and the sound they belong to, to a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def animate(
    timings: Annotated[Path, typer.Argument(help="Phone timings; their format is found from the content.")],
    audio: Annotated[
        Path | None, typer.Option("--audio", "-a", help="The sound: WAV, MP3, FLAC, Ogg or any video.")
    ] = None,
    output: shared.Output = Path("out/talk.mp4"),
    file_format: Annotated[
        str | None, typer.Option("--format", help="Of the timings, if the content does not tell: textgrid, htk, ...")
    ] = None,
    tier: Annotated[str | None, typer.Option("--tier", help="TextGrid: the tier that holds the phones.")] = None,
    alphabet: Annotated[
        str | None, typer.Option("--alphabet", help="Of the labels, if not to be guessed: ipa, arpabet, pinyin, ...")
    ] = None,
    voice: Annotated[
        str, typer.Option("--voice", "-v", help="Whose pronunciation, where the timings have words only.")
    ] = "en-us",
    strict: shared.Strict = False,
    expression: shared.Expressions = [],  # noqa: B006  typer copies it
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
    as_json: shared.AsJson = False,
) -> None:
    """Animate phone timings that another tool made.

    Example: fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
    """
    from fapengine.cli.talk import Options, Report, check, manner_of, print_report, refuse_unknown, talk
    from fapengine.files.sound import load_sound
    from fapengine.files.timings import load_timings

    manner = manner_of(articulation, jaw, lips, loudness, method, without)
    options = Options(output, tuple(expression), profile, head, camera, size, fps, manner, seed, background, edges)
    check(options)
    report = Report()
    with report.stage("read"):
        phones = load_timings(timings, file_format=file_format, tier=tier, alphabet=alphabet)
        if phones.spelled:
            from fapengine.voices.espeak import EspeakVoice
            from fapengine.voices.pronounce import pronounce

            phones = pronounce(phones, EspeakVoice(voice))
        sound = load_sound(audio) if audio else None
    refuse_unknown(phones, str(timings), strict=strict)
    talk(phones, sound, options, report, timings.name)
    print_report(report, as_json=as_json)
