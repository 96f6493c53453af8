"""``[word]{IPA}`` in plain text, and SSML's ``phoneme``: the sounds of a word as the caller gives them."""

import asyncio
from contextlib import suppress
from pathlib import Path

import pytest

from fapengine.cli.main import main
from fapengine.errors import UsageError
from fapengine.speech.marks import read_marks, words_of
from fapengine.speech.text.words import pieces_of
from fapengine.voices.choice import loaded
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.protocol import Speech
from tests.unit.host.test_server_hub import ReadVoice, hub_of


def spoken(text: str, code: str = "en-us", *, ssml: bool = False) -> dict[str, str]:
    """Words with their labels, of a word that occurs once."""
    said: dict[str, str] = {}
    for phone in EspeakVoice(code, ssml=ssml).speak(text).phones.phones:
        if not phone.is_silence:
            said[phone.word] = said.get(phone.word, "") + phone.label
    return said


@pytest.mark.parametrize(
    ("code", "text", "word", "expected"),
    [
        ("en-us", "Mr. [Nguyen]{wɪn} paid $5.", "Nguyen", "wɪn"),
        ("en-us", "I am [Siobhan]{ʃɪˈvɔːn}.", "Siobhan", "ʃɪvɔːn"),
        ("de", "Die [Band]{bɛnt} spielt.", "Band", "bɛnt"),
        ("de", "Meine [Garage]{ɡaˈʁaːʒə}.", "Garage", "ɡaχaʒə"),  # no ʁ, no long a before it
        ("fr-fr", "Voici [Müller]{mylɛʁ}.", "Müller", "mylɛʁ"),
        ("ru", "Это [имя]{ˈwɨm}.", "имя", "wɨm"),
        ("cmn", "我是[安娜]{anːa}。", "安娜", "ana"),
    ],
)
def test_a_word_has_the_sounds_that_are_given(code: str, text: str, word: str, expected: str) -> None:
    assert spoken(text, code)[word] == expected


def test_the_text_is_without_the_sounds_and_other_words_stay() -> None:
    text = "I say [tomato]{təˈmɑːtoʊ} & [New York]{nuː ˈjɔːɹk} < it [smile] costs $3.50 [[hi]]."
    speech = EspeakVoice("en-us").speak(text)
    assert speech.text == "I say tomato & New York < it costs $3.50 [[hi]]."
    words = [word for word, _, _ in words_of(speech.phones.phones)]
    assert words == ["I", "say", "tomato", "&", "New", "York", "it", "costs", "$3.50", "hi"]
    starts = {word: start_s for word, start_s, _ in words_of(speech.phones.phones)}
    assert [mark.at_s for mark in speech.marks] == [starts["costs"]]


def test_ssml_has_it_too() -> None:
    text = '<speak>Mr. <phoneme alphabet="ipa" ph="wɪn">Nguyen</phoneme> and [Siobhan]{ʃɪˈvɔːn} went.</speak>'
    said = spoken(text, ssml=True)
    assert (said["Nguyen"], said["Siobhan"], said["went"]) == ("wɪn", "ʃɪvɔːn", "wɛnt")
    assert spoken('Oh <expr type="break" label="50ms"/> [Nguyen]{wɪn} & I.')["Nguyen"] == "wɪn"


@pytest.mark.parametrize(
    ("sounds", "named"), [("w1n", "'1'"), ("w#n", "'#'"), ("", "''"), ("ː", "'ː'"), ("wiʬ", "'ʬ'")]
)
def test_braces_without_ipa_are_text_and_remarked_on_and_an_error_in_ssml(sounds: str, named: str) -> None:
    message = f"text: got {named} in the sounds of 'Nguyen', expected IPA"
    text = f"Hello [Nguyen]{{{sounds}}}."
    speech = EspeakVoice("en-us").speak(text)
    assert speech.text == text
    assert len([remark for remark in speech.remarks if message in remark]) == 1
    with pytest.raises(UsageError, match=message):
        EspeakVoice("en-us", ssml=True).speak(f'<phoneme ph="{sounds}">Nguyen</phoneme>')


def test_code_is_text() -> None:
    code = r"\sqrt[n]{x} \begin{tabular}[t]{c} f(a)[i]{e} a[i]{e}"
    assert read_marks(f"{code} [n]{{x}}").text == f"{code} n"


def test_an_entity_in_a_word_with_sounds_is_one_character() -> None:
    assert list(spoken("[R&amp;D]{ɑːɹ} is <s>here</s>.", ssml=True)) == ["R&D", "is", "here"]


def test_a_word_and_its_sounds_are_not_cut() -> None:
    for before in range(270, 300):
        text = "a" * before + " [New York]{nuː ˈjɔːɹk} is, here."
        pieces = pieces_of(text)
        assert "".join(pieces) == text
        assert sum("[New York]{nuː ˈjɔːɹk}" in piece for piece in pieces) == 1


def test_a_text_for_pieces_keeps_the_sounds() -> None:
    text = "Mr. [Nguyen]{wɪn} [smile] and [Bach]{bax}."
    assert read_marks(text).text == "Mr. Nguyen and Bach."
    assert read_marks(text).with_sounds == "Mr. [Nguyen]{wɪn} and [Bach]{bax}."


def test_a_live_face_keeps_them() -> None:
    voice = ReadVoice()
    hub, _ = hub_of(voice)
    hub.open("a")
    said = asyncio.run(hub.speak("a", "Mr. [Nguyen]{wɪn} is here."))
    assert said is not None
    assert [text for text, *_ in voice.asked] == ["Mr. [Nguyen]{wɪn} is here."]
    assert said.text == "Mr. Nguyen is here."


def test_the_command_line_names_what_is_not_ipa(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["fapengine", "say", "Mr. [Nguyen]{w1n}.", "-o", str(tmp_path / "name.fap")])
    with suppress(SystemExit):
        main()
    assert (tmp_path / "name.fap").exists()
    assert "got '1' in the sounds of 'Nguyen', expected IPA" in capsys.readouterr().err


def test_a_voice_that_takes_no_sounds_says_so() -> None:
    class Own:
        def speak(self, text: str) -> Speech:
            return EspeakVoice("en-us").speak(text)

    speech = loaded(Own()).speak("Mr. [Nguyen]{wɪn}.")
    assert speech.remarks == ("text: the voice takes no sounds; 'Nguyen' was spoken as it is written",)
    assert speech.text == "Mr. Nguyen."
