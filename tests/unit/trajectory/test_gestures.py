"""Gestures: seeded, apart from each other, at rest at both ends, and the same in whatever pieces phones come."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fapengine.expressions import EXPRESSIONS, Expression
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import to_codable
from fapengine.speaking import DEFAULT_PROFILE, GENERATORS
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.expression import MAX_WEIGHT, expression_faps
from fapengine.trajectory.gestures import (
    BLINK_CLOSE_S,
    BLINK_OPEN_S,
    BLINK_SHUT_S,
    CHANNELS,
    FIRST_BLINK_S,
    GLANCE_RAD,
    NOD_FALL_S,
    NOD_RISE_S,
    ONSET_AHEAD_S,
    REACH_S,
    STANCE_RAD,
    Channel,
    GestureGenerator,
    Phrases,
    add_gestures,
    gesture_faps,
    gestures_of,
    start_levels,
)
from fapengine.trajectory.ramps import Ramp, Ramps, sample_ramps
from fapengine.trajectory.style import Style
from tests.unit.trajectory.mirror import TWINS

TIMES = np.arange(0, 20, 0.01)
PHONES = PhoneTrack.from_phones([Phone("a", 2.0, 2.2, stress=1), Phone("t", 2.2, 2.3), Phone("i", 4.0, 4.1, stress=2)])


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def column(faps: np.ndarray, number: int) -> np.ndarray:
    return faps[:, fap.column(number)]


def sample_gestures(
    times: np.ndarray, end_s: float, phones: Sequence[Phone], style: Style, rng: np.random.Generator
) -> np.ndarray:
    return gestures_of(times, end_s, phones, style, rng)(slice(None))[1].T


def only(*names: str, times: np.ndarray = TIMES, end_s: float = 20.0) -> np.ndarray:
    style = Style(**{name: name in names for name in GENERATORS})  # type: ignore[arg-type]
    return sample_gestures(times, end_s, PHONES.phones, style, rng())


def test_blinks_close_the_eyes_fully_and_come_at_a_human_rate() -> None:
    times = np.arange(0, 300, 0.01)
    upper = column(only("blinks", times=times, end_s=300.0), 19)
    count = (np.diff((upper > 900).astype(int)) == 1).sum()
    assert 14 * 5 <= count <= 21 * 5  # 17 a minute of a face that is silent
    assert upper.max() == pytest.approx(960)
    assert upper[-1] == 0


def test_the_first_blink_has_shut_the_eyes_when_it_may() -> None:
    draws = [GestureGenerator(np.random.default_rng(seed), Style()).draw(2.0) for seed in range(100)]
    shut_s = [next(ramp.at_s for ramp in drawn if ramp.channel == Channel.BLINK) + BLINK_CLOSE_S for drawn in draws]
    assert FIRST_BLINK_S[0] <= min(shut_s) < max(shut_s) <= FIRST_BLINK_S[1]


@pytest.mark.parametrize("seed", range(8))
def test_no_blink_is_cut_off_by_the_end(seed: int) -> None:
    generator = GestureGenerator(np.random.default_rng(seed), Style())
    generator.end(4.0, 0.0)
    blinks = [ramp for ramp in generator.draw(9.0) if ramp.channel == Channel.BLINK]
    assert blinks
    assert max(ramp.at_s + ramp.over_s for ramp in blinks) < 4.0
    assert blinks[1].at_s - blinks[0].at_s == pytest.approx(BLINK_CLOSE_S + BLINK_SHUT_S)
    assert blinks[1].over_s == BLINK_OPEN_S


def test_the_same_seed_is_the_same_motion_and_each_generator_has_its_own_chance() -> None:
    alone = {name: only(name) for name in GENERATORS}
    np.testing.assert_array_equal(only("sway"), only())
    assert not only().any()
    assert all(faps.any() for faps in alone.values())
    np.testing.assert_array_equal(only(*GENERATORS), only(*GENERATORS))
    without_gaze = [name for name in GENERATORS if name != "gaze"]
    np.testing.assert_allclose(only(*without_gaze), sum(alone[name] for name in without_gaze), atol=1e-9)
    head = [fap.column(number) for number in (48, 49, 50)]
    brows = [fap.column(number) for number in range(31, 37)]
    for name in GENERATORS:  # what one adds is the same, whatever else is switched on
        rest = only(*(other for other in GENERATORS if other != name))
        for columns in (head, brows):
            added = (only(*GENERATORS) - rest)[:, columns]
            np.testing.assert_allclose(added, alone[name][:, columns], atol=1e-9)
    glances = column(only(*GENERATORS), 23) + column(only(*GENERATORS), 49)
    np.testing.assert_allclose(glances, column(alone["gaze"], 23), atol=1e-9)


def test_everything_begins_and_ends_at_nothing() -> None:
    faps = only(*GENERATORS)
    assert not faps[0].any()
    assert only(*GENERATORS, times=np.array([20.0, 20.1])) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("end_s", [0.02, 0.3, 1.0])
def test_a_short_track_ends_at_nothing_too(end_s: float) -> None:
    assert only(*GENERATORS, times=np.array([end_s]), end_s=end_s) == pytest.approx(0, abs=1e-6)


def test_a_nod_that_is_under_way_at_the_end_comes_to_rest_with_it() -> None:
    stressed = [Phone("a", 0.5, 0.9, stress=1)]
    style = Style(blinks=False, head_motion=False, gaze=False, idle=False)
    times = np.array([0.55, 1.0, 1.01])
    assert column(sample_gestures(times, 1.0, stressed, style, rng()), 33) == pytest.approx([43.7, 0, 0], abs=0.1)
    assert not sample_gestures(times, 0.5 - NOD_RISE_S + NOD_FALL_S, stressed, style, rng()).any()


def test_eyes_counter_the_head() -> None:
    faps = only("head_motion", "emphasis", "gaze")
    seen = column(faps, 23) + column(faps, 49)
    assert np.abs(column(faps, 49)).max() > 500
    np.testing.assert_allclose(seen, column(only("gaze"), 23), atol=1e-9)
    np.testing.assert_array_equal(column(faps, 23), column(faps, 24))


def test_glances_jump_and_rest() -> None:
    yaw = column(only("gaze", times=np.arange(0, 600, 0.01), end_s=600.0), 23) * 1e-5
    moving = np.abs(np.diff(yaw)) > 1e-9
    assert moving.mean() < 0.08
    rests_s = 0.01 * np.diff(np.flatnonzero(np.diff(moving.astype(int)) == 1))
    assert 0.58 < rests_s.min() < 0.65
    assert rests_s.mean() == pytest.approx(2.0, abs=0.25)
    assert 0.3 * GLANCE_RAD < np.std(yaw) < 2 * GLANCE_RAD


def test_stress_nods_and_raises_the_brows_once_each() -> None:
    faps = only("emphasis")
    brow = column(faps, 33)
    assert brow[205] > 20
    assert column(faps, 48)[205] > 500
    assert 0 < brow[402] < brow[205] + 38  # secondary stress: half
    assert brow[1000:] == pytest.approx(0)


def test_idle_and_head_motion_are_small_and_never_still() -> None:
    drift, turn = only("idle"), only("head_motion")
    assert 3 < np.abs(column(drift, 33)).max() < 30
    assert 1 < np.abs(column(drift, 12)).max() < 15
    for other in (13, 59, 60):  # both corners, inside and outside
        np.testing.assert_array_equal(column(drift, other), column(drift, 12))
    assert 0.01 < np.abs(column(turn, 49)).max() * 1e-5 < 0.08
    assert not column(drift, 4).any()  # the lips' opening is not touched
    assert not column(drift, 5).any()


def test_lids_go_with_the_gaze() -> None:
    faps = only("head_motion", "gaze")
    pitch_rad = column(faps, 25) * 1e-5
    assert np.abs(pitch_rad).max() > 0.01
    for number, per_rad in ((19, 600.0), (20, 600.0), (21, -200.0), (22, -200.0)):
        np.testing.assert_allclose(column(faps, number), per_rad * pitch_rad, atol=1e-9)


def test_lids_that_a_blink_has_shut_do_not_follow_the_gaze() -> None:
    faps = only("gaze", "blinks")
    shut = column(faps, 19) >= 960
    assert np.abs(column(faps, 25)[shut]).max() > 100
    np.testing.assert_allclose(column(faps, 19)[shut], 960)


def nods(pieces: list[list[Phone]], known_s: list[float], step_s: float) -> list[Ramp]:
    """Ramps of nods, for phones that become known in pieces, drawn frame by frame."""
    generator = GestureGenerator(rng(), Style())
    waiting, ramps = list(zip(known_s, pieces, strict=True)), []
    for frame in range(round(12 / step_s)):
        while waiting and waiting[0][0] <= frame * step_s:
            at_s, phones = waiting.pop(0)
            generator.hear([(phone.start_s, phone) for phone in phones], at_s)
        ramps += generator.draw(frame * step_s)
    return [ramp for ramp in ramps if ramp.channel == Channel.NOD]


LENGTHS_S = np.random.default_rng(2).uniform(0.18, 0.28, 29)
STRESSED = [
    Phone("a", float(at_s), float(at_s) + length_s, stress=1 + n % 2)
    for n, (at_s, length_s) in enumerate(zip(np.arange(0.4, 9, 0.3), LENGTHS_S.tolist(), strict=True))
]


@pytest.mark.parametrize("ahead_s", [REACH_S + NOD_RISE_S + 0.001, 3.0])
def test_nods_are_the_same_whether_phones_come_at_once_or_one_by_one_ahead_of_time(ahead_s: float) -> None:
    at_once = nods([STRESSED], [0.0], 1 / 25)
    one_by_one = nods([[phone] for phone in STRESSED], [max(phone.start_s - ahead_s, 0.0) for phone in STRESSED], 1e-3)
    assert one_by_one == at_once
    assert 2 * 3 <= len(at_once) <= 2 * 6  # 29 stresses in 8.6 s
    pairs = [[STRESSED[n + 1], STRESSED[n]] for n in range(0, len(STRESSED) - 1, 2)]
    assert nods(pairs, [0.0] * len(pairs), 0.01) == nods([STRESSED[: 2 * len(pairs)]], [0.0], 0.01)


def test_a_nod_begins_when_its_phone_is_known_and_never_behind_the_phone_s_beginning() -> None:
    (rise, fall) = nods([[Phone("a", 1.0, 1.2, stress=1)]], [0.9], 0.01)
    assert (rise.at_s, fall.at_s) == (0.9, pytest.approx(0.9 + NOD_RISE_S + 0.1))
    assert nods([[Phone("a", 1.0, 1.2, stress=1)]], [1.0], 0.01) == []


def test_a_shouted_nod_is_large_and_a_whispered_one_small() -> None:
    spoken = [Phone("a", 1.0, 1.2, stress=1, loudness_db=loudness_db) for loudness_db in (0.0, 8.0, -12.0)]
    usual, shouted, whispered = (nods([[phone]], [0.0], 0.01)[0].goal for phone in spoken)
    assert shouted == pytest.approx(2 * usual)
    assert whispered == pytest.approx(usual / 2**1.5)


def test_a_nod_takes_over_from_the_one_before() -> None:
    ramps = nods([[Phone("a", 1.0, 1.8, stress=1), Phone("a", 2.0, 2.6, stress=2)]], [0.0], 0.01)
    assert len(ramps) == 4  # a pause lies between them
    level = sample_ramps(np.zeros(CHANNELS), ramps, np.array([1.0, 2.0, 2.1, 2.4]))[Channel.NOD]
    assert level[0] > 0.49
    np.testing.assert_allclose(level[1:3], ramps[2].goal)
    assert 0 < level[3] < ramps[2].goal


def talk(phrases: int, *, phone_s: float = 0.1, pause_s: float = 0.35, phones: int = 22) -> list[Phone]:
    """Phrases of 2.2 s; every fifth phone is stressed, the third stress of a phrase is the longest."""
    spoken, at_s = [], 1.0
    for _ in range(phrases):
        for number in range(phones):
            length_s = 1.6 * phone_s if number == 12 else phone_s
            spoken.append(Phone("a", at_s, at_s + length_s, stress=int(number % 5 == 2)))
            at_s += length_s
        spoken.append(Phone("_", at_s, at_s + pause_s))
        at_s += pause_s
    return spoken


def drawn(spoken: list[Phone], end_s: float, seed: int = 5) -> list[Ramp]:
    generator = GestureGenerator(np.random.default_rng(seed), Style())
    generator.hear([(phone.start_s, phone) for phone in spoken], 0.0)
    return generator.draw(end_s)


def test_a_phrase_has_one_nod_on_its_strongest_accent() -> None:
    spoken = talk(10)
    begins = [ramp.at_s for ramp in drawn(spoken, 30.0) if ramp.channel == Channel.NOD and ramp.goal > 0]
    strongest = [phone.start_s - NOD_RISE_S for phone in spoken if phone.duration_s > 0.15 and phone.stress]
    np.testing.assert_allclose(begins, strongest)
    assert len(begins) == 10


def test_a_louder_accent_is_stronger_and_a_long_phrase_has_several() -> None:
    spoken = [
        Phone("a", 0.1 * n, 0.1 * n + 0.1, stress=int(n % 4 == 0), loudness_db=3.0 * (n == 8)) for n in range(100)
    ]
    begins = [ramp.at_s for ramp in drawn(spoken, 12.0) if ramp.channel == Channel.NOD and ramp.goal > 0]
    assert begins[0] == pytest.approx(0.8 - NOD_RISE_S)
    assert 4 <= len(begins) <= 7
    assert min(np.diff(begins)) >= REACH_S - 1e-9


def test_after_twice_the_reach_without_a_nod_no_accent_waits_for_a_stronger_one() -> None:
    phrases, weak, strong = Phrases(), Phone("a", 0.0, 0.1, stress=2), Phone("a", 0.0, 0.2, stress=1)
    phrases.learn(0.0, Phone("a", 0.0, 8.0))
    for after_s, is_outstanding in ((0.9 * REACH_S, False), (1.9 * REACH_S, False), (2.1 * REACH_S, True)):
        phrases.learn(after_s + 0.5, strong)
        assert phrases.is_outstanding(after_s, weak, last_s=0.0) is is_outstanding


def test_blinks_of_a_speaker_are_drawn_to_pauses() -> None:
    spoken = talk(60)
    ends = np.array([phone.start_s for phone in spoken if phone.is_silence])
    begins = np.array([
        ramp.at_s for seed in range(6) for ramp in drawn(spoken, 155.0, seed)
        if ramp.channel == Channel.BLINK and ramp.goal > 0
    ])  # fmt: skip
    per_minute = 60 * len(begins) / 6 / 155
    assert 22 < per_minute < 31  # people who converse: 26
    behind = np.abs(begins[:, None] - ends[None, :] - 0.1).min(axis=1)
    assert (behind < 0.35).mean() > 1.8 * 0.7 / 2.6  # near an end for 0.7 s of each 2.6


def test_the_head_moves_when_speech_begins_and_settles_when_it_ends() -> None:
    spoken = [*talk(2), Phone("_", 8.0, 11.0)]
    moves = [ramp for ramp in drawn(spoken, 12.0) if ramp.channel == Channel.STANCE_YAW]
    begins = [spoken[0].start_s, spoken[23].start_s]
    ends = [spoken[22].start_s, spoken[45].start_s]
    expected = [begins[0] - ONSET_AHEAD_S, ends[0], max(begins[1] - ONSET_AHEAD_S, ends[0]), ends[1]]
    np.testing.assert_allclose([move.at_s for move in moves], expected, atol=1e-6)
    least, most = STANCE_RAD[Channel.STANCE_YAW]
    assert all(least <= abs(move.goal) <= most for move in moves[::2])
    assert all(abs(settled.goal) < abs(turned.goal) for turned, settled in zip(moves[::2], moves[1::2], strict=True))
    faps = sample_gestures(TIMES, 12.0, spoken, Style(blinks=False, idle=False, emphasis=False, gaze=False), rng())
    assert np.abs(column(faps, 49)[begins[0] - ONSET_AHEAD_S > TIMES]).max() < 0.08 / AU_RAD  # it wanders only
    assert faps[TIMES >= 12.0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("pause_s", [0.1, 0.2])  # within a phrase, and between two of them
def test_a_short_pause_moves_no_head(pause_s: float) -> None:
    spoken = talk(3, pause_s=pause_s)
    assert len([ramp for ramp in drawn(spoken, 6.0) if ramp.channel == Channel.STANCE_PITCH]) == 1


@pytest.mark.parametrize("step_s", [1 / 60, 0.2])
def test_all_gestures_are_the_same_live_as_in_a_file(step_s: float) -> None:
    """Phones come one by one, so far ahead as accents compete."""
    spoken = talk(6)
    generator, waiting, live = GestureGenerator(rng(), Style()), list(spoken), []
    for frame in range(round(20 / step_s)):
        now_s = frame * step_s
        while waiting and waiting[0].start_s - REACH_S - NOD_RISE_S - 0.3 <= now_s:
            generator.hear([(waiting[0].start_s, waiting.pop(0))], now_s)
        live += generator.draw(now_s)
    file = drawn(spoken, 20 - step_s)
    for channel in Channel:
        assert [ramp for ramp in live if ramp.channel == channel] == [ramp for ramp in file if ramp.channel == channel]
    assert {ramp.channel for ramp in live} >= {Channel.BLINK, Channel.NOD, Channel.STANCE_PITCH, Channel.GLANCE_YAW}


def test_speech_that_is_taken_back_settles_the_head_and_makes_no_nod() -> None:
    generator = GestureGenerator(rng(), Style())
    generator.hear([(phone.start_s, phone) for phone in talk(1)], 0.0)
    before = generator.draw(1.05)
    assert any(ramp.channel == Channel.STANCE_YAW for ramp in before)
    generator.hush(1.1)
    after = generator.draw(3.0)
    settled = [ramp for ramp in after if ramp.channel == Channel.STANCE_YAW]
    assert [ramp.at_s for ramp in settled] == [1.1]
    assert not [ramp for ramp in after if ramp.channel == Channel.NOD]


def test_what_is_taken_back_from_a_time_on_makes_no_nod_and_what_is_before_does() -> None:
    def told(generator: GestureGenerator) -> list[Ramp]:
        return [ramp for ramp in generator.draw(12.0) if ramp.channel == Channel.NOD]

    for count in (0, 7, 20, len(STRESSED)):
        shortened, short = GestureGenerator(rng(), Style()), GestureGenerator(rng(), Style())
        shortened.hear([(phone.start_s, phone) for phone in STRESSED], 0.0)
        shortened.forget(STRESSED[count].start_s if count < len(STRESSED) else 12.0)
        short.hear([(phone.start_s, phone) for phone in STRESSED[:count]], 0.0)
        ramps = told(shortened)
        assert ramps == told(short)
        assert bool(ramps) is (count > 0)


def test_left_and_right_are_alike() -> None:
    levels = rng().uniform(-1, 1, (CHANNELS, 30))
    faps = gesture_faps(levels, GestureGenerator(rng(), Style()).waves[..., None], np.linspace(0, 9, 30))
    assert np.abs(faps[[fap.column(number) for number in (19, 21, 23, 25, 31, 35, 48)]]).min(axis=1).all()
    np.testing.assert_allclose(faps[TWINS], faps, atol=1e-9)


def test_an_idle_face_moves_by_as_much_as_one_that_is_attentive() -> None:
    """Head in degrees, of a face that speaks and of one that breathes; brows, corners and lids in FAPU: effective."""
    times = np.arange(0, 400, 0.05)
    head, idle = (only(name, times=times, end_s=400.0).std(axis=0) for name in ("head_motion", "idle"))
    in_degrees = np.degrees(AU_RAD)
    moved = [head[fap.column(number)] * in_degrees for number in (48, 49, 50)]
    assert moved == pytest.approx([0.9, 1.2, 0.5], rel=0.15)
    assert idle[fap.column(48)] * in_degrees == pytest.approx(0.16, rel=0.15)
    for numbers, size in (((31, 33), 11.0), ((35,), 5.8), ((12, 59), 4.8), ((19,), 10.6)):
        for number in numbers:
            assert idle[fap.column(number)] == pytest.approx(size, rel=0.25), number


def test_speech_that_comes_late_moves_the_head_from_then_on() -> None:
    generator = GestureGenerator(rng(), Style())
    generator.draw(5.0)
    generator.hear([(5.05, Phone("a", 0.0, 0.4))], 5.0)
    moves = [ramp.at_s for ramp in generator.draw(5.2) if ramp.channel == Channel.STANCE_YAW]
    assert moves == [5.0]


def test_phrases_grow_in_any_order_and_are_forgotten() -> None:
    phrases = Phrases()
    for at_s in (1.0, 1.2, 3.0, 1.1):
        phrases.learn(at_s, Phone("a", 0.0, 0.1))
    phrases.learn(1.3, Phone("_", 0.0, 1.0))
    assert phrases.around(0.9) is None
    assert phrases.around(2.0) == (1.0, pytest.approx(1.3))
    assert phrases.following(2.0) == (3.0, pytest.approx(3.1))
    phrases.forget_from(1.15)
    assert phrases.around(9.0) == (1.0, 1.15)
    assert phrases.following(1.15) is None
    phrases.forget_before(20.0)
    assert phrases.around(9.0) is None


def test_gestures_do_not_depend_on_the_frame_rate() -> None:
    found = []
    for step_s in (1 / 25, 1 / 60, 30.0):
        generator = GestureGenerator(rng(), Style())
        ramps = [ramp for frame in range(round(30 / step_s) + 1) for ramp in generator.draw(frame * step_s)]
        found.append({channel: [ramp for ramp in ramps if ramp.channel == channel] for channel in Channel})
    assert found[0] == found[1] == found[2]
    assert len(found[0][Channel.BLINK]) > 4


RAMPS = st.lists(
    st.builds(Ramp, st.floats(0, 5), st.integers(0, 2), st.floats(-2, 2), st.floats(0.01, 2), takes_over=st.booleans()),
    max_size=12,
)


@given(RAMPS, st.integers(1, 40))
def test_ramps_are_the_same_sampled_and_frame_by_frame(ramps: list[Ramp], frames: int) -> None:
    times = np.linspace(0, 8, frames)
    start = np.array([0.0, 1.0, -1.0])
    many = Ramps(start)
    row = many.open()
    many.send(row, ramps)
    live = np.array([many.values(float(time_s))[:, row] for time_s in times])
    np.testing.assert_allclose(sample_ramps(start, ramps, times).T, live, atol=1e-9)


LIDS = [fap.column(number) for number in (19, 20, 21, 22)]
GESTURES = (
    Channel.LOOK_YAW,
    Channel.LOOK_PITCH,
    Channel.GLANCE_PITCH,
    Channel.PITCH,
    Channel.NOD,
    Channel.HEAD_MOTION,
    Channel.IDLE,
)
weights = st.fixed_dictionaries({}, optional={expression: st.floats(0.0, MAX_WEIGHT) for expression in EXPRESSIONS})


def added(weights: dict[Expression, float], blink: float, gestures: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """FAPs of a face with expressions and gestures, and their plain sum, (68,) FAPU as coded."""
    levels = start_levels(Style())[:, None]
    levels[[*GESTURES]] = np.array(gestures)[:, None] * np.array([0.5, 0.5, 0.05, 0.3, 1, 1, 1])[:, None]
    levels[Channel.BLINK] = blink
    waves = GestureGenerator(rng(), Style()).waves[..., None]
    faps = expression_faps(load_profile(DEFAULT_PROFILE)) @ [weights.get(expression, 0.0) for expression in EXPRESSIONS]
    gesture = gesture_faps(levels, waves, np.array([3.0])).T
    plain = faps + gesture
    shown = faps[None].copy()
    add_gestures(shown, gesture)
    return to_codable(shown)[0], to_codable(plain)[0]


@given(weights=weights, blink=st.floats(0.0, 1.0), gestures=st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7))
@example(weights={Expression.JOY: 1.0}, blink=1.0, gestures=[0.0] * 7)
@example(weights={Expression.SADNESS: 2.0}, blink=1.0, gestures=[0.0] * 7)
def test_lids_never_overlap(weights: dict[Expression, float], blink: float, gestures: list[float]) -> None:
    shown, plain = added(weights, blink, gestures)
    assert max(shown[LIDS[:2]] + shown[LIDS[2:]]) <= 1024 + 1  # both are rounded
    yields = (plain[LIDS[:2]] + plain[LIDS[2:]]) > 1024
    changed = np.flatnonzero(shown != plain)
    assert set(changed) <= {lower for lower, does in zip(LIDS[2:], yields, strict=True) if does}
    assert (shown <= plain).all()


@given(
    expression=st.sampled_from(EXPRESSIONS),
    weight=st.floats(0.0, MAX_WEIGHT),
    gestures=st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7),
)
def test_without_a_blink_lower_lids_are_the_expression_s(
    expression: Expression, weight: float, gestures: list[float]
) -> None:
    shown, plain = added({expression: weight}, 0.0, gestures)
    np.testing.assert_array_equal(shown, plain)


@pytest.mark.parametrize("expression", [Expression.JOY, Expression.ANGER, Expression.SADNESS, Expression.DISGUST])
def test_a_blink_shuts_the_eyes_of_an_expression_exactly(expression: Expression) -> None:
    shown, plain = added({expression: 1.0}, 1.0, [0.0] * 7)
    assert plain[LIDS[0]] + plain[LIDS[2]] > 1024
    assert shown[LIDS[0]] + shown[LIDS[2]] == pytest.approx(1024, abs=1)
