"""docs/fba-format.md has every section that code cites, and its worked example is the one that is tested."""

import re
from pathlib import Path

import pytest

from tests.unit.codec.test_bitstream import WORKED_EXAMPLE

pytestmark = pytest.mark.conformance

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "fba-format.md").read_text()
CITED = re.compile(r"FBA sections? ((?:\d+)(?:(?:, | and | to )\d+)*)")


def cited_sections() -> dict[str, set[int]]:
    """Sections of the format that each file names."""
    found = {}
    for folder in ("fapengine", "design", "tests", "bench"):
        for path in (ROOT / folder).rglob("*.py"):
            numbers: set[int] = set()
            for group in CITED.findall(path.read_text()):
                first, *others = (int(number) for number in re.findall(r"\d+", group))
                numbers |= {first, *others} | (set(range(first, others[-1])) if " to " in group else set())
            if numbers:
                found[str(path.relative_to(ROOT))] = numbers
    return found


def test_every_section_that_code_cites_is_there() -> None:
    sections = [int(number) for number in re.findall(r"^## (\d+)\. ", PAGE, re.M)]
    assert sections == list(range(17))
    cited = cited_sections()
    assert len(cited) >= 12
    for path, numbers in cited.items():
        assert numbers <= set(sections), path


def test_the_worked_example_is_the_one_that_is_coded() -> None:
    assert WORKED_EXAMPLE.hex(" ").upper() in PAGE
