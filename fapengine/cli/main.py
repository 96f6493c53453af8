"""Joins the verbs; how the program ends is :mod:`fapengine.cli._ending`'s.

A verb's module imports typer alone at its top; everything heavy is imported inside its function, so that
``fapengine --help`` answers at once.
"""

import typer

from fapengine.cli import (
    align,
    animate,
    batch,
    capture,
    convert,
    decode,
    doctor,
    drive,
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
from fapengine.cli._ending import EXITS, run_to_the_end
from fapengine.cli._verb import verb

app = typer.Typer(
    name="fapengine",
    help="Speech to MPEG-4 facial animation: sentences or phone timings in, FAP streams and a talking face out.",
    epilog=EXITS,
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
    drive.drive,
    reduce.reduce,
    doctor.doctor,
)
"""Verbs in the order in which ``--help`` lists them. To add one: its own file, and its function here."""


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
    run_to_the_end(app)
