"""Contacts: lips on lips, lip on teeth, open vowels, whatever is spoken, however fast, under any expression."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fapengine.expressions import Expression
from fapengine.mpeg4 import fap
from fapengine.speaking import METHOD_NAMES
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.closures import (
    BITTEN_FAPU,
    BURST_S,
    CONTACTS,
    GLIDE_SHARE,
    HOLD,
    MIN_HOLD_S,
    NEAR_FAPU,
    NEAR_SHARE,
    OPEN_FAPU,
    PAIRS,
    RAMP_S,
    SIDE_OPENING,
    Hold,
    close_lips,
    held,
    hold_late,
    hold_of,
    settle,
)
from fapengine.trajectory.context import MAX_DURATION_S
from fapengine.trajectory.planner import Style, plan
from fapengine.trajectory.targets import must_open
from tests.english import english
from tests.unit.trajectory.mirror import TWINS


def mm() -> float:
    """Millimetres of one FAPU of the lips."""
    return english().fapu.unit(fap.FapUnit.MNS)


STILL = Style.speech_only()
RATE_HZ = 240.0
ROUNDING_FAPU = 1.5
CLOSED_MM = 0.3

SPEECH = st.lists(
    st.tuples(
        st.sampled_from(["p", "b", "m", "f", "v", "ɱ", "s", "ʃ", "n", "w", "i", "uː", "ɔɪ", "ɑ", "æ", "aɪ", "_"]),
        st.floats(0.09, 0.16),
    ),
    min_size=1,
    max_size=10,
)
"""Phones and their seconds at natural rate."""
MOOD = st.one_of(
    st.just({}),
    st.dictionaries(
        st.sampled_from([mood for mood in Expression if mood]), st.floats(0.2, 0.8), min_size=1, max_size=2
    ),
)


def spoken(speech: list[tuple[str, float]], rate: float) -> PhoneTrack:
    ends = 0.3 + np.cumsum([seconds / rate for _, seconds in speech])
    starts = [0.3, *ends[:-1]]
    phones = [Phone(label, start, end) for (label, _), start, end in zip(speech, starts, ends, strict=True)]
    return PhoneTrack.from_phones([*phones, Phone("_", ends[-1], ends[-1] + 0.4)])


def lips_of(
    phones: PhoneTrack, mood: dict[Expression, float], style: Style = STILL
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Opening and height of the lower lip, middle, mm, at :data:`RATE_HZ`."""
    track = plan(
        phones, english(), rng=np.random.default_rng(1), rate_hz=RATE_HZ, expressions=mood, style=style
    ).track  # fmt: skip
    upper, lower = (track.values[:, fap.column(number)] * mm() for number in (4, 5))
    return -(upper + lower), lower


def frames_in(phone: Phone) -> slice:
    return slice(int(np.ceil(phone.start_s * RATE_HZ)), int(phone.end_s * RATE_HZ) + 1)


STYLE = st.builds(
    lambda jaw, lips: replace(STILL, jaw=jaw, lips=lips), st.sampled_from([1.0, 0.0, 0.4, 2.0]), st.floats(0, 2)
)


@given(SPEECH, st.floats(0.5, 3.0), MOOD, st.one_of(st.just(STILL), STYLE))
def test_contacts_are_made_at_any_rate_under_any_expression(
    speech: list[tuple[str, float]], rate: float, mood: dict[Expression, float], style: Style
) -> None:
    phones = spoken(speech, rate)
    opening, lower = lips_of(phones, mood, style)
    assert opening.min() >= -2 * ROUNDING_FAPU * mm()
    for phone in phones.phones:
        inside = frames_in(phone)
        needed = min(int(0.04 * RATE_HZ), inside.stop - inside.start - 1)  # 40 ms, or the phone if shorter
        if phone.label in "pbm":
            assert (opening[inside] <= CLOSED_MM).sum() >= needed
        if phone.label in "fvɱ":
            assert (lower[inside] >= -ROUNDING_FAPU * mm()).sum() >= needed


GAIN = st.sampled_from([0.0, 0.3, 1.0, 2.0, 3.0])
ANY_STYLE = st.builds(
    lambda method, articulation, jaw, lips, loudness_db: replace(
        STILL, method=method, articulation=articulation, jaw=jaw, lips=lips, loudness_db=loudness_db
    ),
    st.sampled_from([name for name in METHOD_NAMES if name != "published"]), GAIN, GAIN, GAIN,
    st.sampled_from([-20.0, 0.0, 20.0]),
)  # fmt: skip
ANY_MOOD = st.dictionaries(
    st.sampled_from([mood for mood in Expression if mood]), st.sampled_from([0.3, 1.0, 2.0]), max_size=3
)
ANY_SPEECH = st.lists(
    st.tuples(
        st.sampled_from(["p", "b", "m", "f", "v", "s", "ʃ", "n", "w", "i", "uː", "ɑ", "aɪ", "_"]),
        st.sampled_from([0.004, 0.02, 0.05, 0.1, 0.2, 0.6, 2.0, 60.0]),
    ),
    min_size=1,
    max_size=10,
)


@example([("ɑ", 0.1), ("b", 0.1), ("ɑ", 0.1)], replace(STILL, articulation=3.0, lips=3.0), {Expression.SURPRISE: 2.0})
@example([("ɑ", 0.1), ("b", 0.1), ("ɑ", 0.1)], replace(STILL, jaw=3.0, lips=3.0, loudness_db=20.0), {})
@example([("n", 0.05), ("ɑ", 2.0), ("n", 0.05)], replace(STILL, articulation=3.0, lips=3.0, jaw=0.0), {})
@given(ANY_SPEECH, ANY_STYLE, ANY_MOOD)
@settings(max_examples=40)
def test_contacts_hold_in_every_style_that_is_accepted_and_values_at_the_end_of_their_range(
    speech: list[tuple[str, float]], style: Style, mood: dict[Expression, float]
) -> None:
    """Clipped values included: every pair of inner-lip points, any method, any expressions, any lengths."""
    phones = spoken(speech, 1.0)
    track = plan(phones, english(), rng=np.random.default_rng(1), rate_hz=100.0, expressions=mood, style=style).track
    gaps = [-(track.values[:, fap.column(u)] + track.values[:, fap.column(low)]) * mm() for u, low, *_ in PAIRS]
    lower = track.values[:, fap.column(5)] * mm()
    assert min(gap.min() for gap in gaps) >= -2 * ROUNDING_FAPU * mm()
    for phone in phones.phones:
        inside = slice(int(np.ceil(phone.start_s * 100)), int(phone.end_s * 100) + 1)
        needed = min(4, inside.stop - inside.start - 1)
        if phone.label in "pbm":
            assert all((gap[inside] <= CLOSED_MM).sum() >= needed for gap in gaps)
        if phone.label in "fv":
            assert (lower[inside] >= -ROUNDING_FAPU * mm()).sum() >= needed


@given(
    st.sampled_from(["p", "m", "f", "s", "w", "uː", "ʃ", "_"]),
    st.sampled_from(["ɑ", "æ", "aɪ", "aʊ", "ɑː", "ɒ", "θ", "ð"]),
    st.sampled_from(["p", "b", "v", "s", "w", "i", "n", "_"]),
    st.floats(0.08, 0.3),
    MOOD,
)
def test_vowels_and_th_that_must_open_do_open(
    before: str, vowel: str, behind: str, each_s: float, mood: dict[Expression, float]
) -> None:
    phones = spoken([("n", each_s), (before, each_s), (vowel, each_s), (behind, each_s)], 1.0)
    opening, _ = lips_of(phones, mood)
    assert opening[frames_in(next(phone for phone in phones.phones if phone.label == vowel))].max() >= 2.5


def lips(upper: float, lower: float) -> NDArray[np.float64]:
    faps = np.zeros((1, 68))
    for numbers in PAIRS:
        faps[0, [fap.column(number) for number in numbers]] = [upper, lower, upper, lower]
    return faps


@pytest.mark.parametrize(
    ("upper", "lower"), [(-200.0, -300.0), (150.0, 80.0), (0.0, 0.0), (-50.0, 40.0), (-400.0, 350.0)]
)
def test_each_contact_of_one_frame(upper: float, lower: float) -> None:
    faps, on, off = lips(upper, lower), np.ones(1), np.zeros(1)
    free = settle(faps, np.array([off, off, off, off, off]))
    shut = settle(faps, np.array([on, off, off, off, off]))
    touching = settle(faps, np.array([off, on, off, off, off]))
    wide = settle(faps, np.array([off, off, on, off, off]))
    for place, (inner_upper, inner_lower, outer_upper, outer_lower) in enumerate(PAIRS):
        top, bottom, above, below = (fap.column(n) for n in (inner_upper, inner_lower, outer_upper, outer_lower))
        assert free[0, top] + free[0, bottom] <= 1e-9
        assert shut[0, top] + shut[0, bottom] == pytest.approx(0, abs=1e-9)
        assert 0 <= touching[0, bottom] <= BITTEN_FAPU
        assert touching[0, top] + touching[0, bottom] <= 1e-9
        parted = (SIDE_OPENING if place else 1) * OPEN_FAPU
        assert parted - 11 <= -(wide[0, top] + wide[0, bottom]) <= max(parted, -upper - lower)
        for changed in (free, shut, touching, wide):  # outer lips follow the inner
            assert changed[0, above] - faps[0, above] == pytest.approx(changed[0, top] - faps[0, top])
            assert changed[0, below] - faps[0, below] == pytest.approx(changed[0, bottom] - faps[0, bottom])


def test_lips_that_are_far_apart_stay_as_they_are_but_for_the_softness() -> None:
    free = settle(lips(-200.0, -300.0), np.zeros((5, 1)))
    assert free[0, fap.column(4)] == pytest.approx(-196.0)
    assert free[0, fap.column(5)] == pytest.approx(-294.0)
    assert not free[0, :3].any()
    assert not free[0, 18:50].any()


def test_a_mumbler_opens_less() -> None:
    faps, times = np.repeat(lips(50.0, 20.0), 2, axis=0), np.array([0.5, 2.0])
    hold = [Hold(0.4, 0.6, "open")]
    opening = [-close_lips(faps, times, hold, openness=one)[:, 3:5].sum(axis=1) for one in (1.0, 0.5, 0.0)]
    assert opening[0][0] > OPEN_FAPU - 11
    assert 0 < opening[1][0] < 0.7 * OPEN_FAPU
    assert opening[2][0] == 0 == opening[0][1]


def test_holds_lie_in_their_phones_and_last_40_ms() -> None:
    for contact in ("lips", "teeth"):
        for seconds in (0.02, 0.039, 0.05, 0.07, 0.2):
            phone = Phone("x", 1.0, 1.0 + seconds)
            hold = hold_of(phone, contact)
            assert hold.stop_s - hold.start_s >= 0.04 - 1e-12  # what docs/trajectories.md promises
            assert hold.start_s >= phone.start_s
            assert hold.stop_s <= max(phone.end_s, phone.start_s + MIN_HOLD_S) + 1e-12
    assert hold_of(Phone("ɑ", 0.0, 0.02), "open") == Hold(0.35 * 0.02, 0.65 * 0.02, "open")
    assert hold_of(Phone("f", 0.0, 1.0), "teeth").start_s == HOLD["teeth"][0] * MAX_DURATION_S


@pytest.mark.parametrize("contact", CONTACTS)
def test_bursts_and_glides_let_go_sooner_than_other_contacts(contact: str) -> None:
    over_s = 1.1 + (0.03 if contact in ("lips", "glide") else 0.045)
    before, after = held(np.array([over_s - 0.003, over_s]), [Hold(1.0, 1.1, contact)])[CONTACTS.index(contact)]
    assert 0 < before < 0.02
    assert after < 1e-12


@pytest.mark.parametrize("label", ["p", "bʱ", "m", "m̩"])
@pytest.mark.parametrize("each_s", [0.08, 0.12, 0.4])
def test_lips_stay_shut_until_the_burst_and_are_open_a_frame_of_video_after_it(label: str, each_s: float) -> None:
    phones = spoken([("ɑ", each_s), (label, each_s), ("ɑ", each_s)], 1.0)
    opening, _ = lips_of(phones, {})
    (burst_s,) = (phone.end_s - BURST_S for phone in phones.phones if phone.label == label)
    at = [opening[round((burst_s + later_s) * RATE_HZ)] for later_s in (-0.025, 0.0, 0.04)]
    assert at[0] <= CLOSED_MM
    assert at[1] <= CLOSED_MM
    assert at[2] > 2.5


def test_a_label_of_several_letters_lets_go_half_way() -> None:
    assert hold_of(Phone("p͡f", 1.0, 1.2)) == Hold(1.0, 1.1)


def test_lips_nearly_shut_in_w_and_leave_a_hole() -> None:
    phones = spoken([("ɑ", 0.12), ("w", 0.1), ("ɑ", 0.12)], 1.0)
    opening, _ = lips_of(phones, {})
    assert 0.2 < opening[frames_in(next(phone for phone in phones.phones if phone.label == "w"))].min() < 2.0
    assert parted(120.0, glide=1.0) == pytest.approx([(1 - GLIDE_SHARE) * gap for gap in parted(120.0)])
    assert parted(120.0, glide=1.0, lips=1.0)[0] == pytest.approx(0, abs=1e-9)


def test_holds_that_come_late_are_put_off_and_a_vowel_that_is_over_is_let_go() -> None:
    assert hold_late(Hold(1.0, 1.2), 1.05) == Hold(1.05 + RAMP_S, 1.2)
    assert hold_late(Hold(1.0, 1.04, "teeth"), 2.0) == Hold(2.0 + RAMP_S, 2.0 + RAMP_S + MIN_HOLD_S, "teeth")
    assert hold_late(Hold(1.0, 1.2, "open"), 1.1) == Hold(1.1 + RAMP_S, 1.2, "open")
    assert hold_late(Hold(1.0, 1.1, "open"), 1.1) is None


def test_contacts_do_not_disturb_each_other() -> None:
    times = np.array([0.5])
    holds = [Hold(0.4, 0.6), Hold(0.4, 0.6, "teeth")]
    assert held(times, holds)[:, 0].tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]


def test_open_vowels_are_found_by_their_articulation() -> None:
    assert [letter for letter in "aæɑɒɐɛəiuph?" if must_open(letter)] == list("aæɑɒɐ")


def parted(opening_fapu: float, **contacts: float) -> list[float]:
    """Openings, FAPU, middle, left and right, of lips that were so far apart in the middle, 0.6 of it at the sides."""
    faps = np.zeros((1, 68))
    for index, (upper, lower, *_) in enumerate(PAIRS):
        share = SIDE_OPENING if index else 1.0
        faps[0, [fap.column(upper), fap.column(lower)]] = -0.5 * share * opening_fapu
    settled = settle(faps, np.array([[contacts.get(name, 0.0)] for name in CONTACTS]))[0]
    return [-float(settled[fap.column(upper)] + settled[fap.column(lower)]) for upper, lower, *_ in PAIRS]


def test_lips_that_are_near_each_other_come_nearer() -> None:
    """As captured ones do, half as much; what a vowel or θ holds open does not."""
    for opening, captured in ((60.0, 14.0), (120.0, 38.0), (165.0, 100.0)):  # 1.3, 2.5, 3.5 mm; 0.3, 0.8, 2.1
        middle, left, right = parted(opening)
        assert middle == pytest.approx(opening - NEAR_SHARE * (opening - captured), abs=12.0)
        assert left == right == pytest.approx(SIDE_OPENING * middle, rel=0.2)
    assert parted(120.0)[0] < 90.0
    assert parted(1.1 * NEAR_FAPU)[0] == pytest.approx(1.1 * NEAR_FAPU, abs=12.0)
    assert parted(160.0, open=1.0)[0] > 145.0 > 1.15 * parted(160.0)[0]
    rising = [parted(opening)[0] for opening in np.linspace(0, 400, 200)]
    assert (np.diff(rising) > 0).all()


def test_contacts_are_the_same_on_both_sides() -> None:
    rng = np.random.default_rng(1)
    faps, contacts = rng.normal(0, 150, (40, fap.FAP_COUNT)), rng.random((5, 40))
    np.testing.assert_array_equal(settle(faps[:, TWINS], contacts), settle(faps, contacts)[:, TWINS])


def test_a_lower_lip_comes_up_to_the_teeth_from_any_depth() -> None:
    for lower in (-40.0, -100.0, -300.0):
        settled = settle(lips(100.0, lower), np.array([[0.0], [1.0], [0.0], [0.0], [0.0]]))
        assert settled[0, fap.column(5)] == pytest.approx(0, abs=1e-9)  # of the neutral face, which touches them


def test_the_teeth_leave_out_a_share_of_the_upper_lip_and_none_unless_it_is_said():
    faps, teeth = lips(-400.0, 100.0), np.array([[0.0], [1.0], [0.0], [0.0], [0.0]])
    upper = {share: settle(faps, teeth, bitten_share=share)[0, fap.column(4)] for share in (0.0, 0.25, 0.5)}
    assert settle(faps, teeth)[0, fap.column(4)] == upper[0.0]
    assert [upper[share] - upper[0.0] for share in (0.25, 0.5)] == pytest.approx([100.0, 200.0])
