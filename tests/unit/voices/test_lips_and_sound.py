"""Lips against the sound itself: shut while a p is silent, open behind its burst, open when the vowel behind m begins.

Where a sound is silent or bright is found here by other means than in the package, on the finished motion.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.planner import plan
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.sounding import is_vowel

Array = NDArray[np.float64]
SHUT_FAPU = 20.0
"""Opening below which the lips are shut: 0.4 mm on the recorded face."""
FRAME_HZ = 240.0
PLOSIVES = {
    "en-us": "A puppet happy paper copy apart appeared, popping up. Keep up, tapping upon a paper pipe; stop a cook.",
    "it": "La pipa del papa è sopra il tappeto, capito? Dopo la pioggia il papà scappa. Poco pepe per i pesci.",
    "ru": "Папа купил попугая. Попали в капкан, тапки и шапка. Капуста пропала, приплыл пароход.",
    "de": "Der Papa packt die Pappe in die Mappe. Eine Suppe, eine Lampe, Opa pumpt Pilze, sie hupen knapp.",
    "fr": "Papa a pris un repas, il a appelé la poupée. Le lapin n'a pas peur, l'épée est propre. Ma copine répète.",
}  # fmt: skip
NASALS = {
    "en-us": "Mama made many moments more memorable. My mean man may know nine new names.",
    "it": "La mamma ama il mare. Mille amici mangiano le mele.",
    "ru": "Мама мыла раму. Мимо дома молоко.",
    "de": "Meine Mama mag manche Melodie. Immer mit Mehl malen.",
    "fr": "Ma maman aime le miel. Mon ami me montre la maison.",
}
RATES_WPM = (160, 220, 300)


class Heard(NamedTuple):
    """An utterance, and the opening of the lips while it sounds."""

    samples: Array
    rate_hz: int
    phones: tuple[Phone, ...]
    opening_fapu: Array

    def opening(self, start_s: float, end_s: float) -> Array:
        return np.interp(
            np.arange(start_s, end_s, 1e-3), np.arange(len(self.opening_fapu)) / FRAME_HZ, self.opening_fapu
        )


@cache
def heard(voice: str, rate_wpm: int, text: str) -> Heard:
    speech = EspeakVoice(voice, rate_wpm).speak(text).padded(lead_s=0.2, tail_s=0.3)
    track = plan(speech.phones, load_profile("grid_s1_en"), rng=np.random.default_rng(1), rate_hz=FRAME_HZ).track
    opening = -(track.values[:, fap.column(4)] + track.values[:, fap.column(5)]).astype(float)
    return Heard(speech.samples.astype(float), speech.sample_rate_hz, speech.phones.phones, opening)


def silences(sound: Heard) -> list[tuple[float, float]]:
    """Stretches of 10 ms and more in which no 4 ms are louder than 3 % of the whole."""
    width = round(0.004 * sound.rate_hz)
    power = np.convolve(np.square(sound.samples), np.ones(width) / width, mode="same")
    quiet = (power <= 0.03**2 * np.square(sound.samples).mean()).astype(int)
    steps = np.diff(np.concatenate([[0], quiet, [0]]))
    edges = zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True)
    return [(first / sound.rate_hz, last / sound.rate_hz) for first, last in edges if last - first >= 2.5 * width]


def closures(sound: Heard) -> list[tuple[float, float, Phone]]:
    """Silence before the burst of each p that follows a sound, and the phone behind it."""
    quiet, found = silences(sound), []
    for before, phone, behind in zip(sound.phones, sound.phones[1:], sound.phones[2:], strict=False):
        if phone.label.startswith("p") and not before.is_silence:
            inside = [edge for edge in quiet if phone.start_s < edge[1] < phone.end_s]
            assert inside, f"no silence in {phone}"
            found.append((*max(inside, key=lambda edge: edge[1] - edge[0]), behind))
    return found


def bright_s(sound: Heard, start_s: float, end_s: float) -> float:
    """Where the energy between 0.9 and 4 kHz, in windows of 10 ms, has done 30 % of its rise."""
    width = round(0.01 * sound.rate_hz)
    times_s = np.arange(start_s, end_s, 1e-3)
    first = np.rint(times_s * sound.rate_hz).astype(int) - width // 2
    windows = sound.samples[first[:, None] + np.arange(width)] * np.hanning(width)
    hertz = np.fft.rfftfreq(width, 1 / sound.rate_hz)
    spectrum = np.abs(np.fft.rfft(windows))[:, (hertz > 900) & (hertz < 4000)]
    root = np.sqrt(np.square(spectrum).sum(axis=1))
    dark, bright = np.percentile(root, (5, 90))
    return float(times_s[np.argmax(root > dark + 0.3 * (bright - dark))])


@pytest.mark.parametrize("rate_wpm", RATES_WPM)
@pytest.mark.parametrize("voice", PLOSIVES)
def test_lips_are_shut_while_a_p_is_silent_and_open_behind_its_burst(voice: str, rate_wpm: int) -> None:
    sound = heard(voice, rate_wpm, PLOSIVES[voice])
    shut, opened = [], []
    for start_s, burst_s, behind in closures(sound):
        shut.append(np.mean(sound.opening(start_s, burst_s) < SHUT_FAPU))
        if is_vowel(behind.label):
            opened.append(sound.opening(burst_s, burst_s + 0.035).max() > SHUT_FAPU)
    assert len(shut) >= 12
    assert np.mean(shut) >= 0.85
    assert len(opened) >= 8
    assert (
        opened.count(False) <= 1
    )  # at 300 words a minute a p of 44 ms is held for nearly all of it, so that a frame sees it


@pytest.mark.parametrize("rate_wpm", RATES_WPM)
@pytest.mark.parametrize("voice", NASALS)
def test_lips_open_from_m_when_its_vowel_begins(voice: str, rate_wpm: int) -> None:
    sound = heard(voice, rate_wpm, NASALS[voice])
    late_ms = []
    for phone, behind in zip(sound.phones, sound.phones[1:], strict=False):
        if phone.label == "m" and is_vowel(behind.label):
            times_s = np.arange(phone.start_s, behind.end_s, 1e-3)
            opening = sound.opening(phone.start_s, behind.end_s)[: len(times_s)]
            shut = int(np.argmin(opening))
            begins_s = bright_s(sound, phone.start_s + 0.3 * phone.duration_s, behind.start_s + 0.6 * behind.duration_s)
            late_ms.append(1e3 * (times_s[shut + np.argmax(opening[shut:] > SHUT_FAPU)] - begins_s))
    assert len(late_ms) >= 6
    assert abs(np.median(late_ms)) <= 10
