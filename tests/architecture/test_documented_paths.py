"""What the documentation names is there: files, modules, commands with their options, extras, metrics."""

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer

from design.docs_size import pages
from fapengine.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
TEXTS = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (
        *pages(),
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "tests/README.md")),
        *(ROOT / "design" / name for name in ("attacks.md", "decisions.md", "matrix.md", "tried.md")),
        ROOT / "fapengine-face" / "README.md",
    )
}
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith(".")} - {"out"}
PACKAGES = {path.name for path in (ROOT / "fapengine").iterdir() if path.is_dir()}
COUNTED = [
    text
    for path in (ROOT / "fapengine").rglob("*.py")
    if "fapengine._counters import" in (text := path.read_text(encoding="utf-8"))
]
"""Modules that define metrics."""
PATH = re.compile(r"`([\w.-]+(?:/[\w.*-]+)+/?)(?:::\w+)?`")
CODE = re.compile(r"`([^`\n]+)`")
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", flags=re.S | re.M)
DOTTED = re.compile(r"\bfapengine(?:\.[a-z_]\w*)+")
INSTALLED = re.compile(r"pip install ([^`\n#]+)")


def commands(text: str) -> list[str]:
    """Lines that a reader would type."""
    blocks = [code.replace("\\\n", " ") for kind, code in FENCE.findall(text) if kind in ("", "sh", "text")]
    lines = [line for block in blocks for line in block.splitlines()]
    return [*lines, *CODE.findall(FENCE.sub("", text))]


@pytest.mark.parametrize("name", TEXTS)
def test_files_that_are_named_exist(name: str) -> None:
    for found in PATH.findall(TEXTS[name]):
        first = found.split("/")[0]
        if first in FOLDERS:
            places = [ROOT / found]
        elif first in PACKAGES and found.endswith(".py"):
            places = [ROOT / "fapengine" / found]
        else:
            continue
        assert any(list(place.parent.glob(place.name)) for place in places), f"{name}: {found}"


@pytest.mark.parametrize("name", TEXTS)
def test_modules_that_are_named_exist(name: str) -> None:
    for dotted in DOTTED.findall(TEXTS[name]):
        parts = dotted.split(".")
        for count in range(len(parts), 0, -1):
            place = ROOT.joinpath(*parts[:count])
            if place.is_dir() or place.with_suffix(".py").exists():
                break
        source = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        rest = parts[count:]
        assert not rest or re.search(rf"\b{rest[0]}\b", source.read_text(encoding="utf-8")), f"{name}: {dotted}"


def _command(words: list[str]) -> tuple[str, set[str]] | None:
    """Name and options of the command that a line calls; None where it calls none."""
    command: Any = typer.main.get_command(app).get_command(None, words[0])  # type: ignore[attr-defined]
    called = words[0]
    if command is not None and len(words) > 1 and words[1] in getattr(command, "commands", {}):
        command, called = command.commands[words[1]], f"{called} {words[1]}"
    if command is None:
        return None
    return called, {"--help"} | {name for each in command.params for name in (*each.opts, *each.secondary_opts)}


@pytest.mark.parametrize("name", TEXTS)
def test_commands_are_valid(name: str) -> None:
    for line in commands(TEXTS[name]):
        if not line.startswith("fapengine ") or "…" in line:
            continue
        words = shlex.split(line, comments=True)[1:]
        if not words or words[0].isupper():  # fapengine COMMAND --help
            continue
        found = _command(words)
        if found is None:
            assert words[0].startswith("-") or "/" in words[0], f"{name}: no command in {line!r}"
            continue
        called, options = found
        for word in words:
            option = word.split("=")[0]
            if re.fullmatch(r"--?[a-zA-Z][\w-]*", option):
                assert option in options, f"{name}: {called} has no {option}"


OF_OTHER_PROGRAMS = re.compile(r"python -m (?:bench|design|tests)|dask|espeak-ng|apt-get|pip install")


def _options(command: Any) -> set[str]:
    """Options of a command and its subcommands."""
    own = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    return own.union(*(_options(each) for each in getattr(command, "commands", {}).values()), {"--help"})


@pytest.mark.parametrize("name", TEXTS)
def test_options_that_are_named_exist(name: str) -> None:
    root: Any = typer.main.get_command(app)
    known = _options(root).union(*(_options(root.get_command(None, each)) for each in root.list_commands(None)))
    for code in CODE.findall(FENCE.sub("", TEXTS[name])):
        if not OF_OTHER_PROGRAMS.search(code):
            named = set(re.findall(r"(?<![\w-])--[a-z][\w-]+", code))
            assert named <= known | {"--pho", "--bless", "--keep"}, f"{name}: {code}"


@pytest.mark.parametrize("name", TEXTS)
def test_what_pip_installs_can_be_installed_from_a_checkout(name: str) -> None:
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    for wanted in INSTALLED.findall(TEXTS[name]):
        assert "fapengine" not in re.sub(r"/path/to/fapengine", "", wanted), f"{name}: not published: {wanted}"
        for group in re.findall(r"\[([\w,.-]+)\]", wanted):
            assert set(group.split(",")) <= extras | {"..."}, f"{name}: {wanted}"


def test_something_was_looked_at() -> None:
    found = [path for text in TEXTS.values() for path in PATH.findall(text)]
    called = [line for text in TEXTS.values() for line in commands(text) if line.startswith("fapengine ")]
    assert len(found) > 100
    assert len(called) > 100


@pytest.mark.parametrize("name", TEXTS)
def test_metrics_that_are_named_are_counted(name: str) -> None:
    for metric in re.findall(r"`fapengine_(\w+?)(?:_total)?(?:\{[^`]*)?`", TEXTS[name]):
        named = re.compile(rf"[\"'](?:fapengine_)?{metric}(?:_total)?[\"']")
        assert any(map(named.search, COUNTED)), f"{name}: fapengine_{metric}"
