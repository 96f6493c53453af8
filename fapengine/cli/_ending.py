"""How the program ends: our errors are one line and an exit code, and Ctrl-C leaves nothing half written."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable
from importlib.util import find_spec
from io import TextIOWrapper
from typing import NoReturn

from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError

EXIT_CODES: tuple[tuple[type[FapEngineError], int], ...] = ((DataError, 1), (UsageError, 2), (ResourceError, 3))


DEBUG, FAULT = "FAPENGINE_DEBUG", 70
"""Variable that, set to anything, shows the traceback of a bug; exit code of one (EX_SOFTWARE of sysexits.h)."""
EXITS = (
    "Exit codes: 0 it is done; 1 a file's content is wrong; 2 the call is wrong, or a row of batch failed;"
    " 3 the machine lacks something, or a server is not there;"
    f" {FAULT} a bug of fapengine; 128 + N ended by signal N (Ctrl-C: 130)."
)
"""Meaning of each exit code, for the help."""


def run_to_the_end(command_line: Callable[[], object]) -> None:
    """Run a command line; an error of ours is one line and an exit code, another one is said to be a bug."""
    _leave_in_order()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that has no IPA still shows the rest
    try:
        try:
            command_line()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except FapEngineError as error:
        _end(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 3))
    except MemoryError:
        _end("not enough memory; give it less at once", 3)
    except OSError as error:  # our files are dealt with elsewhere: this is the terminal, or a full disk
        _end(f"output: cannot be written ({error.strerror or error})", 3)
    except Exception as error:
        if os.environ.get(DEBUG):
            raise
        if isinstance(error, ModuleNotFoundError) and find_spec("scipy") is None:  # planning and coding do without
            _end("scipy is not installed; mend it with: pip install scipy", 3)
        told = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        _end(f"{told}; this is a bug of fapengine, please report it with what {DEBUG}=1 shows", FAULT)


def _leave_in_order() -> None:
    """Leave by Ctrl-C, SIGTERM and the end of the terminal alike, nothing half written; a second one does not wait."""
    left = False

    def leave(number: int, _: object) -> None:
        nonlocal left
        if left:
            from fapengine.files.paths import remove_unfinished

            remove_unfinished()
            os._exit(128 + number)
        left = True
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(128 + number)

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # Windows has no SIGHUP
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # nohup, or in the background
            signal.signal(number, leave)


def _end(message: str, code: int) -> NoReturn:
    """Say in one line why, and end."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            sys.stderr.write(f"fapengine: {' '.join(message.split(chr(10)))}\n")  # a file's words may hold lines
            sys.stderr.flush()
    if sys.stdout is not None:
        try:
            sys.stdout.flush()
        except OSError:  # what cannot be written now cannot be at the end either, and Python would say so at length
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)
