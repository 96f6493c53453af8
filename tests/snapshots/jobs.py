"""The jobs of ``jobs.txt`` and of :mod:`tests.snapshots.api`: run in a folder of their own, and digested."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.snapshots import api
from tests.snapshots.digests import Digest, digest, encode_row, leaves
from tests.snapshots.run import Ran, run

FOLDER = Path(__file__).parent
TABLE, DIGESTS = FOLDER / "jobs.txt", FOLDER / "digests.txt"


@dataclass(frozen=True)
class Job:
    """One line of the table."""

    name: str
    commands: tuple[str, ...]
    """Command lines, one after the other; of the Python API: none."""
    is_nightly: bool = False

    @property
    def folder(self) -> str:
        """Name of the folder that it runs in."""
        return re.sub(r"\W+", "-", self.name)


@dataclass(frozen=True)
class Result:
    """What a job made."""

    digests: Mapping[str, Digest]
    """By file; what the last command printed is ``stdout``."""
    printed: str
    """Words of the last command, without its numbers."""
    keys: tuple[str, ...]
    """Keys of the result in JSON."""


def all_jobs() -> list[Job]:
    """Read the table; jobs of the Python API come last."""
    jobs = []
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            name, _, commands = line.partition(" | ")
            jobs.append(Job(name.removeprefix("~ "), tuple(commands.split(" && ")), line.startswith("~")))
    jobs += [Job(name, ()) for name in api.JOBS]
    names = [job.name for job in jobs]
    if len(set(names)) < len(names):
        raise AssertionError(f"two jobs of one name: {sorted(name for name in names if names.count(name) > 1)}")
    return jobs


def run_job(job: Job, inputs: Path, folder: Path) -> Result:
    """Run a job in an empty folder, where ``in`` leads to the inputs."""
    folder.mkdir(parents=True)
    (folder / "in").symlink_to(inputs)
    if not job.commands:
        arrays = {name: np.asarray(value) for name, value in api.JOBS[job.name](inputs, folder).items()}
        if arrays:
            np.savez(folder / "result.npz", **arrays)
        (folder / "in").unlink()
        return Result({name: digest(name, data) for name, data in _files(folder).items()}, "", ())
    for command in job.commands:
        ran = run(command, folder)
        if ran.code:
            raise AssertionError(f"fapengine {command}: exit code {ran.code}: {ran.err}")
    (folder / "in").unlink()
    return _result(ran, job.commands[-1], folder)


def _result(ran: Ran, command: str, folder: Path) -> Result:
    digests = {name: digest(name, data) for name, data in _files(folder).items()}
    words = ran.err
    keys: tuple[str, ...] = ()
    if "--json" in command.split():
        digests["stdout"] = digest("stdout.json", ran.out)
        keys = tuple(sorted({path for path, _ in leaves(json.loads(ran.out))}))
    elif re.search(r" -o -(\.\w+)?$", command):
        digests["stdout"] = digest("stdout.bytes", ran.out)
    else:
        digests = digests or {"stdout": digest("stdout.words", ran.out)}
        words = ran.out.decode() + words
    return Result(digests, plain(words, folder), keys)


def _files(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def plain(text: str, folder: Path) -> str:
    """Leave the words: no numbers, no frames around tables, no paths of this machine, no times that work took."""
    text = text.replace(str(folder.resolve()), "FOLDER").replace(str(folder), "FOLDER")
    text = re.sub(r"[─│╭╮╰╯┃━┏┓┗┛]", " ", text)
    text = re.sub(r"\d+(\.\d+)?", "#", text)
    lines = (re.sub(r"\s+", " ", line).strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("time "))


def write_digests(results: Mapping[str, Result]) -> str:
    """Spell ``digests.txt``."""
    rows = ["# job | file | kind of digest | SHA-256, first digits | numbers with a tolerance"]
    for job, result in results.items():
        rows += [encode_row((job, file), value) for file, value in result.digests.items()]
    return "\n".join(rows) + "\n"


def read_digests() -> dict[str, dict[str, Digest]]:
    """Read them: by job and file."""
    found: dict[str, dict[str, Digest]] = {}
    for line in DIGESTS.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            job, file, kind, exact, *near = line.split(" | ")
            numbers = tuple(map(float, near[0].split())) if near else ()
            found.setdefault(job, {})[file] = Digest(kind, exact.split(" |")[0].strip(), numbers)
    return found


def differences(expected: Mapping[str, Digest], found: Mapping[str, Digest]) -> list[str]:
    """Name the files that differ, and how."""
    lines = []
    for file in sorted(set(expected) | set(found)):
        before, now = expected.get(file), found.get(file)
        if before is None or now is None:
            lines.append(f"{file}: {'is new' if before is None else 'is not written any more'}")
        elif not before.equals(now):
            lines.append(f"{file}: got {now}, expected {before}")
    return lines
