"""Each promise of the threat model names a test, and that test is there."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "SECURITY.md"


def promises() -> list[tuple[str, list[str]]]:
    """Each promise, and the names of its tests."""
    table = PAGE.read_text(encoding="utf-8").split("<!-- promises -->")[1].split("<!-- end of promises -->")[0]
    rows = [line.strip("| ").split(" | ") for line in table.strip().splitlines()[2:]]
    return [(promise, re.findall(r"`(tests/[^`]+)`", tests)) for promise, tests in rows]


def test_every_promise_has_tests_that_are_there() -> None:
    found = promises()
    assert len(found) >= 15
    for promise, names in found:
        assert names, promise
        for name in names:
            path, _, function = name.partition("::")
            tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
            functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            wanted = {function} if function else {one for one in functions if one.startswith("test_")}
            assert wanted, name
            assert wanted <= functions, name
