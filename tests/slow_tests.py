"""Which tests are slow: ``slow_tests.txt`` lists them, ``pytest --write-slow`` measures them; make quick omits them.

Processor time is measured, not time on the wall: that is nearly the same on a busy machine. A file that takes long as a
whole is listed as one, since its first test pays for what the others share. The wall's time of long files is kept too,
for :mod:`.queues`, in ``file_times.txt``.
"""

import resource
import time
from collections import Counter
from collections.abc import Generator
from pathlib import Path

import pytest

from tests import queues

LIST = Path(__file__).with_suffix(".txt")
SLOW_TEST_S, SLOW_FILE_S = 0.7, 8.0
"""Processor time from which a test, or a whole file, is slow."""
LONG_FILE_S = 4.0
"""Time on the wall from which a file is long."""


def names(nodeid: str) -> tuple[str, str]:
    """Name a test and its file; all parameters of a test count as one."""
    return nodeid.partition("[")[0], nodeid.partition("::")[0]


def listed() -> set[str]:
    """Names of slow tests and files."""
    return {line.split(maxsplit=1)[1] for line in LIST.read_text().splitlines()}


class Meter:
    """Measures tests; at the end, what was measured replaces what the list said of the same files. Stateful."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self.wall: Counter[str] = Counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        start_s, cpu_s = time.monotonic(), _cpu_s()
        try:
            return (yield)
        finally:
            self.seconds[names(item.nodeid)[0]] += _cpu_s() - cpu_s
            self.wall[names(item.nodeid)[1]] += time.monotonic() - start_s

    def pytest_sessionfinish(self) -> None:
        files: Counter[str] = Counter()
        for name, taken_s in self.seconds.items():
            files[names(name)[1]] += taken_s
        slow = {file: taken_s for file, taken_s in files.items() if taken_s >= SLOW_FILE_S}
        slow |= {
            name: taken_s
            for name, taken_s in self.seconds.items()
            if taken_s >= SLOW_TEST_S and names(name)[1] not in slow
        }
        kept = [line for line in LIST.read_text().splitlines() if names(line.split(maxsplit=1)[1])[1] not in files]
        lines = [*kept, *(f"{taken_s:5.1f} {name}" for name, taken_s in slow.items())]
        LIST.write_text("".join(f"{line}\n" for line in sorted(lines, key=lambda line: line.split(maxsplit=1)[1])))
        times = {name: taken_s for name, taken_s in queues.file_times().items() if name not in self.wall} | self.wall
        long = sorted((taken_s, name) for name, taken_s in times.items() if taken_s >= LONG_FILE_S)
        queues.LIST.write_text("".join(f"{taken_s:5.1f} {name}\n" for taken_s, name in reversed(long)))


def _cpu_s() -> float:
    """Processor time of this process and of those that it waited for, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)
