"""Voices of one's own: by module:Class, by entry point, and as objects."""

from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import fapengine
from fapengine.agents.face import _pronounce
from fapengine.batch import work
from fapengine.cli.main import app
from fapengine.errors import FapEngineError, ResourceError, UsageError
from fapengine.voices import choice
from fapengine.voices.choice import OwnVoice, VoiceChoice
from fapengine.voices.process import FreshVoices

MODULE = """
import numpy as np
from fapengine import Phone, PhoneTrack, Speech, UsageError

PHONES = PhoneTrack.from_phones([Phone("m", 0.0, 0.5), Phone("a", 0.5, 1.0)])

class Good:
    said = []
    def __init__(self, name="", rate_wpm=0):
        self.name, self.rate_wpm = name, rate_wpm
    def speak(self, text):
        self.said.append((text, self.name, self.rate_wpm))
        return Speech(samples=np.full(16000, 0.25, np.float32), sample_rate_hz=16000, phones=PHONES)

class Pair(Good):
    def speak(self, text):
        return np.zeros(9), 16000

class Long(Good):
    def speak(self, text):
        return Speech(samples=np.zeros(160), sample_rate_hz=16000, phones=PHONES)

class Listed(Good):
    def speak(self, text):
        return Speech(samples=np.zeros(16000), sample_rate_hz=16000, phones=list(PHONES.phones))

class Broken(Good):
    def speak(self, text):
        raise KeyError("no key")

class Polite(Good):
    def speak(self, text):
        raise UsageError("text: too long")

class Unmade:
    def __init__(self):
        raise OSError("no model")

class Mute:
    pass

number = 3
"""
WRONG = {
    "Pair": (UsageError, r"own_voice:Pair\.speak returned \(array.*expected a fapengine\.Speech"),
    "Long": (UsageError, r"phones: end at 1\.00 s, but the sound lasts 0\.01 s"),
    "Listed": (UsageError, r"phones: got \[Phone"),
    "Broken": (ResourceError, r"voice: own_voice:Broken failed \(KeyError: 'no key'\)"),
    "Polite": (UsageError, r"text: too long"),
    "Unmade": (ResourceError, r"voice: own_voice:Unmade failed \(OSError: no model\)"),
    "Mute": (UsageError, r"voice: own_voice:Mute is .*, expected an object with speak\(text\)"),
    "number": (UsageError, r"voice: own_voice:number is 3, expected a class or a function"),
    "None_": (UsageError, r"voice: own_voice:None_ cannot be imported \(AttributeError"),
}


@pytest.fixture(autouse=True)
def own_voice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_voice.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    monkeypatch.delitem(__import__("sys").modules, "own_voice", raising=False)
    choice.entry_point.cache_clear()


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_voice_is_said(name: str) -> None:
    kind, message = WRONG[name]
    with pytest.raises(kind, match=message):
        fapengine.speak("Hello.", voice=f"own_voice:{name}")


@pytest.mark.parametrize("name", ["no_such_module:Voice", "own voice:Good", "own_voice:", ":Good", "own_voice:a b"])
def test_names_that_nothing_has(name: str) -> None:
    with pytest.raises(UsageError, match="voice: "):
        fapengine.speak("Hello.", voice=name)


def test_a_voice_gets_its_options_and_a_text_without_marks() -> None:
    spoken = fapengine.speak("[laughs] Hello.", voice=VoiceChoice("own_voice:Good", 200))
    import own_voice  # type: ignore[import-not-found]

    assert own_voice.Good.said == [("Hello.", "", 200)]
    assert len(spoken.marks) == 1
    assert spoken.text == "Hello."
    assert spoken.sound is not None
    assert spoken.sound[0].max() == 8192


def test_say_animate_and_batch_take_it(tmp_path: Path) -> None:
    with work._voices() as started_elsewhere:  # by a batch of another test, before this folder could be imported from
        work._voices.cache_clear()
    assert work._voices() is not started_elsewhere
    (tmp_path / "a.csv").write_text("id,text,voice\na,Hello.,own_voice:Good\n")
    (tmp_path / "words.srt").write_text("1\n00:00:00,000 --> 00:00:00,500\nhello\n")
    for words in (
        ("say", "Hello.", "--voice", "own_voice:Good", "-o", "a.fap"),
        ("animate", "words.srt", "--voice", "own_voice:Good", "-o", "b.fap"),
        ("batch", "a.csv", "--to", "fap", "--workers", "0", "-o", "out"),
    ):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    assert (tmp_path / "a.fap").read_bytes() == (tmp_path / "out" / "a.fap").read_bytes()
    assert fapengine.load("b.fap").values.any()


def test_servers_and_agents_take_it(tmp_path: Path) -> None:
    with FreshVoices() as voices:
        assert voices.speak("Hello.", VoiceChoice("own_voice:Good")).duration_s == 1.0
        with pytest.raises(FapEngineError, match="no key"):
            voices.speak("Hello.", VoiceChoice("own_voice:Broken"))
    pronounce = _pronounce(VoiceChoice("own_voice:Good"))
    assert pronounce is not None
    assert [phone.label for phone in pronounce([("hello", 0.0, 0.4)])] == ["m", "a"]


def test_an_entry_point_is_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint("mytts", "own_voice:Good", choice.GROUP)]
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group, name: [each for each in points if each.name == name]
    )
    monkeypatch.syspath_prepend(".")
    fapengine.speak("Hello.", voice="mytts:anna")
    import own_voice

    assert own_voice.Good.said == [("Hello.", "anna", 160)]
    assert isinstance(VoiceChoice("mytts").load(), OwnVoice)
    assert [VoiceChoice(name).is_language for name in ("mytts", "mytts:anna", "de", "en-us", "sissi")] == [
        False, False, True, True, True,
    ]  # fmt: skip
    with pytest.raises(UsageError, match="voice: got 'sissi'"):
        fapengine.speak("Hello.", voice="sissi")


def test_an_object_is_checked_too() -> None:
    class Tuple:
        def speak(self, text: str) -> object:
            return np.zeros(3), 16_000

    with pytest.raises(UsageError, match=r"voice: Tuple\.speak returned"):
        fapengine.speak("Hello.", voice=Tuple())
