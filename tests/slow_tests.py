"""Which tests are slow: ``slow_tests.txt`` lists them, ``pytest --write-slow`` measures them; make quick omits them.

Processor time is measured, not time on the wall: that is nearly the same on a busy machine. A file that takes long as a
whole is listed as one, since its first test pays for what the others share. The wall's time of long files is kept too,
for :mod:`.queues`, in ``file_times.txt``. A run with workers measures too: ``make tests OPTIONS=--write-slow``.
"""

import resource
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
CPU = "cpu_s"
"""Name of the processor time in a report."""


def names(nodeid: str) -> tuple[str, str]:
    """Name a test and its file; all parameters of a test count as one."""
    return nodeid.partition("[")[0], nodeid.partition("::")[0]


def listed() -> set[str]:
    """Names of slow tests and files."""
    return set(queues.listed_times(LIST))


class Meter:
    """Measures tests, also those of workers; at the end, what was measured replaces what the lists said of their files.

    Stateful. Each process tells the processor time of its tests in their reports, which reach the one that lists them.
    """

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self.wall: Counter[str] = Counter()
        self._told_s = 0.0

    def pytest_collection_finish(self) -> None:
        self._told_s = _cpu_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        before_s, self._told_s = self._told_s, _cpu_s()
        report.user_properties.append((CPU, self._told_s - before_s))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[names(report.nodeid)[0]] += sum(value for name, value in report.user_properties if name == CPU)
        self.wall[names(report.nodeid)[1]] += report.duration

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workerinput"):
            return
        files: Counter[str] = Counter()
        for name, taken_s in self.seconds.items():
            files[names(name)[1]] += taken_s
        slow = {file: taken_s for file, taken_s in files.items() if taken_s >= SLOW_FILE_S}
        slow |= {
            name: taken_s
            for name, taken_s in self.seconds.items()
            if taken_s >= SLOW_TEST_S and names(name)[1] not in slow
        }
        slow |= {  # nightly tests, and those of files that were not asked for
            name: taken_s
            for name, taken_s in queues.listed_times(LIST).items()
            if name not in files and name not in self.seconds and names(name)[1] not in slow
        }
        LIST.write_text("".join(f"{taken_s:5.1f} {name}\n" for name, taken_s in sorted(slow.items())))
        times = {
            name: taken_s for name, taken_s in queues.listed_times(queues.LIST).items() if name not in self.wall
        } | self.wall
        long = sorted((taken_s, name) for name, taken_s in times.items() if taken_s >= LONG_FILE_S)
        queues.LIST.write_text("".join(f"{taken_s:5.1f} {name}\n" for taken_s, name in reversed(long)))


def _cpu_s() -> float:
    """Processor time of this process and of those that it waited for, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)
