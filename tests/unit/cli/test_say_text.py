"""Texts that ``say`` gets: any bytes, words of an expression, markup, scripts."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import UsageError
from fapengine.mpeg4.track import FapTrack  # noqa: F401  imported once, so that each call is short


def say(out: Path, *options: str, stdin: bytes | None = None) -> str:
    done = CliRunner().invoke(app, ["say", *options, "-o", str(out / "a.fap")], input=stdin)
    if done.exception is not None:
        raise done.exception
    return done.stderr


@pytest.mark.parametrize(
    "data", [b"say it \xff now", b"\xff\xfeh\x00i\x00", b"\0hello\x00\x1b[31m", b"\xed\xa0\x80 hi"]
)
def test_any_bytes_are_spoken(tmp_path: Path, data: bytes) -> None:
    told = say(tmp_path, "-", stdin=data)
    assert (tmp_path / "a.fap").stat().st_size > 1000
    assert ("no UTF-8" in told) == (data[:3] in (b"say", b"\xed\xa0\x80"))


@pytest.mark.parametrize("data", [b"", b"\xff\xff", b"\0\x07"])
def test_nothing_to_speak_is_a_line(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(UsageError, match="contains nothing to speak"):
        say(tmp_path, "-", stdin=data)


@pytest.mark.parametrize(
    ("voice", "text", "word"),
    [
        ("en", "We'll be happy", "we'll"), ("en", "We’ll be happy", "we'll"), ("en", "In 1984 we were", "1984"),
        ("en", "Good morning, all", "good morning"), ("fr", "J'aime le cafe\u0301", "café"), ("zh", "你好世界", "世界"),
        ("hi", "नमस्ते दुनिया", "नमस्ते"), ("en", "At 9 a.m. on the 21st", "a.m."),
    ],
)  # fmt: skip
def test_an_expression_finds_its_word(tmp_path: Path, voice: str, text: str, word: str) -> None:
    assert say(tmp_path, text, "--voice", voice, "--expression", f"joy:0.5@{word}") == ""
    with pytest.raises(UsageError, match="expected one of"):
        say(tmp_path, text, "--voice", voice, "--expression", "joy:0.5@absent")


def test_markup_and_scripts_are_told(tmp_path: Path) -> None:
    text = "Hello <emphasis>big</emphasis> world"
    assert "--ssml obeys it" in say(tmp_path, text)
    assert "SSML" not in say(tmp_path, text, "--ssml")
    assert "does not read Arabic" in say(tmp_path, "Say مرحبا")
    with pytest.raises(UsageError, match="well-formed"):
        say(tmp_path, "a & b", "--ssml")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([], "text: missing; give a text, or use --live --mic to speak"),
        (["--mic"], "--mic: requires --live"),
        (["--live", "--mic", "Hello."], "--mic: cannot be used with a text"),
        (["--live", "--mic-device", "1", "Hello."], "--mic: cannot be used with a text"),
        (["--live", "--mic", "-e", "joy@hello"], "--expression: cannot have times or words with a microphone"),
    ],
)
def test_a_microphone_takes_no_text(tmp_path: Path, options: list[str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        say(tmp_path, *options)
