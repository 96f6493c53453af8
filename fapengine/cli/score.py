"""``fapengine score``: how good is a lip sync, whoever made it."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli.options import AsJson, TimingOptions, WriteOptions


def score(
    made: Annotated[
        Path,
        typer.Argument(
            help="The recording: FAPs (.fap, .fba), a table of ARKit, Oculus or VRM shapes (.csv, .json), VMC (.osc);"
            " or a film of a talking head (.mp4, .webm, ...), which a face detector looks at."
        ),
    ],
    against: Annotated[
        Path | None, typer.Option("--against", help="Another recording of the same speech: the truth.")
    ] = None,
    phones: Annotated[Path | None, typer.Option("--phones", help="Timings of what is said, in any format.")] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="With --phones: compare with fapengine's own plan, as if it were a truth.")
    ] = False,
    audio: Annotated[Path | None, typer.Option("--audio", "-a", help="Its sound: do lips grow with loudness?")] = None,
    offset: Annotated[
        float, typer.Option("--offset", help="Seconds of the others at which the recording begins.")
    ] = 0.0,
    closed_mm: Annotated[
        float, typer.Option("--closed-mm", help="Opening against rest below which lips count as closed.")
    ] = 1.0,
    voice: Annotated[
        str, typer.Option("--voice", "-v", help="Whose pronunciation, where the timings have words only.")
    ] = "en-us",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Report with pictures (.html).")] = None,
    as_json: AsJson = False,
    timings: TimingOptions = TimingOptions(),
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Score a lip sync, anybody's: closures, timing, likeness, loudness, head and blinks.

        fapengine score theirs.csv --phones talk.TextGrid -o out/score.html
        fapengine score theirs.csv --against mocap.fap --json
        fapengine score talk.mp4 --phones talk.TextGrid    # any video

    Against phones it tells whether p b m close and f v meet the teeth, and how late; against a true recording also how
    like its lips are. A video needs the face detector (docs/how-to/score.md). A recording of a tool that gives visemes
    only: fapengine animate makes a motion of it first.
    """
    from fapengine.app.score import ScoreJob, is_film, notes_of, run_score
    from fapengine.cli._progress import progress
    from fapengine.errors import UsageError
    from fapengine.files.report.score_page import score_rows
    from fapengine.files.video import count_pictures

    for flag, value in timings.given.items():
        if value is not None and phones is None:
            raise UsageError(f"{flag}: got {value} without --phones, whose timings it is for")
    job = ScoreJob(
        made=made, against=against, phones=phones, plan=plan, audio=audio, offset_s=offset, closed_mm=closed_mm,
        voice=voice, read_phones=timings.load, output=output,
    )  # fmt: skip
    if output is not None:
        writing.check([output], [made, against, phones, audio])
    films = [each for each in (made, against) if each is not None and is_film(each)]
    if films:
        with progress("looking, frames", sum(map(count_pictures, films))) as advance:
            found = run_score(job, on_frame=advance)
    else:
        found = run_score(job)
    if as_json:
        import json

        typer.echo(json.dumps(found.as_dict(), indent=2))
        return
    for name, rows in score_rows(found).items():
        typer.echo(name)
        for measure, figure, meaning in rows:
            typer.echo(f"  {measure:30} {figure:22} {meaning}".rstrip())
    for note in notes_of(job, found):
        typer.echo(note)
    if output is not None:
        typer.echo(f"look at {output}")
