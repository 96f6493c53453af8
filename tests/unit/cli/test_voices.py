"""Voices at the command line: the list, and what a shell completes."""

import os
import subprocess
import sys

from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.voices.espeak import voices


def test_the_list_has_every_voice_and_its_other_codes() -> None:
    done = CliRunner().invoke(app, ["say", "--voices"])
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert [line.split()[0] for line in lines] == list(voices())
    assert "fr-fr                French (France)  (also fr)" in lines
    assert any(line.startswith("yue-latn-jyutping ") for line in lines)


def test_a_shell_completes_voices() -> None:
    words = {"COMP_WORDS": "fapengine say Hello --voice fr-", "COMP_CWORD": "4", "_FAPENGINE_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", "import sys; sys.argv = ['fapengine']; from fapengine.cli import main; main()"]
    done = subprocess.run(command, env=os.environ | words, capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["fr-be", "fr-ch", "fr-fr"]
