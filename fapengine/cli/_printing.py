"""What commands print: results as text or JSON, and progress on standard error, on a terminal only."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING

import typer

from fapengine.cli._command import flags_of, running, with_flags

if TYPE_CHECKING:
    from rich.console import Console

    from fapengine.models.adapted_head import Nearness

WAITS = {"voice": "speaking", "read": "reading", "plan": "planning"}
"""Stages of a report without a progress bar, and the label of each."""


def print_result(facts: object, *lines: str, as_json: bool, err: bool = False) -> None:
    """Print the facts as JSON, or the lines.

    ``err`` prints to standard error, for when the file itself goes to standard output.
    """
    typer.echo(json.dumps(facts, indent=2, ensure_ascii=False) if as_json else "\n".join(lines), err=err)


def print_remarks(remarks: Iterable[str]) -> None:
    """Print remarks to standard error, with the options that override what was assumed."""
    for remark in remarks:
        typer.echo(f"fapengine: {as_flags(remark)}", err=True)


def as_flags(remark: str) -> str:
    """Replace parameter names by the options of the running command."""
    return with_flags(remark, flags_of(running.get()), names_parameter=False)


def print_rows(rows: Iterable[Sequence[object]], *, err: bool = False) -> None:
    """Print rows of a label, a text and optionally the style of the label."""
    if not _is_terminal(err=err):
        for label, text, *_ in rows:
            typer.echo(f"{label:>14}  {text}", err=err)
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, stderr=err)
    for label, text, *style in rows:
        console.print(Text.assemble((f"{label:>14}", "".join(map(str, style))), f"  {text}"), soft_wrap=True)


def spell_nearness(nearness: "Nearness") -> str:
    """Describe the distance of an adapted head from its scan."""
    before, after = nearness.front_mm
    said = f"front of the face to the scan: {before:.2f} mm before, {after:.2f} mm after"
    if nearness.left_out_mm is None:
        return f"{said}; too few feature points to leave some out"
    before, after = nearness.left_out_mm
    return f"{said}; {nearness.left_out} feature points, left out in turn: {before:.2f} mm before, {after:.2f} mm after"


def _is_terminal(*, err: bool = True) -> bool:
    """Whether a stream is a terminal. rich, which takes 20 ms to import, is needed for terminals alone."""
    stream = sys.stderr if err else sys.stdout
    return stream is not None and stream.isatty()


def _screen() -> "Console":
    from rich.console import Console

    return Console(stderr=True)


@contextmanager
def progress(description: str, total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar; call the yielded function after each step, or with the number of steps."""
    if not _is_terminal():
        yield lambda steps=1: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=_screen(), transient=True) as bar:
        yield partial(bar.advance, bar.add_task(description, total=total))


def working(on_what: str) -> AbstractContextManager[object]:
    """Show a spinner with the elapsed time, for work of unknown length.

    Parameters
    ----------
    on_what : str
        Label, or a stage of :data:`WAITS`; other stages have a progress bar.
    """
    label = WAITS.get(on_what, on_what if " " in on_what else "")
    if not (label and _is_terminal()):
        return nullcontext()
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    spinner = Progress(*columns, console=_screen(), transient=True)
    spinner.add_task(label, total=None)
    return spinner
