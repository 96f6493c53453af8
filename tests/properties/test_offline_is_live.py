"""One motion: the same phones, profile, style and seed give the same FAPs offline (``plan``) and live (``Engine``).

The bound is 1 FAPU, for the order of additions may round otherwise. It holds frame by frame for phones that are known
when the session begins, and for the path ``context``; the other methods need all keyframes and are offline only. A file
has an end by which gestures come to rest, a live session has one only if it is told (``Engine.rest``): it is, here,
but for one test, which shows that nothing differs until :data:`END_S` before that end.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.engine.commands import Append, Begin, End, Express
from fapengine.engine.engine import Engine
from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.speaking import GENERATORS
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.expression import Mood, mood_ramps
from fapengine.trajectory.gestures import FIXATION_S
from fapengine.trajectory.planner import plan, rest_s
from fapengine.trajectory.style import Style
from tests.english import english

STYLES = {
    "default": Style(),
    "still": Style.speech_only(),
    **{f"without {name}": Style(**{name: False}) for name in GENERATORS},  # type: ignore[arg-type]
    "loud": Style(1.2, jaw=1.4, lips=0.6, loudness_db=5.0),  # louder ones are faster than live faces may be
    "mumbled": Style.speech_only(articulation=0.4),
}
MOODS = (
    Mood(Expression.JOY, 0.4),
    Mood(Expression.JOY, 0.7, 1.0, 2.2),
    Mood(Expression.ANGER, 0.3, 0.5, 0.7, attack_s=0.1, release_s=0.3),
    Mood(Expression.FEAR, 1.0, 1.5, 3.0),
)
END_S = FIXATION_S[0]
"""Time before a file's end at which it may look straight ahead again, and begin to come to rest."""
MAX_APART_FAPU = 1


def speech(seed: int, count: int = 24, tail_s: float = 0.3) -> PhoneTrack:
    """Phones of 40 to 200 ms, some stressed, and pauses of 10 to 600 ms."""
    rng = np.random.default_rng(seed)
    labels = rng.choice([*english().phones, "ɔɪ", "%", SILENCE, SILENCE, SILENCE], count)
    edges = np.cumsum(
        [0.1, *(rng.uniform(0.01, 0.6) if each == SILENCE else rng.uniform(0.04, 0.2) for each in labels)]
    )
    stress = rng.choice([0, 0, 1, 2], count)
    phones = [
        Phone(str(label), float(start_s), float(end_s), 0 if label == SILENCE else int(level))
        for label, (start_s, end_s), level in zip(labels, pairwise(edges), stress, strict=True)
    ]
    return PhoneTrack.from_phones([*phones, Phone(SILENCE, float(edges[-1]), float(edges[-1]) + tail_s)])


def offline(phones: PhoneTrack, style: Style, seed: int, rate_hz: float, moods: tuple[Mood, ...] = ()) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return plan(phones, english(), rng=rng, rate_hz=rate_hz, style=style, expressions=moods).track.values


def live(
    phones: PhoneTrack, style: Style, seed: int, rate_hz: float, count: int, moods: tuple[Mood, ...] = (),
    *, begins_s: float = 0.0, ahead_s: float = np.inf, ends: bool = True,
) -> np.ndarray:  # fmt: skip
    """FAPs of a session that is told all at its beginning, or each phone so long ahead of its time."""
    engine = Engine(english(), rng=np.random.default_rng(seed), style=style)
    engine.open("face", begins_s)
    engine.apply("face", Begin(1), begins_s)
    if ends:
        engine.rest("face", begins_s + rest_s(phones), begins_s)
    for ramp in mood_ramps(moods, english(), rest_s(phones)):
        request = Express(EXPRESSIONS[ramp.channel], ramp.goal, begins_s + ramp.at_s, ramp.over_s)
        engine.apply("face", request, begins_s)
    told, frames = 0, []
    for frame in range(count):
        now_s = begins_s + frame / rate_hz
        known = sum(phone.start_s - ahead_s <= frame / rate_hz for phone in phones.phones)
        if known > told:
            engine.apply("face", Append(1, told, phones.phones[told:known]), now_s)
            told = known
            if told == len(phones.phones):
                engine.apply("face", End(1, told, phones.duration_s), now_s)
        frames.append(engine.frame(now_s).faps[0])
    return np.array(frames)


def apart(one: np.ndarray, other: np.ndarray) -> int:
    return int(np.abs(one - other).max())


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 60.0])
@pytest.mark.parametrize("name", STYLES)
def test_every_frame_is_the_same(name: str, rate_hz: float) -> None:
    for seed, moods in ((1, ()), (2, MOODS)):
        phones = speech(seed)
        wanted = offline(phones, STYLES[name], seed, rate_hz, moods)
        assert apart(live(phones, STYLES[name], seed, rate_hz, len(wanted), moods), wanted) <= MAX_APART_FAPU
        assert wanted.any()


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(0.001, 0.5), st.sampled_from(sorted(STYLES)))
@settings(max_examples=20)
def test_whatever_is_said(seed: int, count: int, tail_s: float, name: str) -> None:
    """Also where the last phone reaches the end of the track: both come to rest behind it."""
    phones = speech(seed, count, tail_s)
    wanted = offline(phones, STYLES[name], seed, 30.0, MOODS)
    assert apart(live(phones, STYLES[name], seed, 30.0, len(wanted), MOODS), wanted) <= MAX_APART_FAPU


LENGTHS_S = (0.0004, 0.001, 0.002, 0.004, 0.006, 0.011, 0.013, 0.05, 0.1, 0.6)


@given(
    st.lists(
        st.tuples(st.sampled_from(["b", "f", "s", "ɑ", "i", "uː", "ɔɪ", "%", SILENCE]), st.sampled_from(LENGTHS_S)),
        min_size=1,
        max_size=14,
    )
)
@settings(max_examples=30)
def test_phones_and_pauses_of_any_length(spoken: list[tuple[str, float]]) -> None:
    """Also of less than a millisecond, beside pauses that are as short, and of pauses in a row."""
    edges = np.cumsum([0.1, *(length_s for _, length_s in spoken)])
    phones = [Phone(label, float(a), float(b)) for (label, _), (a, b) in zip(spoken, pairwise(edges), strict=True)]
    track = PhoneTrack((Phone(SILENCE, 0.0, 0.1), *phones, Phone(SILENCE, float(edges[-1]), float(edges[-1]) + 0.3)))
    wanted = offline(track, Style.speech_only(), 1, 60.0)
    assert apart(live(track, Style.speech_only(), 1, 60.0, len(wanted)), wanted) <= MAX_APART_FAPU


def test_short_phones_that_come_one_by_one() -> None:
    """Keys nearer than ``keyframes.CLOSEST_KEYS_S`` give way along a row of such phones: no eight here."""
    rng = np.random.default_rng(8)
    for _ in range(6):
        labels = rng.choice([*english().phones, SILENCE], 40)
        lengths = np.where(rng.random(40) < 0.4, rng.choice([0.001, 0.003, 0.006, 0.012], 40), 0.15)
        lengths[::5] = 0.15
        edges = np.cumsum([0.3, *lengths])
        phones = PhoneTrack.from_phones(
            [Phone(str(label), float(a), float(b)) for label, (a, b) in zip(labels, pairwise(edges), strict=True)]
        )
        wanted = offline(phones, Style.speech_only(), 3, 60.0)
        seen = live(phones, Style.speech_only(), 3, 60.0, len(wanted), ahead_s=3.0)
        assert apart(seen, wanted) <= MAX_APART_FAPU


def test_a_long_text() -> None:
    phones = speech(5, 300)
    wanted = offline(phones, Style(), 5, 30.0, MOODS)
    assert len(wanted) > 900
    assert apart(live(phones, Style(), 5, 30.0, len(wanted), MOODS), wanted) <= MAX_APART_FAPU


@pytest.mark.parametrize("ahead_s", [1.2, 3.0])
def test_phones_that_come_one_by_one_ahead_of_time(ahead_s: float) -> None:
    """Ahead by the five phones and the first keyframe that the stream looks at (``stream.AHEAD_PHONES``)."""
    rng = np.random.default_rng(3)
    labels = rng.choice(list(english().phones), 40)
    phones = PhoneTrack.from_phones(
        [Phone(str(label), 0.3 + n / 8, 0.3 + (n + 1) / 8, int(n % 4 == 1)) for n, label in enumerate(labels)]
    )
    wanted = offline(phones, Style(), 3, 60.0)
    assert apart(live(phones, Style(), 3, 60.0, len(wanted), ahead_s=ahead_s), wanted) <= MAX_APART_FAPU


def test_a_session_that_begins_at_any_time() -> None:
    phones = speech(4)
    wanted = offline(phones, Style(), 4, 50.0)
    assert apart(live(phones, Style(), 4, 50.0, len(wanted), begins_s=1000.0), wanted) <= MAX_APART_FAPU


def test_a_session_that_is_told_of_no_end_differs_only_before_it() -> None:
    phones = speech(6, tail_s=1.0)
    for style in (Style(), Style.speech_only()):
        wanted = offline(phones, style, 6, 60.0)
        seen = live(phones, style, 6, 60.0, len(wanted), ends=False)
        same = round((phones.duration_s - END_S) * 60.0)
        assert apart(seen[:same], wanted[:same]) <= MAX_APART_FAPU
        assert (apart(seen, wanted) > MAX_APART_FAPU) == style.has_gestures


def test_the_second_session_has_chance_of_its_own() -> None:
    engine = Engine(english(), rng=np.random.default_rng(1))
    for name in ("first", "second"):
        engine.open(name, 0.0)
    seen = np.array([engine.frame(n / 30).faps for n in range(200)])
    assert apart(seen[:, 0], seen[:, 1]) > 100


@pytest.mark.parametrize("name", GENERATORS)
def test_switching_one_generator_off_leaves_the_others_as_they_are(name: str) -> None:
    """Offline and live; gaze and head motion meet in the eyes, and blinks and gaze in the lids, so one is left out."""
    phones = speech(7)
    others = [other for other in GENERATORS if other != name]
    for other in others:
        with_both = Style(**{each: each in (name, other) for each in GENERATORS})  # type: ignore[arg-type]
        alone = Style(**{each: each == other for each in GENERATORS})  # type: ignore[arg-type]
        one, both = offline(phones, alone, 7, 25.0), offline(phones, with_both, 7, 25.0)
        single = offline(phones, Style(**{each: each == name for each in GENERATORS}), 7, 25.0)  # type: ignore[arg-type]
        still = offline(phones, Style.speech_only(), 7, 25.0)
        untouched = (single == still).all(axis=0)
        eyes_and_lids = slice(18, 26)
        if "gaze" in (name, other) or {"idle", "blinks"} == {name, other}:  # lids that meet yield to each other
            untouched[eyes_and_lids] = False
        np.testing.assert_array_equal(both[:, untouched], one[:, untouched])
