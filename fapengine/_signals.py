"""Delay Ctrl-C and SIGTERM while a C library calls back into Python."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def signals_kept() -> Iterator[list[int]]:
    """Collect signals in a list while the block runs, and handle them at its end.

    Python runs signal handlers in any Python code, also in a callback from C. An exception raised there is printed and
    dropped (ctypes: espeak-ng continued for minutes after Ctrl-C) or crashes the process (moderngl 5.13 while it
    describes a program: 3 of about 250 videos that were stopped at their first frame).

    Examples
    --------
    >>> before = signal.signal(signal.SIGINT, signal.default_int_handler)
    >>> try:
    ...     with signals_kept() as kept:
    ...         signal.raise_signal(signal.SIGINT)
    ...         print("still here", len(kept))
    ... except KeyboardInterrupt:
    ...     print("stopped")
    still here 1
    stopped
    >>> _ = signal.signal(signal.SIGINT, before)
    """
    kept: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            handler = signal.getsignal(name)
            if callable(handler) and name not in before:
                before[name] = handler
                signal.signal(name, lambda number, _: kept.append(number))
    try:
        yield kept
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in kept:
            before[number](number, None)
