"""Every example runs as it stands, and the README's lines do what they say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from design.speech_sample import write_session

ROOT = Path(__file__).resolve().parent.parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)


def test_they_were_found() -> None:
    assert len(EXAMPLES) >= 2
    assert len(BLOCKS) >= 1


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_what_it_made(path: Path, tmp_path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40
    done = subprocess.run([sys.executable, str(path)], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    made = re.findall(r"out/[\w.]+", done.stdout)
    assert made
    assert all((tmp_path / name).stat().st_size > 500 for name in made)


@pytest.mark.parametrize("text", [*(path.read_text(encoding="utf-8") for path in EXAMPLES), *BLOCKS])
def test_one_import_of_the_package_is_enough(text: str) -> None:
    imports = re.findall(r"^ *((?:import|from) +fapengine.*)$", text, flags=re.M)
    assert imports == ["import fapengine"]


def test_the_readme_says_it_in_three_lines() -> None:
    assert len([line for line in BLOCKS[0].splitlines() if line.strip()]) <= 3
    assert len(BLOCKS) <= 2


@pytest.mark.parametrize("block", BLOCKS)
def test_readme_lines_run(block: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out").iterdir())


@pytest.mark.nightly
def test_the_notebook_draws_each_figure_of_the_papers(tmp_path: Path) -> None:
    write_session(tmp_path / "S01", 8, rate_hz=50.0)
    notebook = ROOT / "examples" / "laboratory" / "papers.py"
    words = [sys.executable, str(notebook), str(tmp_path / "S01"), str(tmp_path / "figures")]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    named = set(re.findall(r"figure-\d", "".join(path.name for path in (tmp_path / "figures").iterdir())))
    assert named == {f"figure-{number}" for number in range(1, 8)}
    assert len(list((tmp_path / "figures").iterdir())) == 12
    assert "joy moves component" in done.stdout
