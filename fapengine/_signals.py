"""Ctrl-C and SIGTERM that come while a library calls back into Python wait until it has returned."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def signals_kept() -> Iterator[list[int]]:
    """Keep signals for the end of what is inside, in a list that inside can look at.

    Python runs a signal's handler wherever Python code is, also where a library in C has called it. What the handler
    raises there is printed and forgotten (ctypes: espeak-ng went on for minutes after Ctrl-C), or ends the program with
    a segmentation fault where the library does not look (moderngl 5.13 while it describes a program: seen with 3 of
    some 250 films that were stopped at their first frame, whose hidden files stayed).

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
