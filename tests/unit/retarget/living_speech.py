"""Speech of a face that lives: blinks, gaze, head motion, idle drifts and accents, from phones written by hand."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from fapengine.expressions import Expression
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english

RATE_HZ = 60.0
WORDS = (
    "m aɪ", "b eɪ b i", "p ʊ t", "f aɪ v", "b l uː", "ʃ uː z", "ə b ʌ v", "ð ə", "b ɑː ɹ n", "w aɪ l", "h i",
    "m uː v d", "ɔː l", "f ɛ ɹ i z",
)  # fmt: skip
"""Every other word bears an accent."""


@cache
def phones() -> PhoneTrack:
    """Seconds 0.5 to 4.3 of a sentence."""
    spoken, at_s = [Phone("_", 0.0, 0.5)], 0.5
    for number, word in enumerate(WORDS):
        for label in word.split():
            vowel = label[0] in "aeiouɑɔəɛʊʌ"
            length_s = 0.13 if vowel else 0.08
            stress = 1 if vowel and number % 2 == 0 else 0
            spoken.append(Phone(label, at_s, at_s + length_s, stress=stress, word=f"{word} {number}"))
            at_s += length_s
    return PhoneTrack.from_phones([*spoken, Phone("_", at_s, at_s + 0.6)])


@cache
def living(*without: str, mood: str = "", strength: float = 0.6, seed: int = 5) -> NDArray[np.float64]:
    """(T, 68) FAPU; what is left out is :data:`fapengine.speaking.GENERATORS`'."""
    moods = [Mood(Expression[mood.upper()], strength)] if mood else []
    track = plan(
        phones(), english(), rng=np.random.default_rng(seed), rate_hz=RATE_HZ, expressions=moods,
        style=Style().without(without),
    ).track  # fmt: skip
    return track.values.astype(np.float64)


def held(labels: str) -> list[int]:
    """Frames in the middle of the hold of each of these phones."""
    share = 0.25 if "p" in labels.split() else 0.55
    wanted = [phone for phone in phones().phones if phone.label in labels.split()]
    return [round((phone.start_s + share * phone.duration_s) * RATE_HZ) for phone in wanted]
