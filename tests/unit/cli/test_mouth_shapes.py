"""``--shapes rhubarb`` of say, animate and convert."""

import json
from pathlib import Path

import pytest

import fapengine
from fapengine.errors import UsageError
from fapengine.speech.formats.registry import parse_timings
from tests.command import run


def test_say_writes_shapes_and_the_sound_that_they_name(tmp_path: Path) -> None:
    said = run("say", "My baby.", "--shapes", "rhubarb", "-o", tmp_path / "talk.json")
    assert "visemes" in said
    written = json.loads((tmp_path / "talk.json").read_text())
    assert Path(written["metadata"]["soundFile"]) == (tmp_path / "talk.wav").resolve()
    assert sum(cue["value"] == "A" for cue in written["mouthCues"]) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["talk.json", "talk.wav"]


def test_animate_and_convert_write_them_too(tmp_path: Path) -> None:
    (tmp_path / "m.lab").write_text("0 2000000 m\n2000000 5000000 ay\n", encoding="utf-8")
    run("animate", tmp_path / "m.lab", "--shapes", "rhubarb", "-o", tmp_path / "m.tsv")
    assert (tmp_path / "m.tsv").read_text() == "0.00\tA\n0.20\tD\n0.38\tB\n0.50\tX\n"
    run("animate", tmp_path / "m.lab", "-o", tmp_path / "m.fap")
    run("convert", tmp_path / "m.fap", "--shapes", "rhubarb", "-o", tmp_path / "m.xml")
    assert parse_timings((tmp_path / "m.xml").read_bytes()).phones[0].label == "p"


def test_performance_and_save_write_them(tmp_path: Path) -> None:
    hello = fapengine.speak("My.")
    hello.save(tmp_path / "phones.dat", shapes="rhubarb")
    fapengine.save(hello.track, tmp_path / "motion.dat", shapes="rhubarb")
    for name in ("phones.dat", "motion.dat"):
        assert (tmp_path / name).read_text().startswith("MohoSwitch1\n1 X\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("say", "Hi.", "-o", "talk.json"), "--shapes: got none for talk.json, expected --shapes mpeg4"),
        (("say", "Hi.", "--shapes", "rhubarb", "-o", "talk.mp4"), "--output: got talk.mp4"),
        (("convert", "a.fap", "--shapes", "oculus", "-o", "a.xml"), "--shapes: got oculus"),
    ],
)
def test_names_and_shapes_that_do_not_belong_together_are_refused(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        run(*arguments)
