"""Texts that people read: help, error messages, the example of a configuration, names of metrics.

They stand in ``texts/`` as they are said, so that a change of words is a diff that can be read. The command lines of
``errors.txt`` (``$ say``) are read from that file; what follows each is its exit code and what it says.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from tests.snapshots import _live
from tests.snapshots.run import run

FOLDER = Path(__file__).with_name("texts")
ERRORS = FOLDER / "errors.txt"
PRINTED, KEYS = "printed.txt", "json-keys.txt"
"""Words that jobs print, and keys of their results in JSON: in sections, one a job."""


def lines(text: str) -> list[str]:
    """Leave the frames around tables out, and columns that are as wide as the terminal."""
    text = re.sub(r"python -m [\w.]*fapengine", "fapengine", text)
    text = re.sub(r"[─│╭╮╰╯]", " ", text)
    found = (re.sub(r" {2,}", "   ", line.strip()) for line in text.splitlines())
    return [line for line in found if line]


def helps(folder: Path) -> dict[str, str]:
    """Help of every command, by the file of ``texts/help`` that holds it."""
    found: dict[str, str] = {}
    waiting = [""]
    while waiting:
        command = waiting.pop(0)
        said = lines(run(f"{command} --help", folder).out.decode())
        found[f"help/{command.replace(' ', '-') or 'fapengine'}.txt"] = "\n".join(said) + "\n"
        if "Commands" in said:
            waiting += [f"{command} {line.split()[0]}".strip() for line in _rows(said)]
    return found


def _rows(said: list[str]) -> list[str]:
    """Lines of the table of commands."""
    rest = said[said.index("Commands") + 1 :]
    return [line for line in rest if re.match(r"[a-z]+ {3}", line)]


def errors(inputs: Path, folder: Path) -> str:
    """Run every command line of ``errors.txt`` in a folder with nothing but inputs; spell the file anew."""
    commands = [line[2:] for line in ERRORS.read_text(encoding="utf-8").splitlines() if line.startswith("$ ")]
    blocks = []
    for number, command in enumerate(commands):
        own = folder / str(number)
        own.mkdir()
        (own / "in").symlink_to(inputs)
        ran = run(command, own)
        words = " / ".join(lines(ran.err)).replace(str(inputs.resolve()), "in").replace(str(own.resolve()), "FOLDER")
        blocks.append(f"$ {command}\n{ran.code}   {words}\n")
    return "".join(blocks)


def all_texts(inputs: Path, folder: Path) -> Mapping[str, str]:
    """Every text by its file; ``folder`` is a new one."""
    return {
        **helps(folder), "errors.txt": errors(inputs, folder), "serve.toml": _live.config_example(),
        "metrics.txt": _live.metric_names(),
    }  # fmt: skip


def kept(name: str) -> str:
    """Give the text as it is kept; empty, where it is not."""
    path = FOLDER / name
    return path.read_text(encoding="utf-8") if path.exists() else ""


def keep(name: str, text: str) -> None:
    """Replace a text."""
    (FOLDER / name).parent.mkdir(exist_ok=True)
    (FOLDER / name).write_text(text, encoding="utf-8")


def joined(sections: Mapping[str, str]) -> str:
    """Spell a file of sections: ``== name`` and what belongs to it, or ``as`` and the first that has the same."""
    first: dict[str, str] = {}
    blocks = [
        f"== {name}\n{text if first.setdefault(text, name) == name else f'as {first[text]}'}\n"
        for name, text in sections.items()
        if text
    ]
    return "".join(blocks)


def sections_of(text: str) -> dict[str, str]:
    """Read it again."""
    found: dict[str, list[str]] = {}
    lines_of: list[str] = []
    for line in text.splitlines():
        if line.startswith("== "):
            lines_of = found.setdefault(line[3:], [])
        else:
            lines_of.append(line)
    sections = {name: "\n".join(rows) for name, rows in found.items()}
    return {name: sections.get(text.removeprefix("as "), text) for name, text in sections.items()}
