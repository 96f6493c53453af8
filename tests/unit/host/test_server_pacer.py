"""Frames are due at absolute times, and packets are taken in turn."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import UsageError
from fapengine.host.hub import FramePacer
from fapengine.server.intake.ingress import FairQueue


def test_every_frame_is_due_once_and_lateness_does_not_add_up() -> None:
    pacer = FramePacer(rate_hz=60.0, start_s=100.0)
    seen = []
    for step in range(1, 3601):  # a minute, always 3 ms late
        due = pacer.due(100.0 + step / 60 + 0.003)
        assert due is not None
        seen.append(due)
    assert seen == [(1, 1), *((number, 0) for number in range(2, 3601))]
    assert pacer.next_s == pytest.approx(160.0 + 1 / 60)
    assert pacer.skipped == 1


@given(st.lists(st.floats(0, 0.5), max_size=60))
def test_shown_and_skipped_are_all_that_were_due(waits: list[float]) -> None:
    pacer, now_s, shown = FramePacer(rate_hz=30.0, start_s=0.0), 0.0, []
    for wait in waits:
        now_s += wait
        if (due := pacer.due(now_s)) is not None:
            shown.append(due[0])
            assert pacer.next_s > now_s - 1e-6
    assert shown == sorted(set(shown))
    if shown:
        assert len(shown) + pacer.skipped == shown[-1] + 1


@pytest.mark.parametrize("rate_hz", [0.5, 1001.0, float("nan")])
def test_rates_that_cannot_be(rate_hz: float) -> None:
    with pytest.raises(UsageError, match="rate_hz: got"):
        FramePacer(rate_hz, 0.0)


def test_a_flood_fills_its_own_queue() -> None:
    queue = FairQueue(packets_a_peer=10, peers=3, turn=2)
    for number in range(1000):
        assert queue.put("flood", b"%d" % number) is (number < 10)
    assert queue.put("a", b"x")
    assert queue.put("b", b"y")
    assert not queue.put("c", b"z")
    assert (queue.flooded, queue.crowded, len(queue)) == (990, 1, 12)
    assert [queue.take() for _ in range(5)] == [
        ("flood", b"0"), ("flood", b"1"), ("a", b"x"), ("b", b"y"), ("flood", b"2"),
    ]  # fmt: skip
    assert queue.put("c", b"z")  # there is room again
    assert queue.waiting("flood") == 7
    assert queue.waiting("a") == 0


@given(st.lists(st.tuples(st.sampled_from("abc"), st.binary(max_size=2)) | st.none(), max_size=80))
def test_the_packets_of_a_peer_keep_their_order(steps: list[tuple[str, bytes] | None]) -> None:
    queue, put, taken = FairQueue(), [], []
    for step in steps:
        if step is None:
            taken.append(queue.take())
        else:
            assert queue.put(*step)
            put.append(step)
    while (entry := queue.take()) is not None:
        taken.append(entry)
    assert len(queue) == 0
    for peer in "abc":
        assert [one for one in taken if one and one[0] == peer] == [one for one in put if one[0] == peer]
