"""Random mutants: what is changed, and the verdict on a change that a test notices and on one that none does."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from design import random_mutants

SOURCE = """from dataclasses import dataclass


@dataclass(slots=True)
class Person:
    age: int


def double(x: int) -> int:
    return x + x


def is_adult(age: int) -> bool:
    return age >= 18
"""
TEST = """from fapengine.tiny.sums import double, is_adult


def test_double() -> None:
    assert double(3) == 6


def test_is_adult() -> None:
    assert is_adult(30) and not is_adult(3)
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A checkout with one package, whose tests do not look at the age of 18 itself."""
    for path, text in {
        "fapengine/__init__.py": "", "fapengine/tiny/__init__.py": "", "fapengine/tiny/sums.py": SOURCE,
        "tests/unit/tiny/test_sums.py": TEST,
    }.items():  # fmt: skip
        (tmp_path / "copy" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "copy" / path).write_text(text)
    return tmp_path / "copy"


def test_mutants_change_one_place_of_a_line(tree: Path) -> None:
    path = tree / "fapengine" / "tiny" / "sums.py"
    found = random_mutants.drawn("tiny", 50, 1, tree)
    changed = {one.applied(path.read_bytes()).decode().splitlines()[one.line - 1].strip() for one in found}
    assert changed == {"return x - x", "return age > 18", "return age >= 19"}
    assert random_mutants.drawn("tiny", 2, 1, tree) == found[:2]


def test_a_mutant_is_killed_or_survives_and_known_survivors_do_not_count(
    tree: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def clone() -> Iterator[Path]:
        yield tree

    monkeypatch.setattr(random_mutants, "clone", clone)
    monkeypatch.setattr(random_mutants, "PACKAGES", ("tiny",))
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # of the others one takes most of the time
    monkeypatch.setenv("PYTEST_PLUGINS", "pytest_cov.plugin")
    monkeypatch.setattr(random_mutants, "known", lambda: {"return age >= 19": "so the test says"})
    monkeypatch.setattr("sys.argv", ["random_mutants", "--json", str(tree.parent / "rows.jsonl")])
    assert random_mutants.main() == 1
    out = capsys.readouterr().out
    assert "survived: fapengine/tiny/sums.py:14: return age > 18\n" in out
    assert "1 of 2 noticed; 1 are equivalent" in out
    rows = map(json.loads, (tree.parent / "rows.jsonl").read_text().splitlines())
    assert sorted(row["verdict"] for row in rows) == ["equivalent", "killed", "survived"]
    assert (tree / "fapengine" / "tiny" / "sums.py").read_text() == SOURCE
