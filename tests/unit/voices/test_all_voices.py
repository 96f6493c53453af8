"""Every voice of espeak-ng speaks numbers: no phone unknown, dropped, without its closure; no pause that sounds."""

from collections import Counter
from itertools import accumulate

import pytest

from fapengine.speech.phone_track import Phone
from fapengine.voices import espeak
from fapengine.voices.check import Breach, find_breaches
from fapengine.voices.espeak import read_label
from fapengine.voices.sounding import is_addition

NUMBERS = "0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 30 40 50 60 70 80 90 100 1000 1000000"
RATE_WPM = 300
"""Fast, as more goes wrong there, and sooner over."""


@pytest.fixture(scope="module")
def heard() -> list[tuple[str, tuple[Breach, ...], int]]:
    """Voice, breaches and number of phones."""
    return [(code, *_checked(code)) for code in espeak.voices()]


def _checked(code: str) -> tuple[tuple[Breach, ...], int]:
    voice = espeak.EspeakVoice(code, RATE_WPM)
    events, samples, rate_hz = voice._synthesise(NUMBERS)
    phones = espeak._phones(events, NUMBERS, samples, rate_hz).phones
    return find_breaches(samples, rate_hz, phones, spoken=_spoken(events)), len(phones)


def _spoken(events: list[tuple[int, int, int, int, bytes]]) -> list[str]:
    """Labels as the events name them, one a phone."""
    labels: list[str] = []
    for *_, kind, _, _, name in events:
        label = read_label(name) if kind == espeak._EVENT_PHONEME else None
        if label and label[0] and labels and is_addition(label[0]):
            labels[-1] += label[0]
        elif label and label[0]:
            labels.append(label[0])
    return labels


def test_no_voice_breaks_a_law(heard: list[tuple[str, tuple[Breach, ...], int]]) -> None:
    assert [(code, str(breach)) for code, breaches, _ in heard for breach in breaches] == []


def test_there_was_something_to_check(heard: list[tuple[str, tuple[Breach, ...], int]]) -> None:
    assert len(heard) >= 137
    assert sum(count for _, _, count in heard) > 20_000


def test_the_marks_alone_break_them() -> None:
    """So the check can fail: Cantonese, Italian and Mandarin as espeak-ng marks them."""
    laws: Counter[str] = Counter()
    for code in ("yue", "it", "cmn"):
        events, samples, rate_hz = espeak.EspeakVoice(code, RATE_WPM)._synthesise(NUMBERS)
        named = [(sample / rate_hz, name) for sample, kind, *_, name in events if kind == espeak._EVENT_PHONEME]
        ends = [*(at_s for at_s, _ in named[1:]), len(samples) / rate_hz]
        starts = accumulate((at_s for at_s, _ in named), max)
        phones = [
            Phone(name.split(b"\0")[0].decode(errors="ignore").strip("ˈˌ_:") or "_", start_s, end_s)
            for (_, name), start_s, end_s in zip(named, starts, ends, strict=True)
            if end_s > start_s
        ]
        laws.update(breach.law for breach in find_breaches(samples, rate_hz, phones, spoken=_spoken(events)))
    assert {"unknown", "dropped", "loud pause", "open closure"} <= set(laws)
