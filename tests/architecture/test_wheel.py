"""The wheel, as a stranger gets it: complete, and working from anywhere."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(ROOT)], check=True, timeout=300, capture_output=True)
    (built,) = folder.glob("fapengine-*.whl")
    return built


def test_wheel_holds_every_shader_profile_and_page(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    folders = ("shaders", "profiles", "web-page", "fapengine-face")
    shipped = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    assert len(shipped) >= 25
    missing = [path for path in shipped if f"fapengine/_data/{path.relative_to(ROOT).as_posix()}" not in names]
    assert not missing
    assert "fapengine/py.typed" in names
    tables = [path.relative_to(ROOT).as_posix() for path in (ROOT / "fapengine").rglob("*.npz")]
    assert len(tables) >= 5
    sums = [f"fapengine/{folder}/SHA256SUMS" for folder in ("mesh/default_head", "retarget")]
    assert {*tables, *sums} <= names


def test_wheel_works_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)]
    subprocess.run(command, check=True, timeout=300, capture_output=True)
    code = (
        "import fapengine; from fapengine._resources import profile_ids, shader_source; "
        "print(fapengine.__file__); print(len(profile_ids())); print(len(shader_source('face.vert')))"
    )
    environment = {**os.environ, "PYTHONPATH": str(target)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    where, profiles, shader = done.stdout.split()
    assert where.startswith(str(target))
    assert int(profiles) >= 1
    assert int(shader) > 100
