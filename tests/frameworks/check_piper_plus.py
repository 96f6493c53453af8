"""A voice of piper-plus by the package itself, in an environment of its own, with a generated model: ``make oracles``.

The data that its English needs are generated, too: a dictionary of five words, and a tagger that calls all words nouns.
"""

import json
import zipfile
from pathlib import Path

import nltk
import pytest

from fapengine.errors import ResourceError
from fapengine.speech import ipa
from fapengine.voices import piper_plus
from fapengine.voices.check import find_breaches
from fapengine.voices.choice import VoiceChoice
from tests.unit.voices.speaking_models import save_piper_plus

LANGUAGES = ("ja", "en", "zh", "es", "fr", "pt")
SPOKEN = {
    "es": ("El perro, mucho.", "elperomutʃo"),
    "fr": ("Bonjour, du pain.", "bɔ̃ʒuʁdypɛ̃"),
    "pt": ("Bom dia.", "bõdʒia"),
    "ja": ("こんにちは。", "konnitɕiwa"),
    "zh": ("你好。", "nixaʊ"),
}
WORDS = {"hello": "HH AH0 L OW1", "mama": "M AA1 M AH0", "we": "W IY1", "see": "S IY1", "nine": "N AY1 N"}


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(nltk.data, "path", [str(tmp_path / "nltk_data")])
    return save_piper_plus(tmp_path / "plus.onnx", languages=LANGUAGES)


@pytest.mark.parametrize("language", SPOKEN)
def test_languages_need_no_network(language: str, model: Path) -> None:
    text, expected = SPOKEN[language]
    speech = VoiceChoice(f"piper-plus:{model}?language={language}").load().speak(text)
    phones = speech.phones.phones
    assert "".join(phone.label.rstrip(piper_plus.TONE) for phone in phones if not phone.is_silence) == expected
    assert all(ipa.letters(phone.label) for phone in phones if not phone.is_silence)
    assert find_breaches(speech.samples, speech.sample_rate_hz, phones) == ()
    assert not speech.remarks


def test_english_needs_its_data(model: Path) -> None:
    with pytest.raises(ResourceError, match=r"python -m nltk\.downloader cmudict"):
        VoiceChoice(f"piper-plus:{model}").load()
    folder = model.parent / "nltk_data"
    for name, files in {
        "corpora/cmudict": {"cmudict": "".join(f"{word.upper()} 1 {phones}\n" for word, phones in WORDS.items())},
        "taggers/averaged_perceptron_tagger": {"averaged_perceptron_tagger.pickle": ""},
        "taggers/averaged_perceptron_tagger_eng": {
            f"averaged_perceptron_tagger_eng.{part}.json": json.dumps(value)
            for part, value in (("weights", {}), ("tagdict", dict.fromkeys(WORDS, "NN")), ("classes", ["NN"]))
        },
    }.items():
        (folder / name).mkdir(parents=True)
        with zipfile.ZipFile(folder / f"{name}.zip", "w") as archive:
            for file, text in files.items():
                (folder / name / file).write_text(text)
                archive.writestr(f"{Path(name).name}/{file}", text)
    speech = VoiceChoice(f"piper-plus:{model}").load().speak("Hello mama. We see nine.")
    phones = [phone for phone in speech.phones.phones if not phone.is_silence]
    assert "".join(phone.label.rstrip("ː") for phone in phones) == "həloʊmɑməwisinaɪn"
    assert list(dict.fromkeys(phone.word for phone in phones)) == ["Hello", "mama", "We", "see", "nine"]
    assert find_breaches(speech.samples, speech.sample_rate_hz, speech.phones.phones) == ()


def test_every_symbol_of_the_package_is_a_sound_or_a_tone() -> None:
    from piper_plus.phonemize.token_mapper import FIXED_PUA_MAPPING

    for name, number in FIXED_PUA_MAPPING.items():
        label = piper_plus._label(chr(number), "es")
        assert label == piper_plus.TONE or ipa.letters(label) or name in ("?!", "?.", "?~"), name
