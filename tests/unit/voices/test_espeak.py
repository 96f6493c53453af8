"""The espeak-ng voice, through its real library."""

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE
from fapengine.voices.espeak import EspeakVoice, voices
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


@pytest.mark.parametrize("name", ["en-us", "en-gb", "de", "fr-fr", "es", "it", "pl", "ru", "tr", "sv"])
def test_other_languages_speak_known_ipa(name: str) -> None:
    spoken = EspeakVoice(name).speak("Mama, papa, 1 2 3 4 5 6 7 8 9.").phones.phones
    assert len(spoken) > 20
    strange = {phone.label for phone in spoken if phone.label != SILENCE and not ipa.letters(phone.label)}
    assert not strange


def test_there_are_many_voices() -> None:
    assert len(voices()) > 80
    assert voices()["en-us"] == "English (America)"


def test_refuses() -> None:
    with pytest.raises(UsageError, match=r"got 'en-xx'.*en-us"):
        EspeakVoice("en-xx")
    with pytest.raises(UsageError, match=r"80\.\.450"):
        EspeakVoice("en-us", 20)
    with pytest.raises(UsageError, match="something to speak"):
        EspeakVoice("en-us").speak(" ... ")
    with pytest.raises(UsageError, match="sample_rate_hz"):
        Speech(samples=np.zeros(3, np.int16), sample_rate_hz=0, phones=EspeakVoice().speak("a").phones)
