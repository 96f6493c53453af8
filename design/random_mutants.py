"""Random small mistakes, and whether the unit tests of their own package notice them.

    python -m design.random_mutants [--seed 1] [--each 50] [--only engine] [--json out/mutants.jsonl]

Each mutant changes one operator, number or flag of one line of ``fapengine/PACKAGE`` in a copy of the tree; then only
those tests of ``tests/unit/PACKAGE`` run that execute the line (all of them where it runs at import). A mutant that
survives those and then all others is either equivalent, because no input can show the difference, or a promise that
nobody checks.
``mutants.toml`` beside this file lists the survivors that are known, with the reason for each.
"""

import argparse
import ast
import json
import os
import random
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from coverage import CoverageData
from rich.console import Console
from rich.progress import track

from design.mutations import ROOT, clone

PACKAGES = ("codec", "speech", "trajectory", "engine")
KNOWN = Path(__file__).with_name("mutants.toml")
TIMEOUT_S = 600.0
"""A mutant that makes the tests run longer than this loops for ever: it is noticed."""
COMPARISONS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}
OPERATORS = {ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")}
SYMBOLS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


@dataclass(frozen=True)
class Mutant:
    """One changed place."""

    file: str
    """Path in the repository."""
    line: int
    kind: str
    start: int
    """Offset of the replaced bytes in the file."""
    stop: int
    new: str

    def applied(self, source: bytes) -> bytes:
        """Return the changed file."""
        return source[: self.start] + self.new.encode() + source[self.stop :]


def _slots(node: ast.AST) -> ast.expr | None:
    """A dataclass flag that only saves memory."""
    return node.value if isinstance(node, ast.keyword) and node.arg == "slots" else None


def mutants(path: Path, root: Path) -> Iterator[Mutant]:
    """List every mutant of one file that a test could notice: none of annotations and slots."""
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    tree = ast.parse(source)
    unseen = {
        id(part)
        for node in ast.walk(tree)
        for left in (getattr(node, "annotation", None), getattr(node, "returns", None), _slots(node))
        if left is not None
        for part in ast.walk(left)
    }

    def offset(line: int, column: int) -> int:
        return starts[line - 1] + column

    def between(left: ast.expr, right: ast.expr, old: str, new: str, kind: str) -> Iterator[Mutant]:
        """Replace a sign between two expressions, where it stands there once."""
        start = offset(left.end_lineno or 0, left.end_col_offset or 0)
        stop = offset(right.lineno, right.col_offset)
        if source[start:stop].count(old.encode()) == 1:
            at = source.index(old.encode(), start)
            yield Mutant(str(path.relative_to(root)), left.end_lineno or 0, kind, at, at + len(old), new)

    def instead(node: ast.expr, new: str, kind: str, length: int | None = None) -> Iterator[Mutant]:
        """Replace an expression, or its first bytes."""
        start = offset(node.lineno, node.col_offset)
        stop = start + length if length else offset(node.end_lineno or 0, node.end_col_offset or 0)
        yield Mutant(str(path.relative_to(root)), node.lineno, kind, start, stop, new)

    for node in ast.walk(tree):
        match node:
            case _ if id(node) in unseen:
                continue
            case ast.Compare(left=left, ops=[operator], comparators=[right]) if type(operator) in SYMBOLS:
                sign = SYMBOLS[type(operator)]
                yield from between(left, right, sign, COMPARISONS[sign], "comparison")
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in OPERATORS:
                yield from between(left, right, *OPERATORS[type(operator)], "arithmetic")
            case ast.BoolOp(op=operator, values=[first, second, *_]):
                words = ("and", "or") if isinstance(operator, ast.And) else ("or", "and")
                yield from between(first, second, *words, "and, or")
            case ast.Constant(value=bool(value)):
                yield from instead(node, repr(not value), "flag")
            case ast.Constant(value=int(value)):
                yield from instead(node, repr(value + 1), "number")
            case ast.Constant(value=float(value)):
                yield from instead(node, repr(value * 2 if value else 1.0), "number")
            case ast.Call(func=ast.Name(id="min" | "max" as name)):
                yield from instead(node, "max" if name == "min" else "min", "min, max", len(name))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                yield from instead(node, "", "not", offset(operand.lineno, operand.col_offset) - offset(node.lineno, node.col_offset))  # fmt: skip  # noqa: E501


def drawn(package: str, count: int, seed: int, root: Path = ROOT) -> list[Mutant]:
    """Draw mutants of one package."""
    every = [one for path in sorted((root / "fapengine" / package).rglob("*.py")) for one in mutants(path, root)]
    valid = []
    for one in random.Random(f"{seed} {package}").sample(every, len(every)):
        try:
            ast.parse(one.applied((root / one.file).read_bytes()))
        except SyntaxError:
            continue
        valid.append(one)
        if len(valid) == count:
            break
    return valid


def pytest(copy: Path, *arguments: str, timeout_s: float | None = None) -> int:
    """Run pytest in a copy; returns its exit code, 1 when it ran out of time."""
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    try:
        return subprocess.run(command, cwd=copy, env=environment, capture_output=True, timeout=timeout_s).returncode
    except subprocess.TimeoutExpired:
        return 1


class Coverage:
    """Which tests execute which line of a package."""

    def __init__(self, copy: Path, package: str) -> None:
        data, config = copy.parent / f"{package}.coverage", copy.parent / "coveragerc"
        config.write_text(f"[run]\ndata_file = {data}\nsource = fapengine.{package}\n")
        options = (f"--cov=fapengine.{package}", "--cov-context=test", "--cov-report=", f"--cov-config={config}")
        if pytest(copy, *options, f"tests/unit/{package}") != 0:
            raise SystemExit(f"tests/unit/{package}: fails before anything was changed")
        self._data = CoverageData(str(data))
        self._data.read()
        self._copy, self._package = copy, package

    def tests(self, mutant: Mutant) -> list[str]:
        """List the tests that execute a mutant's line; all of the package where that is not known."""
        names = self._data.contexts_by_lineno(str(self._copy / mutant.file)).get(mutant.line, [""])
        return sorted({name.rpartition("|")[0] for name in names}) if all(names) else [f"tests/unit/{self._package}"]


def judge(copy: Path, mutant: Mutant, tests: list[str]) -> str:
    """Make one change in a copy, run tests, and take it back: ``killed``, ``survived`` or ``broken``."""
    path = copy / mutant.file
    good = path.read_bytes()
    path.write_bytes(mutant.applied(good))
    try:
        code = pytest(copy, "-x", *tests, timeout_s=TIMEOUT_S)
    finally:
        path.write_bytes(good)
    return {0: "survived", 1: "killed", 2: "killed"}.get(code, "broken")  # 2: the module cannot be imported any more


def known() -> dict[str, str]:
    """Read the survivors that are known: changed line and reason."""
    rows = tomllib.loads(KNOWN.read_text(encoding="utf-8"))["survivor"] if KNOWN.exists() else []
    return {row["line"]: row["reason"] for row in rows}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=50, help="mutants of each package")
    parser.add_argument("--only", choices=PACKAGES, action="append", help="this package alone; may be repeated")
    parser.add_argument("--json", type=Path, help="append one JSON object per mutant to this file")
    asked = parser.parse_args()
    console, reasons, verdicts = Console(), known(), []
    with clone() as copy:
        for package in asked.only or PACKAGES:
            coverage = Coverage(copy, package)
            for one in track(drawn(package, asked.each, asked.seed, copy), package, console=Console(stderr=True)):
                source = (copy / one.file).read_bytes()
                changed = one.applied(source).decode().splitlines()[one.line - 1].strip()
                verdict = judge(copy, one, coverage.tests(one))
                if verdict == "survived" and changed in reasons:
                    verdict = "equivalent"
                elif verdict != "killed":  # a line whose result is kept is executed by one test and seen by others
                    verdict = judge(copy, one, [f"tests/unit/{package}"])
                verdicts.append(verdict)
                row = {**asdict(one), "changed": changed, "verdict": verdict}
                if asked.json:
                    with asked.json.open("a", encoding="utf-8") as out:
                        out.write(json.dumps(row, ensure_ascii=False) + "\n")
                if verdict not in ("killed", "equivalent"):
                    console.print(f"{verdict}: {one.file}:{one.line}: {changed}", markup=False)
    judged = len(verdicts) - verdicts.count("equivalent")
    console.print(f"{verdicts.count('killed')} of {judged} noticed; {len(verdicts) - judged} are equivalent")
    return int(verdicts.count("killed") < 0.95 * judged)


if __name__ == "__main__":
    sys.exit(main())
