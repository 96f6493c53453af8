"""Names and docstrings: how bounds are named, which packages may name command-line options, and where array shapes are
documented. Packages that are exempt from a rule are listed with it."""

import ast
import itertools
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "fapengine"
BOUND = re.compile(
    r"(^|_)(MOST|LEAST|FASTEST|SLOWEST|LONGEST|SHORTEST|FARTHEST|NEAREST|LARGEST|SMALLEST|HIGHEST|LOWEST|FEWEST)(_|$)"
)
OPTION = re.compile(r"(?<![\w-])(?<!espeak-ng )--[a-z][a-z-]+")
"""An option of ours; espeak-ng has some of its own."""
ARRAY = re.compile(r"\b(NDArray|ArrayLike|Array|Faps|Points|Indices)\b")
SHAPE = re.compile(r"\([^)]*(\b[A-Z]\b|\.\.\.|\d+)[^)]*\)|[Ss]hape|[Ss]ee :|Like :|as :")
"""A shape in brackets, or a reference to where it stands."""
Found = Iterator[tuple[int, str]]
"""Line and text of each offence."""


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def bodies(tree: ast.AST) -> Iterator[list[ast.stmt]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef):
            yield node.body


def bounds(tree: ast.AST) -> Found:
    """Constants that bound something and do not begin with MAX or MIN."""
    for body in bodies(tree):
        for statement in body:
            targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
            for name in (
                node.id for target in targets if target for node in ast.walk(target) if isinstance(node, ast.Name)
            ):
                if name.isupper() and BOUND.search(name):
                    yield statement.lineno, name


def options(tree: ast.AST) -> Found:
    """Options of the command line in any text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and OPTION.search(node.value):
            yield node.lineno, node.value


def shapeless(tree: ast.AST) -> Found:
    """Public functions that take or return an array and say of none what shape it has."""
    public = [tree.body] if isinstance(tree, ast.Module) else []
    public += [node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    for node in itertools.chain.from_iterable(public):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_"):
            arguments = [argument.annotation for argument in (*node.args.args, *node.args.kwonlyargs)]
            types = [ast.unparse(annotation) for annotation in (*arguments, node.returns) if annotation]
            text = ast.get_docstring(node) or ""
            if any(map(ARRAY.search, types)) and not SHAPE.search(text):
                yield node.lineno, f"{node.name}: {text}"


RULES: dict[Callable[[ast.AST], Found], tuple[str, ...]] = {
    bounds: (),
    options: (
        "cli",
        "conformance",
        "app/fit.py",
        "app/hearing.py",
        "app/inspection",
        "agents/livekit",
        "files/report/sliders.py",
    ),
    shapeless: (),
}
"""Rooms where a rule does not hold: options of the command line have their home there."""


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_words(rule: Callable[[ast.AST], Found]) -> None:
    read = 0
    offences = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith(RULES[rule]):
            read += 1
            for line, text in rule(tree_of(path)):
                offences.append(f"fapengine/{name}:{line}: {text.splitlines()[0]}")
    assert read > 0
    assert offences == []
