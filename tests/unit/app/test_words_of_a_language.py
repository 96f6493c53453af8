"""Timed words are read in the language of the file, in Python, on the command line and in a batch."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.app.hearing import Hearing, _Pronouncer
from fapengine.batch.rows import Options, Row
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.files.sound import save_wav
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.voices.choice import VoiceChoice

pytest.importorskip("espeakng_loader")
WORDS = ("vous", "allez", "bien")


def whisper(path: Path, language: str | None, words: tuple[str, ...] = WORDS) -> Path:
    rows = [{"word": word, "start": 0.4 * n, "end": 0.4 * n + 0.4} for n, word in enumerate(words)]
    path.write_text(json.dumps({"language": language, "segments": [{"words": rows}]}))
    return path


def labels(track: PhoneTrack) -> str:
    return " ".join(phone.label for phone in track.phones)


@pytest.mark.parametrize("named", ["fr", "french", "French", "fr-FR", "fra", "fre", "fr_CA"])
def test_words_are_read_in_the_language_of_the_file(tmp_path: Path, named: str) -> None:
    read = fapengine.animate(whisper(tmp_path / "talk.json", named))
    assert labels(read.phones) == labels(fapengine.animate(tmp_path / "talk.json", voice="fr").phones)
    assert any(remark.startswith("words read in fr") and "(from the file)" in remark for remark in read.remarks)
    assert fapengine.animate(tmp_path / "talk.json", strict=True).remarks == read.remarks


def test_a_voice_or_language_that_is_given_goes_before(tmp_path: Path) -> None:
    talk = whisper(tmp_path / "talk.json", "fr")
    english = labels(fapengine.animate(talk, voice="en-us").phones)
    assert english != labels(fapengine.animate(talk).phones)
    assert labels(fapengine.animate(talk, language="english").phones) == english
    with pytest.raises(UsageError, match="martian"):
        fapengine.animate(talk, language="martian")


def test_without_a_language_the_words_are_english_and_that_is_said(tmp_path: Path) -> None:
    read = fapengine.animate(whisper(tmp_path / "talk.json", None), strict=True)
    assert read.remarks[0].startswith("words read in en-us: the file names no language")


def test_a_language_without_a_voice_is_read_in_english_with_a_remark(tmp_path: Path) -> None:
    talk = whisper(tmp_path / "talk.json", "tagalog")
    assert "no voice speaks 'tagalog'" in fapengine.animate(talk).remarks[0]
    with pytest.raises(DataError, match="no voice speaks 'tagalog'"):
        fapengine.animate(talk, strict=True)


def test_a_transcript_s_language_may_be_named_in_english() -> None:
    said = [" ".join(phone.label for phone in _Pronouncer(name)("vous")) for name in ("french", "fr", "en-us")]
    assert said[0] == said[1] != said[2]
    row = Row(id="a", options=Options(language="french", voice="de"), line=1, audio=Path("a.wav"), text="Vous.")
    assert row.voice == VoiceChoice("fr")


@pytest.mark.parametrize("named", [None, "xx", "en"])
def test_a_script_that_nobody_reads_is_refused(tmp_path: Path, named: str | None) -> None:
    talk = whisper(tmp_path / "talk.json", named, ("привет", "мир"))
    with pytest.raises(
        DataError, match=r"talk\.json: words: voice 'en-us' does not read Cyrillic.*voice=CODE.* be, bg"
    ):
        fapengine.animate(talk)
    assert "does not read Cyrillic" in " ".join(fapengine.animate(talk, voice="en-us").remarks)


def test_the_command_line_and_a_batch_read_the_same(tmp_path: Path) -> None:
    whisper(tmp_path / "talk.json", "fr")
    said = CliRunner().invoke(app, ["animate", str(tmp_path / "talk.json"), "-o", str(tmp_path / "a.fap")])
    assert "read in fr (from the file); --voice CODE reads them in another" in " ".join(said.output.split())
    whisper(tmp_path / "strange.json", "tagalog")
    (tmp_path / "all.csv").write_text("id,timings\none,talk.json\ntwo,strange.json\n")
    out = tmp_path / "out"
    done = CliRunner().invoke(
        app, ["batch", str(tmp_path / "all.csv"), "-o", str(out), "--to", "fap", "--workers", "0", "--json"]
    )
    index = {row["id"]: row for row in csv.DictReader((out / "index.csv").read_text().splitlines())}
    assert int(index["one"]["phones"]) == sum(
        not phone.is_silence for phone in fapengine.animate(tmp_path / "talk.json", voice="fr").phones.phones
    )
    assert list(json.loads(done.stdout)["remarks"]) == ["two"]
    assert "two: words: no voice speaks 'tagalog'" in done.stderr
    assert "no voice speaks" in index["two"]["words"]
    assert (index["one"]["remarks"], index["two"]["remarks"]) == ("0", "1")


def test_python_reads_a_file_as_the_command_line_does(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("von,bis,laut\n0,80,m\n80,200,ao\n200,300,m\n")
    read = fapengine.animate(
        tmp_path / "list.csv", format="table", columns="start=von,end=bis,label=laut,unit=ms", alphabet="arpabet"
    )
    assert [(phone.label, round(phone.end_s, 3)) for phone in read.phones.phones] == [
        ("m", 0.08),
        ("ɔ", 0.2),
        ("m", 0.3),
    ]
    with pytest.raises(UsageError, match="tier"):
        fapengine.animate(tmp_path / "list.csv", format="table", columns="start=von,end=bis,label=laut", tier="a")


def test_strict_holds_for_recordings_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard = Hearing(PhoneTrack.from_phones([Phone("QQ", 0.0, 0.5)]), (), (), ())
    monkeypatch.setattr("fapengine.app.hearing.hear", lambda path, how: heard)
    save_wav(tmp_path / "talk.wav", np.tile(np.array([900, -900], np.int16), 8000), 16000)
    assert "unknown phone 'QQ'" in fapengine.animate(tmp_path / "talk.wav").remarks[0]
    with pytest.raises(DataError, match="unknown phone 'QQ'"):
        fapengine.animate(tmp_path / "talk.wav", strict=True)
