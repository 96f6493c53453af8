"""Bars and spinners on standard error, on a terminal only: what a user waits for, and for how long."""

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
"""Stages of a report that show no bar of their own, and what a user is told of each."""


class Advance:
    """One progress bar; a call moves it on. Stateful."""

    def __init__(self, progress: Progress, total: int, description: str) -> None:
        self._progress, self._task = progress, progress.add_task(description, total=total)

    def __call__(self, steps: float = 1) -> None:
        self._progress.advance(self._task, steps)


@contextmanager
def progress(description: str, total: int) -> Iterator[Advance]:
    """Show a progress bar, on a terminal only; what it gives is called after each step."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield Advance(bar, total, description)


@contextmanager
def working(on_what: str) -> Iterator[None]:
    """Show that work goes on, and for how long, on a terminal only: for work whose length nobody knows before.

    Parameters
    ----------
    on_what : str
        What is done, or the name of a stage of :data:`WAITS`; other stages show a bar of their own.
    """
    console = Console(stderr=True)
    told = WAITS.get(on_what, on_what if " " in on_what else "")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not (told and console.is_terminal)) as bar:
        bar.add_task(told, total=None)
        yield
