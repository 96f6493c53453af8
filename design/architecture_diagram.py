"""docs/pictures/architecture.svg: the layers and packages that the import contracts in pyproject.toml enforce.

python -m design.architecture_diagram
"""

import ast
import re
import textwrap
import tomllib
from html import escape
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
WIDTH, MARGIN = 960, 20
FLOOR_HEIGHT, LINE_HEIGHT, GAP = 44, 15, 8
LETTER = 6.4
"""Mean width of a letter of the notes, px."""
EDGE, CORE, ROOM, CORE_ROOM = "#f2c493", "#a9cfe8", "#ffffff", "#d6e9f5"
INK, SOFT = "#1b2730", "#5b6a75"


def contracts() -> list[dict[str, Any]]:
    """Read the contracts of import-linter from pyproject.toml."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        found: list[dict[str, Any]] = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    return found


def layers_of(container: str) -> list[list[str]]:
    """List the layers of a package from the top down; packages of one layer do not know each other."""
    (contract,) = [entry for entry in contracts() if container in entry.get("containers", ())]
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def rooms() -> dict[str, list[str]]:
    """List the rooms, from the top down, by the package that has them."""
    containers = [name for entry in contracts() for name in entry.get("containers", ()) if name != "fapengine"]
    return {
        name.split(".")[1]: [room for layer in layers_of(name) for room in layer if is_folder(name, room)]
        for name in containers
    }


def is_folder(package: str, room: str) -> bool:
    """Tell whether a room is a folder; modules that contracts name are too many to be drawn."""
    return (ROOT / package.replace(".", "/") / room).is_dir()


def core() -> set[str]:
    """List the packages that know no files, sockets, clocks, chance or devices."""
    (contract,) = [entry for entry in contracts() if entry["name"].startswith("The core knows")]
    return {name.removeprefix("fapengine.") for name in contract["source_modules"]}


def purpose(package: str) -> str:
    """Return the first line of the package's docstring."""
    path = ROOT / "fapengine" / package
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    first = (ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or "").split("\n")[0]
    return re.sub(r":\w+:`~?([^`]+)`|``([^`]+)``", r"\1\2", first).rstrip(".")


def picture() -> str:
    """Draw all floors, the top one first."""
    floors, inside, pure = layers_of("fapengine"), rooms(), core()
    shapes, y = [], 64
    for floor in floors:
        tall = any(name in inside for name in floor)
        width = (WIDTH - 2 * MARGIN - GAP * (len(floor) - 1)) / len(floor)
        lines = max(len(_wrapped(purpose(name), width)) for name in floor)
        height = FLOOR_HEIGHT + LINE_HEIGHT * (lines - 1) + (30 if tall else 0)
        for column, name in enumerate(floor):
            x = MARGIN + column * (width + GAP)
            shapes += _package(x, y, width, height, name, CORE if name in pure else EDGE, inside.get(name, []))
        y += height + GAP
    return _document(y + 12, shapes)


def _package(x: float, y: float, width: float, height: float, name: str, colour: str, inside: list[str]) -> list[str]:
    shapes = [
        f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{height}" rx="6" fill="{colour}"/>',
        f'<text x="{x + 12:.1f}" y="{y + 19}" class="name">{name}</text>',
    ]
    for line, text in enumerate(_wrapped(purpose(name), width)):
        shapes.append(f'<text x="{x + 12:.1f}" y="{y + 35 + LINE_HEIGHT * line}" class="note">{escape(text)}</text>')
    if inside:
        spare = (width - 24 - 5 * (len(inside) - 1) - LETTER * sum(map(len, inside))) / len(inside)
        left, top = x + 12, y + height - 31
        for room in inside:
            room_width = spare + LETTER * len(room)
            shapes += [
                f'<rect x="{left:.1f}" y="{top}" width="{room_width:.1f}" height="23" rx="4" fill="{ROOM}"/>',
                f'<text x="{left + room_width / 2:.1f}" y="{top + 16}" class="room">{room}</text>',
            ]
            left += room_width + 5
    return shapes


def _wrapped(text: str, width: float) -> list[str]:
    """Break a text into lines that fit into a box."""
    return textwrap.wrap(text, int((width - 24) / LETTER))


def _document(height: float, shapes: list[str]) -> str:
    legend = [
        f'<rect x="{MARGIN}" y="16" width="14" height="14" rx="3" fill="{EDGE}"/>',
        f'<text x="{MARGIN + 22}" y="28" class="note">may use files, sockets, clocks and devices</text>',
        f'<rect x="{MARGIN + 300}" y="16" width="14" height="14" rx="3" fill="{CORE}"/>',
        f'<text x="{MARGIN + 322}" y="28" class="note">pure: values in, values out</text>',
        f'<text x="{MARGIN}" y="50" class="note">A package imports only from lower layers. Packages side by side do '
        "not import each other. Small boxes: sub-packages, the upper layer first.</text>",
    ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" font-family="sans-serif">',
            "<!-- Made by python -m design.architecture_diagram from the contracts in pyproject.toml. -->",
            f"<style>.name{{font-size:15px;font-weight:600;fill:{INK}}}.note{{font-size:11.5px;fill:{SOFT}}}"
            f".room{{font-size:11px;fill:{INK};text-anchor:middle}}</style>",
            f'<rect width="{WIDTH}" height="{height:g}" fill="white"/>',
            *legend,
            *shapes,
            "</svg>\n",
        ]
    )


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
