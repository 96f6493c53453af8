"""The documentation stays short enough to be read: README's lines, pages, words, sentences, and the files it shows."""

from pathlib import Path

import pytest

from design import measurements
from design.docs_size import DOCS, median_sentence, pages, sentences, word_count

ROOT = Path(__file__).resolve().parents[2]
MAX_README_LINES = 160
MAX_ROWS = 12
MAX_LIMITS = 5
MAX_PAGES = 38
MAX_WORDS = 36_000
MAX_MEDIAN = 18
MAX_ANIMATION_MB, MAX_VIDEO_MB = 1.5, 1.0
README = (ROOT / "README.md").read_text(encoding="utf-8")
TEXTS = {path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8") for path in pages()}


def section(title: str) -> list[str]:
    return README.split(f"\n## {title}\n")[1].split("\n## ")[0].strip().splitlines()


def test_the_readme_can_be_read_at_once() -> None:
    assert len(README.splitlines()) <= MAX_README_LINES
    rows = [line for line in section("What do you have?") if line.startswith("| ")]
    assert 1 < len(rows) <= MAX_ROWS + 1  # and its header
    assert len([line for line in section("Limits") if line]) <= MAX_LIMITS


def test_there_are_few_pages_and_words() -> None:
    assert 20 < len(TEXTS) <= MAX_PAGES
    assert sum(map(word_count, TEXTS.values())) <= MAX_WORDS, "python -m design.docs_size"


@pytest.mark.parametrize("name", [name for name in TEXTS if len(sentences(TEXTS[name])) > 5])
def test_sentences_are_short(name: str) -> None:
    assert median_sentence([TEXTS[name]]) <= MAX_MEDIAN


def test_the_measurements_are_those_of_the_data_and_name_their_commands() -> None:
    assert measurements.PAGE.read_text(encoding="utf-8") == measurements.page(), "run python -m design.measurements"
    for name in measurements.ORDER:
        assert all(each.get("commands") for each in measurements.sections(name)), name
    assert {path.stem for path in measurements.FOLDER.glob("*.toml")} == set(measurements.ORDER)


@pytest.mark.parametrize(("name", "most_mb"), [("demo.webp", MAX_ANIMATION_MB), ("demo.mp4", MAX_VIDEO_MB)])
def test_animations_are_small(name: str, most_mb: float) -> None:
    assert 10_000 < (DOCS / "pictures" / name).stat().st_size < 1e6 * most_mb
