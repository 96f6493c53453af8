"""What every report is put together from: a page, tables, figures of matplotlib as SVG."""

import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from fapengine.errors import ResourceError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, FAINT, WARM, COOL, GREEN = "#20242a", "#a9adb4", "#c8543c", "#2f6aa8", "#3d8b5f"

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #20242a; background: #faf9f6; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.7rem; margin-bottom: .2rem } h2 { margin-top: 2.4rem; border-bottom: 1px solid #ddd }
table { border-collapse: collapse; font-size: .9rem; margin: .6rem 0 }
td, th { padding: .15rem .7rem; text-align: left }
tr:nth-child(even) { background: #f0efea } th { border-bottom: 1px solid #bbb } td.n { text-align: right }
.warn { background: #fdf1e3; border-left: 4px solid #c8843c; padding: .5rem 1rem } figure { margin: 1rem 0 }
figcaption { color: #70757d; font-size: .88rem } svg { max-width: 100%; height: auto } .note { color: #70757d }
"""


def page(title: str, parts: Iterable[str]) -> bytes:
    """Make a page: UTF-8 HTML without any reference outside of it; ``parts`` are HTML."""
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
    return f"{head}<style>{STYLE}</style>{''.join(parts)}</html>\n".encode()


def picture(svg: bytes, caption: str) -> str:
    """Put a drawing into a page, with its caption as HTML."""
    drawing = svg[svg.index(b"<svg") :].decode()
    return f"<figure>{drawing}<figcaption>{caption}</figcaption></figure>"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Make a table of plain text; a header of empty strings is none."""

    def cell(value: str) -> str:
        number = any(header) and value.replace(".", "").replace("-", "").replace(" ", "").isdigit()
        return f'<td class="n">{escape(value)}</td>' if number else f"<td>{escape(value)}</td>"

    top = "".join(f"<th>{escape(name)}</th>" for name in header) if any(header) else ""
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
    return f"<table>{f'<tr>{top}</tr>' if top else ''}{body}</table>"


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple["Figure", list["Axes"]]:
    """Make a figure of so many inches and its plots, row by row.

    Raises
    ------
    ResourceError
        If matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ResourceError('the report needs matplotlib: pip install "fapengine[lab]", or report=False') from error
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for plot in axes.flat:
        plot.spines[["top", "right"]].set_visible(False)
    return figure, list(axes.flat)


def to_svg(figure: "Figure") -> bytes:
    """Draw a figure as SVG, always the same bytes for the same figure."""
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "fapengine", "font.size": 9}):
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None}, dpi=110)
    return buffer.getvalue()
