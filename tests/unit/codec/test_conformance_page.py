"""docs/conformance.md is what its generator makes, and names only what exists."""

from pathlib import Path

import pytest

from design import conformance

pytestmark = pytest.mark.conformance
ROOT = Path(__file__).resolve().parents[3]


def test_the_page_is_current() -> None:
    assert conformance.page() == conformance.DOC.read_text(), "run: python -m design.conformance"


def test_modules_exist_and_deviations_are_found() -> None:
    modules = {name.strip() for clause in conformance.CLAUSES for name in clause.modules.split(",")} - {"-"}
    assert all((ROOT / "fapengine" / module).exists() for module in modules)
    assert len(conformance.deviations()) >= 4
