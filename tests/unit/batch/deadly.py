"""Work that ends its worker, for the tests of runs."""

import os
import signal

from fapengine.batch.journal import Done
from fapengine.batch.rows import Row
from fapengine.batch.work import Job, do_rows

FATAL = "fatal"


def do_or_die(rows: tuple[Row, ...], keys: tuple[str, ...], job: Job) -> list[Done]:
    if any(row.id == FATAL for row in rows):
        os.kill(os.getpid(), signal.SIGKILL)
    return do_rows(rows, keys, job)
