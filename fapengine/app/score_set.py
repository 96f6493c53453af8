"""Scores of a test set: its recordings from a table or from folders, and their means with intervals."""

import csv
import io
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from fapengine.app.hearing import is_sound
from fapengine.app.motion import LOADED
from fapengine.app.score import Scored, ScoreJob, run_score
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import naming, read_bytes
from fapengine.files.recordings import is_mesh_sequence
from fapengine.files.video import FILMS
from fapengine.scoring.statistics import Estimate, PairedTest, compare, estimate
from fapengine.scoring.verdict import FILE, MEASURES, VERTEX_MEASURES, Fault, Measure, Verdict
from fapengine.scoring.vertices import VertexErrors
from fapengine.speech.formats.documents import decode_text

FILES = ("made", "against", "phones", "audio", "text", "neutral")
"""Columns that are files, relative to the table."""
COLUMNS = (*FILES, "transcript", "offset", "id", "system")
"""Columns of a set's table."""


def is_set(made: Sequence[Path], options: ScoreJob) -> bool:
    """Whether paths are a set: several, a folder of recordings, or a table; also where a reference is a folder."""
    references = (getattr(options, name) for name in FILES[1:])
    return len(made) != 1 or _is_folder(made[0]) or _is_table(made[0]) or any(map(_is_folder, references))


def _is_folder(path: object) -> TypeGuard[Path]:
    """Whether it is a folder of recordings, which one of meshes is not."""
    return isinstance(path, Path) and path.is_dir() and not is_mesh_sequence(path)


def _is_table(path: Path) -> bool:
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as file:
        header = file.readline(1 << 16).decode("utf-8-sig", errors="replace")
    return "made" in [cell.strip() for cell in header.split(",")]


def jobs_of(made: Sequence[Path], options: ScoreJob) -> list[ScoreJob]:
    """List the recordings of a set.

    Raises UsageError if there is no recording, or its file in a folder is missing or ambiguous; DataError if the table
    is wrong, or a file that it names is missing (``where`` is its line).

    Parameters
    ----------
    made : sequence of Path
        A table (CSV with a header of :data:`COLUMNS`, of which ``made`` is required); files; or a folder for each
        system, whose files have the names of the utterances.
    options : ScoreJob
        What holds for all. Where ``against``, ``phones``, ``audio``, ``text`` or ``neutral`` is a folder, each
        recording has the file of its name there.
    """
    if len(made) == 1 and _is_table(made[0]):
        with naming(made[0]):
            return _rows(made[0], options)
    folders = [_is_folder(path) for path in made]
    if any(folders) and not all(folders):
        raise UsageError("made: got folders and files, expected either")
    if all(folders):
        found = [(path, folder.name) for folder in made for path in sorted(folder.iterdir()) if _is_recording(path)]
    else:
        found = [(path, "") for path in made]
    if not found:
        raise UsageError(f"made: got {', '.join(map(str, made))}, expected recordings in it")
    return _named([replace(_partners(options, path.stem), made=path, system=system) for path, system in found])


def _named(jobs: Sequence[ScoreJob]) -> list[ScoreJob]:
    """Name utterances without an id by their files, with folders where a system has two files of one name."""
    stems = [Path(job.name).stem for job in jobs]
    counts = Counter((stem, job.system) for job, stem in zip(jobs, stems, strict=True))
    return [
        replace(job, id=job.id or (stem if counts[stem, job.system] == 1 else str(job.made)))
        for job, stem in zip(jobs, stems, strict=True)
    ]


def _is_recording(path: Path) -> bool:
    """Whether a file of a folder is one that can be scored."""
    return path.name[0] != "." and (path.suffix.lower() in (*LOADED, *FILMS) or is_mesh_sequence(path))


def _partners(options: ScoreJob, stem: str) -> ScoreJob:
    """Replace folders by the file of that name in them."""
    found: dict[str, Any] = {}
    for name in FILES[1:]:
        folder = getattr(options, name)
        if _is_folder(folder):
            files = [path for path in sorted(folder.iterdir()) if path.stem == stem and _may_be(name, path)]
            if len(files) != 1:
                listed = ", ".join(path.name for path in files) or "none"
                raise UsageError(f"{name}: got {listed} in {folder}, expected one file {stem}.*")
            found[name] = files[0]
    return replace(options, **found)


def _may_be(name: str, path: Path) -> bool:
    """Whether a file may be the sound, or something else: sounds, timings and texts often share a folder."""
    return is_sound(path) if name == "audio" else name not in ("phones", "text") or not is_sound(path)


def _rows(path: Path, options: ScoreJob) -> list[ScoreJob]:
    try:
        rows = list(csv.DictReader(io.StringIO(decode_text(read_bytes(path), "table")), strict=True))
    except csv.Error as error:
        raise DataError(f"table: {error}") from error
    jobs = []
    for line, row in enumerate(rows, 2):
        given: dict[str, Any] = {}
        for column, cell in row.items():
            if column not in COLUMNS:
                raise DataError(f"table: got column {column!r}, expected {', '.join(COLUMNS)}", where=f"line {line}")
            if cell and cell.strip():
                given[column] = path.parent / cell.strip() if column in FILES else cell.strip()
        try:
            given |= {"offset_s": float(given.pop("offset"))} if "offset" in given else {}
        except ValueError as error:
            raise DataError("offset: expected a number of seconds", where=f"line {line}") from error
        if "made" not in given:
            raise DataError("made: missing", where=f"line {line}")
        for column, place in given.items():
            if column in FILES and not place.exists():
                raise DataError(f"{column}: file not found: {place}", where=f"line {line}")
        jobs.append(_partners(replace(options, **given), given["made"].stem))
    if not jobs:
        raise DataError("table: contains no recordings")
    named = _named(jobs)
    (name, _), count = Counter((job.id, job.system) for job in named).most_common(1)[0]
    if count > 1:
        raise DataError(f"id: got {name!r} twice for one system, expected different ids")
    return named


def run_set(jobs: Iterable[ScoreJob], *, on_recording: Callable[[], None] = lambda: None) -> list[Scored]:
    """Score each recording; one that cannot be read fails, and the others are scored.

    Parameters
    ----------
    on_recording : callable
        Called after each recording.
    """
    results = []
    for job in jobs:
        try:
            results.append(run_score(job))
        except DataError as error:
            results.append(Scored(job=job, score=None, verdict=Verdict((Fault(FILE, str(error)),), (FILE,), "")))
        on_recording()
    return results


@dataclass(frozen=True, slots=True)
class Summary:
    """Means of a set."""

    systems: Mapping[str, Mapping[str, Estimate]]
    """Mean and interval of each measure, by system."""
    tests: Mapping[str, PairedTest]
    """Test of the first system against the second on the utterances that both have; empty without two systems."""
    units: Mapping[str, str]


def summarize(results: Sequence[Scored]) -> Summary:
    """Average each measure over the utterances of each system, and compare two systems."""
    measures = measures_of(results)
    values: dict[str, dict[str, dict[str, tuple[float, float]]]] = {}
    for result in results:
        for measure in measures:
            value = None if result.score is None else measure.value(result.score)
            if value is not None and (weight := measure.weight(result.score)) > 0:
                of_system = values.setdefault(result.job.system, {}).setdefault(measure.row.name, {})
                of_system[result.job.id] = value, weight
    systems = {
        system: {name: estimate(*zip(*each.values(), strict=True)) for name, each in named.items()}
        for system, named in values.items()
    }
    tests = {}
    if len(values) == 2:
        one, other = values.values()
        for name in one:
            if both := [key for key in one[name] if key in other.get(name, {})]:
                first, second = ([each[name][key][0] for key in both] for each in (one, other))
                tests[name] = compare(first, second, [one[name][key][1] for key in both])
    return Summary(systems, tests, {measure.row.name: measure.row.unit for measure in measures})


def measures_of(results: Sequence[Scored]) -> Sequence[Measure[Any]]:
    """Return the measures of a set, without ``lead``, the negative of ``lag``.

    Raises UsageError if it mixes meshes and other recordings.
    """
    kinds = {isinstance(result.score, VertexErrors) for result in results if result.score is not None}
    if len(kinds) > 1:
        raise UsageError("made: got meshes and other recordings, expected one kind in a set")
    return VERTEX_MEASURES if kinds == {True} else [measure for measure in MEASURES if measure.row.name != "lead"]


def format_set(results: Sequence[Scored]) -> bytes:
    """Format a CSV with a row for each recording: id, system, verdict, and every measure with its unit."""
    measures = measures_of(results)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = [f"{measure.row.name}_{measure.row.unit.replace('%', 'percent')}".rstrip("_") for measure in measures]
    writer.writerow(("id", "system", "made", "verdict", *names))
    for result in results:
        values = [None if result.score is None else measure.value(result.score) for measure in measures]
        figures = ["" if value is None else f"{value:.6g}" for value in values]
        writer.writerow((result.job.id, result.job.system, result.job.made, result.verdict, *figures))
    return out.getvalue().encode()
