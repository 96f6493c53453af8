"""A voice of piper-plus: a generated model speaks, and a stand-in for the package spells.

The package itself, with the same model: tests/frameworks/check_piper_plus.py (make oracles).
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest

from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.voices import piper_plus
from fapengine.voices.check import find_breaches
from fapengine.voices.choice import VoiceChoice
from tests.unit.voices.speaking_models import save_piper_plus

PRIVATE = {"rr": 0xE01D, "tʃ": 0xE054, "N_uvular": 0xE01C, "sh": 0xE010, "tone2": 0xE047, "y_vowel": 0xE01E}
SPELT = {"ll": "j", "rr": chr(PRIVATE["rr"]), "ch": chr(PRIVATE["tʃ"]), "á": "ˈa", "í": "ˈi", "n'": chr(0xE01C),
         "sh": chr(PRIVATE["sh"]),
         "2": chr(PRIVATE["tone2"]), "ü": chr(PRIVATE["y_vowel"]), "h": "", "y": "i"}  # fmt: skip


class Speller:
    """Stand-in for the package's phonemizer: a symbol for each letter, or for two."""

    def __init__(self, languages: Sequence[str], default_latin_language: str) -> None:
        assert default_latin_language in languages

    def phonemize(self, text: str) -> list[str]:
        return [*re.sub("|".join(SPELT), lambda found: SPELT[found[0]], text.lower())]


def find(place: str) -> str:
    raise LookupError(place)


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(piper_plus, "multilingual", SimpleNamespace(MultilingualPhonemizer=Speller))
    monkeypatch.setattr(piper_plus, "token_mapper", SimpleNamespace(FIXED_PUA_MAPPING=PRIVATE))
    sentences = SimpleNamespace(split_sentences=lambda text: re.findall(r"\S[^.!?]*[.!?]*", text))
    monkeypatch.setattr(piper_plus, "text_splitter", sentences)
    monkeypatch.setattr(piper_plus, "nltk_data", SimpleNamespace(find=find))
    return save_piper_plus(tmp_path / "plus.onnx", speakers=3)


def labels(name: str, text: str) -> list[str]:
    phones = VoiceChoice(name).load().speak(text).phones.phones
    return [phone.label for phone in phones if not phone.is_silence]


@pytest.mark.parametrize("rate_wpm", [100, 160, 300])
def test_phones_and_words_lie_where_they_sound(model: Path, rate_wpm: int) -> None:
    speech = VoiceChoice(f"piper-plus:{model}?language=es", rate_wpm).load().speak("Hola mamá. Mi perro, y muchas!")
    phones = speech.phones.phones
    assert [phone.label for phone in phones if not phone.is_silence] == [*"olamamamipe", "r", *"oimu", "tʃ", *"as"]
    assert find_breaches(speech.samples, speech.sample_rate_hz, phones) == ()
    words = dict.fromkeys(phone.word for phone in phones if phone.word)
    assert [*words] == ["Hola", "mamá", "Mi", "perro", "y", "muchas"]
    assert [phone.stress for phone in phones if phone.label == "a"] == [0, 0, 1, 0]
    assert phones[-1].end_s == pytest.approx(speech.duration_s)
    assert not speech.remarks


def test_the_rate_is_obeyed(model: Path) -> None:
    voices = [VoiceChoice(f"piper-plus:{model}?language=es", rate).load() for rate in (80, 320)]
    slow, fast = (voice.speak("mama").duration_s for voice in voices)
    assert 2.5 < slow / fast < 4.5


def test_japanese_labels_are_japanese(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        piper_plus, "nltk_data", SimpleNamespace(find=str)
    )  # the stand-in's Japanese is in Latin letters
    assert labels(f"piper-plus:{model}?language=ja", "n'jsho") == ["ɴ", "dʑ", "ɕ", "o"]
    assert labels(f"piper-plus:{model}?language=es", "jü") == ["j", "y"]


def test_tones_and_accents_are_no_sounds(model: Path) -> None:
    speech = VoiceChoice(f"piper-plus:{model}?language=es").load().speak("ma2mi")
    assert [phone.label.rstrip(piper_plus.TONE) for phone in speech.phones.phones] == ["_", "m", "a", "m", "i"]
    assert not speech.remarks


def test_symbols_that_the_model_lacks_are_reported(model: Path) -> None:
    speech = VoiceChoice(f"piper-plus:{model}?language=es").load().speak("maßi ma")
    assert speech.remarks == ("text: plus.onnx has no symbol 'ß', which is not spoken",)


def test_english_without_its_data_says_how_to_get_it(model: Path) -> None:
    for name, text in ((f"piper-plus:{model}", "Hello."), (f"piper-plus:{model}?language=ja", "a robot")):
        with pytest.raises(ResourceError, match=r"python -m nltk\.downloader cmudict averaged_perceptron_tagger av"):
            VoiceChoice(name).load().speak(text)


def test_wrong_names_and_files_are_told(model: Path, tmp_path: Path) -> None:
    name = f"piper-plus:{model}"
    silent = save_piper_plus(tmp_path / "silent.onnx", told=False)
    wrong = tmp_path / "wrong.onnx"
    wrong.write_bytes(b"no model")
    for bad, error, message in (
        ("piper-plus:", UsageError, "expected piper-plus:/path"),
        (f"{name}?language=sv", UsageError, "got language 'sv', expected one of .*: ja, en, es"),
        (f"{name}?language=es&speaker=7", UsageError, "speaker '7', expected one of .*: a number less than 3"),
        (f"piper-plus:{wrong}", UsageError, "file not found: .*wrong.onnx.json"),
        (f"piper-plus:{silent}", DataError, "without an output 'durations'"),
    ):
        with pytest.raises(error, match=message):
            VoiceChoice(bad).load()
    description = json.loads(Path(f"{model}.json").read_text())
    Path(f"{wrong}.json").write_text(json.dumps(description))
    with pytest.raises(DataError, match="cannot be read as a voice of piper-plus"):
        VoiceChoice(f"piper-plus:{wrong}").load()
    for key, value, message in (
        ("language_id_map", {"sv": 0}, "got no language of piper-plus, expected one of en, es"),
        ("phoneme_id_map", {"a": [1]}, r"got no symbol of piper-plus, expected one of \$, \^, _"),
    ):
        Path(f"{model}.json").write_text(json.dumps({**description, key: value}))
        with pytest.raises(DataError, match=message):
            VoiceChoice(f"{name}?language=es").load()
    Path(f"{model}.json").unlink()
    (model.parent / "config.json").write_text(json.dumps(description))
    assert labels(f"{name}?language=es&speaker=2", "mi") == ["m", "i"]
    with pytest.raises(UsageError, match="contains nothing to speak"):
        labels(f"{name}?language=es", "...")
    with pytest.raises(UsageError, match="too long, expected at most 1 s"):
        VoiceChoice(f"{name}?language=es").load(1.0).speak("mama mama mama mama mama")
