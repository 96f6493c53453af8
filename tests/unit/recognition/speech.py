"""Speech with known phones: flite's four voices (Debian), and sounds that are no speech."""

import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter, resample_poly

from fapengine.files.sound import load_sound
from fapengine.recognition.protocol import RATE_HZ, Recognizer
from fapengine.speech.formats.corpora import parse_flite
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from fapengine.voices.espeak import EspeakVoice
from tests.english import english

VOICES = ("rms", "slt", "awb", "kal16")
BABY = "My baby brother bumped the big blue bowl."
POPPIES = "Vivid purple poppies bloom behind the barn."
FAPU_MM = 30.0 / 1024
"""About a millimetre's share of one unit of the lips' FAPs (the distance of mouth and nose is some 30 mm)."""


@dataclass(frozen=True)
class Spoken:
    """A sentence, its sound and when its phones sound."""

    text: str
    samples: NDArray[np.int16]
    phones: PhoneTrack


@cache
def spoken(voice: str, text: str) -> Spoken:
    """Speak with flite. ``-psdur`` prints each phone and its end."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        command = ["flite", "-voice", voice, "-t", text, "-o", str(path), "-psdur"]
        done = subprocess.run(command, capture_output=True, check=True, timeout=300)
        samples, _ = load_sound(path, rate_hz=RATE_HZ)
    return Spoken(text, samples, parse_flite(done.stdout))


def spoken_by_espeak(voice: str, text: str) -> Spoken:
    """Speak with espeak-ng, which knows its phones."""
    speech = EspeakVoice(voice).speak(text)
    count = round(len(speech.samples) * RATE_HZ / speech.sample_rate_hz)
    samples = resample_poly(speech.samples.astype(float), RATE_HZ, speech.sample_rate_hz)[:count]
    return Spoken(text, np.clip(samples, -32768, 32767).astype(np.int16), speech.phones)


def opening_mm(phones: PhoneTrack, duration_s: float, rate_hz: float = 60.0) -> NDArray[np.float64]:
    """(T,) mm: how far the planner opens the lips in the middle."""
    rng = np.random.default_rng(1)
    track = plan(phones, english(), rng=rng, rate_hz=rate_hz, style=Style.speech_only(), duration_s=duration_s).track
    opening = -(track.values[:, 3] + track.values[:, 4]) * FAPU_MM
    return opening[: round(duration_s * rate_hz)].astype(float)


def closures(phones: PhoneTrack) -> list[float]:
    """Middles of p, b and m."""
    return [(phone.start_s + phone.end_s) / 2 for phone in phones.phones if phone.label in ("p", "b", "m")]


def met(these: list[float], those: list[float], within_s: float = 0.08) -> int:
    return sum(any(abs(this - that) < within_s for that in those) for this in these)


def no_speech(duration_s: float = 4.0, seed: int = 1) -> dict[str, NDArray[np.int16]]:
    """Sounds that must not move the lips."""
    rng = np.random.default_rng(seed)
    count = round(duration_s * RATE_HZ)
    at_s = np.arange(count) / RATE_HZ
    white = rng.normal(0, 1, count)
    arpeggio = np.zeros(count)
    for index, start in enumerate(range(0, count, RATE_HZ // 4)):  # plucked strings, four notes a second, and a drum
        rest_s = at_s[: count - start]
        note = sum(
            np.sin(2 * np.pi * h * (220, 440, 330, 277, 659, 554)[index % 6] * rest_s) / h**1.5 for h in range(1, 8)
        )
        arpeggio[start:] += note * np.exp(-3 * rest_s)
        arpeggio[start:] += (index % 2) * rng.normal(0, 1, len(rest_s)) * np.exp(-50 * rest_s)
    chord = sum(np.sin(2 * np.pi * f * at_s) / n for n, f in enumerate((130.8, 164.8, 196.0, 261.6), start=1))
    hum = sum(np.sin(2 * np.pi * 50 * k * at_s) / k for k in (1, 2, 3, 5, 7))
    swell = (1 + np.sin(8 * np.pi * at_s)) * np.fft.irfft(
        np.fft.rfft(white) / np.maximum(np.fft.rfftfreq(count, 1 / RATE_HZ), 8.0) ** [[0.5], [1.0]], count
    )
    sounds = {
        "silence": np.zeros(count), "white noise": 0.4 * white, "a quiet room": 0.003 * white, "hum": hum,
        "clicks": (rng.random(count) < 3e-4) * white, "music": arpeggio, "a chord": chord,
        "pink noise that swells": swell[0], "brown noise that swells": swell[1],
    }  # fmt: skip
    return {name: (12_000 * sound / max(np.abs(sound).max(), 1.0)).astype(np.int16) for name, sound in sounds.items()}


def in_noise(samples: NDArray[np.int16], snr_db: float, seed: int = 1) -> NDArray[np.int16]:
    """Beside pink noise."""
    at_hz = np.fft.rfftfreq(len(samples))
    at_hz[0] = 1.0
    white = np.fft.rfft(np.random.default_rng(seed).normal(size=len(samples)))
    noise, sound = np.fft.irfft(white / np.sqrt(at_hz), len(samples)), samples.astype(float)
    sound += noise * np.sqrt((sound**2).mean() / (noise**2).mean() / 10 ** (snr_db / 10))
    return (20_000 * sound / np.abs(sound).max()).astype(np.int16)


def over_telephone(samples: NDArray[np.int16]) -> NDArray[np.int16]:
    """Between 300 and 3400 Hz, in mu-law of 8 bits."""
    at_hz = np.fft.rfftfreq(len(samples), 1 / RATE_HZ)
    passed = np.fft.rfft(samples.astype(float)) * ((at_hz >= 300) & (at_hz <= 3400))
    sound = np.fft.irfft(passed, len(samples))
    sound /= np.abs(sound).max()
    coded = np.round(127 * np.sign(sound) * np.log1p(255 * np.abs(sound)) / np.log(256)) / 127
    return (20_000 * np.sign(coded) * (256 ** np.abs(coded) - 1) / 255).astype(np.int16)


def in_room(samples: NDArray[np.int16], seed: int = 1, decay_s: float = 0.6) -> NDArray[np.int16]:
    """With reverberation that falls by 60 dB in ``decay_s``."""
    count = round(RATE_HZ * decay_s)
    echoes = np.random.default_rng(seed).normal(size=count) * np.exp(-6.9 * np.arange(count) / count)
    echoes[0] = 8.0
    sound = np.convolve(samples.astype(float), echoes)[: len(samples)]
    return (20_000 * sound / np.abs(sound).max()).astype(np.int16)


def heard(ear: Recognizer, samples: np.ndarray, cuts: list[int] | None = None) -> list[Phone]:
    ear.reset()
    phones = [phone for piece in np.split(samples, cuts or []) for phone in ear.push(piece)]
    return phones + ear.end()


def whispered(samples: NDArray[np.int16], seed: int = 1) -> NDArray[np.int16]:
    """The same words without a voice: noise through the filter of each 25 ms (18 poles, widened as a whisper's are)."""
    rng, sound = np.random.default_rng(seed), samples / 32768.0
    whisper, window = np.zeros(len(sound)), np.hanning(400)
    for start in range(0, len(sound) - 400, 160):
        frame = sound[start : start + 400] * window
        alike = np.correlate(frame, frame, "full")[399 : 399 + 19]
        if alike[0] > 1e-9:
            alike[0] *= 1.0001
            ahead = solve_toeplitz(alike[:-1], alike[1:]) * 0.96 ** np.arange(1, 19)
            breath = rng.normal(size=400) * np.sqrt(max(alike[0] - ahead @ alike[1:], 0.0))
            whisper[start : start + 400] += lfilter([1.0], [1.0, *-ahead], breath) * window
    whisper = lfilter([1.0, -0.9], [1.0], whisper)
    return (15_000 * whisper / np.abs(whisper).max()).astype(np.int16)
