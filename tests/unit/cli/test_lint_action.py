"""The action that lints lips: its script in a checkout of git, with the real command line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import fapengine
from fapengine.speech.formats.writing import WRITERS

ACTION = Path(__file__).resolve().parents[3] / ".github" / "actions" / "lint-lips"
GIT = ("git", "-c", "user.name=a", "-c", "user.email=a@example.org")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository whose first commit has a right lip sync, and whose second adds one that never opens."""
    folder = tmp_path / "repository"
    (folder / "timings").mkdir(parents=True)
    spoken = fapengine.speak("My baby fell off a boat.", rate_hz=50.0)
    subprocess.run(["git", "init", "-q", folder], check=True)
    for name, size in (("right", 1.0), ("dead", 0.0)):
        fapengine.save(spoken.track * size, folder / f"{name}.fap")
        (folder / "timings" / f"{name}.TextGrid").write_bytes(WRITERS[".textgrid"](spoken.phones))
        subprocess.run([*GIT, "add", "."], cwd=folder, check=True)
        subprocess.run([*GIT, "commit", "-qm", name], cwd=folder, check=True)
    return folder


def lint(folder: Path, **given: str) -> tuple[int, str, str]:
    """Exit code, what is printed, and outputs of the step."""
    tools, output = folder.parent / "tools", folder.parent / "output"
    tools.mkdir(exist_ok=True)
    (tools / "fapengine").write_text(f'#!/bin/sh\nexec {sys.executable} -m fapengine "$@"\n', encoding="utf-8")
    (tools / "fapengine").chmod(0o755)
    output.write_text("", encoding="utf-8")
    surroundings = {
        **os.environ, "PATH": f"{tools}:{os.environ['PATH']}", "PYTHONPATH": str(ACTION.parents[2]), "FILES": "*.fap",
        "PHONES": "timings", "RUNNER_TEMP": str(folder.parent), "GITHUB_OUTPUT": str(output),
        "GITHUB_STEP_SUMMARY": str(folder.parent / "summary"), **given,
    }  # fmt: skip
    done = subprocess.run(
        ["bash", ACTION / "lint.sh"], cwd=folder, env=surroundings, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout, output.read_text(encoding="utf-8")


def test_what_a_pull_request_adds_is_checked(checkout: Path) -> None:
    code, said, outputs = lint(checkout, BASE="HEAD~1")
    assert (code, said.splitlines()[0]) == (1, "fails: 1 of 1 recordings")
    assert "dead: fails: opens 0 mm" in said
    assert outputs.split() == [f"junit={checkout.parent}/lips.xml", f"sarif={checkout.parent}/lips.sarif"]
    assert "dead.fap" in (checkout.parent / "lips.sarif").read_text(encoding="utf-8")
    assert "fails: 1 of 1" in (checkout.parent / "summary").read_text(encoding="utf-8")


def test_thresholds_and_patterns_are_passed_on(checkout: Path) -> None:
    code, said, _ = lint(checkout, FILES="*.glb\nright.fap", FAIL_UNDER="opens=50mm,closures=95")
    assert (code, said.splitlines()[0]) == (1, "fails: 1 of 1 recordings")
    assert "right: fails: opens 1" in said
    assert lint(checkout, FILES="*.glb") == (0, "No lip sync to check.\n", "")
    assert lint(checkout, FILES=":(no-such-magic)*.fap")[0] == 128  # git says why


def test_the_action_runs_the_script_with_all_its_inputs() -> None:
    action = yaml.safe_load((ACTION / "action.yml").read_text(encoding="utf-8"))
    step = action["runs"]["steps"][-1]
    assert step["run"].endswith('lint.sh"')
    text = (ACTION / "lint.sh").read_text(encoding="utf-8")
    assert all(f"${name}" in text or f"${{{name}" in text for name in step["env"])
    assert all(f"inputs.{name}" in str(action["runs"]) for name in action["inputs"])
