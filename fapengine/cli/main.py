"""Joins the verbs and turns our errors into one line and an exit code.

A verb's module imports typer alone at its top; everything heavy is imported inside its function, so that
``fapengine --help`` answers at once.
"""

import signal
import sys

import typer

from fapengine.cli import (
    align,
    animate,
    convert,
    decode,
    doctor,
    encode,
    fit,
    head,
    inspect,
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
    align.align,
    render.render,
    encode.encode,
    decode.decode,
    convert.convert,
    inspect.inspect,
    score.score,
    fit.fit,
    doctor.doctor,
)
"""Verbs in the order in which ``--help`` lists them. To add one: its own file, and its function here."""

EXIT_CODES: tuple[tuple[type[FapEngineError], int], ...] = ((DataError, 1), (UsageError, 2), (ResourceError, 3))


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
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # leave as by Ctrl-C: nothing half written
    try:
        app()
    except FapEngineError as error:
        typer.echo(f"fapengine: {error}", err=True)
        sys.exit(next(code for kind, code in EXIT_CODES if isinstance(error, kind)))
