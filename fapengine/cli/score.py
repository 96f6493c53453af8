"""``fapengine score``: score a lip sync."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli.options import AsJson, TimingOptions, WordsVoice, WriteOptions


def score(
    made: Annotated[
        Path,
        typer.Argument(
            help="The lip sync: FAPs (.fap, .fba), a table of ARKit, Oculus or VRM weights (.csv, .json), VMC (.osc),"
            " or a video of a talking head (.mp4, .webm, ...), which needs the face detector."
        ),
    ],
    against: Annotated[
        Path | None, typer.Option("--against", help="Reference: a captured recording of the same speech.")
    ] = None,
    phones: Annotated[Path | None, typer.Option("--phones", help="Phone timings, in any format.")] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="With --phones: use fapengine's own plan as the reference.")
    ] = False,
    audio: Annotated[
        Path | None, typer.Option("--audio", "-a", help="Sound, to compare lip opening with loudness.")
    ] = None,
    offset: Annotated[
        float,
        typer.Option(
            "--offset", min=-86_400.0, max=86_400.0, help="Start of the lip sync within the other files, in seconds."
        ),
    ] = 0.0,
    closed_mm: Annotated[
        float,
        typer.Option(
            "--closed-mm",
            min=0.001,
            max=100.0,
            help="Lip opening relative to neutral below which lips count as closed, in mm.",
        ),
    ] = 1.0,
    voice: WordsVoice = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Report with plots (.html).")] = None,
    as_json: AsJson = False,
    timings: TimingOptions = TimingOptions(),
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Score any lip sync: closures, timing, similarity, loudness, head motion and blinks.

        fapengine score theirs.csv --phones talk.TextGrid -o out/score.html
        fapengine score theirs.csv --against mocap.fap --json
        fapengine score talk.mp4 --phones talk.TextGrid    # any video

    With --phones, it reports whether p b m close and f v meet the teeth, and how late. With --against, also the
    similarity to the reference. A video needs the face detector (docs/how-to/score.md). For a tool that writes visemes
    only, use `fapengine animate` first.
    """
    from fapengine.app.score import ScoreJob, is_film, notes_of, run_score
    from fapengine.cli._printing import print_result, progress
    from fapengine.errors import UsageError
    from fapengine.files.report.score_page import score_rows
    from fapengine.files.video import count_pictures

    for flag, value in timings.given.items():
        if value is not None and phones is None:
            raise UsageError(f"{flag}: requires --phones")
    job = ScoreJob(
        made=made, against=against, phones=phones, plan=plan, audio=audio, offset_s=offset, closed_mm=closed_mm,
        voice=voice, how=timings.how, output=output,
    )  # fmt: skip
    if output is not None:
        writing.check([output], [made, against, phones, audio])
    films = [each for each in (made, against) if each is not None and is_film(each)]
    if films:
        with progress("detecting, frames", sum(map(count_pictures, films))) as advance:
            found = run_score(job, on_frame=advance)
    else:
        found = run_score(job)
    lines = []
    for name, rows in score_rows(found).items():
        lines += [name, *(f"  {measure:30} {figure:22} {meaning}".rstrip() for measure, figure, meaning in rows)]
    lines += notes_of(job, found) + ([] if output is None else [f"report: {output}"])
    print_result(found.as_dict(), *lines, as_json=as_json)
