"""Clocks of two machines: offsets, rates, steps and late packets."""

import numpy as np
import pytest

from fapengine.wire.speech_osc.clock import EngineClock, SenderClock, TagClock, time_tag, unix_s

OFFSET_S, SKEW = 1234.5, 200e-6


def engine_time(true_s: float) -> float:
    return true_s * (1 + SKEW) + OFFSET_S


def ping(clock: EngineClock, true_s: float, there_s: float, back_s: float, step_s: float = 0.0) -> None:
    arrived = engine_time(true_s + there_s)
    clock.add(true_s + step_s, arrived, arrived + 1e-4, true_s + there_s + 1e-4 + back_s + step_s)


def exchange(clock: EngineClock, rng: np.random.Generator, seconds: range, step_s: float = 0.0) -> list[float]:
    errors = []
    for second in seconds:
        ping(clock, second, 0.004 + rng.exponential(0.01), 0.004 + rng.exponential(0.01), step_s)
        errors.append(clock.engine_s(second + 1.0 + step_s) - engine_time(second + 1.0))
    return errors


def test_offset_and_rate_are_found_through_jitter():
    clock = EngineClock()
    errors = exchange(clock, np.random.default_rng(1), range(0, 120, 2))
    assert max(abs(error) for error in errors[10:]) < 0.01  # the mean jitter of one way
    assert clock.skew_ppm == pytest.approx(200, abs=60)
    assert clock.rtt_s >= 0.008
    assert clock.steps == 0
    assert clock.sender_s(clock.engine_s(100.0)) == pytest.approx(100.0, abs=1e-3)


def test_without_jitter_both_are_exact():
    clock = EngineClock()
    for second in range(0, 40, 2):
        ping(clock, second, 0.005, 0.005)
    assert clock.skew_ppm == pytest.approx(200, abs=2)
    assert clock.engine_s(45.0) == pytest.approx(engine_time(45.0), abs=1e-4)


def test_the_shortest_round_trip_counts():
    clock = EngineClock()
    ping(clock, 1.0, 0.002, 0.002)
    ping(clock, 1.1, 0.08, 0.002)
    ping(clock, 1.2, 0.002, 0.09)
    assert clock.engine_s(1.3) == pytest.approx(engine_time(1.3), abs=1e-3)


def test_a_clock_that_is_set_is_followed_after_three_and_a_late_pong_is_not():
    clock = EngineClock()
    rng = np.random.default_rng(2)
    exchange(clock, rng, range(0, 30, 2))
    before = clock.engine_s(40.0)
    for way_s in (0.9, 0.5):  # held up, and by different times
        ping(clock, 31.0, way_s, 0.004, step_s=0.0)
    assert clock.engine_s(40.0) == pytest.approx(before, abs=0.01)
    exchange(clock, rng, range(32, 36, 2), step_s=3600.0)
    assert clock.steps == 0
    exchange(clock, rng, range(36, 60, 2), step_s=3600.0)
    assert clock.steps == 1
    assert clock.engine_s(60.0 + 3600.0) == pytest.approx(engine_time(60.0), abs=0.015)


def test_an_engine_clock_is_known_from_the_first_pong():
    clock = EngineClock()
    assert not clock.is_known
    assert clock.engine_s(5.0) == clock.sender_s(5.0) == 5.0
    assert clock.rtt_s == 0.0
    ping(clock, 1.0, 0.01, 0.01)
    assert clock.is_known


def test_a_rate_that_no_clock_has_is_bounded():
    clock = EngineClock()
    for second in range(0, 40, 2):
        clock.add(second, second * 1.01, second * 1.01, second)
    assert clock.skew_ppm == 1000.0


def test_odd_stamps_that_do_not_agree_are_all_left():
    clock, other = EngineClock(), SenderClock()
    for second in range(10):
        ping(clock, second, 0.004, 0.004)
        other.ping(second, second + OFFSET_S)
    for second, way_s in enumerate((0.9, 0.5, 1.4, 0.7, 2.0), start=11):
        ping(clock, second, way_s, 0.004)
        other.ping(second, second + OFFSET_S + way_s)
    assert (clock.steps, other.steps) == (0, 0)
    assert clock.engine_s(20.0) == pytest.approx(engine_time(20.0), abs=5e-3)
    assert other.engine_s(20.0) == pytest.approx(20.0 + OFFSET_S, abs=5e-3)


# The engine's view of the sender --------------------------------------------------------------------------------------


def test_the_senders_word_counts_while_it_is_fresh():
    clock = SenderClock()
    clock.report(10.0, OFFSET_S, 200.0)
    assert clock.engine_s(20.0) == pytest.approx(20.0 + OFFSET_S + 10 * 200e-6)
    assert clock.sender_s(clock.engine_s(20.0)) == pytest.approx(20.0, abs=1e-6)
    clock.ping(12.0, 12.0 + OFFSET_S + 0.3)  # a stamp says less than the word
    assert clock.engine_s(20.0) == pytest.approx(20.0 + OFFSET_S + 10 * 200e-6)


def test_a_step_in_the_senders_word_makes_older_stamps_worthless():
    clock = SenderClock()
    clock.ping(0.0, OFFSET_S)
    clock.report(1.0, OFFSET_S - 40.0, 0.0)
    assert clock.steps == 1
    clock.ping(50.0, 50.0 + OFFSET_S - 40.0)
    clock.ping(51.0, 51.0 + OFFSET_S - 40.0)
    assert clock.engine_s(52.0) == pytest.approx(52.0 + OFFSET_S - 40.0)
    back = SenderClock()
    back.ping(0.0, OFFSET_S)
    back.report(1.0, OFFSET_S + 40.0, 0.0)
    back.ping(50.0, 50.0 + OFFSET_S + 40.0)
    assert back.engine_s(52.0) == pytest.approx(52.0 + OFFSET_S + 40.0)


def test_of_a_sender_that_tells_nothing_the_quickest_stamp_counts():
    clock = SenderClock()
    rng = np.random.default_rng(3)
    for second in range(0, 30, 2):
        clock.ping(float(second), second + OFFSET_S + 0.003 + rng.exponential(0.02))
    assert 0 <= clock.engine_s(30.0) - (30.0 + OFFSET_S) < 0.012
    assert clock.steps == 0


def test_stamps_of_a_clock_that_was_set_are_believed_at_the_third():
    clock = SenderClock()
    for second in range(0, 20, 2):
        clock.ping(float(second), second + OFFSET_S + 0.003)
    clock.ping(20.0, 20.0 + OFFSET_S + 0.7)  # held up: alone
    assert clock.engine_s(30.0) == pytest.approx(30.0 + OFFSET_S, abs=0.01)
    for second in (22, 24):
        clock.ping(second - 5.0, second + OFFSET_S + 0.003)
        assert clock.steps == 0
    clock.ping(26 - 5.0, 26 + OFFSET_S + 0.003)
    assert clock.steps == 1
    assert clock.engine_s(30.0 - 5.0) == pytest.approx(30.0 + OFFSET_S, abs=0.01)


def test_positions_of_the_sound_are_judged_by_their_own_lateness():
    clock = SenderClock()
    assert clock.audio(100.0, 7.0) == 7.0  # nothing known: it means now
    clock.report(0.0, OFFSET_S, 0.0)
    for tenth in range(10):  # told 150 ms behind, as a sound card with a long buffer does
        now_s = tenth / 10 + OFFSET_S
        assert clock.audio(tenth / 10 - 0.15, now_s) == pytest.approx(now_s - 0.15)
    assert clock.audio(1.0 - 0.65, 1.0 + OFFSET_S) is None  # held up
    assert clock.audio(1.1 - 0.15, 1.1 + OFFSET_S) is not None
    for tenth in range(12, 14):
        assert clock.audio(tenth / 10 + 8.0, tenth / 10 + OFFSET_S) is None
    found = clock.audio(1.4 + 8.0, 1.4 + OFFSET_S)
    assert clock.steps == 1
    assert found == pytest.approx(1.4 - 0.15 + OFFSET_S, abs=0.01)


def test_a_step_that_pings_and_sound_both_show_is_taken_once():
    clock = SenderClock()
    for second in range(8):
        clock.ping(second * 1.0, second + OFFSET_S)
        clock.audio(second * 1.0, second + OFFSET_S)
    for second in range(8, 14):
        clock.audio(second + 50.0, second + OFFSET_S)
        clock.ping(second + 50.0, second + OFFSET_S)
    assert clock.steps == 1
    assert clock.engine_s(64.0) == pytest.approx(14.0 + OFFSET_S, abs=0.01)


# Time tags ------------------------------------------------------------------------------------------------------------

WALL_S = 1_800_000_000.0


def test_tags_are_kept_to_a_nanosecond_and_go_on_after_2036():
    assert unix_s(time_tag(WALL_S + 0.25)) == WALL_S + 0.25
    assert unix_s(time_tag(2_200_000_000.5)) == 2_200_000_000.5  # 2039


def test_a_tag_means_its_time_and_the_receivers_clock_may_be_set_meanwhile():
    clock = TagClock()
    assert clock.engine_s(time_tag(WALL_S + 0.3), 50.0, WALL_S) == pytest.approx(50.3)
    assert clock.engine_s(time_tag(WALL_S + 1.3), 51.0, WALL_S + 7200.0) == pytest.approx(51.3)
    assert clock.engine_s(time_tag(WALL_S + 1.6), 52.0, WALL_S - 10.0) == pytest.approx(51.6)  # 0.4 s late is late
    assert clock.clamped == 0


@pytest.mark.parametrize("ahead_s", [11.0, 3600.0, 1e8])
def test_a_tag_far_ahead_is_clamped_and_shows_that_the_clocks_differ(ahead_s):
    clock = TagClock()
    assert clock.engine_s(time_tag(WALL_S + ahead_s), 50.0, WALL_S) == 50.0
    assert clock.engine_s(time_tag(WALL_S + ahead_s + 0.2), 50.0, WALL_S) == pytest.approx(50.2, abs=1e-6)
    assert clock.clamped == 1


def test_tags_far_behind_are_clamped_and_believed_at_the_third():
    clock = TagClock()
    for second, delay_s in enumerate((0.02, 0.01, 0.03)):
        assert (
            clock.engine_s(time_tag(WALL_S - 100 + second), 50.0 + second + delay_s, WALL_S) == 50.0 + second + delay_s
        )
    assert clock.clamped == 3
    assert clock.engine_s(time_tag(WALL_S - 100 + 3.5), 53.2, WALL_S) == pytest.approx(53.51, abs=1e-6)


def test_one_late_packet_moves_nothing():
    clock = TagClock()
    clock.engine_s(time_tag(WALL_S), 50.0, WALL_S)
    assert clock.engine_s(time_tag(WALL_S + 1.0), 53.0, WALL_S) == 53.0
    assert clock.engine_s(time_tag(WALL_S + 4.0), 54.0, WALL_S) == pytest.approx(54.0)
    assert clock.clamped == 1


@pytest.mark.parametrize("tag", [0, 2, 2**64 - 1, 1 << 63])
def test_any_tag_has_a_time_that_is_not_far(tag):
    assert abs(TagClock().engine_s(tag, 50.0, WALL_S) - 50.0) <= 10.0
