"""What a browser's processes take: memory, and processor time of its workers."""

import os
from collections.abc import Iterator
from pathlib import Path

WORKERS = ("DedicatedWorker", "DOM Worker")
"""How the names of workers' threads begin, in Chromium and in Firefox."""


def fields_of(stat: Path) -> tuple[str, list[str]]:
    """Name of a process or thread, and the fields after it."""
    begin, _, rest = stat.read_text().rpartition(")")
    return begin.partition("(")[2], rest.split()


def family(pid: int) -> set[int]:
    """A process and all that it started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(fields_of(stat)[1][1])
        except (FileNotFoundError, ProcessLookupError):  # it has just ended
            continue
    found = {pid}
    while more := {child for child, parent in parents.items() if parent in found} - found:
        found |= more
    return found


def memory(pid: int) -> float:
    """Memory of their own that a process and all that it started have, swapped out or not, bytes; no files."""
    return 1024.0 * sum(
        int(line.split()[1])
        for lines in _read(f"/proc/{member}/smaps_rollup" for member in family(pid))
        for line in lines
        if line.startswith(("Private_Dirty:", "Swap:"))
    )


def worker_seconds(pid: int) -> float:
    """Processor time that the workers of a browser's pages have taken, s."""
    seconds = 0.0
    for member in family(pid):
        for stat in Path(f"/proc/{member}/task").glob("*/stat"):
            try:
                name, fields = fields_of(stat)
            except (FileNotFoundError, ProcessLookupError):
                continue
            if name.startswith(WORKERS):
                seconds += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return seconds


def _read(names: Iterator[str]) -> Iterator[list[str]]:
    for name in names:
        try:
            yield Path(name).read_text().splitlines()
        except (FileNotFoundError, ProcessLookupError):
            continue
