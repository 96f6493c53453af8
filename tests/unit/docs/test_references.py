"""docs/references.md has an entry for every paper that code and pages cite."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
CITED = re.compile(r"[Pp]apers? (\d{3})")


def texts() -> list[Path]:
    folders = ("fapengine", "bench", "design", "docs", "examples", "tests")
    paths = [path for folder in folders for kind in ("*.py", "*.md") for path in (ROOT / folder).rglob(kind)]
    return [*paths, ROOT / "README.md", ROOT / "CHANGELOG.md"]


def test_every_paper_that_is_cited_has_an_entry() -> None:
    entries = set(re.findall(r"^## Paper (\d{3})", (ROOT / "docs" / "references.md").read_text(), re.M))
    assert entries == {"000", "001", "003", "004"}
    cited = {path: set(CITED.findall(path.read_text())) for path in texts() if path.name != "references.md"}
    assert sum(bool(numbers) for numbers in cited.values()) >= 25
    for path, numbers in cited.items():
        assert numbers <= entries, path
