"""Program exit: errors become one line and an exit code; Ctrl-C leaves no partial files."""

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
"""Environment variable that shows tracebacks of internal errors; their exit code (EX_SOFTWARE of sysexits.h)."""
EXITS = (
    "Exit codes: 0 success; 1 invalid file, or a failed check; 2 invalid usage, or a batch row failed; 3 missing"
    f" dependency, device or server; {FAULT} internal error (please report it); 128 + N killed by signal N (Ctrl-C:"
    " 130)."
)
"""Exit codes, for the help."""


def run_to_the_end(command_line: Callable[[], object]) -> None:
    """Run a command line. Expected errors print one line; any other exception is reported as an internal error."""
    _leave_in_order()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without IPA still shows the rest
    try:
        try:
            command_line()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except FapEngineError as error:
        _end(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 3))
    except MemoryError:
        _end("out of memory; process less at a time", 3)
    except OSError as error:  # files are handled elsewhere: this is the terminal, or a full disk
        _end(f"output: cannot be written ({error.strerror or error})", 3)
    except Exception as error:
        if os.environ.get(DEBUG):
            raise
        if isinstance(error, ModuleNotFoundError) and find_spec("scipy") is None:  # planning and coding do not need it
            _end("scipy is not installed. Install it with: pip install scipy", 3)
        told = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        _end(f"{told}; this is a bug in fapengine. Please report it, with the output of {DEBUG}=1", FAULT)


def _leave_in_order() -> None:
    """Handle Ctrl-C, SIGTERM and SIGHUP alike, without partial files; a second signal exits at once."""
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
    """Print one line and exit."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            line = message.replace(":\n", ": ").replace("\n", "; ")
            sys.stderr.write(f"fapengine: {line}\n")
            sys.stderr.flush()
    if sys.stdout is not None:
        try:
            sys.stdout.flush()
        except OSError:  # else Python would print a traceback when it flushes again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)
