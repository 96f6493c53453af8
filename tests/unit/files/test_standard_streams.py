"""``-``: standard input is read where a file is; nothing is written to standard output, or to a file of that name."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import UsageError

TIMINGS = "start,end,phone\n0.0,0.2,m\n0.2,0.5,a\n"


def test_timings_come_from_standard_input(tmp_path: Path) -> None:
    out = tmp_path / "talk.fap"
    for _ in range(2):
        result = CliRunner().invoke(app, ["animate", "-", "-o", str(out)], input=TIMINGS, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    result = CliRunner().invoke(app, ["inspect", "-"], input=TIMINGS, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    stream = ["encode", "-", "-o", str(tmp_path / "talk.fba")]
    assert CliRunner().invoke(app, stream, input=out.read_bytes(), catch_exceptions=False).exit_code == 0


@pytest.mark.parametrize("words", [("animate", "-", "-o", "-"), ("say", "Hello.", "-o", "-")])
def test_nothing_is_written_to_a_file_of_that_name(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="nothing is written to standard output; expected a file's name"):
        CliRunner().invoke(app, list(words), input=TIMINGS, catch_exceptions=False)
    assert not list(tmp_path.iterdir())
