"""``inspect`` of timings, and what ``animate`` and ``say`` do with words, alphabets and unknown phones."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.pictures import LIPS, MAX_ROWS, OTHER, ROUND, SILENT, UNKNOWN, VOWEL, colour, draw_timeline
from fapengine.files.sound import save_wav
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from tests.command import run


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    path = tmp_path / "odd.lab"
    path.write_text("0 2000000 m\n2000000 3000000 §§\n3000000 4000000 §§\n4000000 6000000 ay\n", encoding="utf-8")
    return path


def test_inspect_shows_the_timeline(odd: Path, tmp_path: Path) -> None:
    said = run("inspect", odd, "--plot", tmp_path / "line.png")
    assert "htk" in said
    assert "4 phones, 0.60 s of speech in 0.60 s" in said
    assert "'§§' 2 times, first at 0.200 s" in said
    picture = np.asarray(Image.open(tmp_path / "line.png"))
    assert picture.shape[1:] == (1400, 3)
    for fill in (LIPS, VOWEL, UNKNOWN):
        assert (picture == fill).all(axis=-1).sum() > 1000


def test_inspect_as_json(odd: Path) -> None:
    report = json.loads(run("inspect", odd, "--json"))
    assert (report["format"], report["level"], report["phones"], report["duration_s"]) == ("htk", "phone", 4, 0.6)
    assert report["timeline"][3] == {"start_s": 0.4, "end_s": 0.6, "label": "aɪ", "stress": 0, "word": ""}
    assert len(report["unknown"]) == 1


def test_inspect_takes_the_wishes_that_animate_takes(tmp_path: Path) -> None:
    tiers = "".join(
        f'"IntervalTier"\n"{name}"\n0\n1\n1\n0\n1\n"{label}"\n' for name, label in (("a", "m"), ("b", "AY1"))
    )
    (tmp_path / "two.TextGrid").write_text(
        f'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n1\n<exists>\n2\n{tiers}'
    )
    with pytest.raises(DataError, match="tier"):
        run("inspect", tmp_path / "two.TextGrid")
    report = json.loads(run("inspect", tmp_path / "two.TextGrid", "--tier", "b", "--alphabet", "arpabet", "--json"))
    assert report["timeline"][0]["label"] == "aɪ"
    assert (
        json.loads(run("inspect", tmp_path / "two.TextGrid", "--format", "textgrid", "--tier", "a", "--json"))["phones"]
        == 1
    )


def test_inspect_of_long_files_and_words(tmp_path: Path) -> None:
    long = tmp_path / "long.pho"
    long.write_text("m 100\n" * 60)
    assert "and 20 more: --all" in run("inspect", long)
    assert "more" not in run("inspect", long, "--all")
    words = tmp_path / "words.align"
    words.write_text("0 10000 [bold]my\n10000 20000 oh\n")
    said = run("inspect", words)
    assert "These are words" in said
    assert "[bold]my" in said
    assert "unknown" not in said


def test_inspect_of_what_nobody_knows(tmp_path: Path) -> None:
    (tmp_path / "tale").write_text("once upon a time")
    with pytest.raises(UnsupportedError, match="phone timings"):
        run("inspect", tmp_path / "tale")


def test_animate_pronounces_words(tmp_path: Path) -> None:
    pytest.importorskip("espeakng_loader")
    words = tmp_path / "words.align"
    words.write_text("0 10000 mama\n10000 20000 sil\n")
    report = json.loads(run("animate", words, "-o", tmp_path / "talk.fap", "--json"))
    assert (report["level"], report["phones"], report["unknown_phones"]) == ("word", 4, [])
    assert report["duration_s"] == pytest.approx(0.8)


def test_unknown_phones_are_counted_or_refused(odd: Path, tmp_path: Path) -> None:
    said = CliRunner().invoke(app, ["animate", str(odd), "-o", str(tmp_path / "talk.fap"), "--json"])
    report = json.loads(said.stdout)
    assert report["unknown_phones"] == [{"label": "§§", "count": 2, "first_s": 0.2, "stand_in": "ə"}]
    assert report["remarks"] == ["unknown phone '§§' 2 times, first at 0.200 s; /ə/ is used instead"]
    assert "fapengine: unknown phone '§§' 2 times" in said.stderr
    with pytest.raises(DataError, match=r"unknown phone '§§' 2 times, first at 0\.200 s.*odd\.lab"):
        run("animate", odd, "-o", tmp_path / "talk.fap", "--strict")


def test_animate_format_and_alphabet(odd: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"odd\.lab: Rhubarb XML: no XML"):
        run("animate", odd, "--format", "rhubarb-xml", "-o", tmp_path / "talk.fap")
    with pytest.raises(UsageError, match="--format: unknown value 'doc'"):
        run("animate", odd, "--format", "doc", "-o", tmp_path / "talk.fap")
    with pytest.raises(UsageError, match="alphabet: unknown value 'runes'"):
        run("animate", odd, "--alphabet", "runes", "-o", tmp_path / "talk.fap")


def test_say_strictly(tmp_path: Path) -> None:
    pytest.importorskip("espeakng_loader")
    assert "FAPs" in run("say", "Mama.", "--strict", "-o", tmp_path / "talk.fap")


@pytest.mark.parametrize(
    ("label", "expected"),
    [(SILENCE, SILENT), ("m", LIPS), ("f", LIPS), ("u", ROUND), ("aɪ", VOWEL), ("t", OTHER), ("%", UNKNOWN)],
)  # fmt: skip
def test_colours_tell_what_is_seen(label: str, expected: tuple[int, int, int]) -> None:
    assert colour(Phone(label, 0.0, 1.0)) == expected


def test_timeline_grows_with_speech_up_to_a_bound() -> None:
    heights = [
        draw_timeline(PhoneTrack((Phone("m", 0.0, length_s),))).shape[0] for length_s in (0.5, 9.0, 1000.0, 9000.0)
    ]
    assert heights[0] < heights[1] < heights[2] == heights[3]
    assert heights[2] < 150 * MAX_ROWS
    assert draw_timeline(PhoneTrack(())).shape[0] == heights[0]


def test_the_guessed_alphabet_is_printed_and_two_readings_are_refused(tmp_path: Path) -> None:
    timit = tmp_path / "talk.lab"
    timit.write_text("0 1000000 sh\n1000000 2000000 iy\n2000000 3000000 bcl\n3000000 4000000 pho\n")
    assert "labels read as arpabet (guessed)" in run("inspect", timit)
    said = CliRunner().invoke(app, ["inspect", str(timit)]).stderr
    assert "warning: unknown phone 'pho' once, first at 0.300 s; /p h o/ is used instead" in said
    report = json.loads(run("inspect", timit, "--json"))
    assert (report["alphabet"], report["alphabet_guessed"], report["alphabet_could_be"]) == ("arpabet", True, [])
    said = run("animate", timit, "-o", tmp_path / "talk.fap")
    assert "labels read as arpabet (guessed)" in said
    with pytest.raises(DataError, match="unknown phone 'pho' once"):
        run("animate", timit, "-o", tmp_path / "talk.fap", "--strict")
    two = tmp_path / "two.lab"
    two.write_text("0 1000000 m\n1000000 2000000 ao\n2000000 3000000 t\n")
    assert "ipa and pinyin would fit as well" in run("animate", two, "-o", tmp_path / "talk.fap")
    with pytest.raises(DataError, match=r"ipa and pinyin would fit as well.*two\.lab"):
        run("animate", two, "-o", tmp_path / "talk.fap", "--strict")
    assert "labels read" not in run("animate", two, "--alphabet", "pinyin", "--strict", "-o", tmp_path / "talk.fap")
    report = json.loads(run("animate", two, "--alphabet", "pinyin", "--json", "-o", tmp_path / "new.fap"))
    assert (report["alphabet"], report["alphabet_guessed"]) == ("pinyin", False)


def test_a_sound_that_ends_before_its_timings_is_told_and_nothing_is_cut(tmp_path: Path) -> None:
    talk = tmp_path / "talk.pho"
    talk.write_text("m 400\na 1600\n")
    save_wav(tmp_path / "short.wav", np.zeros(8000, np.int16), 16000)
    result = CliRunner().invoke(
        app, ["animate", str(talk), "--audio", str(tmp_path / "short.wav"), "-o", str(tmp_path / "talk.fap"), "--json"]
    )
    assert "it ends at 0.50 s, but the timings end at 2.00 s" in result.stderr
    assert json.loads(result.stdout)["duration_s"] == pytest.approx(2.0)
    save_wav(tmp_path / "right.wav", np.tile(np.array([900, -900], np.int16), 15500), 16000)
    fine = CliRunner().invoke(
        app, ["animate", str(talk), "--audio", str(tmp_path / "right.wav"), "-o", str(tmp_path / "new.fap"), "--json"]
    )
    assert fine.stderr == ""
