"""What was accepted in silence: rates that were missed, silence, sounds of another length, options without effect."""

import csv
import logging
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.cli.main import app
from fapengine.errors import UsageError
from fapengine.files.sound import save_wav
from fapengine.speech.plausible import remarks_on, sound_remarks

PHONES = fapengine.PhoneTrack.from_phones([fapengine.Phone("ma"[n % 2], 0.1 * n, 0.1 * n + 0.1) for n in range(12)])
MISSED = "kbit/s is more than the 0.5 asked for"


def test_a_bit_rate_that_is_missed_is_said_in_python_and_in_a_batch(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    talk = fapengine.animate(PHONES)
    with caplog.at_level(logging.WARNING):
        talk.save(tmp_path / "a.fba", kbit_s=0.5)
        assert MISSED in caplog.text
        caplog.clear()
        talk.save(tmp_path / "a.fba", kbit_s=50)
    assert caplog.text == ""
    (tmp_path / "a.pho").write_text("m 100\na 100\n" * 6)
    (tmp_path / "rows.csv").write_text("id,timings,kbps\na,a.pho,0.5\n")
    words = ["batch", str(tmp_path / "rows.csv"), "--to", "fba", "--workers", "0", "-o", str(tmp_path / "out")]
    assert CliRunner().invoke(app, words).exit_code == 0
    (row,) = csv.DictReader((tmp_path / "out" / "index.csv").read_text().splitlines())
    assert MISSED in row["other"]
    assert row["remarks"] == "1"


def test_a_sound_of_another_length_is_remarked() -> None:
    tone = np.tile(np.array([3000, -3000], np.int16), 80_000)
    (long,) = sound_remarks((tone, 16_000), PHONES)
    assert long.startswith("sound: it lasts 10.00 s, but the timings end at 1.20 s")
    assert sound_remarks((tone[:48_000], 16_000), PHONES) == ()
    (short,) = sound_remarks((tone[:8_000], 16_000), PHONES)
    assert short.startswith("sound: it ends at 0.50 s, but the timings end at 1.20 s")


def test_silence_alone_is_remarked() -> None:
    quiet = fapengine.PhoneTrack.from_phones([fapengine.Phone("_", 0.0, 1.0)])
    assert remarks_on(quiet)[0].startswith("phones: there is nothing but silence")
    assert remarks_on(fapengine.PhoneTrack.from_phones([])) == ()


@pytest.mark.parametrize("name", ["format", "tier", "alphabet", "columns"])
def test_options_of_files_do_not_go_with_phones(name: str) -> None:
    with pytest.raises(UsageError, match=f"{name}: got 'x', but phones are no file"):
        fapengine.animate(PHONES, **{name: "x"})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sya", "Hi."], "command: got 'sya', did you mean say?"),
        (["frobnicate"], "command: got 'frobnicate', expected one of say, serve"),
        (
            ["animate", "a.wav", "--transcript-file", "hello"],
            "--transcript-file: file not found: hello; --transcript takes the words",
        ),
    ],
)
def test_commands_and_texts_that_are_not_there(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_wav(tmp_path / "a.wav", np.zeros(1600, np.int16), 16_000)
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, UsageError)
    assert str(done.exception).startswith(message)
