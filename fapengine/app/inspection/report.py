"""The parts of a report: a kind of file, its source, and what was found: values, lines, tables and a plot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UnsupportedError
from fapengine.files.paths import read_bytes
from fapengine.files.pictures import Picture, bar_chart
from fapengine.mpeg4.track import FapTrack

BARS = 120
"""Pieces of time of a plot."""


@dataclass(frozen=True)
class Source:
    """A file, a folder, or the name of a profile or a head; with options of phone timings."""

    path: Path
    format: str | None = None
    tier: str | None = None
    alphabet: str | None = None
    columns: str | None = None

    @cached_property
    def data(self) -> bytes:
        """Its bytes. Raises UsageError if it is not a file that can be read."""
        return read_bytes(self.path)

    @property
    def ending(self) -> str:
        """Ending of the name, in lower case."""
        return self.path.suffix.lower()


class Markup(str):
    """A text with rich markup; other texts are printed unchanged."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of which the first are shown, or all."""

    rows: Sequence[Sequence[str] | str]
    """Cells; or lines, if there are no columns."""
    columns: tuple[str, ...] = ()
    right: int = 0
    """Number of columns, from the left, that are aligned to the right."""
    styles: Sequence[str] = ()
    """Style of each row; empty for none."""
    shown: int | None = None
    """Number of rows that are shown without ``--all``."""
    more: str = "... and {} more: --all shows them"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Description of a file."""

    facts: dict[str, Any]
    """Plain values, for JSON."""
    text: Sequence[str | Table]
    plot: Callable[[], Picture] | str
    """Draws a plot; or the reason why there is none."""
    sliders: Callable[[], bytes] | None = None
    """Makes a page with a slider for each component of a profile."""
    pose: Callable[[str], FapTrack] | None = None
    """Makes one frame of FAPs from weights of a profile's components, as that page spells them."""
    warnings: Sequence[str] = ()

    def draw(self, path: Path) -> Picture:
        """Draw the plot. Raises UnsupportedError if there is nothing to draw."""
        if isinstance(self.plot, str):
            raise UnsupportedError(f"{path}: {self.plot}")
        return self.plot()


@dataclass(frozen=True, slots=True, kw_only=True)
class FileKind:
    """A kind of file: how it is recognized and described."""

    name: str
    """Its name in help and errors."""
    fits: Callable[[Source], bool]
    describe: Callable[[Source], Report]
    endings: tuple[str, ...] = field(default=())
    """Usual endings, for the help."""


def level_bars(values: NDArray[np.generic], title: str, seconds: float) -> Picture:
    """Draw the peak of each part of a signal, (N,) of any number type."""
    highest = [float(piece.max()) for piece in np.array_split(values, min(BARS, len(values)))]
    return bar_chart(highest, title=title, marked=[False] * len(highest), first="0.00 s", last=f"{seconds:.2f} s")
