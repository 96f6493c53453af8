"""Two queues of test files: those that wait, for sockets, browsers and children, and those that compute.

Of every three workers of pytest-xdist the first takes files that compute, the others files that wait; a worker with
nothing left in its queue takes from the other. Files go out whole, so what a module sets up is set up once, and the
longest first, by :data:`LIST`, so that no worker has a long one left at the end.
"""

from collections.abc import Mapping
from pathlib import Path

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

LIST = Path(__file__).with_name("file_times.txt")
"""Seconds on the wall that each long file takes; ``make tests OPTIONS=--write-slow`` measures them."""
WAITS = (
    "tests/browser/", "tests/examples/", "tests/live/", "tests/end_to_end/test_batch.py",
    "tests/unit/app/test_watch_live.py", "tests/unit/audio/", "tests/unit/clients/", "tests/unit/conformance/",
    "tests/unit/server/",
)  # fmt: skip
"""What the names of files that wait begin with."""
WORKERS_IN_TURN = 3


def waits(name: str) -> bool:
    """Whether the file of a test, or a file, waits most of the time."""
    return name.startswith(WAITS)


def listed_times(path: Path) -> dict[str, float]:
    """Read a list of names and the seconds that each takes."""
    rows = (line.split(maxsplit=1) for line in path.read_text(encoding="utf-8").splitlines())
    return {name: float(seconds) for seconds, name in rows}


def next_file(left: Mapping[str, object], times_s: Mapping[str, float], *, computes: bool) -> str:
    """Choose a worker's next file: of its own queue if there is one left, the longest first."""
    own = [name for name in left if waits(name) != computes] or list(left)
    return max(own, key=lambda name: times_s.get(name, 0.0))


class TwoQueues(LoadFileScheduling):
    """Hands out files as this module says. Stateful."""

    _times_s: Mapping[str, float] | None = None

    def _assign_work_unit(self, node: WorkerController) -> None:
        if self._times_s is None:
            self._times_s = listed_times(LIST)
        computes = int(node.gateway.id.removeprefix("gw")) % WORKERS_IN_TURN == 0
        self.workqueue.move_to_end(next_file(self.workqueue, self._times_s, computes=computes), last=False)
        super()._assign_work_unit(node)
