"""Licences of the installed packages: everything that fapengine requires, with its extras, and what is copyleft."""

import json
from importlib.metadata import Distribution
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fapengine.cli.doctor import Package, used_packages
from fapengine.cli.main import app


def test_every_required_package_is_listed_once() -> None:
    packages = used_packages()
    names = [package.name for package in packages]
    assert names == sorted(set(names))
    assert {"fapengine", "numpy", "scipy", "typer", "av", "pillow"} <= set(names)
    assert "hatchling" not in names  # it builds, and is not used
    by_name = {package.name: package for package in packages}
    assert by_name["numpy"].licence.startswith("BSD")
    assert not by_name["numpy"].is_copyleft
    if "espeakng-loader" in by_name:
        assert by_name["espeakng-loader"].is_copyleft


@pytest.mark.parametrize(
    ("written", "licence", "is_copyleft"),
    [
        ("License-Expression: GPL-3.0-or-later", "GPL-3.0-or-later", True),
        ("License: GNU GENERAL PUBLIC LICENSE", "GNU GENERAL PUBLIC LICENSE", True),
        ("License: " + 30 * "long " + "\nClassifier: License :: OSI Approved :: MIT License", "MIT License", False),
        ("License: UNKNOWN\nClassifier: Topic :: GPLed", "not stated", False),
        ("Classifier: License :: OSI Approved :: GNU Lesser General Public License v2 (LGPLv2)",
         "GNU Lesser General Public License v2 (LGPLv2)", True),
    ],
)  # fmt: skip
def test_metadata_of_any_age_are_read(
    written: str, licence: str, is_copyleft: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "odd-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.4\nName: odd\nVersion: 1.0\n{written}\n")
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: Distribution.at(folder))
    assert used_packages("odd") == [Package("odd", "1.0", licence)]
    assert used_packages("odd")[0].is_copyleft is is_copyleft


def test_doctor_lists_them() -> None:
    told = CliRunner().invoke(app, ["doctor", "--licences", "--json"], catch_exceptions=False)
    assert {"name": "numpy"}.items() <= next(row for row in json.loads(told.stdout) if row["name"] == "numpy").items()
    assert "numpy" in CliRunner().invoke(app, ["doctor", "--licences"], catch_exceptions=False).stdout
