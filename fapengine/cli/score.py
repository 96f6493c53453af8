"""``fapengine score``: score a lip sync, check it, compare systems, and ask people."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import _hearing
from fapengine.cli.options import AsJson, TimingOptions, WordsVoice, WriteOptions
from fapengine.scoring.thresholds import LIP_THRESHOLDS, MESH_THRESHOLDS, parse_thresholds

if TYPE_CHECKING:
    from fapengine.app.score import Scored, ScoreJob

_check = partial(typer.Option, rich_help_panel="Checks, for continuous integration")
_mesh = partial(typer.Option, rich_help_panel="Meshes")
_people = partial(typer.Option, rich_help_panel="Listening tests")


def score(
    made: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="MADE",
            help="The lip sync: FAPs (.fap, .fba), a table of ARKit, Oculus or VRM weights (.csv, .json), an animated"
            " avatar (.glb, .vrm), a VRM animation (.vrma), VMC (.osc), a video (.mp4, .webm, ...), which needs the"
            " face detector, or meshes (.npy, .npz, a folder). A set: several of them, a folder for each system, or a"
            " table of recordings (.csv with a column 'made').",
            show_default=False,
        ),
    ] = None,
    against: Annotated[
        Path | None, typer.Option("--reference", help="Reference: a captured recording of the same speech.")
    ] = None,
    phones: Annotated[Path | None, typer.Option(help="Phone timings, in any format.")] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="With --phones: use fapengine's own plan as the reference.")
    ] = False,
    audio: Annotated[
        Path | None,
        typer.Option(
            "--audio", "-a", help="Sound. Without --phones and --reference, its phones are recognized or aligned."
        ),
    ] = None,
    text: _hearing.Text = None,
    transcript: _hearing.Transcript = None,
    language: _hearing.Language = None,
    recognizer: _hearing.RecognizerName = None,
    offset: Annotated[
        float,
        typer.Option(min=-86_400.0, max=86_400.0, help="Start of the lip sync within the other files, in seconds."),
    ] = 0.0,
    closed_mm: Annotated[
        float,
        typer.Option(
            min=0.001, max=100.0, help="Lip opening relative to neutral below which lips count as closed, in mm."
        ),
    ] = 1.0,
    voice: WordsVoice = None,
    check: Annotated[bool, _check("--check", help="Exit with code 1 if the verdict is 'fails'.")] = False,
    fail_under: Annotated[
        str | None,
        _check(
            metavar="NAME=VALUE,...",
            help=f"Check with these thresholds: closures=95,lag=80ms. Names, units, and thresholds by default:"
            f" {'; '.join(map(str, LIP_THRESHOLDS))}. For meshes: {', '.join(row.name for row in MESH_THRESHOLDS)}.",
        ),
    ] = None,
    junit: Annotated[Path | None, _check(help="Write the checks as JUnit XML.")] = None,
    sarif: Annotated[Path | None, _check(help="Write the faults and their times as SARIF 2.1.0.")] = None,
    lips: Annotated[Path | None, _mesh(help="Vertices of the lips: a list of indices (.txt, .npy).")] = None,
    upper: Annotated[Path | None, _mesh(help="Vertices of the upper face.")] = None,
    neutral: Annotated[Path | None, _mesh(help="The face at rest; --upper needs it.")] = None,
    listen: Annotated[
        bool,
        _people(
            "--listen",
            help="Write a listening test of two folders of films, or of motion with --audio, into the folder --output.",
        ),
    ] = False,
    seed: Annotated[int, _people(min=0, help="Seed of the listening test's order.")] = 1,
    answers: Annotated[
        list[Path] | None,
        _people(help="Analyse the answers of a listening test: its CSV files, or a folder of them. Repeatable."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Report with plots (.html); of a set, a table (.csv); of --listen, a folder."
        ),
    ] = None,
    as_json: AsJson = False,
    timings: TimingOptions = TimingOptions(),
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Score any lip sync: closures, timing, similarity, loudness, head motion and blinks.

        fapengine score theirs.csv --phones talk.TextGrid -o out/score.html
        fapengine score avatar.glb --audio talk.wav --transcript-file talk.txt --check
        fapengine score theirs.csv --phones t.lab --fail-under closures=95,lag=80ms
        fapengine score ours/ theirs/ --phones timings/ -o out/set.csv
        fapengine score made.npy --reference true.npy --lips lips.txt
        fapengine score --listen ours/ theirs/ -o out/page

    The verdict comes first. With --phones, --audio or --reference, p b m must close, f v meet the teeth, and neither be
    late. With --reference, also the similarity to the reference. --listen makes a page that asks people which of two
    systems fits better. A video needs the face detector (docs/how-to/score.md). For a tool that writes visemes only,
    use `fapengine animate` first.
    """
    from dataclasses import replace

    from fapengine.app.score import ScoreJob
    from fapengine.app.score_set import is_set, jobs_of
    from fapengine.errors import UsageError
    from fapengine.files.recordings import is_mesh_sequence

    made = made or []
    if answers:
        if made or listen or output or junit or sarif or check or fail_under:
            raise UsageError("answers: cannot be combined with anything but --json")
        _analyse(answers, as_json=as_json)
        return
    if listen:
        if len(made) != 2 or output is None:
            raise UsageError("listen: expected two folders and an output folder: --listen A/ B/ -o page")
        writing.check([output / "index.html"], [*made, audio])
        _write_test(made[0], made[1], output, audio, seed, as_json=as_json)
        return
    if not made:
        raise UsageError("made: missing, expected a recording to score")
    for name, value in timings.how.items():
        if value is not None and phones is None:
            raise UsageError(f"--{name}: requires --phones")
    job = ScoreJob(
        made=made[0], against=against, phones=phones, plan=plan, audio=audio, text=text, transcript=transcript,
        language=language, recognizer=recognizer, offset_s=offset, closed_mm=closed_mm, voice=voice, how=timings.how,
        lips=lips, upper=upper, neutral=neutral, output=output,
    )  # fmt: skip
    outputs = [path for path in (output, junit, sarif) if path is not None]
    if outputs:
        writing.check(outputs, [*made, against, phones, audio, text, recognizer, lips, upper, neutral])
    many = is_set(made, job)
    if many and output is not None and output.suffix != ".csv":
        raise UsageError(f"output: got {output}, expected a name that ends with .csv, for a set")
    jobs = jobs_of(made, replace(job, output=None)) if many else [job]
    if fail_under is not None:
        is_mesh = isinstance(jobs[0].made, Path) and is_mesh_sequence(jobs[0].made)
        thresholds = parse_thresholds(fail_under, MESH_THRESHOLDS if is_mesh else LIP_THRESHOLDS)
        jobs = [replace(each, thresholds=thresholds) for each in jobs]
    results = _score_set(jobs, output, as_json=as_json) if many else [_score_one(jobs[0], as_json=as_json)]
    _write_checks(results, junit, sarif)
    if (check or fail_under is not None) and not all(result.verdict.passes for result in results):
        raise typer.Exit(1)


def _write_test(one: Path, other: Path, output: Path, audio: Path | None, seed: int, *, as_json: bool) -> None:
    from dataclasses import asdict

    from fapengine.app.listening import write_listening_test
    from fapengine.cli._printing import print_result, working

    with working("films of the test"):
        test = write_listening_test(one, other, output, audio=audio, seed=seed)
    left_out = [f"left out, as one system lacks them: {', '.join(test.left_out)}"] if test.left_out else []
    print_result(
        asdict(test) | {"page": str(output / "index.html")},
        f"page: {output / 'index.html'}, {test.pairs} pairs and {test.checks} attention checks",
        *left_out,
        "Send each listener its address with ?listener=NAME, and collect the CSV that the page saves.",
        as_json=as_json,
    )


def _analyse(answers: list[Path], *, as_json: bool) -> None:
    from dataclasses import asdict

    from fapengine.app.listening import analyse_answers
    from fapengine.cli._printing import print_result

    found = analyse_answers(answers)
    over = found.over_listeners
    by_people = "" if over.low is None else f"; over listeners {100 * over.low:.0f} to {100 * (over.high or 0):.0f} %"
    lines = [
        f"{found.system} preferred to {found.other}: {100 * found.share:.1f} % ({found.chosen} of {found.answers}),"
        f" 95 % interval {100 * found.low:.1f} to {100 * found.high:.1f} % (binomial){by_people}; p = {found.p:.3g}",
        f"listeners: {found.listeners}; left out for failed attention checks: {len(found.excluded)}",
        *(f"  {name}: passed {100 * share:.0f} %" for name, share in found.excluded.items()),
        *(f"  {item}: {100 * share:.0f} %" for item, share in found.by_item.items()),
    ]
    print_result(asdict(found), *lines, as_json=as_json)


def _score_one(job: "ScoreJob", *, as_json: bool) -> "Scored":
    from fapengine.app.score import is_film, notes_of, run_score
    from fapengine.cli._printing import print_result, progress
    from fapengine.files.report.score_page import score_rows, vertex_rows
    from fapengine.files.video import count_pictures
    from fapengine.scoring.score import Score
    from fapengine.scoring.vertices import VertexErrors

    films = [each for each in (job.made, job.against) if each is not None and is_film(each)]
    if films:
        with progress("detecting, frames", sum(map(count_pictures, films))) as advance:
            found = run_score(job, on_frame=advance)
    else:
        found = run_score(job)
    sections, notes = {}, []
    if isinstance(found.score, Score):
        sections, notes = score_rows(found.score), notes_of(job, found.score)
    elif isinstance(found.score, VertexErrors):
        sections = vertex_rows(found.score)
    lines = [str(found.verdict)]
    for name, rows in sections.items():
        lines += [name, *(f"  {measure:30} {figure:22} {meaning}".rstrip() for measure, figure, meaning in rows)]
    lines += [*found.remarks, *notes] + ([] if job.output is None else [f"report: {job.output}"])
    print_result(found.as_dict(), *lines, as_json=as_json)
    return found


def _score_set(jobs: "list[ScoreJob]", output: Path | None, *, as_json: bool) -> "list[Scored]":
    from dataclasses import asdict

    from fapengine.app.score_set import format_set, run_set, summarize
    from fapengine.cli._printing import print_result, progress
    from fapengine.files.paths import write_bytes
    from fapengine.files.report.score_page import summary_lines

    with progress("scoring, recordings", len(jobs)) as advance:
        results = run_set(jobs, on_recording=advance)
    summary = summarize(results)
    if output is not None:
        write_bytes(output, format_set(results))
    failed = [result for result in results if not result.verdict.passes]
    verdict = f"fails: {len(failed)} of {len(results)} recordings" if failed else f"passes: {len(results)} recordings"
    lines = [verdict, *(f"  {_name(result)}: {result.verdict}" for result in failed)]
    lines += summary_lines(summary.systems, summary.units, summary.tests)
    facts = {
        "verdict": {"passes": not failed, "failed": len(failed), "recordings": len(results)},
        "recordings": [
            {"id": each.job.id, "system": each.job.system, "made": str(each.job.made), **each.as_dict()}
            for each in results
        ],
        "summary": asdict(summary),
    }
    print_result(facts, *lines, *([] if output is None else [f"table: {output}"]), as_json=as_json)
    return results


def _name(result: "Scored") -> str:
    return f"{result.job.id} ({result.job.system})" if result.job.system else result.job.id


def _write_checks(results: "list[Scored]", junit: Path | None, sarif: Path | None) -> None:
    from fapengine import __version__
    from fapengine.files.paths import write_bytes
    from fapengine.files.report.lint import Judged, format_junit, format_sarif

    judged = [Judged(Path(str(result.job.made)), result.verdict, result.frames) for result in results]
    if junit is not None:
        write_bytes(junit, format_junit(judged))
    if sarif is not None:
        write_bytes(sarif, format_sarif(judged, version=__version__))
