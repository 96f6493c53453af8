"""Voices of models of the user's own, with small models that are made here: what is heard, and when, is known."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from kokoro_onnx.config import DEFAULT_VOCAB
from typer.testing import CliRunner

import fapengine
from fapengine.cli.main import app
from fapengine.errors import DataError, UsageError
from fapengine.speech import ipa
from fapengine.speech.formats.synthesizers import piper_entries
from fapengine.speech.marks import read_marks
from fapengine.voices import piper
from fapengine.voices.check import find_breaches
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.kokoro import lengths_of as kokoro_lengths
from fapengine.voices.model_speech import Spoken, choices_of, speech_of, spoken
from fapengine.voices.protocol import Speech
from tests.unit.voices.speaking_models import UNITS, UNITS_OF, save_kokoro, save_piper

TEXT = "Hello mama, I go away. Then we see nine people!"
WORDS = ["Hello", "mama", "I", "go", "away", "Then", "we", "see", "nine", "people"]
SOUNDS = "h ə l o ʊ m ɑ m ɐ a ɪ ɡ o ʊ ɐ w e ɪ ð ɛ n w i s i n a ɪ n p i p ə l".split()  # noqa: SIM905


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("models")
    save_piper(folder / "piper.onnx")
    save_kokoro(folder / "kokoro.onnx", DEFAULT_VOCAB, ["af_heart", "bm_george"])
    return {
        "piper": f"piper:{folder}/piper.onnx",
        "kokoro": f"kokoro:{folder}/kokoro.onnx?voices={folder}/voices.bin&voice=af_heart",
    }


def words_in(speech: Speech) -> list[str]:
    words = [phone.word for phone in speech.phones.phones if phone.word]
    return [word for n, word in enumerate(words) if n == 0 or words[n - 1] != word]


@pytest.mark.parametrize("kind", ["piper", "kokoro"])
def test_phones_lie_where_they_sound(kind: str, names: dict[str, str]) -> None:
    speech = VoiceChoice(names[kind]).load().speak(TEXT)
    phones = speech.phones.phones
    assert [phone.label.rstrip("ː") for phone in phones if not phone.is_silence] == SOUNDS
    assert find_breaches(speech.samples, speech.sample_rate_hz, phones, spoken=[
        phone.label for phone in phones if not phone.is_silence]) == ()  # fmt: skip
    assert words_in(speech) == WORDS
    assert speech.sample_rate_hz == {"piper": 22_050, "kokoro": 24_000}[kind]
    assert {phone.stress for phone in phones} >= {0, 1}
    assert not speech.remarks


def test_pipers_lengths_are_the_models(names: dict[str, str]) -> None:
    speech = VoiceChoice(names["piper"]).load().speak("so")
    symbols = [*"^sˈoʊ.$"]  # as Piper's espeak-ng writes it, its full stop added
    units = sum(UNITS_OF.get(symbol, 7) + (symbol != "$") for symbol in symbols if symbol != ".")
    assert len(speech.samples) == UNITS["piper"] * units
    phones = {phone.label: phone for phone in speech.phones.phones}
    assert phones["ʊ"].start_s == pytest.approx((7 + 8 + 3 + 8) * UNITS["piper"] / 22_050, abs=0.002)
    assert phones["ʊ"].word == "so"


@pytest.mark.parametrize("kind", ["piper", "kokoro"])
def test_the_rate_is_obeyed(kind: str, names: dict[str, str]) -> None:
    slow, usual, fast = (VoiceChoice(names[kind], rate).load().speak("mama").duration_s for rate in (80, 160, 320))
    assert slow > 1.4 * usual > 1.8 * fast


@pytest.mark.parametrize("kind", ["piper", "kokoro"])
def test_marks_come_at_their_words(kind: str, names: dict[str, str]) -> None:
    speech = VoiceChoice(names[kind]).load().speak("Hello mama. [laughs] Nine people.")
    nine = next(phone for phone in speech.phones.phones if phone.word == "Nine")
    assert [mark.at_s for mark in speech.marks] == [pytest.approx(nine.start_s, abs=0.05)]
    assert "laughs" not in words_in(speech)


def test_the_command_line_speaks_with_a_model(names: dict[str, str], tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["say", "Hello mama.", "--voice", names["kokoro"], "-o", str(tmp_path / "a.fap")])
    assert done.exit_code == 0, done.output
    assert len(fapengine.load(tmp_path / "a.fap").values) > 20


def test_a_speaker_is_chosen(tmp_path: Path) -> None:
    path = save_piper(tmp_path / "many.onnx", speakers={"anna": 0, "bert": 1})
    for speaker in ("anna", "bert", "1"):
        assert VoiceChoice(f"piper:{path}?speaker={speaker}").load().speak("so").duration_s > 0.3
    with pytest.raises(UsageError, match=r"speaker 'carl', expected one of .*many.onnx: anna, bert"):
        VoiceChoice(f"piper:{path}?speaker=carl").load()


@pytest.mark.parametrize("kind", ["piper", "kokoro"])
def test_what_cannot_be_spoken_is_said(kind: str, names: dict[str, str]) -> None:
    voice = VoiceChoice(names[kind])
    for text in ("", "…", " . "):
        with pytest.raises(UsageError, match="contains nothing to speak"):
            voice.load().speak(text)
    with pytest.raises(UsageError, match="too long, expected at most 1 s"):
        voice.load(1.0).speak(TEXT)


def test_wrong_names_and_files_are_told(names: dict[str, str], tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.onnx"
    wrong.write_bytes(b"no model")
    kokoro, _, rest = names["kokoro"].partition("?")
    hidden = save_kokoro(tmp_path / "hidden.onnx", DEFAULT_VOCAB, ["af_heart"], told=False)
    for name, error, message in (
        ("piper:", UsageError, "expected piper:/path"),
        (f"{names['piper']}?voice=x", UsageError, "speaker=…"),
        (f"piper:{tmp_path}/none.onnx", UsageError, "file not found"),
        (f"piper:{wrong}", UsageError, r"wrong.onnx.json"),
        (kokoro, UsageError, "voices=/path"),
        (f"{kokoro}?{rest.replace('af_heart', 'nobody')}", UsageError, "use one of .*af_heart, bm_george"),
        (f"kokoro:{wrong}?{rest}", DataError, "cannot be read as a model of Kokoro"),
        (f"kokoro:{hidden}?{rest}", DataError, "without an output 'duration'"),
    ):
        with pytest.raises(error, match=message):
            VoiceChoice(name).load()
    with pytest.raises(UsageError, match="must be 80 to 320"):
        VoiceChoice(names["kokoro"], 400).load()
    Path(f"{wrong}.json").write_text("{}")
    with pytest.raises(DataError, match="cannot be read as a voice of Piper"):
        VoiceChoice(f"piper:{wrong}").load()
    silent = VoiceChoice(f"piper:{save_piper(tmp_path / 'silent.onnx', told=False)}").load()
    with pytest.raises(DataError, match="gives no lengths of phones"):
        silent.speak("so")


@pytest.mark.parametrize(("package", "extra"), [("piper", "piper"), ("onnx", "piper"), ("kokoro_onnx", "kokoro")])
def test_a_missing_package_is_told_with_its_extra(package: str, extra: str, names: dict[str, str]) -> None:
    program = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from fapengine.voices.choice import VoiceChoice\n"
        "from fapengine.errors import ResourceError\n"
        f"try: VoiceChoice({names[extra]!r}).load()\n"
        "except ResourceError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert f'pip install "fapengine[{extra}]"' in done.stdout


def test_symbols_that_a_model_lacks_cost_no_time() -> None:
    numbers = {"_": [0], "^": [1], "$": [2], "m": [3], "a": [4], "ɪ": [5, 6]}
    chunk = SimpleNamespace(
        phoneme_alignments=None, phonemes=[*"mx", "ɪ"], phoneme_id_samples=np.array([10, 1, 20, 2, 30, 3, 4, 40]),
        audio_float_array=np.zeros(110),
    )  # fmt: skip
    assert piper._spoken(chunk, numbers, "here").lengths == (("^", 11), ("m", 22), ("ɪ", 37), ("$", 40))
    chunk.phoneme_id_samples = np.array([10, 1])
    with pytest.raises(DataError, match="got 2 counts of samples, expected 8"):
        piper._spoken(chunk, numbers, "here")


def test_lengths_are_fitted_to_the_sound() -> None:
    assert spoken(np.zeros(30), [("m", 20), ("a", 20)], where="x").lengths == (("m", 20), ("a", 10))
    assert spoken(np.zeros(50), [("m", 20), ("a", 20)], where="x").lengths == (("m", 20), ("a", 20), ("_", 10))
    for sound, lengths in (
        (np.full(3, np.nan), [("m", 3)]),
        (np.zeros(3), [("m", -1)]),
        (np.zeros(3), [("m", np.nan)]),
    ):
        with pytest.raises(DataError, match="x: the model"):
            spoken(sound, lengths, where="x")
    with pytest.raises(DataError, match=r"expected 0\.3 or later"):
        kokoro_lengths([("m", 0.1, 0.3), ("a", 0.2, 0.4)], 100)


def test_words_that_do_not_fit_are_none_and_marks_are_remarked() -> None:
    noise = np.random.default_rng(1).uniform(-9000, 9000, 3000).astype(np.int16)
    one = Spoken(noise, (("m", 1000), ("a", 2000)))
    speech = speech_of([one], 16_000, read_marks("of [laughs] the"), piper_entries, "ipa", "x")
    assert words_in(speech) == []
    assert "all marks come at the start" in speech.remarks[0]
    assert all(ipa.letters(phone.label) for phone in speech.phones.phones if not phone.is_silence)


def test_a_name_may_hold_signs() -> None:
    assert choices_of("piper:/a b/ä.onnx?speaker=x y", ["speaker"]) == (Path("/a b/ä.onnx"), {"speaker": "x y"})
