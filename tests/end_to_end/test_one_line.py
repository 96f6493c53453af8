"""Whatever the terminal, its locale and its input are: an error is one line, and never a traceback."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from fapengine.cli import _ending
from fapengine.errors import FapEngineError

command_line = import_module("fapengine.cli.main")  # the package has a function of this name
TIMINGS = "m 100\na 200\nb 100\n"


def run(*arguments: str, shell: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """A command in a process; ``shell`` says where its streams go."""
    command = ["sh", "-c", f'exec "$@" {shell}', "sh", sys.executable, "-m", "fapengine", *arguments]
    return subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, encoding="utf-8", timeout=300, check=False
    )  # fmt: skip


@pytest.fixture
def timings(tmp_path: Path) -> str:
    path = tmp_path / "ok.pho"
    path.write_text(TIMINGS)
    return str(path)


@pytest.mark.parametrize(
    "locale",
    [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}],
    ids=["ascii", "C"],
)
def test_a_terminal_without_unicode_shows_what_it_can(timings: str, locale: dict[str, str]) -> None:
    told = run("inspect", timings, **locale)
    assert (told.returncode, told.stderr) == (0, "")
    assert "MBROLA" in told.stdout
    assert told.stdout.isascii()


@pytest.mark.parametrize(
    ("arguments", "shell", "code", "message"),
    [
        (("say", "-", "-o", "x.fap"), "<&-", 2, "standard input, but it is closed"),
        (("say", "Hello.", "--seed", "-1"), "", 2, "--seed: got -1"),
        (("inspect", "TIMINGS"), ">/dev/full", 3, "output: cannot be written (No space left on device)"),
    ],
)
def test_streams_and_numbers_that_cannot_be_used(
    timings: str, arguments: tuple[str, ...], shell: str, code: int, message: str
) -> None:
    told = run(*(timings if argument == "TIMINGS" else argument for argument in arguments), shell=shell)
    assert told.returncode == code
    assert message in told.stderr
    assert "Traceback" not in told.stderr
    assert "Exception ignored" not in told.stderr


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (AttributeError("no\nrate"), 70, "fapengine: AttributeError: no rate; this is a bug in fapengine"),
        (MemoryError(), 3, "fapengine: out of memory"),
        (FapEngineError("odd"), 3, "fapengine: odd"),
    ],
)
def test_a_bug_is_one_line_too(
    error: Exception, code: int, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr(command_line, "app", fail)
    monkeypatch.setattr(_ending.signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        command_line.main()
    told = capsys.readouterr().err
    assert ended.value.code == code
    assert told.startswith(line)
    assert told.count("\n") == 1
    if code == 70:
        monkeypatch.setenv(_ending.DEBUG, "1")
        with pytest.raises(AttributeError):
            command_line.main()


def test_what_a_message_lists_is_told_apart_in_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _ending._end("2 invalid rows:\nb.wav: no text\nc.wav: no text", 1)
    assert capsys.readouterr().err == "fapengine: 2 invalid rows: b.wav: no text; c.wav: no text\n"
