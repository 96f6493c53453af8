"""Parts of HTML reports: the page, tables, and figures of matplotlib as SVG."""

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape, unescape
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fapengine._late import missing
from fapengine.errors import ResourceError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, FAINT, WARM, COOL, GREEN = "#20242a", "#a9adb4", "#c8543c", "#2f6aa8", "#3d8b5f"

Grade = Literal["good", "fair", "poor", ""]
"""Grade of a verdict; empty if there is nothing to judge."""


def asset(name: str) -> str:
    """Read a file next to this module, such as a style sheet."""
    return (files("fapengine.files.report") / name).read_text("utf-8")


def page(title: str, parts: Iterable[str]) -> bytes:
    """Join ``parts``, which are HTML, into a page: UTF-8, without external references.

    It fits a phone's screen, where only tables scroll sideways. Links to the second-level headings precede the first.
    """
    head = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
    )
    body, links = "".join(parts), []
    for number, heading in enumerate(re.findall("<h2>(.*?)</h2>", body)):
        links.append(f'<a href="#part{number}">{heading}</a>')
        body = body.replace(f"<h2>{heading}</h2>", f'<h2 id="part{number}">{heading}</h2>', 1)
    contents = f'<nav aria-label="Contents">{" ".join(links)}</nav>' if len(links) > 1 else ""
    body = body.replace('<h2 id="part0">', f'{contents}<h2 id="part0">', 1)
    return f"{head}<style>\n{asset('page.css')}</style><main>{body}</main></html>\n".encode()


def verdict(grade: Grade, text: str) -> str:
    """Format the conclusion of a report, which comes first."""
    return f'<p class="verdict {grade}"><b>{grade.capitalize() or "Not judged"}.</b> {escape(text)}</p>'


def picture(svg: bytes, caption: str) -> str:
    """Embed an SVG drawing; the caption is HTML."""
    drawing = svg[svg.index(b"<svg") :].decode()
    label = escape(unescape(re.sub("<.*?>", "", caption)))
    return f'<figure><div role="img" aria-label="{label}">{drawing}</div><figcaption>{caption}</figcaption></figure>'


def image(png: bytes, caption: str) -> str:
    """Embed a PNG image; the caption is text."""
    data = base64.b64encode(png).decode()
    alt = escape(caption)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{alt}</figcaption></figure>'


def table(header: Sequence[str], rows: Iterable[Sequence[object]], formats: str = "", *, marked: str = "") -> str:
    """Make a table.

    Parameters
    ----------
    header : sequence of str
        Empty strings for a table without a header.
    rows : iterable of sequence
        Values of each row.
    formats : str, optional
        Format of each column's values, separated by spaces; by default all are text.
    marked : str, optional
        The row that begins with this text is highlighted.
    """

    def cell(text: str) -> str:
        is_number = any(header) and text.replace(".", "").replace("-", "").replace(" ", "").isdigit()
        kind = ' class="n"' if is_number else ""
        return f"<td{kind}>{escape(text)}</td>"

    def line(row: Sequence[object]) -> str:
        texts = [format(value, spec) for value, spec in zip(row, formats.split() or ["s"] * len(row), strict=True)]
        mark = ' class="ours"' if marked and texts[0] == marked else ""
        return f"<tr{mark}>{''.join(map(cell, texts))}</tr>"

    top = f"<tr>{''.join(f'<th>{escape(name)}</th>' for name in header)}</tr>" if any(header) else ""
    label = escape(next((name for name in header if name), "") or "Figures")
    inner = f"<table>{top}{''.join(map(line, rows))}</table>"
    return f'<div class="scroll" role="region" tabindex="0" aria-label="{label}">{inner}</div>'


def name_phones(plot: "Axes", phones: Iterable[tuple[str, float, float]], fontsize: int) -> None:
    """Write phones, given by label, start and end in s, along the top of a plot over time."""
    for label, start_s, end_s in phones:
        plot.annotate(
            label, ((start_s + end_s) / 2, 1.0), xycoords=("data", "axes fraction"),
            ha="center", fontsize=fontsize, color=FAINT, annotation_clip=True,
        )  # fmt: skip


def figure_class() -> type["Figure"]:
    """Import matplotlib, or raise ResourceError."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ResourceError(f"{missing('matplotlib', 'figures')}; fit works without it by report=False") from error
    return Figure


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple["Figure", list["Axes"]]:
    """Create a figure, sized in inches, and its plots, row by row.

    Raises
    ------
    ResourceError
        If matplotlib is not installed.
    """
    figure = figure_class()(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for plot in axes.flat:
        plot.spines[["top", "right"]].set_visible(False)
    return figure, list(axes.flat)


def to_svg(figure: "Figure") -> bytes:
    """Convert a figure to SVG; the same figure always gives the same bytes."""
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "fapengine", "font.size": 9}):
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None}, dpi=110)
    return buffer.getvalue()


def to_picture(figure: "Figure") -> NDArray[np.uint8]:
    """Draw a figure as an image, (H, W, 3) uint8."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
    figure.set_dpi(110)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
