"""What a run came to: a table of all rows, and a page with percentiles and the worst ten."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fapengine.batch.journal import Done
from fapengine.batch.rows import Row
from fapengine.files.paths import write_bytes
from fapengine.files.report.parts import page, table

INDEX, PAGE = "index.csv", "index.html"
COLUMNS = ("id", "state", "file", "bytes", "duration_s", "frames", "phones", "unknown", "seconds", "error", "remarks")
PERCENTILES = (5, 25, 50, 75, 95, 100)
WORST = 10


def write_report(folder: Path, rows: Sequence[Row], done: Mapping[str, Done]) -> None:
    """Write ``index.csv`` and ``index.html`` into a run's folder. Raises ResourceError if they cannot be written."""
    write_bytes(folder / INDEX, format_index(rows, done))
    write_bytes(folder / PAGE, format_page(rows, done))


def format_index(rows: Sequence[Row], done: Mapping[str, Done]) -> bytes:
    """List every row in the manifest's order: done, failed or left."""
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
        writer.writerow([row.id, state, name, size, *figures, entry.error, "; ".join(entry.remarks)])
    return buffer.getvalue().encode()


def format_page(rows: Sequence[Row], done: Mapping[str, Done]) -> bytes:
    """Put percentiles, errors and the worst rows on a page that refers to nothing outside of it."""
    entries = [done[row.id] for row in rows if row.id in done]
    good, bad = [entry for entry in entries if not entry.error], [entry for entry in entries if entry.error]
    counts = f"{len(rows)} rows: {len(good)} done, {len(bad)} failed, {len(rows) - len(entries)} left."
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
    if bad:
        told = [[entry.id, entry.error] for entry in bad[: 10 * WORST]]
        more = f"<p>and {len(bad) - len(told)} more: see {INDEX}</p>" if len(bad) > len(told) else ""
        parts += ["<h2>Failed</h2>", table(["id", "error"], told), more]
    return page("Batch", parts)


def _cost(entry: Done) -> float:
    return entry.seconds / max(entry.duration_s, 0.1)
