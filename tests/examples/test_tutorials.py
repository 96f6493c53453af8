"""The blocks of every tutorial run one after another, as a reader runs them, on a machine without display or sound."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.processes import free_port, start

TUTORIALS = sorted((Path(__file__).resolve().parents[2] / "docs" / "tutorials").glob("*.md"))
HOW_TO = TUTORIALS[0].parents[1] / "how-to"
BLOCK = re.compile(r'^```(python|sh)(?: title="([\w.]+)")?\n(.*?)^```$', flags=re.S | re.M)
OSC_PORT, WEB_PORT = 9110, 8110
NAMES, SLOW = [path.stem for path in TUTORIALS], {"laboratory": pytest.mark.nightly}
LIMIT_S = 300.0
"""Time that a block may take on a busy machine."""
MADE = {
    "first-face": ("hello.mp4", "oh.fap", "oh.png", "oh.csv", "oh.fba", "again.fap", "again.csv"),
    "first-live-face": (),
    "laboratory": ("seen.png", "s01/report.html", "s01/tables/phones.csv", "error.png", "driven.mp4", "sentence.mp4"),
    "own-head": ("wide.obj", "wide.csv", "wide.png", "own.png"),
    "tts-over-osc": (),
}
"""Files that a tutorial writes below ``out``."""
PRINTED = {
    "first-face": ("open_jaw reaches", "frames came back"),
    "first-live-face": ("the face is neutral again",),
    "laboratory": ("3 markers drive the face", "phones, 6 expressions"),
    "own-head": ("FAPs move it",),
    "tts-over-osc": ("finished\nfinished\ncancelled",),
}


@dataclass
class Reader:
    """Somebody who follows a tutorial in an empty folder. Stateful."""

    folder: Path
    printed: str = ""
    server: subprocess.Popen[str] | None = None
    ports: dict[int, int] = field(default_factory=lambda: {OSC_PORT: free_port(), WEB_PORT: free_port()})

    def run(self, language: str, title: str, code: str) -> None:
        """Do what one block says."""
        if language == "python":
            (self.folder / title).write_text(self.on_free_ports(code))
            self.command([sys.executable, title])
            return
        for line in code.strip().splitlines():
            words = shlex.split(line)
            assert words[0] == "fapengine"
            command = [sys.executable, "-m", *words]
            if words[1] == "serve":
                page = () if "--no-page" in words else ("--web-port", str(self.ports[WEB_PORT]))
                self.serve([*command, "--port", str(self.ports[OSC_PORT]), *page])
            else:
                self.command(command)

    def command(self, words: list[str]) -> None:
        done = subprocess.run(
            words, cwd=self.folder, env=environment(), capture_output=True, text=True, timeout=LIMIT_S
        )
        assert done.returncode == 0, done.stderr
        self.printed += done.stdout

    def serve(self, words: list[str]) -> None:
        self.server = start(words, cwd=self.folder, env=environment(), stdout=subprocess.PIPE, text=True)
        assert self.server.stdout is not None
        assert self.server.stdout.readline().startswith("OSC in")

    def stop(self) -> None:
        if self.server is not None:
            with self.server:
                self.server.send_signal(signal.SIGINT)
            assert self.server.returncode == 0

    def on_free_ports(self, code: str) -> str:
        """Let code of the reader speak to the server of this test, not to one that may be running on this machine."""
        code = code.replace(str(OSC_PORT), str(self.ports[OSC_PORT]))
        return code.replace(
            'fapengine.Client(session="anna")', f'fapengine.Client(port={self.ports[OSC_PORT]}, session="anna")'
        )


def environment() -> dict[str, str]:
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "PULSE_SERVER")
    return {**{name: value for name, value in os.environ.items() if name not in hidden}, "PYTHONUTF8": "1"}


@pytest.mark.parametrize("path", [pytest.param(path, marks=SLOW.get(path.stem, ())) for path in TUTORIALS], ids=NAMES)
def test_a_reader_who_follows_it_gets_there(path: Path, tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    begun_s = time.monotonic()
    try:
        for language, title, code in BLOCK.findall(path.read_text(encoding="utf-8")):
            reader.run(language, title, code)
    finally:
        reader.stop()
    for name in MADE[path.stem]:
        assert (tmp_path / "out" / name).stat().st_size > 100, name
    for words in PRINTED[path.stem]:
        assert words in reader.printed
    print(f"{path.stem}: {time.monotonic() - begun_s:.1f} s")


def test_all_are_there_and_every_block_is_run_or_marked_as_text() -> None:
    assert {path.stem for path in TUTORIALS} == MADE.keys() == PRINTED.keys()
    for path in TUTORIALS:
        text = path.read_text(encoding="utf-8")
        fences = re.findall(r"^```\S+", text, flags=re.M)
        assert len(BLOCK.findall(text)) + fences.count("```text") == len(fences) >= 3


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(HOW_TO.glob("*.md")) if "```python" in path.read_text()],
    ids=lambda path: path.stem,
)
def test_the_python_of_the_how_to_pages_runs(path: Path, tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", path.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert blocks
    for block in blocks:
        Reader(tmp_path).run("python", "block.py", block)
