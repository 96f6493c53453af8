"""Joins the verbs and turns our errors into one line and an exit code.

A verb's module imports typer alone at its top; everything heavy is imported inside its function, so that
``fapengine --help`` answers at once.
"""

import contextlib
import os
import signal
import sys
from io import TextIOWrapper
from typing import NoReturn

import typer

from fapengine.cli import (
    align,
    animate,
    batch,
    capture,
    convert,
    decode,
    doctor,
    encode,
    fit,
    head,
    inspect,
    reduce,
    render,
    say,
    score,
    serve,
    view,
)
from fapengine.cli._verb import verb
from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError

app = typer.Typer(
    name="fapengine",
    help="Speech to MPEG-4 facial animation: sentences or phone timings in, FAP streams and a talking face out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

VERBS = (
    say.say,
    serve.serve,
    view.view,
    animate.animate,
    batch.batch,
    align.align,
    capture.capture,
    render.render,
    encode.encode,
    decode.decode,
    convert.convert,
    inspect.inspect,
    score.score,
    fit.fit,
    reduce.reduce,
    doctor.doctor,
)
"""Verbs in the order in which ``--help`` lists them. To add one: its own file, and its function here."""

EXIT_CODES: tuple[tuple[type[FapEngineError], int], ...] = ((DataError, 1), (UsageError, 2), (ResourceError, 3))


DEBUG, FAULT = "FAPENGINE_DEBUG", 70
"""Variable that, set to anything, shows the traceback of a bug; exit code of one (EX_SOFTWARE of sysexits.h)."""


def _show_version(wanted: bool) -> None:
    if wanted:
        from fapengine import __version__

        typer.echo(f"fapengine {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(False, "--version", callback=_show_version, is_eager=True, help="Show the version."),
) -> None:
    pass


for _verb in VERBS:
    app.command()(verb(_verb))
app.add_typer(head.head, name="head")


def main() -> None:
    """Run the command line."""
    _leave_in_order()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that has no IPA still shows the rest
    try:
        try:
            app()
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
            typer.echo(f"fapengine: {' '.join(message.split(chr(10)))}", err=True)  # a file's words may hold lines
    if sys.stdout is not None:
        try:
            sys.stdout.flush()
        except OSError:  # what cannot be written now cannot be at the end either, and Python would say so at length
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)
