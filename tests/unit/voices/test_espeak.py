"""The espeak-ng voice, through its real library."""

from itertools import groupby

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speaking import RATES_WPM
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE
from fapengine.voices import espeak
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import EspeakVoice, catalogue, voices
from fapengine.voices.protocol import Speech

SENTENCE = "Bright sunshine shimmers on the ocean."


@pytest.fixture(scope="module")
def speech() -> Speech:
    return EspeakVoice("en-us").speak(SENTENCE)


def test_phones_cover_the_sound(speech: Speech) -> None:
    assert speech.phones.duration_s == pytest.approx(speech.duration_s, abs=1e-9)
    assert speech.samples.dtype == np.int16
    assert np.abs(speech.samples).max() > 3000


def test_phones_are_those_of_the_sentence(speech: Speech) -> None:
    spoken = [phone.label for phone in speech.phones.phones if phone.label != SILENCE]
    assert spoken[:5] == ["b", "ɹ", "aɪ", "t", "s"]
    assert "m" in spoken
    assert [phone.word for phone in speech.phones.phones if phone.label == "m"] == ["shimmers"]
    assert sum(phone.stress == 1 for phone in speech.phones.phones) >= 4


def test_vowels_are_louder_than_silence(speech: Speech) -> None:
    def loudness(phone_label: str) -> float:
        phone = next(phone for phone in speech.phones.phones if phone.label == phone_label)
        first, last = (int(time * speech.sample_rate_hz) for time in (phone.start_s, phone.end_s))
        return float(np.abs(speech.samples[first:last].astype(float)).mean())

    assert loudness("aɪ") > 5 * loudness(SILENCE)


def test_a_faster_voice_is_shorter() -> None:
    slow, fast = (EspeakVoice("en-us", rate).speak(SENTENCE).duration_s for rate in (120, 240))
    assert fast < 0.75 * slow


def test_padding_adds_silence_on_both_sides(speech: Speech) -> None:
    padded = speech.padded(lead_s=0.3, tail_s=0.5)
    assert padded.duration_s == pytest.approx(speech.duration_s + 0.8, abs=1e-4)
    assert padded.phones.duration_s == pytest.approx(padded.duration_s, abs=1e-9)
    assert padded.phones.phones[0].is_silence
    assert padded.phones.phones[-1].is_silence
    assert not padded.samples[: int(0.29 * padded.sample_rate_hz)].any()
    for wrong in (-0.1, float("nan"), float("inf"), 1e9):
        with pytest.raises(UsageError, match="lead_s: got"):
            speech.padded(lead_s=wrong, tail_s=0.0)
        with pytest.raises(UsageError, match="tail_s: got"):
            speech.padded(lead_s=0.0, tail_s=wrong)


@pytest.mark.parametrize("name", ["en-us", "en-gb", "de", "fr-fr", "es", "it", "pl", "ru", "tr", "sv"])
def test_other_languages_speak_known_ipa(name: str) -> None:
    spoken = EspeakVoice(name).speak("Mama, papa, 1 2 3 4 5 6 7 8 9.").phones.phones
    assert len(spoken) > 20
    strange = {phone.label for phone in spoken if phone.label != SILENCE and not ipa.letters(phone.label)}
    assert not strange


def test_there_are_many_voices() -> None:
    assert len(voices()) > 80
    assert voices()["en-us"] == "English (America)"


def spoken(name: str, text: str, rate_wpm: int = 160) -> list[str]:
    return [phone.label for phone in EspeakVoice(name, rate_wpm).speak(text).phones.phones if not phone.is_silence]


def test_a_voice_speaks_its_own_language_whoever_spoke_before() -> None:
    words = {"fr-fr": "Bonjour tout le monde.", "en-gb": "A car in the park.", "en-us": "A car in the park."}
    alone = {name: spoken(name, text) for name, text in words.items()}
    for before in ("de", "ru", "en-us"):
        for name, text in words.items():
            EspeakVoice(before).speak("1")
            assert spoken(name, text) == alone[name]
    assert "ʁ" in alone["fr-fr"]
    assert "ɑːɹ" in alone["en-us"]
    assert "ɑːɹ" not in alone["en-gb"]  # no r in park


def test_a_text_has_the_same_sound_whoever_spoke_before(monkeypatch: pytest.MonkeyPatch) -> None:
    voice, text = EspeakVoice("vi"), "Xin chào, cái cầu này đẹp quá, tôi đi học."

    def sounds() -> list[bytes]:
        found = [voice.speak(text).samples.tobytes()]
        EspeakVoice("ru").speak("Google")  # with the dictionary of a second language
        return [*found, voice.speak(text).samples.tobytes()]

    monkeypatch.setattr(espeak, "_second_dictionaries", [])
    assert len(set(sounds() + sounds())) == 1
    assert espeak._second_dictionaries == [b"(en)"] * 2
    monkeypatch.setattr(espeak, "_second_dictionaries", [b"(en)"] * espeak.MAX_SECOND_DICTIONARIES)
    assert len(set(sounds() + sounds())) > 1  # stays loaded


def test_a_phoneme_that_a_voice_lacks_is_spoken() -> None:
    assert spoken("kl", "Åland") == ["ɒ", "l", "a", "n", "d"]  # the process died where Greenlandic spoke first


def test_a_voice_without_its_dictionary_is_none() -> None:
    assert not {"fo", "kaa", "xex"} & voices().keys()  # espeakng-loader 0.2.4 has no dictionary of these
    with pytest.raises(UsageError, match="got 'fo', expected a language code"):
        EspeakVoice("fo")


def test_every_voice_is_accepted_by_the_library_and_speaks() -> None:
    silent = []
    for name in voices():
        try:
            assert spoken(name, "a e i o u 1", 449)
        except UsageError:
            silent.append(name)
    assert silent == []


def test_a_text_without_a_phone_is_refused() -> None:
    with pytest.raises(UsageError, match=r"contains nothing to speak \(voice 'cv' finds nothing"):
        EspeakVoice("cv").speak("1")  # knows letters, but no numbers
    assert spoken("cv", "а")


@pytest.mark.parametrize("rate_wpm", RATES_WPM)
@pytest.mark.parametrize("name", ["en-us", "de", "ru", "cmn"])
def test_both_ends_of_the_rate(name: str, rate_wpm: int) -> None:
    text = "1234567890. Mama, papa! 19 84, 21, 350; 17 18 19 20 30 40 50 60 70 80 90 100 1000."
    speech = VoiceChoice(name, rate_wpm).load().speak(text)
    assert speech.phones.duration_s == pytest.approx(speech.duration_s, abs=1e-9)
    assert len(speech.phones.phones) > 100


@pytest.mark.parametrize("rate_wpm", [RATES_WPM[0] - 1, RATES_WPM[1] + 1])
def test_rates_beyond_the_ends_are_refused(rate_wpm: int) -> None:
    for choose in (EspeakVoice, lambda name, rate: VoiceChoice(name, rate).load()):
        with pytest.raises(UsageError, match=r"80(\.\.| to )449"):
            choose("en-us", rate_wpm)


def test_a_faster_rate_is_never_slower() -> None:
    """From 450 on espeak-ng makes the sound longer again (66,903 samples for a paragraph, 60,583 at 449)."""
    lengths = [EspeakVoice("en-us", rate).speak(SENTENCE).duration_s for rate in (80, 160, 300, 400, 449)]
    assert lengths == sorted(lengths, reverse=True)


def test_every_code_of_every_voice_is_found() -> None:
    for entry in catalogue().entries:
        assert catalogue().find(entry.code) == entry
        assert catalogue().find(entry.identifier) == entry
        for _, code in entry.codes:
            assert catalogue().find(code.upper().replace("-", "_")).codes


WHOLE_WORDS = [
    ("en-us", "We'll be happy, don’t worry", ["We'll", "be", "happy", "don’t", "worry"]),
    ("en-us", "My mother-in-law on the phone", ["My", "mother-in-law", "on", "the", "phone"]),
    (
        "en-us",
        "In 1984, on 2026-11-22, 3.50 or 1,234,567.89",
        ["In", "1984", "on", "2026-11-22", "3.50", "or", "1,234,567.89"],
    ),
    ("en-us", "etc. at 9 a.m. on the 21st", ["etc", "at", "9", "a.m.", "on", "the", "21st"]),
    ("en-us", "I like 🚀 C++", ["I", "like", "🚀", "C++"]),
    ("fr", "L'homme m'appelle là-bas qu'il", ["L'homme", "m'appelle", "là-bas", "qu'il"]),
    ("it", "dell'uomo", ["dell'uomo"]),
    ("cy", "Mae'r gath", ["Mae'r", "gath"]),
    ("de", "Im Jahr 1984 z.B. am 21.", ["Im", "Jahr", "1984", "z.B.", "am", "21"]),
    ("hi", "नमस्ते मेरा नाम है", ["नमस्ते", "मेरा", "नाम", "है"]),
    ("ta", "வணக்கம் என் பெயர்", ["வணக்கம்", "என்", "பெயர்"]),
    ("th", "ผมชื่อสมชาย สวัสดี", ["ผมชื่อสมชาย", "สวัสดี"]),  # espeak-ng 1.52 marks no words inside
    ("fa", "می‌رویم به خانه", ["می‌رویم", "به", "خانه"]),
    ("cs", "do krku a v krku", ["do", "krku", "a", "v", "krku"]),
    ("bg", "в парка и с теб", ["в", "парка", "и", "с", "теб"]),
    ("ko", "오늘 날씨가 좋습니다", ["오늘", "날씨가", "좋습니다"]),
    ("cmn", "你好世界，我们吃苹果。", ["你好", "世", "界", "我", "们", "吃", "苹果"]),
    ("ja", "こんにちは、2026年", ["こんにちは", "2026", "年"]),
    ("ru", "Привет, мир!", ["Привет", "мир"]),
    ("en-us", "cafe\u0301 wor\u00adld Ｈｅｌｌｏ", ["café", "world", "Hello"]),
]


@pytest.mark.parametrize(("name", "text", "words"), WHOLE_WORDS)
def test_phones_know_their_whole_word(name: str, text: str, words: list[str]) -> None:
    phones = EspeakVoice(name).speak(text).phones.phones
    assert [word for word, _ in groupby(phone.word for phone in phones if not phone.is_silence)] == words


@pytest.mark.parametrize(
    ("text", "as_if"),
    [
        ("cafe\u0301", "café"), ("e\u0301cole", "école"), ("Ｈｅｌｌｏ", "Hello"), ("𝐇ello", "Hello"),
        ("wor\u00adld", "world"),
        ("He\u200bllo", "Hello"), ("\x1b[31mred\x1b[0m", "red"), ("Hello\0 world", "Hello world"), ("\0Hello", "Hello"),
        ("Hello \ud800world", "Hello world"), ("\u202eHello\u202c", "Hello"), ("①", "1"), ("5 ℃", "5 °C"),
    ],
)  # fmt: skip
def test_odd_text_is_spoken_as_what_it_means(text: str, as_if: str) -> None:
    assert spoken("en-us", text) == spoken("en-us", as_if)


def test_emoji_without_a_face_are_for_the_voice_to_say() -> None:
    assert spoken("en-us", "🚂")
    for nothing in ("\u200b\ud800 \x07", "😀", "🤔 🤔"):
        with pytest.raises(UsageError, match="nothing to speak"):
            EspeakVoice().speak(nothing)


def test_tags_are_obeyed_on_request_and_remarked_without() -> None:
    text = 'Hello <emphasis>big</emphasis> world, <break time="300ms"/> cats'
    obeyed, read = EspeakVoice(ssml=True).speak(text), EspeakVoice().speak(text)
    words = [word for word, _ in groupby(phone.word for phone in obeyed.phones.phones if not phone.is_silence)]
    assert words == ["Hello", "big", "world", "cats"]
    assert obeyed.remarks == ()
    assert read.duration_s > obeyed.duration_s + 1.0
    assert "<emphasis> looks like SSML" in read.remarks[0]


@pytest.mark.parametrize(
    ("name", "text", "remark"),
    [
        ("en-us", "Say مرحبا please", "does not read Arabic: 'مرحبا' (letter 5) cannot"),
        ("en-us", "cafe\u0301 мир", "does not read Cyrillic: 'мир' (letter 7)"),
        ("ja", "hello", "does not read Latin"),
        ("en-us", "ສະບາຍດີ", "no voice reads it"),
        ("en-us", "say it \udcff now", "bytes that are no UTF-8 (1)"),
    ],
)
def test_what_is_not_read_is_remarked(name: str, text: str, remark: str) -> None:
    (told,) = EspeakVoice(name).speak(text).remarks
    assert remark in told


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("en-us", "naïve नमस्ते"),
        ("ru", "привет hello"),
        ("ko", "안녕 hello"),
        ("ja", "です カタカナ"),
        ("sr", "мама mama"),
    ],
)
def test_what_is_read_is_not(name: str, text: str) -> None:
    assert EspeakVoice(name).speak(text).remarks == ()


def test_refuses() -> None:
    with pytest.raises(UsageError, match=r"got 'english'.*en-us"):
        EspeakVoice("english")
    with pytest.raises(UsageError, match=r"80(\.\.| to )449"):
        EspeakVoice("en-us", 20)
    with pytest.raises(UsageError, match="nothing to speak"):
        EspeakVoice("en-us").speak(" ... ")
    with pytest.raises(UsageError, match="rate of 0 Hz"):
        Speech(samples=np.zeros(3, np.int16), sample_rate_hz=0, phones=EspeakVoice().speak("a").phones)
