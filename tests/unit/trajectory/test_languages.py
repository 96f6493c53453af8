"""Fifteen languages, on words written in IPA: round sounds come forward, front vowels do not, contacts are made.

A word a line; what is looked at is chosen by the letter's class, not by the profile, which heard English alone.
"""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from fapengine.mpeg4 import fap
from fapengine.speech import ipa
from fapengine.speech.articulation import ARTICULATIONS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english

WORDS = {
    "English": "b uː t|f iː t|ʃ ɪ p|w ɛ b|v oʊ t|θ ɪ ŋ k|m ʊ n",
    "German": "m yː d ə|ʃ øː n|f ʏ n f|b iː n ə|v eː k|p ʊ t s ən|k œ n ə n",
    "French": "p y|f ø|v i|b o|m œ b l|p ɥ i|v ɛ̃|b ɔ̃|ʃ u",
    "Spanish": "p e r o|b u r o|f i n o|m i s m o|x u ɣ o|t ʃ i k a",
    "Italian": "p i u|f i ʎ o|v o tʃ e|m u r o|b ɛ lː a|ʃ ɛ n a",
    "Portuguese": "p ɐ̃ w̃|f i ʎ u|v e ʎ u|m ũ d u|b õ|ʒ e s t u",
    "Dutch": "m y r|p ø s|f i t s|b u k|v eː l|ʋ ɪ l|d œy",
    "Polish": "b ɨ tɕ|p i ɕ|f u t r ɔ|m u s|v i n ɔ|w u k|ʂ u m",
    "Russian": "b ɨ k|pʲ i tʲ|f u|m u ʂ|vʲ i d|tɕ u",
    "Turkish": "ɟ y l|ɟ œ z|b u|p i l|f i l|v e|m ɯ|k ɯ z",
    "Arabic": "b iː|f uː l|m uː z|ħ uː t|w i l|f iː l",
    "Hindi": "p uː l|b iː|m iː|f i|ʈ iː|ʋ o|dʒ uː",
    "Mandarin": "p y|m u|f u|ɕ i|tɕ y|ʂ u|p i|m i",
    "Japanese": "b i|m o|ɸ ɯ|k i|p o|m e",
    "Korean": "p u|m o|p i|m e|k i|tɕ u",
}
EACH_S = 0.13
ROUND_MM, PLAIN_MM, CONTRAST_MM = 3.0, 2.5, 4.0


@cache
def measured(word: str) -> list[tuple[str, dict[str, float]]]:
    """For each phone of one letter: the letter, and what is seen in its middle or where it touches, in mm."""
    labels = word.split()
    edges = np.cumsum([0.3, *[EACH_S] * len(labels)])
    phones = [Phone(label, float(a), float(b)) for label, (a, b) in zip(labels, pairwise(edges), strict=True)]
    end_s = float(edges[-1])
    track = PhoneTrack.from_phones([Phone(SILENCE, 0.0, 0.3), *phones, Phone(SILENCE, end_s, end_s + 0.3)])
    made = plan(track, english(), rng=np.random.default_rng(0), rate_hz=100.0, style=Style.speech_only())
    assert not made.unknown, word
    mm = made.track.values * english().fapu.steps()

    def column(number: int, start: float, stop: float, phone: Phone) -> np.ndarray:
        first, last = (round(100 * (phone.start_s + share * phone.duration_s)) for share in (start, stop))
        return np.asarray(mm[first : last + 1, fap.column(number)])

    seen = []
    for phone in phones:
        letters = ipa.letters(phone.label)
        if len(letters) == 1:
            push, width = (sum(column(n, 0.2, 0.7, phone).mean() for n in two) for two in ((16, 17), (53, 54)))
            gap = -column(4, 0.15, 0.45, phone) - column(5, 0.15, 0.45, phone)
            lower = column(5, 0.45, 0.65, phone).min()
            seen.append((letters[0], {"push": push / 2, "width": width, "gap": gap.max(), "lower": lower}))
    return seen


@pytest.mark.parametrize("language", WORDS)
def test_mouths_of(language: str) -> None:
    found = [entry for word in WORDS[language].split("|") for entry in measured(word)]
    checked = dict.fromkeys(("round", "front", "lips"), 0)
    rounded = [(letter, mm) for letter, mm in found if ipa.SOUNDS[letter].vowel and ARTICULATIONS[letter].round >= 0.7]
    front = [(letter, mm) for letter, mm in found if letter in "iɪeɛ"]
    for letter, mm in rounded:
        assert mm["push"] > ROUND_MM, (letter, mm)
        assert mm["width"] < 0, (letter, mm)
        checked["round"] += 1
    for letter, mm in front:
        assert mm["push"] < PLAIN_MM, (letter, mm)
        checked["front"] += 1
    assert np.mean([mm["width"] for _, mm in front]) - np.mean([mm["width"] for _, mm in rounded]) > 3.0
    assert np.mean([mm["push"] for _, mm in rounded]) - np.mean([mm["push"] for _, mm in front]) > CONTRAST_MM
    for letter, mm in found:
        if letter in "pbm":
            assert abs(mm["gap"]) < 0.1, (letter, mm)
            checked["lips"] += 1
        if letter in "fvʋɱ":
            assert mm["lower"] > -0.4, (letter, mm)
    assert min(checked.values()) >= 2, checked


def test_every_language_of_the_list_is_there() -> None:
    assert len(WORDS) == 15
    touched = {letter for words in WORDS.values() for word in words.split("|") for letter, _ in measured(word)}
    assert set("pbmfvyøœɥuoɨɯɕʂħʈʋ") <= touched
