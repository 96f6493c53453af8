"""What tests must not do, and that their lists are true."""

import ast
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import queues, slow_tests

TESTS = Path(__file__).resolve().parents[1]
FILES = sorted(TESTS.rglob("*.py"))
COSTLY = {"english", "parse_profile", "build_head", "load_head", "load_levels", "load_profile", "plan", "speak"}
"""Functions that build or load heads, profiles and motion, each for a second and more."""


def calls_at_import(node: ast.AST) -> Iterator[str]:
    """Names of the functions that are called when a module is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(child, ast.Call):
            yield getattr(child.func, "id", "")
        yield from calls_at_import(child)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_test_file_builds_heads_or_profiles_when_it_is_imported(path: Path) -> None:
    assert COSTLY.isdisjoint(calls_at_import(ast.parse(path.read_text())))


def test_calls_at_import_are_seen() -> None:
    source = "HEAD = build_head()\nclass A:\n    b = [f(c()) for _ in x]\ndef g():\n    return h()\nl = lambda: i()\n"
    assert set(calls_at_import(ast.parse(source))) == {"build_head", "f", "c"}


def test_slow_tests_are_there() -> None:
    root = TESTS.parent
    for name in slow_tests.listed():
        path, _, function = name.partition("::")
        assert (root / path).exists(), name
        assert not function or f"def {function}(" in (root / path).read_text(), name


def test_no_program_outlives_tests_that_are_killed() -> None:
    code = "import sys, time; from tests.processes import start; "
    code += "print(start([sys.executable, '-c', 'import time; time.sleep(600)']).pid, flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=TESTS.parent) as tests:
        assert tests.stdout is not None
        program = int(tests.stdout.readline())
        os.kill(program, 0)
        tests.send_signal(signal.SIGKILL)
    until_s = time.monotonic() + 300
    while Path(f"/proc/{program}/stat").exists() and "Z" not in Path(f"/proc/{program}/stat").read_text().split()[2]:
        assert time.monotonic() < until_s, "the program runs on"
        time.sleep(0.02)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_programs_that_run_on_are_started_in_one_way(path: Path) -> None:
    if path.name not in ("processes.py", Path(__file__).name):
        assert "subprocess.Popen(" not in path.read_text(), "use tests.processes.start: it ends with the tests"


def test_the_queues_are_of_files_that_are_there() -> None:
    names = [str(path.relative_to(TESTS.parent)) for path in FILES]
    assert all(any(name.startswith(start) for name in names) for start in queues.WAITS)
    assert set(queues.listed_times(queues.LIST)) <= set(names)


def test_each_worker_takes_the_longest_file_of_its_queue_and_then_of_the_other() -> None:
    left = dict.fromkeys(["tests/unit/a.py", "tests/live/b.py", "tests/unit/c.py", "tests/live/d.py"])
    times_s = {"tests/unit/c.py": 9.0, "tests/live/d.py": 5.0}
    taken = []
    while left:
        taken.append(queues.next_file(left, times_s, computes=True))
        del left[taken[-1]]
    assert taken == ["tests/unit/c.py", "tests/unit/a.py", "tests/live/d.py", "tests/live/b.py"]
    assert queues.next_file(dict.fromkeys(taken), times_s, computes=False) == "tests/live/d.py"
