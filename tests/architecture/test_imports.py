"""What an import may cost, seen from a fresh interpreter."""

import json
import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "moderngl", "av", "PIL", "sounddevice", "pythonosc", "rich", "matplotlib"}


def modules_after(statement: str) -> set[str]:
    code = f"import sys\n{statement}\nimport json; print(json.dumps(sorted(m.partition('.')[0] for m in sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize("statement", ["import fapengine", "import fapengine.cli", "import fapengine.errors"])
def test_import_is_light(statement: str) -> None:
    assert not modules_after(statement) & HEAVY


def test_the_check_sees_a_heavy_import() -> None:
    assert "numpy" in modules_after("import fapengine.mpeg4.track")


def test_core_needs_only_numpy_and_scipy() -> None:
    core = ("mpeg4.track", "codec", "capture", "mesh", "models", "speech", "trajectory", "profiles")
    loaded = modules_after("\n".join(f"import fapengine.{name}" for name in core))
    assert not loaded & (HEAVY - {"numpy", "scipy"})


def test_saying_a_sentence_starts_without_what_it_does_not_use() -> None:
    loaded = modules_after(
        "import fapengine.app.performance, fapengine.app.talk, fapengine.voices.espeak\n"
        "parts = {'linalg', 'spatial', 'interpolate', 'sparse', 'special', 'ndimage', 'signal', 'optimize'}\n"
        "assert not {f'scipy.{part}' for part in parts} & set(sys.modules)"
    )
    assert "matplotlib" not in loaded


def test_a_picture_of_faps_needs_no_scipy() -> None:
    loaded = modules_after("import fapengine.app.dense_film, fapengine.files.motion")
    assert "scipy" not in loaded


@pytest.mark.parametrize(
    "module", ["app.capture", "app.inspection.kinds", "batch.run", "app.scene_files", "files.heads.meshes"]
)
def test_commands_for_many_kinds_of_files_start_without_scipy(module: str) -> None:
    assert "scipy" not in modules_after(f"import fapengine.{module}")


def test_the_list_of_commands_needs_neither_numpy_nor_asyncio() -> None:
    assert not {"numpy", "asyncio"} & modules_after(
        "from fapengine.cli import main\n"
        "sys.argv, sys.stdout = ['fapengine', '--help'], sys.stderr\n"
        "try: main()\n"
        "except SystemExit: sys.stdout = sys.__stdout__"
    )
