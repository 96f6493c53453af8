"""What a run came to: a table of all rows, and a page with percentiles and the worst ten."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from fapengine.batch.journal import Done
from fapengine.batch.rows import Row
from fapengine.files.paths import write_bytes
from fapengine.files.report.parts import page, table

INDEX, PAGE = "index.csv", "index.html"
ABOUT = ("alphabet", "labels", "sound", "text", "timings", "words", "other")
"""Subjects of remarks, with which they begin."""
COLUMNS = (
    "id", "state", "file", "bytes", "duration_s", "frames", "phones", "unknown", "seconds", "error", "remarks", *ABOUT
)  # fmt: skip
NONE: Mapping[str, str] = MappingProxyType({})
PERCENTILES = (5, 25, 50, 75, 95, 100)
WORST = 10


def write_report(folder: Path, rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str]) -> None:
    """Write ``index.csv`` and ``index.html`` into a run's folder.

    ``bad`` has the errors of rows that were left out, by their lines. Raises ResourceError if they cannot be written.
    """
    write_bytes(folder / INDEX, format_index(rows, done, bad))
    write_bytes(folder / PAGE, format_page(rows, done, bad))


def format_index(rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str] = NONE) -> bytes:
    """List every row in the manifest's order, done, failed or left, and then those that were left out.

    What looked wrong has columns: a count of remarks, and one for each of :data:`ABOUT`.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        entry = done.get(row.id)
        if entry is None:
            writer.writerow([row.id, "left", *[""] * (len(COLUMNS) - 2)])
            continue
        name, (size, _) = next(iter(entry.outputs.items()), ("", (0, 0)))
        state = "failed" if entry.error else "done"
        figures = (entry.duration_s, entry.frames, entry.phones, entry.unknown, entry.seconds)
        about = _by_subject(entry.remarks)
        writer.writerow([row.id, state, name, size, *figures, entry.error, len(entry.remarks), *about])
    for place, error in bad.items():
        writer.writerow([place, "bad", *[""] * COLUMNS[2:].index("error"), error])
    return buffer.getvalue().encode()


def _by_subject(remarks: Sequence[str]) -> list[str]:
    """Join the remarks on each subject; the last column has those on anything else."""
    found: dict[str, list[str]] = {name: [] for name in ABOUT}
    for remark in remarks:
        subject = remark.partition(":")[0] if not remark.startswith("unknown phone") else "labels"
        found[subject if subject in found else ABOUT[-1]].append(remark)
    return ["; ".join(some) for some in found.values()]


def format_page(rows: Sequence[Row], done: Mapping[str, Done], bad: Mapping[str, str] = NONE) -> bytes:
    """Put percentiles, errors and the worst rows on a page that refers to nothing outside of it."""
    entries = [done[row.id] for row in rows if row.id in done]
    good, failed = [entry for entry in entries if not entry.error], [entry for entry in entries if entry.error]
    counts = f"{len(rows)} rows: {len(good)} done, {len(failed)} failed, {len(rows) - len(entries)} left."
    counts += f" {len(bad)} more were invalid and left out." if bad else ""
    parts = ["<h1>Batch</h1>", f"<p>{counts}</p>"]
    if good:
        figures = {
            "length, s": [entry.duration_s for entry in good],
            "work, s": [entry.seconds for entry in good],
            "work for a second, s": [_cost(entry) for entry in good],
            "bytes": [sum(size for size, _ in entry.outputs.values()) for entry in good],
            "unknown phones": [entry.unknown for entry in good],
        }
        header = ["", *(f"{share} %" for share in PERCENTILES[:-1]), "most"]
        shares = {name: np.percentile(np.array(numbers, float), PERCENTILES) for name, numbers in figures.items()}
        body = [[name, *(f"{value:.4g}" for value in values)] for name, values in shares.items()]
        parts += ["<h2>Percentiles</h2>", table(header, body)]
        strange = sorted((entry for entry in good if entry.unknown), key=lambda entry: (-entry.unknown, entry.id))[
            :WORST
        ]
        if strange:
            rows_of = [[entry.id, str(entry.unknown), str(entry.phones)] for entry in strange]
            parts += ["<h2>Most unknown phones</h2>", table(["id", "unknown", "phones"], rows_of)]
        slow = sorted(good, key=lambda entry: (-_cost(entry), entry.id))[:WORST]
        slow_rows = [[entry.id, f"{entry.duration_s:.2f}", f"{entry.seconds:.2f}"] for entry in slow]
        parts += ["<h2>Most work for their length</h2>", table(["id", "length, s", "work, s"], slow_rows)]
    doubtful = [[entry.id, "; ".join(entry.remarks)] for entry in good if entry.remarks]
    errors = [[entry.id, entry.error] for entry in failed], [list(each) for each in bad.items()]
    for title, listed in zip(("Remarks", "Failed", "Left out"), (doubtful, *errors), strict=True):
        if listed:
            more = len(listed) - 10 * WORST
            parts += [f"<h2>{title}</h2>", table(["id", title.lower()], listed[: 10 * WORST])]
            parts += [f"<p>and {more} more: see {INDEX}</p>"] if more > 0 else []
    return page("Batch", parts)


def _cost(entry: Done) -> float:
    return entry.seconds / max(entry.duration_s, 0.1)
