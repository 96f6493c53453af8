"""The command line: which commands there are, and how their modules are found.

A command's module is imported when it runs or is listed: ``fapengine say`` imports none of the others. How the program
ends is in :mod:`fapengine.cli._ending`.
"""

import atexit
import gc
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from fapengine.cli._command import command
from fapengine.cli._ending import EXITS, run_to_the_end
from fapengine.errors import UsageError

COMMANDS = (
    "say", "serve", "agent", "view", "animate", "batch", "align", "capture", "render", "encode", "decode", "convert",
    "inspect", "score", "fit", "drive", "reduce", "doctor", "head", "mcp",
)  # fmt: skip
"""Commands in the order in which ``--help`` lists them. To add one: its module in this package, and its name here."""


class Commands(TyperGroup):
    """A group of commands whose modules are imported on demand."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return list(COMMANDS)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command of the arguments. Raises UsageError for an unknown name."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            near = get_close_matches(args[0], COMMANDS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(COMMANDS)}"
            raise UsageError(f"command: got {args[0]!r}, {hint}")
        return super().resolve_command(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        function = getattr(import_module(f"fapengine.cli.{cmd_name}"), cmd_name)
        if isinstance(function, typer.Typer):
            return get_command(function)
        single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        single.command(cmd_name)(command(function))
        return get_command(single)


app = typer.Typer(
    name="fapengine",
    cls=Commands,
    help="Create talking faces from text, recordings or phone timings.",
    epilog=EXITS,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


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


def main() -> None:
    """Run the command line."""
    atexit.register(gc.freeze)  # or Python searches everything for cycles at its end: a seventh of a short command
    run_to_the_end(app)
