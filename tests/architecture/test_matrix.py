"""The hundred items of the papers and the standard, and the attacks: each row names something that exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "design" / "matrix.md").read_text(encoding="utf-8")
ATTACKS = (ROOT / "design" / "attacks.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")] for line in TEXT.splitlines() if re.match(r"\| \d", line)
]
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")


def test_a_hundred_rows_have_a_grade_each():
    assert [int(row[0]) for row in ROWS] == list(range(1, 101))
    assert all(len(row) == 4 for row in ROWS)
    assert {re.split(r"[:;]", row[3])[0] for row in ROWS} <= {"whole", "thin", "missing", "wrong"}
    assert all(row[3].startswith("whole") or ": " in row[3] for row in ROWS)  # the others say why


def test_every_row_is_shown_by_a_command_a_test_or_the_report():
    assert [row[0] for row in ROWS if not re.search(r"`|report", row[2])] == []


def test_every_attack_has_a_test_and_figures():
    rows = [line.strip("| ").split(" | ") for line in ATTACKS.splitlines() if re.match(r"\| \d", line)]
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1))
    assert [row[0] for row in rows if len(row) != 6 or not TEST.search(row[2])] == []


@pytest.mark.parametrize(("text", "fewest"), [(TEXT, 50), (ATTACKS, 33)], ids=["matrix", "attacks"])
def test_tests_that_are_named_exist(text: str, fewest: int):
    named = TEST.findall(text)
    assert len(named) >= fewest
    for path, function in named:
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not function or function in functions, f"{path}::{function}"
