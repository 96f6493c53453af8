"""The documentation hangs together: pages, links, pictures, and the cross references of docstrings."""

import ast
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from design import architecture_diagram

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LINK = re.compile(r"""!?\[[^\]]*\]\(([^)\s]+)\)|<video src="([^"]+)\"""")
FENCE = re.compile(r"^```.*?^```$", flags=re.S | re.M)
ROLE = re.compile(r":(class|func|meth|mod|data|attr|exc):`([^`]+)`")
GENERATED = {"reference/cli.md"}
"""Pages that design/site_pages.py makes when the site is built."""
MODULES = sorted((ROOT / "fapengine").rglob("*.py"))
MIN_REFERENCES = 250


def links(page: Path) -> Iterator[str]:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    found = (link or video for link, video in LINK.findall(text))
    yield from (link for link in found if not re.match(r"\w+:", link))


def anchors(page: Path) -> set[str]:
    """Names by which other pages point at headings, as Markdown's ``toc`` makes them."""
    from markdown.extensions.toc import slugify

    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, flags=re.M)
    return {slugify(re.sub(r"[`*]|\]\([^)]*\)", "", title), "-") for title in titles}


def test_every_page_is_in_the_navigation_once() -> None:
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r"([\w/-]+\.md)$", config[config.index("\nnav:") :], flags=re.M)
    pages = {page.relative_to(DOCS).as_posix() for page in PAGES}
    assert sorted(listed) == sorted(pages | GENERATED)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_and_picture_is_there(page: Path) -> None:
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if target.is_relative_to(DOCS) and target.relative_to(DOCS).as_posix() in GENERATED:
            continue
        assert target.exists(), f"{page.name}: {link}"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{page.name}: {link}"


def test_every_picture_is_shown() -> None:
    shown = {Path(link).name for page in [*PAGES, ROOT / "README.md"] for link in links(page)}
    assert {path.name for path in (DOCS / "pictures").iterdir()} <= shown


def test_the_picture_of_the_architecture_shows_the_contracts() -> None:
    made = architecture_diagram.PICTURE.read_text(encoding="utf-8")
    assert made == architecture_diagram.picture(), "run python -m design.architecture_diagram"


def docstrings(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Every docstring, of attributes too, with the name of the class around it."""

    def walk(node: ast.AST, owner: str) -> Iterator[tuple[str, str]]:
        for child in ast.iter_child_nodes(node):
            if (
                isinstance(child, ast.Expr)
                and isinstance(child.value, ast.Constant)
                and isinstance(child.value.value, str)
            ):
                yield owner, child.value.value
            yield from walk(child, child.name if isinstance(child, ast.ClassDef) else owner)

    yield from walk(tree, "")


def resolves(target: str, module: ModuleType, owner: str) -> bool:
    """Whether a name leads somewhere: from its class, its module, or the top."""
    if target.startswith("."):
        package = module.__name__ if hasattr(module, "__path__") else module.__name__.rpartition(".")[0]
        return _from_the_top(f"{package}{target}")
    if owner and _leads(getattr(module, owner, None), target):
        return True
    return _leads(module, target) or _from_the_top(target)


def _leads(value: object, path: str) -> bool:
    for name in path.split("."):
        names = {*getattr(value, "__annotations__", ()), *getattr(value, "__slots__", ())}
        if not hasattr(value, name):
            return name in names
        value = getattr(value, name)
    return True


def _from_the_top(path: str) -> bool:
    names = path.split(".")
    for count in range(len(names), 0, -1):
        try:
            module = importlib.import_module(".".join(names[:count]))
        except ModuleNotFoundError:
            continue
        return count == len(names) or _leads(module, ".".join(names[count:]))
    return False


NEED_FRAMEWORKS = ("fapengine.agents.livekit", "fapengine.agents.pipecat")
"""Prefixes of modules that can be imported only in environments of their own (make oracles)."""


def test_cross_references_of_docstrings_resolve() -> None:
    references, wrong = 0, []
    for path in MODULES:
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        found = [
            (role, target, owner)
            for owner, text in docstrings(ast.parse(path.read_text(encoding="utf-8")))
            for role, target in ROLE.findall(text)
        ]
        references += len(found)
        if not found:
            continue
        if name.startswith(NEED_FRAMEWORKS):
            continue
        module = importlib.import_module(name)
        wrong += [
            f"{path.relative_to(ROOT)}: :{role}:`{target}`"
            for role, target, owner in found
            if not resolves(target.removeprefix("~"), module, owner)
        ]
    assert wrong == []
    assert references >= MIN_REFERENCES


@pytest.mark.nightly
def test_the_site_builds(tmp_path: Path) -> None:
    pytest.importorskip("mkdocstrings")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    command_line = (tmp_path / "site" / "reference" / "cli.html").read_text(encoding="utf-8")
    for command in ("say", "serve", "view", "animate", "render", "fit", "doctor", "head import"):
        assert f"fapengine {command}" in command_line
