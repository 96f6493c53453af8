"""Progress bars and spinners on standard error, on a terminal only."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

WAITS = {"voice": "speaking", "read": "reading", "plan": "planning"}
"""Stages of a report without a progress bar, and the label of each."""


class Advance:
    """One progress bar; a call advances it. Stateful."""

    def __init__(self, progress: Progress, total: int, description: str) -> None:
        self._progress, self._task = progress, progress.add_task(description, total=total)

    def __call__(self, steps: float = 1) -> None:
        self._progress.advance(self._task, steps)


@contextmanager
def progress(description: str, total: int) -> Iterator[Advance]:
    """Show a progress bar, on a terminal only; call the yielded object after each step."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield Advance(bar, total, description)


@contextmanager
def working(on_what: str) -> Iterator[None]:
    """Show a spinner with the elapsed time, on a terminal only, for work of unknown length.

    Parameters
    ----------
    on_what : str
        Label, or a stage of :data:`WAITS`; other stages have a progress bar.
    """
    console = Console(stderr=True)
    told = WAITS.get(on_what, on_what if " " in on_what else "")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not (told and console.is_terminal)) as bar:
        bar.add_task(told, total=None)
        yield
