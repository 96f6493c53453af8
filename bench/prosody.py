"""Does a shout look like one? A sentence said as usual, 20 dB quieter and 12 dB louder, animated from its sound.

    python -m bench.prosody

The same sentence of flite five times: 0, -20, 0, +12, 0 dB. Each row is a face with and without what loudness and
pitch do (:mod:`fapengine.speech.prosody`): greatest opening in each part in mm, the greatest nod in degrees, SLCC of
``fapengine score``, p b m that close. Below: how many of the vowels that are found to stand out have primary
stress, against espeak-ng, which knows (56 sentences of four of its speakers).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bench.recognizers import SENTENCES, pronounce
from fapengine.app.score import power_of
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.recognition.loudness import soundings
from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.recording import Recording, follow, listen
from fapengine.recognition.sphinx import words_of
from fapengine.recognition.sphinx_aligner import SphinxAligner
from fapengine.scoring.mouth import mouth_of
from fapengine.scoring.score import score_mouth
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.speech.prosody import is_vowel, with_prosody
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english
from tests.unit.recognition.speech import BABY, FAPU_MM, spoken, spoken_by_espeak

PARTS_DB = (0, -20, 0, 12, 0)
PAUSE_S = 0.5
RATE_FPS = 50.0
SPEAKERS = ("en-us", "en-gb", "en-us+f2", "en-us+m3")
LONGER = (
    "Alexander bought twenty tomatoes and a yellow umbrella yesterday.",
    "The children were singing in the garden behind our house.",
    "Nobody remembers where the captain hid the golden treasure.",
    "She carefully opened the letter and began to cry.",
)
STYLE = Style(blinks=False, head_motion=False, gaze=False, idle=False)


def parts_of(voice: str, text: str) -> tuple[np.ndarray, PhoneTrack, float]:
    """Sound, true phones, and length of a part."""
    speech = spoken(voice, text)
    once = speech.samples / np.abs(speech.samples).max() * 10 ** (-max(PARTS_DB) / 20) * 32_000
    pause = np.zeros(round(PAUSE_S * RATE_HZ))
    sound = np.concatenate([part for db in PARTS_DB for part in (once * 10 ** (db / 20), pause)]).astype(np.int16)
    length_s, end_s = (len(once) + len(pause)) / RATE_HZ, len(once) / RATE_HZ
    said = [phone for phone in speech.phones.phones if phone.start_s < end_s - 1e-3]
    phones = [
        replace(phone, start_s=phone.start_s + n * length_s, end_s=min(phone.end_s, end_s) + n * length_s)
        for n in range(len(PARTS_DB))
        for phone in said
    ]
    return sound, PhoneTrack.from_phones(phones, tolerance_s=0.02), length_s


def without_prosody(phones: PhoneTrack) -> PhoneTrack:
    return PhoneTrack(tuple(replace(phone, loudness_db=0.0, stress=0) for phone in phones.phones))


def row(name: str, phones: PhoneTrack, truth: PhoneTrack, sound: np.ndarray, length_s: float) -> None:
    rng = np.random.default_rng(1)
    track = plan(phones, english(), rng=rng, rate_hz=RATE_FPS, duration_s=len(sound) / RATE_HZ, style=STYLE).track
    opening_mm = -(track.values[:, 3] + track.values[:, 4]) * FAPU_MM
    nod_deg = np.rad2deg(track.values[:, 47] * AU_RAD)
    edges = [round(n * length_s * RATE_FPS) for n in range(len(PARTS_DB) + 1)]
    spans = [slice(*edges[n : n + 2]) for n in range(len(PARTS_DB))]
    score = score_mouth(mouth_of(track), phones=truth, power=power_of(sound, RATE_HZ))
    opened = " ".join(f"{opening_mm[span].max():5.1f}" for span in spans)
    nodded = " ".join(f"{nod_deg[span].max():4.1f}" for span in spans)
    closures = score.phones.closures
    print(f"{name:34s} {opened}   {nodded}   {score.intensity.slcc:.2f}   {closures.met}/{closures.wanted}")


def shouts() -> None:
    recognizers: dict[str, Callable[[np.ndarray, str], Recording]] = {
        "with the text": lambda sound, text: follow(
            [sound], SphinxAligner(words_of(" ".join([text] * len(PARTS_DB))), pronounce)
        ),
        "sound alone": lambda sound, _: listen([sound]),
    }
    levels = " ".join(f"{db:+5d}" for db in PARTS_DB)
    print(f"{'':34s} {levels} dB{'nods, deg':>17s} {'SLCC':>15s}  p b m")
    for voice, text in (("rms", BABY), ("slt", SENTENCES[2])):
        sound, truth, length_s = parts_of(voice, text)
        for name, hear in recognizers.items():
            phones = hear(sound, text).phones
            row(f"{voice}, {name}: without", without_prosody(phones), truth, sound, length_s)
            row(f"{voice}, {name}: with", phones, truth, sound, length_s)


def stresses() -> None:
    told = right = vowels = stressed = 0
    for voice in SPEAKERS:
        for text in (*SENTENCES, *LONGER):
            speech = spoken_by_espeak(voice, text)
            phones = list(speech.phones.phones)
            bare: list[Phone] = [replace(phone, stress=0) for phone in phones]
            found = with_prosody(bare, soundings(bare, speech.samples))
            vowels += sum(map(is_vowel, phones))
            stressed += sum(is_vowel(phone) and phone.stress == 1 for phone in phones)
            told += sum(phone.stress == 1 for phone in found)
            right += sum(one.stress == 1 == other.stress for one, other in zip(found, phones, strict=True))
    print(f"\nstress: {told} of {vowels} vowels stand out, {100 * right / told:.0f} % of them have primary stress;")
    print(f"{100 * stressed / vowels:.0f} % of all vowels have it; {100 * right / stressed:.0f} % of those are found")


if __name__ == "__main__":
    shouts()
    stresses()
