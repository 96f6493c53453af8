"""Make the tables of commands in docs/osc.md and docs/page.md from the list of commands.

``python -m design.command_tables`` writes them anew between their markers.
"""

from pathlib import Path

from fapengine.engine import commands
from fapengine.engine.command_table import Choice, Command, FieldSpec, defaults_of, fields_of
from fapengine.wire.speech_osc import codec

DOCS = Path(__file__).resolve().parents[1] / "docs"
UNITS = {"rad": "rad", "s": "s"}


def osc_table() -> str:
    """Rows of docs/osc.md: commands whose messages carry their fields and nothing else."""
    lines = ["| command | types | arguments | meaning |", "|---|---|---|---|"]
    return "\n".join([*lines, *(_osc_row(kind) for kind in commands.COMMANDS if kind.SPEC.is_direct)])


def json_table() -> str:
    """Rows of docs/page.md: commands that a page may send."""
    lines = ["| command | fields | meaning |", "|---|---|---|"]
    return "\n".join([*lines, *(_json_row(kind) for kind in commands.COMMANDS if kind.SPEC.json)])


def _osc_row(kind: type[Command]) -> str:
    layout = codec.layout(kind)
    needed, others = layout.tags[: layout.required], layout.tags[layout.required :]
    types = f"{needed}[{others}]" if others else needed
    notes = [f"{spec.osc} {spec.doc}" for spec in fields_of(kind).values() if spec.osc and spec.doc]
    meaning = ": ".join([kind.SPEC.doc, "; ".join(notes)] if notes else [kind.SPEC.doc])
    return f"| `{layout.address}` | `{types}` | {', '.join(layout.names)} | {meaning} |"


def _json_row(kind: type[Command]) -> str:
    specs = [(name, spec) for name, spec in fields_of(kind).items() if spec.json]
    described = "; ".join(_json_field(name, spec, name in defaults_of(kind)) for name, spec in specs)
    return f"| `{kind.SPEC.json}` | {described} | {kind.SPEC.doc} |"


def _json_field(name: str, spec: FieldSpec, is_optional: bool) -> str:
    unit = UNITS.get(name.rpartition("_")[2], "")
    if isinstance(spec, Choice):
        values = ", ".join(spec.values)
    elif spec.high > 1e6:
        values = unit
    else:
        values = f"{unit} {spec.low:g} to {spec.high:g}".strip()
    doc = "" if isinstance(spec, Choice) else spec.doc
    words = ", ".join(part for part in (values, doc) if part)
    field = f"[`{spec.json}`]" if is_optional else f"`{spec.json}`"
    return f"{field} ({words})" if words else field


PAGES = {"osc.md": osc_table, "page.md": json_table}


def page(name: str) -> str:
    """Text of a page with its table made anew."""
    text = (DOCS / name).read_text(encoding="utf-8")
    start, stop = "<!-- commands: made by python -m design.command_tables -->\n", "\n<!-- end of commands -->"
    head, rest = text.split(start)
    _, tail = rest.split(stop)
    return f"{head}{start}{PAGES[name]()}{stop}{tail}"


if __name__ == "__main__":
    for name in PAGES:
        (DOCS / name).write_text(page(name), encoding="utf-8")
