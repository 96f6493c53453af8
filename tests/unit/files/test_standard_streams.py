"""``-``: standard input is read where a file is; what is one text or stream goes to standard output, nothing else."""

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


@pytest.mark.parametrize("words", [("animate", "-", "-o", "-.mp4"), ("say", "Hello.", "-o", "-.webm")])
def test_nothing_is_written_to_a_file_of_that_name(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="cannot be written to standard output; expected a file's name"):
        CliRunner().invoke(app, list(words), input=TIMINGS, catch_exceptions=False)
    assert not list(tmp_path.iterdir())


def test_a_pipe_of_commands_gives_what_files_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def run(*words: str, data: str | bytes = b"") -> bytes:
        result = CliRunner().invoke(app, list(words), input=data, catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.stdout_bytes

    Path("talk.csv").write_text(TIMINGS)
    run("animate", "talk.csv", "-o", "talk.fap")
    run("encode", "talk.fap", "-o", "talk.fba")
    run("decode", "talk.fba", "-o", "back.fap")
    run("convert", "back.fap", "-o", "shapes.csv")
    run("convert", "shapes.csv", "-o", "again.fap")
    before = sorted(path.name for path in tmp_path.iterdir())
    faps = run("animate", "-", "-o", "-", data=TIMINGS)
    assert faps == Path("talk.fap").read_bytes()
    stream = run("encode", "-", "-o", "-", data=faps)
    assert stream == Path("talk.fba").read_bytes()
    decoded = run("decode", "-", "-o", "-", data=stream)
    assert decoded == Path("back.fap").read_bytes()
    table = run("convert", "back.fap", "-o", "-")
    assert table == Path("shapes.csv").read_bytes()
    assert run("convert", "shapes.csv", "-o", "-.fap") == Path("again.fap").read_bytes()
    assert run("convert", "back.fap", "--shapes", "rhubarb", "-o", "-").startswith(b"{")
    assert sorted(path.name for path in tmp_path.iterdir()) == before
