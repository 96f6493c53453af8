"""Phones as they come: the stream equals the offline plan, never jumps, closes late lips, and comes to rest."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory import hermite
from fapengine.trajectory.closures import BURST_S, MIN_HOLD_S, OPEN_FAPU, RAMP_S
from fapengine.trajectory.planner import Style, plan
from fapengine.trajectory.stream import AHEAD_PHONES, BEHIND_PHONES, PLANNED_LETTERS
from fapengine.trajectory.targets import keys_of
from tests.english import english
from tests.single_stream import SingleStream, jet_of_plan

STILL = Style.speech_only()
RATE_HZ = 100.0
LABELS = st.lists(
    st.sampled_from(["p", "b", "m", "f", "s", "aɪ", "ɑː", "i", "uː", "w", "ʃ", "n"]), min_size=3, max_size=14
)
LENGTHS = st.floats(0.05, 0.22)
SPANS = st.lists(
    st.tuples(
        st.sampled_from("pbmfsiɑuwʃn"), st.sampled_from([0.08, 0.15, 2.5, 6.0]), st.sampled_from([0.0, 0.0, 0.2, 3.0])
    ),
    min_size=8,
    max_size=14,
)
"""Label, length and pause before it, s."""


def closed() -> float:
    return 0.3 / english().fapu.unit(fap.FapUnit.MNS)


def phones(labels: list[str], each_s: float, lead_s: float = 0.4) -> list[Phone]:
    times = lead_s + each_s * np.arange(len(labels) + 1)
    return [Phone(label, float(a), float(b)) for label, (a, b) in zip(labels, pairwise(times), strict=True)]


def times_until(end_s: float) -> np.ndarray:
    return np.arange(round(end_s * RATE_HZ)) / RATE_HZ


def offline(spoken: list[Phone], times: np.ndarray) -> np.ndarray:
    track = PhoneTrack.from_phones(spoken)
    return keys_of(track, english()).paths()[0].sample(times)


def opening(values: np.ndarray) -> np.ndarray:
    return -(values[:, fap.column(4)] + values[:, fap.column(5)])


def streamed(spoken: list[Phone], times: np.ndarray, planner: SingleStream, most_phones: float = np.inf) -> np.ndarray:
    """Path of a stream in which each phone comes just early enough; the first ones are known."""
    path, known = [], AHEAD_PHONES + 1
    for time in times:
        while known < len(spoken) and spoken[known - AHEAD_PHONES].start_s - 0.2 <= time:
            planner.feed([spoken[known]])
            known += 1
        path.append(planner.path([time])[0])
        planner.frames([time])
        assert len(planner._phones) <= most_phones
    return np.array(path)


@given(LABELS, LENGTHS, st.integers(0, 2**32 - 1))
def test_phones_that_come_early_enough_give_the_offline_path(labels, each_s, seed):
    spoken = phones(labels, each_s)
    times = np.arange(0, spoken[-1].end_s + 0.4, 0.03)
    planner, rng = SingleStream(english()), np.random.default_rng(seed)
    waiting = list(rng.permutation(AHEAD_PHONES + 1))  # the first ones in any order
    planner.feed([spoken[index] for index in waiting if index < len(spoken)])
    np.testing.assert_allclose(streamed(spoken, times, planner), offline(spoken, times), atol=1e-9)
    assert planner.counts.late == planner.counts.dropped == 0


@pytest.mark.parametrize(("lengths", "seed"), [((0.03, 0.05, 0.09), 18), ((0.02, 0.04, 0.06, 0.1), 10)])
def test_so_do_diphthongs_and_affricates_that_are_too_short_for_all_their_keys(lengths, seed):
    rng = np.random.default_rng(seed)
    edges = 0.4 + np.cumsum(rng.choice(lengths, 12))
    labels = rng.choice(["p", "aɪ", "ɔɪ", "tʃ", "uː", "aɪə"], 11)
    spoken = [Phone(*phone) for phone in zip(labels.tolist(), edges.tolist(), edges[1:].tolist(), strict=False)]
    planner, times = SingleStream(english()), np.arange(0, edges[-1] + 0.2, 0.02)
    planner.feed(spoken[: AHEAD_PHONES + 1])
    np.testing.assert_allclose(streamed(spoken, times, planner), offline(spoken, times), atol=1e-9)


def test_lips_prepare_in_a_stream_as_in_a_file_when_phones_come_a_quarter_of_a_second_early():
    for label in "bslɑu":
        spoken = phones([label, "ɪ", "n"], 0.1, lead_s=1.0)
        planner = SingleStream(english())
        assert not planner.frames(np.arange(0.0, 0.755, 0.01)).any()
        planner.feed(spoken)
        times = np.arange(0.76, 1.5, 0.01)
        np.testing.assert_allclose(planner.path(times), offline(spoken, times), atol=1e-9)


def test_its_faps_are_the_planners():
    spoken = phones(["b", "aɪ", "m", "s", "uː", "p"], 0.12)
    track = PhoneTrack.from_phones([*spoken, Phone(SILENCE, spoken[-1].end_s, spoken[-1].end_s + 0.5)])
    whole = plan(track, english(), style=STILL, rate_hz=RATE_HZ, rng=np.random.default_rng(0)).track.values
    planner = SingleStream(english())
    planner.feed(spoken)
    np.testing.assert_array_equal(planner.frames(times_until(track.duration_s)), whole)


def test_long_vowels_sway_in_a_stream_as_in_a_file():
    edges = np.cumsum([0.4, 0.1, 1.5, 0.1, 0.9, 0.08, 3.0, 0.1, 0.1, 0.1])
    spoken = [Phone(*phone) for phone in zip("sɑpumitɑs", edges, edges[1:], strict=False)]
    planner, path, times = SingleStream(english()), [], np.arange(0, 6.5, 0.05)
    planner.feed(spoken[: AHEAD_PHONES + 1])
    for time in times:
        planner.feed(spoken[: AHEAD_PHONES + 1 + sum(phone.end_s < time + 0.03 for phone in spoken)])
        path.append(planner.path([time])[0])
        planner.frames([time])
    np.testing.assert_allclose(path, offline(spoken, times), atol=1e-9)


@settings(max_examples=10)
@given(SPANS)
def test_long_phones_and_pauses_are_in_a_stream_as_in_a_file(spans):
    """What ended long ago is a neighbour still, as in a file."""
    ends = np.cumsum([pause_s + length_s for _, length_s, pause_s in spans]) + 0.4
    spoken = [
        Phone(label, float(end_s - length_s), float(end_s))
        for (label, length_s, _), end_s in zip(spans, ends, strict=True)
    ]
    planner, times = SingleStream(english()), np.arange(0, ends[-1] + 0.4, 0.1)
    planner.feed(spoken[: AHEAD_PHONES + 1])
    path = streamed(spoken, times, planner, most_phones=BEHIND_PHONES + AHEAD_PHONES + 3)
    np.testing.assert_allclose(path, offline(spoken, times), atol=1e-9)


@given(LABELS, LABELS, LENGTHS, st.floats(0.0, 1.0), st.sampled_from(["revise", "cancel", "late"]))
def test_nothing_jumps_whatever_happens(labels, others, each_s, share, event):
    """Value, velocity and acceleration are continuous at the moment of a change."""
    planner = SingleStream(english())
    spoken = phones(labels, each_s)
    planner.feed(spoken)
    at_s = spoken[0].start_s + share * (spoken[-1].end_s - spoken[0].start_s)
    planner.frames([at_s])
    before = jet_of_plan(planner._plans[-1], np.array([at_s]))
    if event == "revise":
        planner.feed(phones(others, each_s, lead_s=at_s + 0.05))
    elif event == "late":
        planner.feed([Phone("b", at_s - 0.02, at_s + 0.06)])
    else:
        planner.cancel(at_s)
    after = jet_of_plan(planner._plans[-1], np.array([at_s]))
    for old, new, unit in zip(before, after, (1.0, 20.0, 1000.0), strict=True):
        np.testing.assert_allclose(new, old, atol=1e-7 * unit)
    fine = np.linspace(at_s, at_s + 0.5, 2001)
    speed = np.abs(np.diff(planner.path(fine), axis=0)).max() / (fine[1] - fine[0])
    assert speed < 3000  # weights (mm) a second; a jump of a millimetre would be 4,000


@given(LABELS, LENGTHS, st.floats(0.0, 1.0), st.floats(0.08, 0.5))
def test_cancelling_brings_rest_in_time_from_any_state(labels, each_s, share, fade_s):
    planner = SingleStream(english())
    spoken = phones(labels, each_s)
    planner.feed(spoken)
    at_s = spoken[0].start_s + share * (spoken[-1].end_s - spoken[0].start_s)
    planner.frames([at_s])
    planner.cancel(at_s, fade_s=fade_s)
    settled = at_s + max(fade_s, 2 * RAMP_S + MIN_HOLD_S + each_s)
    assert np.abs(planner.path(np.linspace(at_s + fade_s, at_s + 3, 50))).max() < 1e-9
    assert not planner.frames([settled + 0.1]).any()
    planner.feed(phones(labels, each_s, lead_s=at_s + 2.0))
    assert planner.frames(np.arange(at_s + 2, at_s + 3, 0.01)).any()


@pytest.mark.parametrize("ending", ["cancel", "silence", "vowel"])
def test_a_long_vowel_that_is_cut_short_holds_the_mouth_open_no_longer(ending):
    planner = SingleStream(english())
    planner.feed([Phone("æ", 0.0, 5.0)])
    assert opening(planner.frames([2.0]))[0] > OPEN_FAPU
    if ending == "cancel":
        planner.cancel(2.0)
    else:
        planner.feed([Phone(SILENCE if ending == "silence" else "u", 2.0, 5.0)])
        planner.feed([Phone(SILENCE, 2.1, 5.0)])
    assert not planner.frames([2.5]).any()


@given(LABELS, LENGTHS, st.floats(0.2, 1.0), st.floats(0.01, 10.0))
def test_a_slow_fade_opens_the_face_no_farther_than_speech_did(labels, each_s, share, fade_s):
    uncancelled, planner = SingleStream(english(), Style.speech_only()), SingleStream(english(), Style.speech_only())
    spoken = phones(["m", "ɑ", "b", "i", *labels, "ɑ", "b"], each_s)
    uncancelled.feed(spoken)
    planner.feed(spoken)
    at_s = spoken[0].start_s + share * (spoken[-1].end_s - spoken[0].start_s)
    before = uncancelled.frames(np.arange(0.0, spoken[-1].end_s, 1 / 60))
    planner.frames([at_s])
    planner.cancel(at_s, fade_s=fade_s)
    after = planner.frames(np.linspace(at_s, at_s + fade_s + 0.5, 200))
    gap = [-(faps[:, fap.column(4)] + faps[:, fap.column(5)]) for faps in (before, after)]
    assert gap[1].min() >= 0  # lips never cross
    # FAPU. A mouth that was held shut shows what was below it; 4,900 (102 mm) when velocity faded as slowly.
    assert gap[1].max() <= 1.25 * max(gap[0].max(), 300) + 120
    assert not after[-1].any()


@given(LABELS, st.floats(0.0, 0.2), st.floats(0.0, 0.05), st.sampled_from([0.01, 0.02, 0.05, 1.0]))
def test_a_face_that_is_called_back_while_it_hurries_to_rest_does_not_shoot_beyond_it(labels, share, wait_s, fade_s):
    planner = SingleStream(english())
    planner.feed(phones(["m", "ɑ", "b", "ɑ"], 0.2))
    at_s = 0.7 + share  # in the first open vowel
    shown = planner.frames(np.arange(0.0, at_s, 1 / 200))
    planner.cancel(at_s, fade_s=fade_s)
    planner.frames([at_s + wait_s])
    planner.feed(phones(["n", *labels], 0.12, lead_s=at_s + wait_s + 0.3))
    after = planner.frames(np.arange(at_s + wait_s, at_s + wait_s + 0.3, 1 / 500))
    # FAPU. 4,320, the end of the range, where velocity faded over 0.15 s, whatever it came from
    assert np.abs(after).max() <= 1.1 * np.abs(shown).max() + 60


def test_what_stands_before_a_coming_cancel_is_still_said():
    """Also when new phones are fed before that moment."""
    labels = ["b", "aɪ", "t", "s", "ʌ", "n"]
    undisturbed, planner = SingleStream(english()), SingleStream(english())
    for one in (undisturbed, planner):
        one.feed(phones(labels, 0.12))
        one.frames([0.45])
    planner.cancel(0.8)
    planner.feed(phones(["ɑ", "m"], 0.2, lead_s=1.3))
    times = np.arange(0.46, 0.8, 0.01)
    np.testing.assert_allclose(planner.path(times), undisturbed.path(times), atol=1e-12)
    assert np.abs(planner.path([1.05])).max() < 1e-9
    assert np.abs(planner.path([1.45])).max() > 5
    assert planner.counts.late == 0


def test_every_unknown_phone_is_counted():
    planner = SingleStream(english())
    for second in range(5):
        planner.feed([Phone("%", second + 0.1, second + 0.3), Phone("ɑ", second + 0.3, second + 0.5)])
        planner.frames([second + 0.9])
    assert planner.counts.unknown == 5


@pytest.mark.parametrize("late_s", [0.02, 0.05, 0.09, 0.15])
def test_a_late_bilabial_still_closes_the_lips(late_s):
    planner = SingleStream(english())
    planner.feed([Phone("ɑ", 0.3, 0.6), Phone("ɑ", 0.68, 1.2)])
    shown = planner.frames(times_until(0.6 + late_s))
    planner.feed([Phone("m", 0.6, 0.68)])
    rest = planner.frames(np.arange(0.6 + late_s, 1.2, 0.01))
    gap = opening(np.concatenate([shown, rest]))
    assert (opening(rest) <= closed()).sum() >= 4  # 40 ms
    assert np.abs(np.diff(gap)).max() < 0.5 * gap.max()  # in 10 ms, for a burst takes 30; else it would be a jump
    assert planner.counts.late + planner.counts.dropped == 1


def test_a_closure_that_has_begun_is_finished_though_its_phone_is_revised():
    planner = SingleStream(english())
    planner.feed([Phone("ɑ", 0.3, 0.6), Phone("b", 0.6, 0.7), Phone("ɑ", 0.7, 1.0)])
    planner.frames(times_until(0.6))
    planner.feed([Phone("s", 0.6, 0.7)])
    gap = opening(planner.frames(np.arange(0.6, 1.0, 0.01)))
    assert gap.min() <= closed()
    assert planner.counts.revised == 1


def test_a_bilabial_whose_times_change_a_little_while_it_is_shut_closes_once():
    planner = SingleStream(english())
    planner.feed([Phone("ɑ", 0.3, 0.6), Phone("b", 0.6, 0.7), Phone("ɑ", 0.7, 1.0)])
    planner.frames(times_until(0.62))
    (hold,) = [hold for hold in planner.holds if hold.contact == "lips"]
    planner.feed([Phone("ɑ", 0.3, 0.59), Phone("p", 0.59, 0.69), Phone("ɑ", 0.69, 1.0)])
    assert [one for one in planner.holds if one.contact == "lips"] == [hold]


def test_a_change_that_fades_goes_on_fading_when_the_same_phones_are_planned_again():
    def shown(again: bool) -> np.ndarray:
        planner, values = SingleStream(english()), []
        planner.feed([Phone("ɑ", 0.3, 0.6)])
        for time in times_until(0.7):
            if abs(time - 0.4) < 1e-9:
                planner.feed([Phone("i", 0.35, 0.6)])
            if again and time > 0.4:
                planner.feed([Phone("i", 0.35, 0.6 + 1e-5 * time)])  # only its end changes, and hardly
            values.append(planner.frames(np.array([time]))[0])
        return opening(np.array(values))

    changed = np.abs(shown(again=True) - shown(again=False))[round(0.42 * RATE_HZ) :].max()
    assert changed < 0.1 * shown(again=False).max()


def test_a_cancel_takes_its_time_though_a_change_is_fading():
    planner = SingleStream(english())
    planner.feed([Phone("ɑ", 0.3, 0.9)])
    planner.frames(times_until(0.4))
    planner.feed([Phone("m", 0.35, 0.9)])
    planner.frames(np.arange(0.4, 0.45, 1 / RATE_HZ))
    planner.cancel(0.45, fade_s=1.0)
    seen = opening(planner.frames(np.arange(0.45, 1.5, 1 / RATE_HZ)))
    assert np.abs(seen[round(0.4 * RATE_HZ)]) > 0.2 * np.abs(seen).max()
    assert np.abs(seen[-1]) < 0.01 * np.abs(seen).max()


def test_a_cancel_among_the_shortest_phones_opens_the_mouth_hardly_wider_than_speech():
    """Keys 4 ms apart have accelerations that opened the mouth by 3,318 FAPU, where the same speech opens it by 704."""
    rng = np.random.default_rng(5)
    edges = np.cumsum([0.2, *rng.choice([0.004, 0.02, 0.05], 24)]).tolist()
    labels = rng.choice(["m", "b", "ɑ", "iː", "s", "f", "uː", "æ"], 24).tolist()
    spoken = [Phone(label, start_s, end_s) for label, (start_s, end_s) in zip(labels, pairwise(edges), strict=True)]

    def widest(cancel_s: float) -> float:
        planner = SingleStream(english())
        planner.feed(spoken)
        before = planner.frames(times_until(cancel_s))
        planner.cancel(cancel_s, fade_s=0.2)
        after = planner.frames(np.arange(cancel_s, cancel_s + 0.3, 1 / RATE_HZ))
        return float(opening(np.concatenate([before, after])).max())

    whole = widest(1.2)
    assert max(widest(cancel_s) for cancel_s in np.arange(0.22, 0.7, 0.04).tolist()) < 1.6 * whole


def test_a_closure_that_is_over_is_not_made_again_when_what_followed_is_taken_back():
    planner = SingleStream(english())
    said = phones(["b", "ɑ", "s", "z", "ɑ", "s", "ɑ"], 0.1, lead_s=0.1)
    planner.feed(said[:6])
    planner.frames(times_until(0.68))
    planner.feed(said[6:])
    planner.frames(np.arange(0.68, 0.78, 0.01))
    planner.feed([Phone("ɑ", 0.35, 1.2)])
    assert opening(planner.frames(np.arange(0.78, 1.1, 0.01))).min() > closed()


def test_a_bilabial_that_is_cut_short_while_it_is_shut_opens_no_later():
    planner = SingleStream(english())
    planner.feed([Phone("ɑ", 0.3, 0.6), Phone("b", 0.6, 0.8)])
    planner.frames(times_until(0.64))
    until_s = max(hold.stop_s for hold in planner.holds if hold.contact == "lips")
    planner.feed([Phone("ɑ", 0.68, 0.9)])  # as when nobody knew how long it would be
    assert planner.counts.revised == 1
    assert max(hold.stop_s for hold in planner.holds if hold.contact == "lips") <= until_s


def test_a_bilabial_that_grows_while_it_is_shut_opens_at_its_end():
    def opens_s(lengths_s: list[float]) -> float:
        """When lips that are shut for an m open, if its length becomes known so, each 0.02 s after the one before."""
        planner, gap = SingleStream(english()), []
        planner.feed([Phone("ɑ", 0.3, 0.6)])
        gap.append(opening(planner.frames(times_until(0.55))))
        for number, length_s in enumerate(lengths_s):
            planner.feed([Phone("m", 0.6, 0.6 + length_s)])
            gap.append(opening(planner.frames(0.55 + 0.02 * number + np.array([0.0, 0.01]))))
        planner.feed([Phone("ɑ", 0.6 + lengths_s[-1], 1.2)])
        begun_s = 0.55 + 0.02 * len(lengths_s)
        gap.append(opening(planner.frames(np.arange(begun_s, 1.2, 0.01))))
        shut = np.flatnonzero(np.concatenate(gap) <= closed())
        return float(shut[-1]) / RATE_HZ

    at_once = opens_s([0.2])
    assert at_once == pytest.approx(0.8 - BURST_S, abs=0.011)
    assert opens_s([0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2]) == pytest.approx(at_once, abs=0.011)


def test_of_phones_that_come_together_the_last_word_counts():
    together, apart = SingleStream(english()), SingleStream(english())
    told = [Phone("ɑ", 0.1, 0.24), Phone("ɑ", 0.24, 0.38), Phone("b", 0.23, 0.37)]
    together.feed(told)
    for phone in told:
        apart.feed([phone])
    assert list(together.phones) == list(apart.phones) == [Phone("ɑ", 0.1, 0.23), told[2]]


@settings(max_examples=20)
@given(LABELS, LENGTHS, st.integers(0, 2**32 - 1))
def test_phones_that_come_twice_change_no_frame(labels, each_s, seed):
    """Some come early, some late, some after their end; each comes again, before, during and after its time."""
    rng = np.random.default_rng(seed)
    spoken = phones(labels, each_s)
    spoken.append(Phone(SILENCE, spoken[-1].end_s, spoken[-1].end_s + 0.3))
    times = np.arange(0.0, spoken[-1].end_s + 0.5, 0.04)
    firsts_s = [phone.start_s + rng.uniform(-0.5, each_s + 0.1) for phone in spoken]
    agains_s = [first_s + rng.uniform(0.0, 0.6, 3) for first_s in firsts_s]

    def shown(*, twice: bool) -> np.ndarray:
        planner, frames, before_s = SingleStream(english()), [], -np.inf
        for time_s in times:
            come = [phone for phone, first_s in zip(spoken, firsts_s, strict=True) if before_s < first_s <= time_s]
            if come:
                planner.feed(come)
            again = [
                phone
                for phone, at_s in zip(spoken, agains_s, strict=True)
                if twice and ((before_s < at_s) & (at_s <= time_s)).any()
            ]
            if again:
                planner.feed(again)
            frames.append(planner.frames([time_s])[0])
            before_s = time_s
        return np.array(frames)

    np.testing.assert_array_equal(shown(twice=True), shown(twice=False))


def test_a_bilabial_that_is_over_closes_no_vowel_when_its_phones_come_again():
    once, again = SingleStream(english()), SingleStream(english())
    said = phones(["b", "ɑ", "m", "ɑ"], 0.2)
    for planner in (once, again):
        planner.feed(said)
    for time_s in times_until(1.3):
        if round(time_s * RATE_HZ) % 5 == 0:
            again.feed(said)
        np.testing.assert_array_equal(again.frames([time_s]), once.frames([time_s]))


def test_a_bilabial_that_was_cancelled_while_it_was_shut_is_not_shut_again():
    once, again = SingleStream(english()), SingleStream(english())
    said = phones(["ɑ", "b", "ɑ"], 0.1)
    for planner in (once, again):
        planner.feed(said)
        planner.frames(times_until(0.64))
        planner.cancel(0.64)
    again.feed(said[:2])
    times = np.arange(0.64, 1.2, 0.01)
    np.testing.assert_array_equal(again.frames(times), once.frames(times))


def test_phones_that_stop_coming_leave_a_mouth_at_rest():
    planner = SingleStream(english())
    planner.feed(phones(["ɑ", "ɑ"], 0.2))
    values = planner.frames(times_until(2.0))
    assert opening(values)[70] > 100
    assert not values[95:].any()  # 0.8 s and the margin of 0.12


def test_silence_takes_away_what_stood_there():
    planner = SingleStream(english())
    planner.feed(phones(["ɑ", "ɑ", "ɑ"], 0.2))
    planner.feed([Phone(SILENCE, 0.6, 1.0)])
    assert not planner.frames(times_until(2.0))[78:].any()


def test_old_news_is_counted():
    planner = SingleStream(english(), horizon_s=0.1)
    planner.frames([2.0])
    assert planner.edge_s == pytest.approx(2.1)
    assert planner.take([Phone("a", 1.0, 1.2), Phone("%", 2.0, 2.3)]) == 2
    assert (planner.counts.dropped, planner.counts.late, planner.counts.unknown) == (1, 1, 1)
    assert planner.take([Phone("a", 1.1, 1.3), Phone("b", 5.0, 5.3)]) == 1
    assert planner.take([Phone("a", 1.1, 1.3)], is_counted=False) == 0
    assert planner.take([Phone("o", 1.0, 1.2), Phone("o", 1.2, 1.4)]) == 2  # they touch; neither is the other


def test_memory_does_not_grow_with_time():
    planner = SingleStream(english())
    for second in range(60):
        planner.feed(phones(["b", "ɑ", "s"], 0.2, lead_s=second + 0.2))
        planner.frames(np.arange(second, second + 1, 0.05))
    assert len(planner._phones) < 20
    assert len(planner._plans) < 8
    assert len(planner._holds) + len(planner._kept_holds) < 10


def test_phones_shorter_than_a_millisecond_keep_their_order_though_they_come_backwards():
    planner = SingleStream(english())
    short = [Phone("ma"[n % 2], 0.4 + n * 1e-4, 0.4 + (n + 1) * 1e-4) for n in range(150)]
    for phone in reversed(short):
        planner.feed([phone])
    assert list(planner.phones) == short


def test_refuses():
    planner = SingleStream(english())
    assert planner.frames([]).shape == (0, 68)
    planner.frames([1.0, 1.1])
    with pytest.raises(UsageError, match=r"expected rising times from 1\.1 s"):
        planner.frames([1.05])
    with pytest.raises(UsageError, match="rising"):
        planner.frames([2.0, 1.9])
    with pytest.raises(UsageError, match="fade_s: must be a positive time, got 0"):
        planner.cancel(3.0, fade_s=0)
    with pytest.raises(UsageError, match="horizon_s: must be 0 or more, got -1"):
        SingleStream(english(), horizon_s=-1)


@given(st.integers(2, 8), st.integers(0, 2**32 - 1))
def test_the_path_is_c2_and_local(count, seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.03, 0.2, count))
    values = rng.normal(0, 5, (count, 3))
    path_of = np.zeros(count, np.intp)
    (path,) = hermite.paths(times, values, path_of, 1)
    for knot, value in zip(times, values, strict=True):
        left, right = path.jet(np.array([knot - 1e-9])), path.jet(np.array([knot]))
        np.testing.assert_allclose(right[0][0], value, atol=1e-9)
        for a, b, unit in zip(left, right, (1.0, 100.0, 1e5), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-4 * unit)
    changed = values.copy()
    changed[0] += 1.0
    at = np.linspace(times[min(2, count - 1)], times[-1] + 0.1, 30)
    if count > 3:
        np.testing.assert_array_equal(path.sample(at), hermite.paths(times, changed, path_of, 1)[0].sample(at))


@pytest.mark.parametrize("length", [1, 7])
def test_letters_that_are_planned_are_counted_right_whatever_is_dropped(length):
    planner, said = SingleStream(english()), phones(["ama" * length, "m" * length] * (120 // length), 0.1)
    for at in (0, len(said) // 2):
        planner.feed(said[at : at + len(said) // 2])
        assert planner._letters == sum(len(phone.label) for phone in planner.phones) <= PLANNED_LETTERS
    assert list(planner.phones) == said[: len(planner.phones)]
    assert planner.counts.dropped == len(said) - len(planner.phones) > 0
