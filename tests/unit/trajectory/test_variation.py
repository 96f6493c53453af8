"""Natural variation of speech: sizes, spectrum, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest

from fapengine.errors import UsageError
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.closures import RAMP_S, holds_of
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from fapengine.trajectory.targets import keys_of
from fapengine.trajectory.variation import DIRECTIONS, PARTS, QUANTILES_HZ, SINES, draw_variation, variation_faps
from tests.unit.trajectory.mirror import TWINS

RATE_HZ = 100.0
WORD = (("b", 0.08), ("ɑ", 0.14), ("m", 0.08), ("i", 0.12), ("w", 0.07), ("u", 0.14), ("s", 0.1), ("ɛ", 0.12))


def said(times: int = 3) -> PhoneTrack:
    """A word, again and again, with a pause after each."""
    phones, at_s = [], 0.5
    for _ in range(times):
        for label, length_s in WORD:
            phones.append(Phone(label, at_s, at_s + length_s))
            at_s += length_s
        at_s += 0.8
    return PhoneTrack.from_phones(phones)


def test_speech_that_begins_at_once_varies_too() -> None:
    phones = PhoneTrack.from_phones([Phone("ɑ", 0.0, 0.3), Phone("s", 0.3, 0.6), Phone("i", 0.6, 1.0)])
    profile, style = load_profile(DEFAULT_PROFILE), Style(blinks=False, gaze=False, idle=False, emphasis=False)
    lively, still = (
        plan(phones, profile, rng=np.random.default_rng(1), rate_hz=RATE_HZ, style=each).track.values
        for each in (style, replace(style, liveliness=0.0))
    )
    assert np.abs(lively - still)[:, fap.column(5)].max() > 20


def mouth(liveliness: float, seed: int = 1, times: int = 3) -> np.ndarray:
    """(T, 68) FAPU of speech alone, varied."""
    style = Style(blinks=False, head_motion=False, gaze=False, idle=False, emphasis=False, liveliness=liveliness)
    rng = np.random.default_rng(seed)
    return plan(said(times), load_profile(DEFAULT_PROFILE), rng=rng, rate_hz=RATE_HZ, style=style).track.values


def test_directions_have_their_measured_sizes_and_speeds() -> None:
    times_s = np.arange(0, 40, 1 / 50)
    drawn = [
        variation_faps(np.ones(len(times_s)), draw_variation(np.random.default_rng(n))[..., None], times_s)
        for n in range(60)
    ]
    measured = np.sqrt(np.mean([(one**2).mean(axis=1) for one in drawn], axis=0))
    expected = np.zeros(fap.FAP_COUNT)
    for direction in DIRECTIONS:
        expected[[fap.column(number) for number in direction]] += np.square(list(direction.values()))
    np.testing.assert_allclose(measured, np.sqrt(expected), rtol=0.12, atol=0.2)


def test_frequencies_have_the_measured_spectrum_of_each_direction() -> None:
    drawn = np.stack([draw_variation(np.random.default_rng(n))[0] for n in range(500)]) / (2 * np.pi)
    for hertz, quantiles in zip(drawn.reshape(500, len(DIRECTIONS), SINES).swapaxes(0, 1), QUANTILES_HZ, strict=True):
        counts, _ = np.histogram(hertz, quantiles)
        np.testing.assert_allclose(counts / hertz.size, 1 / PARTS, atol=0.025)


def test_a_word_varies_from_time_to_time_and_by_seed_and_not_without_liveliness() -> None:
    length = round(RATE_HZ * (sum(length_s for _, length_s in WORD) + 0.8))

    def unlike(faps: np.ndarray) -> float:
        first, second = faps[50 : 50 + length], faps[50 + length : 50 + 2 * length]
        return float(np.abs(first - second)[: length - 80, fap.column(5)].max())

    assert unlike(mouth(0.0)) < 20 < 40 < unlike(mouth(1.0)) < 250
    assert unlike(mouth(0.5)) < unlike(mouth(1.0))
    assert np.array_equal(mouth(1.0), mouth(1.0))
    assert np.abs(mouth(1.0, seed=2) - mouth(1.0)).max() > 30


def test_both_halves_of_the_mouth_differ() -> None:
    still, lively = (mouth(liveliness) for liveliness in (0.0, 1.0))
    left, right = fap.column(59), fap.column(60)
    assert np.abs(still[:, left] - still[:, right]).max() < 30
    assert (lively - still)[:, left].std() > 3
    assert ((lively - still)[:, left] - (lively - still)[:, right]).std() > 3


@pytest.mark.parametrize("seed", range(8))
def test_lips_meet_and_rest_is_rest_whatever_the_seed(seed: int) -> None:
    faps, still = mouth(1.0, seed), mouth(0.0)
    times_s = np.arange(len(faps)) / RATE_HZ
    opening = -(faps[:, fap.column(4)] + faps[:, fap.column(5)])
    holds = [
        hold for hold in holds_of(keys_of(said(), load_profile(DEFAULT_PROFILE)).said[0]) if hold.contact == "lips"
    ]
    assert len(holds) == 6
    for hold in holds:
        assert opening[(times_s >= hold.start_s) & (times_s <= hold.stop_s)].max() <= 2
    last_s = said().phones[-1].end_s
    at_rest = (times_s < 0.2) | (times_s > last_s + 0.13)
    assert np.abs(faps - still)[at_rest].max() == 0
    assert RAMP_S < 0.13


def test_a_face_that_does_not_articulate_does_not_vary() -> None:
    assert Style(articulation=0.0).variation == 0
    assert Style(articulation=2.0).variation == 1
    assert Style().without(["all"]).liveliness == 0
    with pytest.raises(UsageError, match=r"^liveliness: must be 0 to 1, got 1\.5"):
        Style(liveliness=1.5)


def test_directions_are_symmetric_or_asymmetric() -> None:
    """Both halves move alike, or one up as far as the other down; what is in the middle moves with both."""
    for index, direction in enumerate(DIRECTIONS):
        faps, sign = np.zeros(fap.FAP_COUNT), -1.0 if index < 3 else 1.0
        faps[[fap.column(number) for number in direction]] = list(direction.values())
        paired = np.arange(fap.FAP_COUNT) != TWINS
        np.testing.assert_array_equal(faps[TWINS][paired], sign * faps[paired])


def test_the_outer_lips_go_with_the_inner_ones() -> None:
    for direction in DIRECTIONS:
        for inner, outer in zip(range(4, 14), range(51, 61), strict=True):
            sizes = direction.get(inner, 0.0), direction.get(outer, 0.0)
            if max(map(abs, sizes)) > 3.0:  # FAPU
                assert 0.4 < sizes[1] / sizes[0] < 2.5


def test_quantiles_rise_from_rest_to_half_the_frame_rate_of_video() -> None:
    for quantiles in QUANTILES_HZ:
        assert (quantiles[0], quantiles[-1]) == (0.0, 12.5)
        assert (np.diff(quantiles) > 0).all()
        assert (np.diff(quantiles, 2)[-4:] > 0).all()  # the faster, the rarer
