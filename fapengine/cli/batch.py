"""``fapengine batch``: process a corpus, on one machine or many."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import _hearing
from fapengine.cli import options as shared

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fapengine.batch.journal import Done


def batch(
    manifest: Annotated[
        str,
        typer.Argument(
            help="Table (.csv, .jsonl) with one row per utterance: id; text, timings or audio; any option of the"
            " commands. Or a file pattern ('wav/*.wav'), or the folder of an earlier run with --status, --verify or"
            " --retry-failed. For profiles: one row per speaker (id, session), or a pattern of folders."
        ),
    ],
    avatar: shared.AvatarOptions,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Output folder.")] = None,
    to: Annotated[
        str,
        typer.Option(
            help="Output type: the ending of any file that `say` writes (fba, fap, mp4, csv, json, glb ...), or profile"
            " (see `fit`)."
        ),
    ] = "fba",
    text: Annotated[
        str | None,
        typer.Option("--transcript-file", help="With a file pattern: transcript of each recording, 'txt/{stem}.txt'."),
    ] = None,
    trust_transcript: _hearing.TrustTranscript = False,
    workers: Annotated[
        int | None,
        typer.Option(min=0, max=1024, help="Number of processes. Default: one per core. 0 uses this process only."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Use the workers of a Dask scheduler.")
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="K/N", help="Process every Nth row from the Kth on, for job arrays.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Process failed rows again.")] = False,
    status: Annotated[bool, typer.Option("--status", help="Print the progress of a run and exit.")] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Check every output file against its recorded digest and exit.")
    ] = False,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Leave out invalid rows; the report lists them. Exit code 2.")
    ] = False,
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    no_overwrite: Annotated[
        bool,
        typer.Option("--no-overwrite", help="Do not overwrite files that an earlier run of the folder did not write."),
    ] = False,
) -> None:
    """Process every utterance of a corpus. Resumes an interrupted run.

        fapengine batch corpus.csv -o out/corpus --to fba
        fapengine batch '*.wav' --transcript-file '{stem}.txt' -o out/corpus --to fap
        fapengine batch corpus.csv -o out/corpus --to mp4 --scheduler tcp://head:8786
        fapengine batch out/corpus --retry-failed
        fapengine batch 'recordings/*' -o profiles --to profile

    Each row gives the same bytes as `say` (text), `animate` (timings, audio), `encode`, `convert` or `fit` with the
    same options. Invalid rows, unknown voices, heads, profiles and shapes, and missing files are all reported before
    any work starts. A row that fails is listed in the report (index.csv, index.html), and the exit code is 2. The
    report has a column for each kind of remark.
    """
    import os
    from dataclasses import asdict

    from fapengine.batch.corpus import RECORD, Corpus, keep, load_corpus, state_of
    from fapengine.batch.journal import load_journals
    from fapengine.batch.rows import Options
    from fapengine.batch.run import INDEX, PAGE, on_dask, on_this_machine, plan_run, run, serially, write_report
    from fapengine.batch.work import Job
    from fapengine.cli._printing import print_remarks, print_result, progress
    from fapengine.errors import UsageError
    from fapengine.files.outputs import check_outputs
    from fapengine.files.paths import resolved

    folder = Path(manifest)
    is_run = folder.is_dir()
    if status or verify:
        state = state_of(folder, verify=verify)
        lines = _lines(manifest, state.rows, state.done, state.failed, state.left)
        lines += [f"{name}: the file or its input has changed" for name in state.damaged]
        print_result(asdict(state), *lines, as_json=as_json)
        if state.failed or state.damaged:
            raise typer.Exit(2)
        return
    if is_run:
        if not retry_failed:
            todo = (
                "--status, --verify or --retry-failed"
                if (folder / RECORD).exists()
                else f"'{folder / '*'}' for the files in it"
            )
            raise UsageError(f"manifest: {folder} is a folder; use {todo}")
        output, corpus = folder, load_corpus(folder)
    else:
        if output is None:
            raise UsageError("output: missing; give a folder with --output")
        avatar.value()
        into, mapping = (_place(path) for path in (avatar.into, avatar.mapping))
        options = Options(keys=avatar.keys, into=into, map=mapping, strict=strict, trust_transcript=trust_transcript)
        pattern = manifest if any(letter in manifest for letter in "*?[") else str(resolved(folder))
        corpus = Corpus(manifest=pattern, kind=to, text=text, options=options, skip_bad=skip_bad)
    number, count = _share(shard)
    journal = output / (f"journal.{number}-of-{count}.jsonl" if shard else "journal.jsonl")
    is_new = not (output / RECORD).exists()
    own = [output / name for name in (RECORD, INDEX, PAGE)] + [journal]
    check_outputs(own, corpus.inputs(), overwrite=not (no_overwrite and is_new))
    bad: dict[str, str] = {}
    rows = corpus.rows(bad)
    mine = rows[number - 1 :: count]
    read = corpus.inputs(rows)
    check_outputs([*own, *(name for row in mine for name in row.outputs(output, corpus.kind))], read)
    keep(output, corpus)
    cores = workers if workers is not None else len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    engine = on_dask(scheduler) if scheduler else on_this_machine(cores) if cores else serially
    plan = plan_run(mine, Job(output.resolve(), corpus.kind), retry_failed=retry_failed)
    outputs = [name for place in plan.left for name in mine[place].outputs(output, corpus.kind)]
    check_outputs(outputs, overwrite=not (no_overwrite and is_new))
    with progress("rows", len(plan.left)) as advance:
        done = run(plan, engine, max(cores, 1), journal, on_rows=advance)
    write_report(output, rows, load_journals(output) if shard else done, bad)
    failed = [done[row.id] for row in mine if row.id in done and done[row.id].error]
    facts: dict[str, object] = {"rows": len(mine), "done": len(done) - len(failed), "new": len(plan.left)}
    facts["failed"], facts["bad"] = {one.id: one.error for one in failed}, bad
    facts["remarks"] = {row.id: list(done[row.id].remarks) for row in mine if row.id in done and done[row.id].remarks}
    lines = _lines(str(output), len(mine), len(done) - len(failed), failed, 0)
    print_result(facts, *lines, *([f"{len(bad)} invalid rows were left out"] if bad else []), as_json=as_json)
    remarks = [f"{row.id}: {remark}" for row in mine if row.id in done for remark in done[row.id].remarks]
    print_remarks(remarks[:MAX_LISTED])
    if len(remarks) > MAX_LISTED:
        print_remarks([f"and {len(remarks) - MAX_LISTED} more remarks: index.csv"])
    print_remarks(f"{place} was left out: {error}" for place, error in list(bad.items())[:MAX_LISTED])
    if failed or bad:
        raise typer.Exit(2)


MAX_LISTED = 10


def _lines(where: str, rows: int, done: int, failed: "Sequence[Done]", left: int) -> list[str]:
    from fapengine.cli._printing import as_flags

    lines = [f"{where}: {rows} rows: {done} done, {len(failed)} failed{f', {left} left' if left else ''}"]
    lines += [f"  {one.id}: {as_flags(one.error)}" for one in failed[:MAX_LISTED]]
    return lines + ([f"  and {len(failed) - MAX_LISTED} more: index.csv"] if len(failed) > MAX_LISTED else [])


def _share(shard: str | None) -> tuple[int, int]:
    """Read K/N."""
    from fapengine.errors import UsageError

    if shard is None:
        return 1, 1
    number, slash, count = shard.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise UsageError(f"shard: must be K/N such as 3/40, with K from 1 to N, got {shard!r}")
    return int(number), int(count)


def _place(path: Path | None) -> str | None:
    """Name a file from everywhere; the name of a head stays as it is."""
    return str(path.resolve() if path.exists() else path) if path else None
