"""``fapengine animate``: phone timings, and the sound they belong to, to a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def animate(
    timings: Annotated[Path, typer.Argument(help="Phone timings; their format is found from the content.")],
    manner: shared.MannerOptions,
    drawing: shared.DrawingOptions,
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
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns", help="Of a CSV or JSON list: start=NAME,end=NAME,label=NAME,unit=ms; of frames: fps=24."
        ),
    ] = None,
    voice: Annotated[
        str, typer.Option("--voice", "-v", help="Whose pronunciation, where the timings have words only.")
    ] = "en-us",
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
) -> None:
    """Animate phone timings that another tool made.

    Example: fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
    """
    from fapengine.app.performance import perform, pronounced
    from fapengine.app.report import Report
    from fapengine.app.talk import check, refuse_unknown
    from fapengine.cli._talking import write_and_print
    from fapengine.files.sound import load_sound
    from fapengine.files.timings import load_timings

    chosen, how = manner.value(), drawing.value()
    inputs = [timings, *([audio] if audio else [])]
    check(output, chosen, how, inputs=inputs)
    report = Report()
    with report.stage("read"):
        read = load_timings(timings, file_format=file_format, tier=tier, alphabet=alphabet, columns=columns)
        phones = pronounced(read, voice)
        sound = load_sound(audio) if audio else None
    if strict:
        refuse_unknown(phones, str(timings))
    with report.stage("plan"):
        performance = perform(phones, sound, chosen, text=timings.name)
    for remark in performance.remarks:
        typer.echo(f"fapengine: {remark}", err=True)
    write_and_print(performance, output, report, head=head, drawing=how, as_json=as_json, inputs=inputs)
