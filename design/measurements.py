"""docs/measurements.md, made from the figures in design/measured/*.toml.

Run ``python -m design.measurements`` after a change of a file there. Each file is a list of ``[[section]]``:

- ``title``, and ``level`` 2 (the default) or 3;
- ``text``, Markdown;
- ``commands``: what measures the figures again; every section with figures names one;
- ``table``: rows of cells, the first one its header;
- ``picture``: a file of docs/pictures, and what it shows.

``python -m bench.render --page`` writes drawing.toml and ``python -m design.rate_tables`` rate.toml; the others are
written by hand from what their commands print.
"""

import json
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "design" / "measured"
PAGE = ROOT / "docs" / "measurements.md"
ORDER = ("motion", "speech", "face", "formats", "live", "drawing", "gpu", "rate", "budgets")
"""Files in the order of the page."""
KEYS = {"title", "level", "text", "commands", "table", "picture"}

HEAD = """<!-- Made by python -m design.measurements from design/measured; do not edit. -->
# Measurements

Every figure names the command that measures it again. Some commands need recorded data that may not be passed on;
`tests/README.md` in the repository says which, and what a clone can show without them.

Seconds depend on the machine, here two shared cores of an EPYC without a GPU unless stated otherwise. Ratios,
distances and correlations do not. *r* is a correlation. The *opening* is the distance between the inner lips.
"""


def sections(name: str) -> list[dict[str, Any]]:
    """Sections of one file, checked."""
    data = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    if data.keys() != {"section"}:
        raise ValueError(f"{name}.toml: expected only [[section]], got {sorted(data)}")
    for section in data["section"]:
        if not {"title"} <= section.keys() <= KEYS:
            raise ValueError(f"{name}.toml, {section.get('title')}: got {sorted(section)}, expected some of {KEYS}")
        if "table" in section and len({len(row) for row in section["table"]}) != 1:
            raise ValueError(f"{name}.toml, {section['title']}: rows of different lengths")
    return list(data["section"])


def markdown(section: dict[str, Any]) -> str:
    """One section of the page.

    >>> print(markdown({"title": "Speed", "commands": ["python -m bench.say"], "table": [["", "s"], ["first", "1"]]}))
    ## Speed
    <BLANKLINE>
    |  | s |
    |---|---|
    | first | 1 |
    <BLANKLINE>
    Command: `python -m bench.say`.
    """
    parts = [f"{'#' * section.get('level', 2)} {section['title']}"]
    if "text" in section:
        parts.append(section["text"].strip())
    if "picture" in section:
        file, shows = section["picture"]
        parts.append(f"![{shows}](pictures/{file})")
    if "table" in section:
        head, *rows = (f"| {' | '.join(row)} |" for row in section["table"])
        parts.append("\n".join([head, "|" + "---|" * len(section["table"][0]), *rows]))
    if "commands" in section:
        commands = ", ".join(f"`{command}`" for command in section["commands"])
        parts.append(f"Command{'s' if len(section['commands']) > 1 else ''}: {commands}.")
    return "\n\n".join(parts)


def page() -> str:
    """Text of the page."""
    return HEAD + "".join(f"\n{markdown(section)}\n" for name in ORDER for section in sections(name))


def write_sections(name: str, made: list[dict[str, Any]]) -> None:
    """Write a file of sections, for programs that measure."""
    lines = ["# Made by a program, see design/measurements.py; do not edit.\n"]
    for section in made:
        lines.append("\n[[section]]\n")
        for key, value in section.items():
            if key == "table":
                rows = "".join(f"    {json.dumps(row, ensure_ascii=False)},\n" for row in value)
                lines.append(f"table = [\n{rows}]\n")
            else:
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}\n")
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{name}.toml").write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"{PAGE.name}: {sum(len(sections(name)) for name in ORDER)} sections")
