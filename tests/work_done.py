"""How much a piece of work is, on any machine: lines of our code that are run, and memory. No clock is asked."""

import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

PACKAGE = str(Path(__file__).resolve().parent.parent / "fapengine")


def lines_run(work: Callable[[], object], *more: str) -> int:
    """Count the lines that are run in our package, and in more files."""
    count = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        file = frame.f_code.co_filename
        if not file.startswith(PACKAGE) and file not in more:
            return None
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return count


def bytes_taken(work: Callable[[], object]) -> int:
    """Count the bytes that Python and NumPy hold at most."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
