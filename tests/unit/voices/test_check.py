"""The check that any voice can be put through: each law, kept and broken."""

import numpy as np
import pytest

from fapengine.speech.phone_track import SILENCE, Phone
from fapengine.voices.check import find_breaches
from tests.unit.voices.test_sounding import BRIGHT, DARK, QUIET, RATE_HZ, piece

SOUND = np.concatenate(
    [piece(*stretch) for stretch in [(QUIET, 50), (DARK, 80), (BRIGHT, 100), (QUIET, 60), (BRIGHT, 110)]]
)
GOOD = ((SILENCE, 0, 50), ("m", 50, 130), ("a", 130, 230), ("p", 230, 320), ("a", 320, 400))


def breaches(*phones: tuple[str, float, float], spoken: list[str] | None = None) -> list[tuple[str, str]]:
    made = [Phone(label, start_ms / 1e3, end_ms / 1e3) for label, start_ms, end_ms in phones]
    return [(breach.law, breach.label) for breach in find_breaches(SOUND, RATE_HZ, made, spoken=spoken)]


def test_a_voice_that_keeps_all_laws() -> None:
    assert breaches(*GOOD, spoken=["m", "a", "p", "a"]) == []


@pytest.mark.parametrize(
    ("phones", "expected"),
    [
        ((*GOOD[:2], ("a", 131, 230), *GOOD[3:]), ("order", "a")),
        ((*GOOD[:2], ("a", 120, 230), *GOOD[3:]), ("order", "a")),
        (GOOD[1:], ("cover", "m")),
        ((*GOOD[:4], ("a", 320, 390)), ("cover", "a")),
        ((*GOOD[:4], ("QQ", 320, 400)), ("unknown", "QQ")),
        ((*GOOD[:4], ("a", 320, 397), ("s", 397, 400)), ("short", "s")),
        ((*GOOD[:3], ("p", 230, 300), (SILENCE, 300, 400)), ("loud pause", SILENCE)),
        ((*GOOD[:2], ("a", 130, 290), ("p", 290, 320), GOOD[4]), ("open closure", "p")),
        ((GOOD[0], ("m", 50, 160), ("a", 160, 230), *GOOD[3:]), ("late vowel", "a")),
    ],
)  # fmt: skip
def test_each_law_can_be_broken(phones: tuple[tuple[str, float, float], ...], expected: tuple[str, str]) -> None:
    assert breaches(*phones) == [expected]


def test_what_was_spoken_must_be_there() -> None:
    assert breaches(*GOOD, spoken=["m", "a", "p", "t", "a"]) == [("dropped", "t")]
    assert breaches(*GOOD, spoken=["m", "a", "b", "a"]) == [("dropped", "b")]
    assert breaches(*GOOD, spoken=["m", "a", "p", "a", "k"]) == [("dropped", "k")]


def test_no_phones_at_all() -> None:
    assert breaches() == [("cover", "")]
    assert breaches(spoken=["a"]) == [("cover", ""), ("dropped", "a")]
    assert find_breaches(np.zeros(0), RATE_HZ, []) == ()


def test_a_breach_says_where_and_what() -> None:
    (breach,) = find_breaches(SOUND, RATE_HZ, [Phone("m", 0.0, 0.13), *(Phone(*at) for at in [("a", 0.13, 0.4)])][:1])
    assert str(breach) == "cover, 'm' at 0.130 s: got 0.1300 s, expected the sound's 0.4000 s"
