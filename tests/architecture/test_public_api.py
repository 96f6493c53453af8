"""The public interface: its names, where they are documented, their signatures, and what importing it costs.

Signatures are compared with ``public_api.txt``. After a change that is meant::

    python tests/architecture/test_public_api.py > tests/architecture/public_api.txt
"""

import ast
import inspect
import re
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import fapengine
from fapengine import lab

ROOT = Path(__file__).resolve().parent.parent.parent
SNAPSHOT = Path(__file__).with_name("public_api.txt")
API_PAGE = ROOT / "docs" / "reference" / "api.md"
HEAVY = ("numpy", "scipy", "moderngl", "sounddevice", "av", "PIL", "aiohttp", "asyncio", "typer")
SPECIAL = ("__init__", "__len__", "__enter__", "__iter__")


def surface() -> str:
    """Every public name with its signature and, of a class, its fields, properties and methods; from the source."""
    values = {name: getattr(fapengine, name) for name in sorted(fapengine.__all__)}
    values |= {f"lab.{name}": getattr(lab, name) for name in sorted(lab.__all__)}
    return "\n".join(line for name, value in values.items() for line in _described(name, value)) + "\n"


def _described(name: str, value: Any) -> Iterator[str]:
    node = _parsed(value)
    if isinstance(node, ast.FunctionDef):
        yield f"def {name}{_signature(node)}"
        return
    assert isinstance(node, ast.ClassDef)
    yield f"class {name}({', '.join(map(ast.unparse, node.bases))})"
    yield from _members(node)
    for base in value.__mro__[1:]:
        if base.__module__.startswith("fapengine") and base.__name__ not in fapengine.__all__:
            yield f"    # of {base.__name__}"
            yield from _members(_parsed(base))


def _parsed(value: Any) -> ast.stmt:
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(value))).body
    return node


def _members(node: ast.ClassDef) -> Iterator[str]:
    for member in node.body:
        if isinstance(member, ast.FunctionDef) and (member.name in SPECIAL or not member.name.startswith("_")):
            kinds = "".join(f"@{ast.unparse(each)} " for each in member.decorator_list)
            yield f"    {kinds}def {member.name}{_signature(member)}"
        elif isinstance(member, ast.AnnAssign | ast.Assign) and not ast.unparse(member).startswith("_"):
            yield f"    {ast.unparse(member)}"


def _signature(node: ast.FunctionDef) -> str:
    result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"({ast.unparse(node.args)}){result}"


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300).stdout


def test_the_interface_is_small_and_sorted() -> None:
    assert 25 <= len(fapengine.__all__) <= 34
    assert fapengine.__all__ == sorted(fapengine.__all__)
    assert len(lab.__all__) <= 26
    assert lab.__all__ == sorted(lab.__all__)


def test_every_name_is_there() -> None:
    for package in (fapengine, lab):
        for name in package.__all__:
            assert getattr(package, name).__doc__, name
    assert set(fapengine.__all__) <= set(dir(fapengine))
    with pytest.raises(AttributeError, match="no attribute 'shout'"):
        _ = fapengine.shout


def test_type_checkers_see_the_same_names_in_the_same_modules() -> None:
    tree = ast.parse(Path(fapengine.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    seen = {
        (node.module, alias.asname or alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {(f"fapengine.{module}", name) for module, names in fapengine._MODULES.items() for name in names}
    assert {name for _, name in seen} == set(fapengine.__all__)


def test_every_name_is_on_the_page_of_the_interface() -> None:
    documented = re.findall(r"^::: fapengine\.([\w.]+)$", API_PAGE.read_text(encoding="utf-8"), flags=re.M)
    assert sorted(documented) == sorted([*fapengine.__all__, *(f"lab.{name}" for name in lab.__all__)])


def test_signatures_are_as_they_were() -> None:
    assert surface() == SNAPSHOT.read_text(encoding="utf-8"), __doc__


def test_importing_it_costs_nothing() -> None:
    loaded = run("import sys, fapengine, json; dir(fapengine); print(*sys.modules)").split()
    assert "fapengine" in loaded
    assert not {name.partition(".")[0] for name in loaded} & set(HEAVY)
    assert not [name for name in loaded if name.startswith("fapengine.")]


def test_a_name_loads_what_it_needs_and_no_more() -> None:
    loaded = run("import sys, fapengine; fapengine.UsageError; print(*sys.modules)").split()
    assert "fapengine.errors" in loaded
    assert "numpy" not in loaded
    loaded = run("import sys, fapengine; fapengine.FapTrack; print(*sys.modules)").split()
    assert not {"moderngl", "av", "fapengine.render"} & set(loaded)


def test_the_floors_in_the_docstring_are_those_that_are_enforced() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    floors = next(c for c in config["tool"]["importlinter"]["contracts"] if c["name"].startswith("Floors"))["layers"]
    rows = re.findall(r"^(\d+) +(``.+?``) {2,}\S", fapengine.__doc__ or "", flags=re.M)
    assert [re.findall(r"``(\w+)``", names) for _, names in rows] == [layer.split(" | ") for layer in floors]
    assert [int(number) for number, _ in rows] == list(range(len(floors)))[::-1]


if __name__ == "__main__":
    print(surface(), end="")
