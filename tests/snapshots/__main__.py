"""Runs the snapshots outside of the suite, and says what differs.

python -m tests.snapshots
python -m tests.snapshots --bless texts            keeps the texts as they are now: help, errors, what jobs print
python -m tests.snapshots --bless jobs             keeps the digests of the jobs
python -m tests.snapshots --bless sessions         keeps the digests of the live sessions
python -m tests.snapshots --keep out/now           keeps the files of every job, to compare two trees with diff -r
"""

import argparse
import difflib
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.snapshots import jobs, sessions, texts
from tests.snapshots.fresh import Fresh
from tests.snapshots.inputs import make_inputs


def main() -> int:
    """Run what is asked for; exit code 1 where something differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bless", nargs="+", choices=("texts", "jobs", "sessions"), default=[])
    parser.add_argument("--keep", type=Path, help="folder that the files of the jobs go into")
    parser.add_argument("--only", default="", help="jobs and sessions with this in their names, and no texts")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        root = (chosen.keep or Path(temporary)).resolve()
        for name in ("in", "texts"):
            (root / name).mkdir(parents=True)
        with Fresh() as fresh:
            fresh.call(make_inputs, root / "in")
            results = _run_jobs(fresh, root, chosen.only)
            found = {} if chosen.only else dict(fresh.call(texts.all_texts, root / "in", root / "texts"))
            names = [name for name in sessions.conversations() if chosen.only in name]
            replayed = {name: fresh.call(sessions.replay, name) for name in names}
    if chosen.only and chosen.bless:
        parser.error("--only: got --bless with it, expected one of them")
    found |= _words(results, is_whole=not chosen.only)
    differs = _compare_texts(found, bless="texts" in chosen.bless)
    differs |= _compare_jobs(results, bless="jobs" in chosen.bless)
    differs |= _compare_sessions(replayed, bless="sessions" in chosen.bless)
    return int(differs)


def _run_jobs(fresh: Fresh, root: Path, only: str) -> dict[str, jobs.Result]:
    results = {}
    for job in jobs.all_jobs():
        if only in job.name:
            try:
                results[job.name] = fresh.call(jobs.run_job, job, root / "in", root / "jobs" / job.folder)
            except AssertionError as error:  # the others are run as well
                print(f"{job.name}: failed: {error}")
    return results


def _words(results: Mapping[str, jobs.Result], *, is_whole: bool) -> dict[str, str]:
    """Sections of the two files that hold words of jobs; of some jobs alone, the others stay as they are."""
    printed = {name: result.printed for name, result in results.items()}
    keys = {name: ", ".join(result.keys) for name, result in results.items()}
    old = [{} if is_whole else texts.sections_of(texts.kept(name)) for name in (texts.PRINTED, texts.KEYS)]
    return {texts.PRINTED: texts.joined(old[0] | printed), texts.KEYS: texts.joined(old[1] | keys)}


def _compare_texts(found: Mapping[str, str], *, bless: bool) -> bool:
    differs = False
    for name, text in found.items():
        lines: Sequence[str] = [
            *difflib.unified_diff(texts.kept(name).splitlines(), text.splitlines(), name, "now", lineterm="", n=1)
        ]
        print("\n".join(lines), end="\n" * bool(lines))
        differs |= bool(lines)
        if bless:
            texts.keep(name, text)
    return differs


def _compare_jobs(results: Mapping[str, jobs.Result], *, bless: bool) -> bool:
    expected, differs = jobs.read_digests(), False
    for name, result in results.items():
        for line in jobs.differences(expected.get(name, {}), result.digests):
            print(f"{name}: {line}")
            differs = True
    if bless:
        jobs.DIGESTS.write_text(jobs.write_digests(results), encoding="utf-8")
    return differs


def _compare_sessions(found: Mapping[str, Mapping[str, str]], *, bless: bool) -> bool:
    expected, differs = sessions.read_digests(), False
    for name, digests in found.items():
        for what in digests | expected.get(name, {}):
            before, now = expected.get(name, {}).get(what), digests.get(what)
            if before != now:
                print(f"{name}, {what}: got {now}, expected {before}")
                differs = True
    if bless:
        sessions.DIGESTS.write_text(sessions.write_digests(found), encoding="utf-8")
    return differs


if __name__ == "__main__":
    sys.exit(main())
