"""Without pictures, windows and sound cards: what needs none works, and the rest says what it lacks."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fapengine.errors import ResourceError
from fapengine.render import context

LACKING = (
    "moderngl", "av", "PIL", "sounddevice", "pythonosc", "font_source_sans_pro", "fapengine_native", "aiohttp",
    "trimesh", "matplotlib", "espeakng_loader", "num2words", "glfw", "pocketsphinx", "onnxruntime", "prometheus_client",
    "distributed", "piper", "piper_plus", "nltk", "onnx", "kokoro_onnx",
)  # fmt: skip
RUNNER = """
import importlib.abc, json, sys

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {lacking!r}:
            raise ImportError(f"No module named {{name!r}}")

sys.meta_path.insert(0, Blocker())
from fapengine.cli.main import main

def run(words):
    sys.argv = ["fapengine", *words]
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0

commands = json.loads(sys.argv[1])
if {platform!r} != sys.platform:
    for words in commands:  # the standard library is of this system, and is loaded as such
        run(words)
    import os
    import fapengine.files.paths
    sys.platform = {platform!r}
    if sys.platform == "win32":
        del os.fork, os.sched_getaffinity
        fapengine.files.paths.fcntl = None
for words in commands:
    print("CODE", words[0], run(words), flush=True)
"""
WORKS = [
    ["animate", "a.pho", "-o", "a.fap"],
    ["encode", "a.fap", "-o", "a.fba"],
    ["decode", "a.fba", "-o", "b.fap"],
    ["convert", "b.fap", "-o", "b.csv"],
    ["convert", "b.csv", "-o", "c.fap"],
    ["inspect", "a.fba"],
    ["inspect", "a.fap", "--json"],
    ["inspect", "a.pho"],
    ["batch", "corpus.csv", "-o", "corpus", "--to", "fba", "--workers", "0"],
]
LACKS = {
    "pillow": ('"fapengine[video]"', ["head", "export", "default:level=coarse", "-o", "a.glb"]),
    "moderngl": ("moderngl", ["render", "a.fap", "-o", "a.png"]),
    "av": ('"fapengine[video]"', ["align", "a.mp3", "-o", "a.TextGrid"]),
    "espeak-ng": ('"fapengine[voice]"', ["say", "Hello.", "-o", "hello.fap"]),
}


def run(folder: Path, commands: list[list[str]], platform: str = sys.platform) -> tuple[list[str], str]:
    """Exit codes in order, and what was said on standard error."""
    import json

    program = RUNNER.format(lacking=LACKING, platform=platform)
    command = [sys.executable, "-c", program, json.dumps(commands)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    return [line for line in done.stdout.splitlines() if line.startswith("CODE ")], done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.pho").write_text("_ 100\nb 80\na 150\n_ 100\n")
    (tmp_path / "a.mp3").write_bytes(b"ID3\x04" + bytes(100))
    (tmp_path / "corpus.csv").write_text("id,timings\none,a.pho\n")
    return tmp_path


@pytest.mark.parametrize(
    "platform", [sys.platform, *(pytest.param(name, marks=pytest.mark.nightly) for name in ("win32", "darwin"))]
)
def test_the_core_works(folder: Path, platform: str) -> None:
    """On a system that only claims to be another, without its calls: our own ways are shown, nothing else."""
    codes, told = run(folder, WORKS, platform)
    assert codes == [f"CODE {words[0]} 0" for words in WORKS], told
    assert {"a.fba", "b.csv", "c.fap"} <= {path.name for path in folder.iterdir()}


def test_a_missing_library_is_named_with_the_command_that_installs_it(folder: Path) -> None:
    commands = [words for _, words in LACKS.values()]
    codes, told = run(folder, [WORKS[0], *commands])
    assert codes[1:] == [f"CODE {words[0]} 3" for words in commands], told
    lines = [line for line in told.splitlines() if not line.startswith("FAPENGINE_CACHE: ")]  # which needs pillow
    for (package, (install, _)), line in zip(LACKS.items(), lines, strict=True):
        assert f"{package} is not installed. Install it with: pip install {install}" in line


@pytest.mark.parametrize(("platform", "backend"), [("linux", "egl"), ("win32", None), ("darwin", None)])
def test_a_context_is_the_system_s_own(platform: str, backend: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """EGL where there is no window; elsewhere moderngl chooses WGL or CGL. Nobody has seen those two draw."""
    asked: dict[str, Any] = {}

    def refused(**settings: Any) -> None:
        asked.update(settings)
        raise OSError("no display")

    monkeypatch.setattr(context.sys, "platform", platform)
    monkeypatch.setattr(context, "moderngl", type("moderngl", (), {"create_context": staticmethod(refused)}))
    with pytest.raises(ResourceError, match="no context"):
        context.create_context()
    assert asked.get("backend") == backend
