"""tests/README.md lists every test that needs recorded data, with what runs in its place in any clone."""

import re
from pathlib import Path

TESTS = Path(__file__).resolve().parents[2]


def test_every_test_that_needs_recorded_data_is_listed() -> None:
    mark = "pytest.mark." + "shared"
    marked = {str(path.relative_to(TESTS)) for path in TESTS.rglob("test_*.py") if mark in path.read_text()}
    if mark in (TESTS / "unit" / "models" / "conftest.py").read_text():
        marked |= {str(path.relative_to(TESTS)) for path in (TESTS / "unit" / "models").glob("test_*_on_speech.py")}
    rows = [line for line in (TESTS / "README.md").read_text().splitlines() if re.match(r"\| `(unit|browser)/", line)]
    listed = {name for row in rows for name in re.findall(r"`((?:unit|browser)/[\w/]+\.py)`", row.split("|")[1])}
    assert len(marked) >= 10
    assert listed == marked
