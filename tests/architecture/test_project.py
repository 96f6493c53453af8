"""The files around the code agree with each other: versions of Python, packages, workflows, citation, changelog."""

import os
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent.parent
PYPROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())
PYTHONS = [entry.rpartition(" ")[2] for entry in PYPROJECT["project"]["classifiers"] if re.search(r":: 3\.\d+$", entry)]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def workflow(name: str) -> dict[str, Any]:
    return yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text())


def commands(job: dict[str, Any]) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def test_pythons_are_those_of_requires_python_and_of_mypy() -> None:
    assert len(PYTHONS) >= 3
    assert PYPROJECT["project"]["requires-python"] == f">={PYTHONS[0]}"
    assert PYPROJECT["tool"]["mypy"]["python_version"] == PYTHONS[0]


def test_nox_and_the_workflow_test_every_python() -> None:
    matrix = workflow("ci.yml")["jobs"]["matrix"]
    assert matrix["strategy"]["matrix"]["python"] == PYTHONS
    assert "nox" in commands(matrix)[-1]
    assert "PYTHONS = nox.project.python_versions(PROJECT)" in (ROOT / "noxfile.py").read_text()


def test_no_package_is_declared_twice() -> None:
    def names(requirements: list[Any]) -> list[str]:  # a group that includes another has an entry that is no text
        return [re.split(r"[<>=!~;\[ ]", entry)[0].lower() for entry in requirements if isinstance(entry, str)]

    installed = names(PYPROJECT["project"]["dependencies"])
    for extra in PYPROJECT["project"]["optional-dependencies"].values():
        installed += [name for name in names(extra) if name != "fapengine"]  # extras that include others
    assert len(installed) >= 15
    assert sorted(installed) == sorted(set(installed))
    for group in PYPROJECT["dependency-groups"].values():
        assert len(names(group)) == len(set(names(group)))


def test_all_is_every_extra() -> None:
    extras = PYPROJECT["project"]["optional-dependencies"]
    (everything,) = extras["all"]
    named = set(everything.partition("[")[2].rstrip("]").split(","))
    for name in tuple(named):
        named |= {part for entry in extras[name] if entry.startswith("fapengine[") for part in entry[10:-1].split(",")}
    assert named == set(extras) - {"all"}


def test_version_comes_from_the_tag() -> None:
    assert "version" not in PYPROJECT["project"]
    assert "version" in PYPROJECT["project"]["dynamic"]
    assert PYPROJECT["tool"]["hatch"]["version"]["source"] == "vcs"


@pytest.mark.parametrize("installed", [True, False])
def test_version_is_read_when_it_is_asked_for(installed: bool, tmp_path: Path) -> None:
    if not installed:  # the package alone, seen by an interpreter without our environment
        (tmp_path / "fapengine").symlink_to(ROOT / "fapengine")
    options = [] if installed else ["-I", "-S"]
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT if installed else tmp_path)!r}); import fapengine; "
        "print('importlib.metadata' in sys.modules, fapengine.__version__)"
    )
    done = subprocess.run(
        [sys.executable, *options, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    loaded, version = done.stdout.split()
    assert installed or loaded == "False"
    assert re.match(r"\d+\.\d+", version)
    assert (version == "0.0.0") is not installed


def test_core_that_is_measured_is_the_core_of_the_contract() -> None:
    (core,) = (c for c in PYPROJECT["tool"]["importlinter"]["contracts"] if c["name"].startswith("The core knows no"))
    assert PYPROJECT["tool"]["coverage"]["run"]["source"] == core["source_modules"]
    assert PYPROJECT["tool"]["coverage"]["report"]["fail_under"] >= 90


def test_hosted_ci_runs_what_everybody_runs() -> None:
    assert ".ci/run" in commands(workflow("ci.yml")["jobs"]["gate"])
    build = commands(workflow("release.yml")["jobs"]["build"])
    assert build == [".ci/run", "make release-check"]
    assert os.access(ROOT / ".ci" / "release-check", os.X_OK)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_may_only_read(path: Path) -> None:
    content = workflow(path.name)
    assert content["permissions"] == {"contents": "read"}
    wider = {name: job["permissions"] for name, job in content["jobs"].items() if "permissions" in job}
    assert wider in ({}, {"publish": {"id-token": "write"}})
    for job in content["jobs"].values():
        assert "timeout-minutes" in job


ACTIONS = sorted([*WORKFLOWS, ROOT / "action.yml", *(ROOT / ".github" / "actions").rglob("action.yml")])


def test_every_action_is_pinned_by_its_hash() -> None:
    used = [line for path in ACTIONS for line in re.findall(r"^\s*- uses: .*", path.read_text(), flags=re.MULTILINE)]
    assert len(used) >= 10
    assert [line for line in used if not re.search(r"@[0-9a-f]{40}  # v\d+\.\d+\.\d+$", line)] == []


def test_make_targets_that_are_named_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    named: set[str] = set()
    for path in ("CONTRIBUTING.md", "SECURITY.md", "README.md", *WORKFLOWS):
        named |= set(re.findall(r"(?:`|run: |^ *)make ([a-z-]+)", (ROOT / path).read_text(), flags=re.MULTILINE))
    assert len(named) >= 10
    assert named <= targets


def test_hooks_call_the_tools_of_the_gate() -> None:
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert repository["repo"] == "local"
    (gate,) = re.findall(r"^check:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    in_gate = set(re.findall(r"\$\(BIN\)/(\S+(?: format| check)?)", gate))
    in_hooks = {re.match(r"\.venv/bin/(\S+(?: format| check)?)", hook["entry"])[1] for hook in repository["hooks"]}  # type: ignore[index]
    assert len(in_gate) >= 4
    assert in_hooks == in_gate


def test_citation_has_what_the_format_asks_for() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["license"] == PYPROJECT["project"]["license"].partition(" AND ")[0]  # that of the code
    assert {"message", "title", "authors"} <= citation.keys()
    papers = citation["references"]
    assert [paper["authors"][0]["family-names"] for paper in papers] == ["Kshirsagar", "Lucero", "Berger", "Kuratate"]
    for paper in papers:
        assert {"type", "title", "year", "conference"} <= paper.keys()


def test_every_file_has_a_licence_whose_text_is_here() -> None:
    reuse = tomllib.loads((ROOT / "REUSE.toml").read_text())
    assert reuse["annotations"][0]["path"] == "**"
    beside = list((ROOT / "fapengine").rglob("*.license"))
    assert all(path.with_suffix("").exists() for path in beside)
    stated = [row["SPDX-License-Identifier"] for row in reuse["annotations"]]
    words = "\n".join(path.read_text() for path in beside)
    stated += re.findall("^SPDX-License" r"-Identifier: (.*)$", words, re.MULTILINE)  # one word is a tag for reuse
    named = {name for each in stated for name in each.split(" AND ")}
    assert named == {path.stem for path in (ROOT / "LICENSES").iterdir()}
    assert set(PYPROJECT["project"]["license"].split(" AND ")) <= named
    for row in reuse["annotations"]:
        for pattern in [row["path"]] if isinstance(row["path"], str) else row["path"]:
            assert next(ROOT.glob(pattern.removesuffix("/**")), None), pattern


def test_every_picture_and_figure_has_a_command_that_exists() -> None:
    text = (ROOT / "REPRODUCE.md").read_text()
    rows = text.split("## ")[1].split("\n|")[3:]
    named = [name for row in rows for name in re.findall(r"`([^`]+)`", row.split("|")[0])]
    for name in named:
        assert next((ROOT / "docs" / "pictures").glob(name), None), name
    pictures = {path.name for path in (ROOT / "docs" / "pictures").iterdir()}
    assert {name for name in pictures if not any(fnmatch(name, each) for each in named)} == set()
    modules = set(re.findall(r"\b(?:design|bench)\.[a-z_]+", text))
    assert len(modules) >= 15
    assert [name for name in modules if not (ROOT / f"{name.replace('.', '/')}.py").exists()] == []


def test_changelog_keeps_its_form() -> None:
    lines = (ROOT / "CHANGELOG.md").read_text().splitlines()
    versions = [line for line in lines if line.startswith("## ")]
    assert versions[0] == "## Unreleased"
    assert all(re.fullmatch(r"## \d+\.\d+\.\d+ - \d{4}-\d{2}-\d{2}", line) for line in versions[1:])
    kinds = {line for line in lines if line.startswith("### ")}
    assert kinds <= {f"### {kind}" for kind in ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")}


def test_folders_that_the_coverage_takes_are_there() -> None:
    named = re.search(r"CORE_TESTS := \$\(addprefix tests/unit/,([\w \\\n]+)\)", (ROOT / "Makefile").read_text())
    assert named
    folders = named[1].replace("\\", " ").split()
    assert len(folders) > 10
    assert all((ROOT / "tests" / "unit" / folder).is_dir() for folder in folders)


def test_llms_txt_links_to_pages_that_exist() -> None:
    title, _, rest = (ROOT / "llms.txt").read_text().partition("\n\n> ")
    links = re.findall(r"^- \[[^]]+\]\(([^)]+)\)", rest, flags=re.MULTILINE)
    assert title == "# fapengine"
    assert len(links) >= 15
    assert [link for link in links if not (ROOT / link).is_file()] == []
